//! What a watch costs, and that it costs nothing once it is over. The only test of its process: it
//! counts what all of that does.
mod support;

use std::alloc::System;

use bytes::Bytes;
use fipa_acl::AgentId;
use fipa_codec::bit_efficient;
use fipa_link::{Frame, LetterFrame, Parts, Role};
use fipa_mts::{Machine, Registration};
use fipa_sim::Sim;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};

use support::Raw;

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Allocations for each of many letters from a program to an agent here.
fn allocations(raw: &mut Raw, letter: &Parts) -> f64 {
    const LETTERS: usize = 1000;
    let send = |raw: &mut Raw, id| {
        let parts = letter.clone();
        let ttl_millis = 1000;
        raw.say(Frame::Letter(LetterFrame {
            id,
            ttl_millis,
            parts,
        }));
        assert!(raw.mts.take_mail("b").is_some());
        raw.heard.clear();
        raw.outputs.clear();
    };
    (0..100).for_each(|id| send(raw, id));
    let region = Region::new(ALLOCATOR);
    (0..LETTERS).for_each(|id| send(raw, 1000 + id as u64));
    region.change().allocations as f64 / LETTERS as f64
}

#[test]
fn a_watch_that_is_over_costs_no_allocation() {
    let sim = Sim::new(1);
    let letter = sim.letter("a", vec![AgentId::new("b")], Bytes::from_static(b"hi"));
    let mut head = fipa_codec::Output::new();
    bit_efficient::encode_envelope(&letter.envelope, &mut head).unwrap();
    let letter: Parts = [head.take_bytes(), letter.payload].into_iter().collect();
    let mut raw = Raw::new(Role::Program);
    raw.mts.register(raw.now, 0, Registration::new("b"));
    let before = allocations(&mut raw, &letter);
    raw.mts.sniff(raw.now, true);
    let during = allocations(&mut raw, &letter);
    raw.mts.sniff(raw.now, false);
    let after = allocations(&mut raw, &letter);
    println!("allocations a letter: {before} before, {during} during, {after} after");
    assert!(during > before + 1.0, "{before}, {during}");
    assert!((after - before).abs() < 0.05, "{before}, {after}");
}
