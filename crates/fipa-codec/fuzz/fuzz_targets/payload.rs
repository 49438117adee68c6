#![no_main]

use fipa_codec::fuzzing::payload;

libfuzzer_sys::fuzz_target!(|data: &[u8]| payload(data));
