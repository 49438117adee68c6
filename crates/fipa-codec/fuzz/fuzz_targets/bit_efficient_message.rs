#![no_main]

use fipa_codec::fuzzing::bit_efficient_message;

libfuzzer_sys::fuzz_target!(|data: &[u8]| bit_efficient_message(data));
