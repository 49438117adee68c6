//! Agents of two programs that are attached to one daemon, through the library.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;
use fipa::prelude::*;
use fipa_benches::daemons::Daemon;

use super::{Peer, Work};
use crate::end::{End, Tally};

/// Letters whose outcomes are not known yet, as many as one agent may have.
const UNDER_WAY: usize = 1024;

/// Messages from agent to agent. Each comes with the outcome `delivered` from the other end.
pub(crate) struct Agents {
    tally: Tally,
    source: Arc<Agent>,
    _platforms: [Platform; 2],
    // Dropped after what runs there.
    here: End,
    _there: End,
    daemon: Daemon,
    _folder: tempfile::TempDir,
}

impl Agents {
    pub(crate) fn start() -> Agents {
        let folder = tempfile::tempdir().expect("a folder");
        let daemon = Daemon::start(folder.path(), "middle", &[]);
        let (here, there) = (End::new(), End::new());
        let tally = Tally::default();
        let other = there.run(attach(daemon.control().to_owned(), tally.clone()));
        let control = daemon.control().to_owned();
        let (platform, source) = here.run(async move {
            let platform = Platform::attach_to(control).await.expect("the daemon");
            let source = platform.agent("source@bench").await.expect("an agent");
            for name in ["sink@bench", "echo@bench"] {
                platform.wait_for(name).await.expect("found");
            }
            (platform, source)
        });
        Agents {
            tally,
            source: Arc::new(source),
            _platforms: [platform, other],
            here,
            _there: there,
            daemon,
            _folder: folder,
        }
    }
}

/// The other end: an agent that counts what comes, and one that sends it back.
async fn attach(control: PathBuf, tally: Tally) -> Platform {
    let platform = Platform::attach_to(control).await.expect("the daemon");
    let sink = platform.agent("sink@bench").await.expect("an agent");
    let echo = platform.agent("echo@bench").await.expect("an agent");
    tokio::spawn(async move {
        while let Ok(message) = sink.receive().await {
            tally.add(message.content.map_or(0, |content| content.len()));
        }
    });
    tokio::spawn(async move {
        while let Ok(query) = echo.receive().await {
            let mut answer = query.reply(Performative::Inform);
            answer.content = query.content;
            drop(echo.try_send(answer).expect("room"));
        }
    });
    platform
}

impl Peer for Agents {
    fn name(&self) -> String {
        "fipad, agents".to_owned()
    }

    fn middle(&self) -> u32 {
        self.daemon.process()
    }

    fn one_way(&mut self, work: Work) {
        let all = self.tally.seen().0 + work.letters;
        let (source, tally) = (Arc::clone(&self.source), self.tally.clone());
        self.here.run(async move {
            let content = Bytes::from(vec![b'x'; work.octets]);
            let most = UNDER_WAY.min(work.window);
            let mut under_way = VecDeque::with_capacity(most);
            for _ in 0..work.letters {
                if under_way.len() == most {
                    under_way.pop_front().map(delivered).expect("full").await;
                }
                let letter = message("sink@bench", content.clone());
                under_way.push_back(source.try_send(letter).expect("room"));
            }
            for sending in under_way {
                delivered(sending).await;
            }
            tally.reached(all).await;
        });
    }

    fn round_trips(&mut self, octets: usize, count: usize) -> Vec<Duration> {
        let source = Arc::clone(&self.source);
        self.here.run(async move {
            let content = Bytes::from(vec![b'x'; octets]);
            let mut times = Vec::with_capacity(count);
            for _ in 0..count {
                let start = Instant::now();
                let letter = message("echo@bench", content.clone());
                let sending = source.try_send(letter).expect("room");
                let answer = source.receive().await.expect("an answer");
                times.push(start.elapsed());
                assert_eq!(answer.content, Some(content.clone()));
                delivered(sending).await;
            }
            times
        })
    }
}

fn message(to: &'static str, content: Bytes) -> Message {
    Message::new(Performative::Inform).to(to).content(content)
}

async fn delivered(sending: fipa::Sending) {
    let outcomes = sending.await;
    assert!(outcomes.iter().all(|o| o.outcome == Outcome::Delivered));
}
