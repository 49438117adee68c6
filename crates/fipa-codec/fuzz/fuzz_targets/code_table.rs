#![no_main]

use fipa_codec::fuzzing::code_table;

libfuzzer_sys::fuzz_target!(|data: &[u8]| code_table(data));
