//! Searches, here and at the DFs that are registered here.

use std::collections::HashSet;
use std::ops::ControlFlow;
use std::time::Duration;

use fipa_acl::{AgentId, FipaTime, Message, Performative, Text};
use fipa_directory::Now;
use fipa_sl::Term;

use super::questions::{About, Question};
use super::{Df, described, matching};
use crate::answer::{Action, Outcome, answer};
use crate::client::MORE;
use crate::objects::{CONSTRAINTS, DF_DESCRIPTION};
use crate::{DfAgentDescription, DirectoryView, Origin, Reason, SearchConstraints, client};

/// However soon an answer is wanted, clocks may differ by so much.
const SHORTEST_WAIT: Duration = Duration::from_secs(1);

/// A search that waits for other DFs.
#[derive(Debug)]
pub(super) struct Search {
    /// The request, without its content.
    request: Message,
    action: Action,
    found: Vec<DfAgentDescription>,
    names: HashSet<Text>,
    limit: usize,
    /// More were wanted than the limit allows.
    limited: bool,
    /// There are more than are told, here or at others.
    more: bool,
    /// DFs that have not answered yet.
    waiting: usize,
}

impl Search {
    /// Adds what another DF found, save for agents that are known already.
    fn add(&mut self, found: Vec<DfAgentDescription>) {
        for description in found {
            let Some(name) = description.name.as_ref().map(|agent| agent.name.clone()) else {
                continue;
            };
            if self.names.contains(&name) {
                continue;
            }
            if self.found.len() < self.limit {
                self.names.insert(name);
                self.found.push(description);
            } else {
                self.more |= self.limited;
            }
        }
    }
}

impl Df {
    pub(super) fn search(
        &mut self,
        now: Now,
        (origin, message): (Origin, &Message),
        action: Action,
        directory: &dyn DirectoryView,
    ) {
        let (template, constraints) = match asked_for(&action) {
            Ok(search) => search,
            Err(outcome) => return self.answer(message, Some(&action), outcome),
        };
        if let Some(id) = &constraints.search_id
            && !self.served.is_new(now.mono, id)
        {
            let served = Reason::InternalError(Text::from_static("search-id already served"));
            return self.answer(message, Some(&action), Outcome::Failed(served));
        }
        let (limit, limited) = self.limit(origin, &constraints);
        let (found, more) = self.find(&template, (limit, limited), directory);
        let others = self.others_to_ask(message, &constraints, limit.saturating_sub(found.len()));
        let search = Search {
            request: Message {
                content: None,
                ..message.clone()
            },
            action,
            names: names_of(&found),
            found,
            limit,
            limited,
            more,
            waiting: others.len(),
        };
        if others.is_empty() {
            return self.finish(search);
        }
        let wanted = limit.saturating_sub(search.found.len());
        self.ask_others(now, search, others, &template, constraints, wanted);
    }

    /// What matches here: what was registered, then what the directory knows beside that. Whether
    /// there is more, where more was wanted than is given.
    pub(super) fn find(
        &self,
        template: &DfAgentDescription,
        (limit, limited): (usize, bool),
        directory: &dyn DirectoryView,
    ) -> (Vec<DfAgentDescription>, bool) {
        let tried = limit.saturating_add(limited.into());
        let mut found = self.find_some(template, tried, directory);
        let more = found.len() > limit;
        found.truncate(limit);
        (found, more)
    }

    fn find_some(
        &self,
        template: &DfAgentDescription,
        limit: usize,
        directory: &dyn DirectoryView,
    ) -> Vec<DfAgentDescription> {
        let matching = self.store.search(template);
        let mut found: Vec<_> = matching.take(limit).cloned().collect();
        if let Some(wanted) = &template.name {
            let known = directory.find(&wanted.name).into_iter();
            let matching = known.filter(|agent| matching::matches_known(template, *agent));
            let matching = matching.filter(|agent| !self.store.contains(agent.name));
            found.extend(matching.map(|agent| described(agent, directory)));
            found.truncate(limit);
            return found;
        }
        directory.visit(&mut |agent| {
            if found.len() >= limit {
                return ControlFlow::Break(());
            }
            if matching::matches_known(template, agent) && !self.store.contains(agent.name) {
                found.push(described(agent, directory));
            }
            ControlFlow::Continue(())
        });
        found
    }

    /// The federated DFs that a search goes on to: none where enough was found here, and never
    /// back to where it came from.
    fn others_to_ask(
        &self,
        message: &Message,
        constraints: &SearchConstraints,
        wanted: usize,
    ) -> Vec<AgentId> {
        let is_deep_enough = constraints.max_depth.unwrap_or(0) == 0;
        if is_deep_enough || wanted == 0 || self.searches.len() >= self.config.max_searches {
            return Vec::new();
        }
        let sender = message.sender.as_ref().map(|sender| &sender.name);
        let others = self.store.facilitators().filter_map(|df| df.name.clone());
        others
            .filter(|df| df.name != self.config.name && Some(&df.name) != sender)
            .take(self.config.max_federated)
            .collect()
    }

    fn ask_others(
        &mut self,
        now: Now,
        search: Search,
        others: Vec<AgentId>,
        template: &DfAgentDescription,
        constraints: SearchConstraints,
        wanted: usize,
    ) {
        let patience = self.patience_with(now, &search.request);
        let constraints = self.constraints_beyond(now, constraints, wanted);
        let reply_by = FipaTime::from_unix_millis(now.plus(patience).unix_millis);
        self.count += 1;
        let id = self.count;
        self.searches.insert(id, search);
        for other in others {
            let tag = self.fresh();
            let question = Question {
                whom: other.name.clone(),
                about: About::Search(id),
                deadline: now.mono.saturating_add(patience),
            };
            self.questions.ask(tag.clone(), question);
            let request = client::df_search_request(&other, template, &constraints)
                .from_agent(AgentId::new(&self.config.name))
                .conversation_id(tag.clone())
                .reply_with(tag)
                .reply_by(reply_by);
            self.send(Some(request));
        }
    }

    /// What the others are asked for: one step less deep, under an id by which they and we know
    /// the search again.
    fn constraints_beyond(
        &mut self,
        now: Now,
        constraints: SearchConstraints,
        wanted: usize,
    ) -> SearchConstraints {
        let depth = constraints.max_depth.unwrap_or(0);
        let search_id = constraints.search_id.unwrap_or_else(|| {
            let id = self.fresh();
            self.served.is_new(now.mono, &id);
            id
        });
        SearchConstraints {
            max_depth: Some(if depth > 0 { depth - 1 } else { depth }),
            max_results: i64::try_from(wanted).ok(),
            search_id: Some(search_id),
        }
    }

    /// How long others are waited for: shorter than the one who asked waits for us.
    fn patience_with(&self, now: Now, request: &Message) -> Duration {
        let longest = self.config.patience;
        let Some(reply_by) = request.reply_by else {
            return longest;
        };
        let left = reply_by
            .resolve(now.unix_millis)
            .saturating_sub(now.unix_millis);
        let left = Duration::from_millis(u64::try_from(left).unwrap_or(0));
        (left / 4 * 3).max(SHORTEST_WAIT).min(longest)
    }

    /// Something came back for what was asked of another DF. Whoever carries mail may tell that it
    /// could not be delivered; results are taken from the one who was asked only.
    pub(super) fn answered(&mut self, message: &Message) {
        let tags = [&message.in_reply_to, &message.conversation_id];
        let mut tags = tags.into_iter().flatten().map(ToString::to_string);
        let Some(tag) = tags.find(|tag| self.questions.get(tag).is_some()) else {
            return;
        };
        let whom = self.questions.get(&tag).map(|question| &question.whom);
        let is_inform = message.performative == Performative::Inform;
        let sender = message.sender.as_ref().map(|sender| &sender.name);
        if is_inform && sender != whom {
            return;
        }
        let Some(question) = self.questions.take(&tag) else {
            return;
        };
        match question.about {
            About::Search(id) => {
                if let Some(search) = self.searches.get_mut(&id) {
                    search.add(client::search_result(message).unwrap_or_default());
                    search.more |= client::has_more(message);
                }
                self.one_less(id);
            }
            About::Federation(id) => self.federated(id, question.whom, message),
        }
    }

    /// A search waits for one DF less; when it waits for none, or has enough, it is answered.
    pub(super) fn one_less(&mut self, id: u64) {
        let Some(search) = self.searches.get_mut(&id) else {
            return;
        };
        search.waiting = search.waiting.saturating_sub(1);
        if (search.waiting == 0 || search.found.len() >= search.limit)
            && let Some(search) = self.searches.remove(&id)
        {
            self.finish(search);
        }
    }

    fn finish(&mut self, search: Search) {
        // Others may know more, which is no matter where enough was found.
        let more = search.more && (search.limited || search.found.len() < search.limit);
        let items = search.found.iter().map(Term::from).collect();
        let (name, outcome) = (&self.config.name, Outcome::Result(items));
        let answer = answer(name, &search.request, Some(&search.action), outcome);
        self.send(answer.map(|answer| marked(answer, more)));
    }
}

/// Tells that there is more than what is told, if there is.
pub(super) fn marked(message: Message, more: bool) -> Message {
    match more {
        true => message.user_defined(MORE, "true"),
        false => message,
    }
}

fn asked_for(action: &Action) -> Result<(DfAgentDescription, SearchConstraints), Outcome> {
    let template = action.object(0, DF_DESCRIPTION)?;
    let constraints = action.object(1, CONSTRAINTS)?;
    action.at_most(2)?;
    Ok((template, constraints))
}

fn names_of(found: &[DfAgentDescription]) -> HashSet<Text> {
    let names = found
        .iter()
        .filter_map(|description| description.name.as_ref());
    names.map(|agent| agent.name.clone()).collect()
}
