//! What is read is right, whatever is kept of it; and nobody who sends much keeps others waiting.

mod support;

use std::io::Write;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use bytes::Bytes;
use fipa_transport::Buffers;
use proptest::prelude::*;
use tokio::sync::mpsc;

use support::{Pieces, pair, spawn};

const SOON: Duration = Duration::from_secs(20);

/// A piece that is sent, and how.
#[derive(Clone, Debug)]
struct Sent {
    octets: usize,
    /// The other side pauses after so many octets.
    pause: prop::sample::Index,
    /// The slice is kept while so many more pieces arrive.
    kept_for: usize,
}

fn sent() -> impl Strategy<Value = Sent> {
    let octets = prop_oneof![
        6 => 1_usize..2_000,
        2 => 2_000_usize..70_000,
        1 => 70_000_usize..400_000,
    ];
    (octets, any::<prop::sample::Index>(), 0_usize..30).prop_map(|(octets, pause, kept_for)| Sent {
        octets,
        pause,
        kept_for,
    })
}

/// The content of a piece, another one for each number.
fn content(number: usize, octets: usize) -> Vec<u8> {
    (0..octets)
        .map(|at| (at.wrapping_mul(31) ^ (at >> 8) ^ number.wrapping_mul(101)) as u8)
        .collect()
}

fn piece(content: &[u8]) -> Vec<u8> {
    let mut piece = (content.len() as u32).to_be_bytes().to_vec();
    piece.extend_from_slice(content);
    piece
}

/// Sends the pieces over several connections that share their buffers, and looks at each slice
/// when it is let go.
async fn arrive(connections: Vec<Vec<Sent>>) {
    let buffers = Arc::new(Buffers::default());
    let mut looked_at = tokio::task::JoinSet::new();
    for (connection, pieces) in connections.into_iter().enumerate() {
        let (stream, mut plain) = pair().await;
        let (tell, mut told) = mpsc::unbounded_channel::<Bytes>();
        spawn(
            stream,
            &buffers,
            Pieces(Mutex::new(move |piece| {
                let _ = tell.send(piece);
            })),
        );
        let writing = pieces.clone();
        let number = move |at: usize| connection * 1_000 + at;
        let writer = std::thread::spawn(move || {
            for (at, sent) in writing.iter().enumerate() {
                let octets = piece(&content(number(at), sent.octets));
                let (one, two) = octets.split_at(sent.pause.index(octets.len()));
                plain.write_all(one).unwrap();
                if at % 4 == 0 {
                    std::thread::sleep(Duration::from_micros(300));
                }
                plain.write_all(two).unwrap();
            }
            plain
        });
        looked_at.spawn(async move {
            let mut held = Vec::new();
            let look = |(at, slice): &(usize, Bytes)| {
                assert!(slice == &content(number(*at), pieces[*at].octets));
            };
            for at in 0..pieces.len() {
                let slice = tokio::time::timeout(SOON, told.recv()).await;
                held.push((at, slice.unwrap().expect("a piece")));
                held.retain(|kept| {
                    let keep = kept.0 + pieces[kept.0].kept_for > at;
                    if !keep {
                        look(kept);
                    }
                    keep
                });
            }
            held.iter().for_each(look);
            drop(writer.join());
        });
    }
    while let Some(looked) = looked_at.join_next().await {
        looked.unwrap();
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn slices_stay_as_they_were_while_buffers_are_used_again(
        connections in prop::collection::vec(prop::collection::vec(sent(), 1..60), 1..4),
        threads: bool,
    ) {
        let mut runtime = match threads {
            true => tokio::runtime::Builder::new_multi_thread(),
            false => tokio::runtime::Builder::new_current_thread(),
        };
        runtime.enable_all().build().unwrap().block_on(arrive(connections));
    }
}

#[tokio::test]
async fn who_sends_without_end_does_not_keep_others_waiting() {
    let buffers = Arc::new(Buffers::default());
    let flood = Arc::new(AtomicUsize::new(0));
    let mut flooding = Vec::new();
    for _ in 0..2 {
        let (stream, mut plain) = pair().await;
        let seen = Arc::clone(&flood);
        spawn(
            stream,
            &buffers,
            Pieces(Mutex::new(move |piece: Bytes| {
                seen.fetch_add(piece.len(), Ordering::Relaxed);
            })),
        );
        let octets = piece(&[7; 1_000]).repeat(1_000);
        flooding.push(std::thread::spawn(move || {
            while plain.write_all(&octets).is_ok() {}
        }));
    }
    let (stream, mut plain) = pair().await;
    let (tell, mut told) = mpsc::unbounded_channel();
    let seen = Arc::clone(&flood);
    spawn(
        stream,
        &buffers,
        Pieces(Mutex::new(move |_| {
            let _ = tell.send(seen.load(Ordering::Relaxed));
        })),
    );
    while flood.load(Ordering::Relaxed) == 0 {
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    for _ in 0..50 {
        // This thread runs all the connections: none has a turn before the piece is there to be
        // read. Counted is what the flood brings until it is read, not the time that takes.
        let before = flood.load(Ordering::Relaxed);
        plain.write_all(&piece(b"small")).unwrap();
        let after = tokio::time::timeout(SOON, told.recv()).await.unwrap();
        let meanwhile = after.unwrap() - before;
        assert!(meanwhile <= 1 << 20, "{meanwhile} octets came first");
    }
}
