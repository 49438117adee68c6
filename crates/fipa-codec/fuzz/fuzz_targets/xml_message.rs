#![no_main]

use fipa_codec::fuzzing::xml_message;

libfuzzer_sys::fuzz_target!(|data: &[u8]| xml_message(data));
