#![no_main]

use fipa_codec::fuzzing::roundtrip;

libfuzzer_sys::fuzz_target!(|data: &[u8]| roundtrip(data));
