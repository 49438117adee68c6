use std::collections::{BTreeSet, HashMap, HashSet, VecDeque};
use std::time::Duration;

use fipa_acl::Text;

/// What was asked of other DFs and not answered yet, by the tag that an answer carries.
#[derive(Debug, Default)]
pub(super) struct Questions {
    asked: HashMap<Text, Question>,
    deadlines: BTreeSet<(Duration, Text)>,
}

#[derive(Clone, Debug)]
pub(super) struct Question {
    /// Who was asked.
    pub(super) whom: Text,
    pub(super) about: About,
    pub(super) deadline: Duration,
}

#[derive(Clone, Copy, Debug)]
pub(super) enum About {
    /// A search that waits for its results.
    Search(u64),
    /// Our own registration there, or its end; the number under which somebody asked for it.
    Federation(u64),
}

impl Questions {
    pub(super) fn ask(&mut self, tag: Text, question: Question) {
        self.deadlines.insert((question.deadline, tag.clone()));
        self.asked.insert(tag, question);
    }

    pub(super) fn get(&self, tag: &str) -> Option<&Question> {
        self.asked.get(tag)
    }

    pub(super) fn take(&mut self, tag: &str) -> Option<Question> {
        let (tag, question) = self.asked.remove_entry(tag)?;
        self.deadlines.remove(&(question.deadline, tag));
        Some(question)
    }

    /// Takes away one that nobody answered in time.
    pub(super) fn expire(&mut self, now: Duration) -> Option<Question> {
        let (deadline, tag) = self.deadlines.first()?;
        if *deadline > now {
            return None;
        }
        let tag = tag.clone();
        self.take(&tag)
    }

    pub(super) fn next_deadline(&self) -> Option<Duration> {
        self.deadlines.first().map(|(deadline, _)| *deadline)
    }
}

/// The ids of searches that came by, for as long as they may come around again.
#[derive(Debug, Default)]
pub(super) struct Served {
    ids: HashSet<Text>,
    order: VecDeque<(Duration, Text)>,
}

impl Served {
    /// How long an id is remembered: longer than anybody waits for a search.
    const MEMORY: Duration = Duration::from_secs(600);
    /// Ids that are remembered at most.
    const MOST: usize = 10_000;

    /// Remembers an id; tells whether it is new.
    pub(super) fn is_new(&mut self, now: Duration, id: &Text) -> bool {
        while let Some((since, _)) = self.order.front()
            && (now >= *since + Served::MEMORY || self.order.len() >= Served::MOST)
        {
            if let Some((_, id)) = self.order.pop_front() {
                self.ids.remove(&id);
            }
        }
        let is_new = self.ids.insert(id.clone());
        if is_new {
            self.order.push_back((now, id.clone()));
        }
        is_new
    }
}
