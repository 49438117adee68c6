#![no_main]

use fipa_codec::fuzzing::string_message;

libfuzzer_sys::fuzz_target!(|data: &[u8]| string_message(data));
