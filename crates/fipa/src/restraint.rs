//! How much is told about whom. Whoever reaches a platform can give it cause for a notice as often
//! as it likes; neither the log nor who listens is to drown in them.

use std::collections::HashMap;
use std::time::Duration;

use fipa_acl::Text;
use fipa_mts::Notice;

/// How long notices are counted together.
const WINDOW: Duration = Duration::from_secs(60);

/// Notices about one source in that time, at most.
const OF_ONE: u64 = 10;

/// Notices about all strangers together, and about all peers: of those there may be a thousand, who
/// all come and go.
const OF_STRANGERS: u64 = 100;
const OF_PEERS: u64 = 3000;

/// Counts notices. Those that are too many are left out, and how many these were is told when the
/// time is over.
#[derive(Debug, Default)]
pub(crate) struct Restraint {
    ends: Duration,
    strangers: Tally,
    peers: Tally,
}

/// The notices of one kind.
#[derive(Debug, Default)]
struct Tally {
    told: u64,
    /// By source. Only those have a place that were told of, so that there are few.
    sources: HashMap<Text, Source>,
    /// Left out, about sources without a place, and about all.
    others: u64,
    left_out: u64,
}

#[derive(Debug, Default)]
struct Source {
    told: u64,
    left_out: u64,
}

impl Restraint {
    /// Whether a notice is told.
    pub(crate) fn allows(&mut self, now: Duration, notice: &Notice) -> bool {
        if now >= self.ends && self.due().is_none() {
            *self = Restraint {
                ends: now + WINDOW,
                ..Restraint::default()
            };
        }
        match notice {
            Notice::LinkFailed { with: who, .. }
            | Notice::Refused { who, .. }
            | Notice::LetterLost { from: who, .. }
            | Notice::Conflict { other: who, .. } => {
                self.strangers.allows(without_port(who), OF_STRANGERS)
            }
            Notice::PeerUp { name, .. }
            | Notice::PeerSuspect { name, .. }
            | Notice::PeerGone { name, .. } => self.peers.allows(name, OF_PEERS),
            _ => true,
        }
    }

    /// When [`left_out`](Self::left_out) has something to tell.
    pub(crate) fn due(&self) -> Option<Duration> {
        let left_out = self.strangers.left_out + self.peers.left_out;
        (left_out > 0).then_some(self.ends)
    }

    /// How much was left out, once the time is over.
    pub(crate) fn left_out(&mut self, now: Duration) -> Vec<Notice> {
        match self.due().is_some_and(|due| now >= due) {
            true => self.left_out_so_far(),
            false => Vec::new(),
        }
    }

    /// How much was left out, before the time is over: all is counted anew.
    pub(crate) fn left_out_so_far(&mut self) -> Vec<Notice> {
        let all = std::mem::take(self);
        let tallies = [all.strangers, all.peers].into_iter();
        tallies.flat_map(Tally::into_notices).collect()
    }
}

impl Tally {
    fn allows(&mut self, who: &str, most: u64) -> bool {
        let full = self.told >= most;
        let source = match self.sources.get_mut(who) {
            Some(source) => source,
            None if full => {
                self.others += 1;
                self.left_out += 1;
                return false;
            }
            None => self.sources.entry(Text::from(who)).or_default(),
        };
        let allowed = !full && source.told < OF_ONE;
        if allowed {
            source.told += 1;
            self.told += 1;
        } else {
            source.left_out += 1;
            self.left_out += 1;
        }
        allowed
    }

    fn into_notices(self) -> impl Iterator<Item = Notice> {
        let others = (Text::from_static("others"), self.others);
        let sources = self.sources.into_iter();
        let counts = sources.map(|(who, source)| (who, source.left_out));
        let counts = counts.chain([others]).filter(|(_, count)| *count > 0);
        counts.map(|(who, count)| Notice::LeftOut { who, count })
    }
}

/// Where a stranger is, without the port, which changes each time.
fn without_port(who: &str) -> &str {
    match who.rsplit_once(':') {
        Some((host, port)) if port.parse::<u16>().is_ok() => host,
        _ => who,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const START: Duration = Duration::from_secs(1000);

    fn refused(who: &str) -> Notice {
        Notice::Refused {
            who: Text::from(who),
            reason: Text::from("it has no key"),
        }
    }

    fn counts(notices: Vec<Notice>) -> Vec<(String, u64)> {
        let count = |notice| match notice {
            Notice::LeftOut { who, count } => (who.to_string(), count),
            other => panic!("{other}"),
        };
        let mut counts: Vec<_> = notices.into_iter().map(count).collect();
        counts.sort();
        counts
    }

    #[test]
    fn who_gives_cause_again_and_again_is_told_of_ten_times_a_minute_and_then_counted() {
        let mut restraint = Restraint::default();
        for minute in 0..3 {
            let now = START + WINDOW * minute;
            let told = (0..1000).filter(|port| {
                let who = format!("tcp://10.0.0.1:{port}");
                restraint.allows(now, &refused(&who))
            });
            assert_eq!(told.count(), 10);
            assert!(restraint.allows(now, &refused("tcp://[fe80::1]:5")));
            let due = restraint.due().unwrap();
            assert_eq!(due, now + WINDOW);
            assert!(restraint.left_out(now).is_empty());
            let left_out = counts(restraint.left_out(due));
            assert_eq!(left_out, [("tcp://10.0.0.1".to_owned(), 990)]);
            assert_eq!(restraint.due(), None);
        }
    }

    #[test]
    fn many_strangers_together_are_told_of_a_hundred_times_and_remembered_as_often() {
        let mut restraint = Restraint::default();
        let told = (0..100_000).filter(|n| {
            let who = format!("stranger{n}");
            restraint.allows(START, &refused(&who))
        });
        assert_eq!(told.count(), 100);
        assert_eq!(restraint.strangers.sources.len(), 100);
        let left_out = counts(restraint.left_out(START + WINDOW));
        assert_eq!(left_out, [("others".to_owned(), 99_900)]);
    }

    #[test]
    fn peers_are_told_of_whatever_strangers_do_and_what_they_cannot_cause_always() {
        let mut restraint = Restraint::default();
        let strangers = (0..1000).filter(|n| restraint.allows(START, &refused(&n.to_string())));
        assert_eq!(strangers.count(), 100);
        let up = |name: String| Notice::PeerUp {
            name: Text::from(name),
            via: Text::from("tcp://10.0.0.1:4100"),
        };
        assert!((0..1000).all(|n| restraint.allows(START, &up(format!("robot{n}")))));
        let flapping = (0..50).filter(|_| restraint.allows(START, &up("robot7".to_owned())));
        assert_eq!(flapping.count(), 9);
        assert!((0..1000).all(|_| restraint.allows(START, &Notice::DaemonUp)));
    }

    #[test]
    fn a_quiet_minute_later_all_is_told_again() {
        let mut restraint = Restraint::default();
        assert!((0..10).all(|_| restraint.allows(START, &refused("a"))));
        assert_eq!(restraint.due(), None);
        assert!(restraint.allows(START + WINDOW, &refused("a")));
        assert!(restraint.left_out(START + WINDOW * 9).is_empty());
    }
}
