#![no_main]

use fipa_codec::fuzzing::xml_letter;

libfuzzer_sys::fuzz_target!(|data: &[u8]| xml_letter(data));
