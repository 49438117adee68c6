//! Bit-efficient messages (SC00069G) and envelopes (SC00088D).
