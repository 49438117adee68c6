use std::time::Duration;

use fipa_acl::{AgentId, Message, Performative, Text};
use fipa_link::ReceiverOutcome;
use tokio::task::{JoinError, JoinSet};
use tokio::time::Instant;

use super::ConversationError;
use super::exchange::{Exchange, failure_of};
use super::routes::Heard;
use crate::Agent;

/// What was decided in a contract net; the contractors are at work. Dropping it cancels what they
/// have not done.
pub struct Contracts<'a> {
    exchange: Exchange<'a>,
    accepted: Vec<Message>,
    rejected: Vec<Message>,
    without_proposal: Vec<(Text, ConversationError)>,
    sendings: JoinSet<(Text, Vec<ReceiverOutcome>)>,
}

/// The proposals that have come so far.
struct Call<'a> {
    exchange: Exchange<'a>,
    /// Those that may still answer.
    awaited: Vec<Text>,
    proposals: Vec<Message>,
    without: Vec<(Text, ConversationError)>,
}

impl Agent {
    /// Calls for proposals, and accepts those that `choose` picks (fipa-contract-net, SC00029H).
    ///
    /// The call (a `cfp`) goes to all bidders. When each has answered, or at the deadline, `choose`
    /// is given the proposals of those that are still there, and says by their places which are
    /// accepted: none, one or several. The others are rejected. Then
    /// [`Contracts::results`] waits for what the contractors have to report.
    ///
    /// A missing conversation-id, reply-with, reply-by and protocol are filled in. When the future
    /// is dropped, all bidders are sent a `cancel`.
    ///
    /// # Errors
    /// The platform has ended. A bidder that makes no proposal is no error: see
    /// [`Contracts::without_proposal`].
    pub async fn contract_net(
        &self,
        mut call: Message,
        bidders: impl IntoIterator<Item = impl Into<AgentId>>,
        deadline: Duration,
        choose: impl FnOnce(&[Message]) -> Vec<usize>,
    ) -> Result<Contracts<'_>, ConversationError> {
        call.receiver = bidders.into_iter().map(Into::into).collect();
        let exchange = Exchange::new(self, call, "fipa-contract-net", deadline);
        let awaited = exchange.opening.receiver.iter();
        let call = Call {
            awaited: awaited.map(|bidder| bidder.name.clone()).collect(),
            exchange,
            proposals: Vec::new(),
            without: Vec::new(),
        };
        let call = call.collect(deadline).await?;
        let chosen = choose(&call.proposals);
        Ok(call.decide(&chosen, deadline))
    }
}

impl<'a> Call<'a> {
    /// Waits until every bidder has answered, and until the deadline at most.
    async fn collect(mut self, deadline: Duration) -> Result<Call<'a>, ConversationError> {
        let until = Instant::now() + deadline;
        let voice = self.exchange.voice();
        // One bidder that cannot be reached holds up the outcome, not the answers of the others.
        let sending = voice.send(self.exchange.opening.clone(), deadline);
        tokio::pin!(sending);
        let mut is_sent = false;
        while !self.awaited.is_empty() {
            tokio::select! {
                outcomes = &mut sending, if !is_sent => {
                    is_sent = true;
                    self.take_outcomes(&outcomes);
                }
                heard = self.exchange.hear(Some(until)) => match heard? {
                    Some(heard) => self.take(heard),
                    None => break,
                },
            }
        }
        // Whoever went while the last ones answered is not chosen.
        while let Some(heard) = self.exchange.heard_already() {
            self.take(heard);
        }
        for late in std::mem::take(&mut self.awaited) {
            self.exchange.settled(&late);
            let late = (late, ConversationError::NoAnswer(deadline));
            self.without.push(late);
        }
        Ok(self)
    }

    fn take(&mut self, heard: Heard) {
        match heard {
            Heard::Said(message) => self.take_answer(*message),
            Heard::Gone(name) => {
                let lost = ConversationError::PeerLost(name.clone());
                self.drop_out(&name, lost);
            }
        }
    }

    fn take_outcomes(&mut self, outcomes: &[ReceiverOutcome]) {
        for outcome in outcomes {
            if let Some(error) = ConversationError::undelivered(std::slice::from_ref(outcome))
                && self.awaited.contains(&outcome.to)
            {
                self.drop_out(&outcome.to, error);
            }
        }
    }

    fn take_answer(&mut self, message: Message) {
        let Some(sender) = message.sender.as_ref().map(|sender| sender.name.clone()) else {
            return;
        };
        if !self.awaited.contains(&sender) {
            return;
        }
        if let Some(end) = failure_of(&message) {
            self.drop_out(&sender, end(Box::new(message)));
        } else if message.performative == Performative::Propose {
            self.awaited.retain(|bidder| *bidder != sender);
            self.proposals.push(message);
        }
    }

    /// A bidder that makes no proposal, or is gone with the one that it has made.
    fn drop_out(&mut self, name: &Text, why: ConversationError) {
        self.awaited.retain(|bidder| bidder != name);
        self.proposals.retain(|proposal| !is_from(proposal, name));
        self.exchange.settled(name);
        if !self.without.iter().any(|(known, _)| known == name) {
            self.without.push((name.clone(), why));
        }
    }

    fn decide(self, chosen: &[usize], deadline: Duration) -> Contracts<'a> {
        let mut contracts = Contracts {
            accepted: Vec::new(),
            rejected: Vec::new(),
            without_proposal: self.without,
            sendings: JoinSet::new(),
            exchange: self.exchange,
        };
        let voice = contracts.exchange.voice();
        for (place, proposal) in self.proposals.into_iter().enumerate() {
            if !chosen.contains(&place) {
                voice.post(proposal.reply(Performative::RejectProposal));
                contracts.exchange.settled(&sender_of(&proposal));
                contracts.rejected.push(proposal);
                continue;
            }
            let mut acceptance = proposal.reply(Performative::AcceptProposal);
            acceptance.reply_with = Some(contracts.exchange.agent.tag());
            let (voice, name) = (voice.clone(), sender_of(&proposal));
            contracts
                .sendings
                .spawn(async move { (name, voice.send(acceptance, deadline).await) });
            contracts.accepted.push(proposal);
        }
        contracts
    }
}

impl Contracts<'_> {
    /// The proposals that were accepted, in the order in which they came.
    pub fn accepted(&self) -> &[Message] {
        &self.accepted
    }

    /// The proposals that were rejected, in the order in which they came.
    pub fn rejected(&self) -> &[Message] {
        &self.rejected
    }

    /// The bidders that made no proposal, and why: they refused, were not reached, are gone, or did
    /// not answer in time.
    pub fn without_proposal(&self) -> &[(Text, ConversationError)] {
        &self.without_proposal
    }

    /// Waits for the results of the contractors, for so long at most: the `inform` of each, or why
    /// there is none. Who has not reported by then is sent a `cancel`.
    pub async fn results(
        mut self,
        timeout: Duration,
    ) -> Vec<(Text, Result<Message, ConversationError>)> {
        let until = Instant::now() + timeout;
        let mut awaited: Vec<Text> = self.accepted.iter().map(sender_of).collect();
        let mut results = Vec::new();
        while !awaited.is_empty() {
            let (name, result) = tokio::select! {
                Some(sent) = self.sendings.join_next() => match unsent(sent) {
                    Some(failed) => failed,
                    None => continue,
                },
                heard = self.exchange.hear(Some(until)) => match heard {
                    Ok(Some(Heard::Said(message))) => match report(*message) {
                        Some(report) => report,
                        None => continue,
                    },
                    Ok(Some(Heard::Gone(name))) => {
                        (name.clone(), Err(ConversationError::PeerLost(name)))
                    }
                    Ok(None) | Err(_) => break,
                },
            };
            if awaited.contains(&name) {
                awaited.retain(|contractor| *contractor != name);
                self.exchange.settled(&name);
                results.push((name, result));
            }
        }
        let has_ended = self.exchange.agent.has_ended();
        let silence = || match has_ended {
            true => ConversationError::Ended,
            false => ConversationError::NoAnswer(timeout),
        };
        results.extend(awaited.into_iter().map(|name| (name, Err(silence()))));
        results
    }
}

/// The contractor whom the acceptance did not reach.
fn unsent(
    sent: Result<(Text, Vec<ReceiverOutcome>), JoinError>,
) -> Option<(Text, Result<Message, ConversationError>)> {
    let (name, outcomes) = sent.ok()?;
    Some((name, Err(ConversationError::undelivered(&outcomes)?)))
}

/// What a contractor says at the end.
fn report(message: Message) -> Option<(Text, Result<Message, ConversationError>)> {
    let name = sender_of(&message);
    if let Some(end) = failure_of(&message) {
        return Some((name, Err(end(Box::new(message)))));
    }
    (message.performative == Performative::Inform).then_some((name, Ok(message)))
}

fn sender_of(message: &Message) -> Text {
    let sender = message.sender.as_ref();
    sender.map_or_else(Text::default, |sender| sender.name.clone())
}

fn is_from(message: &Message, name: &Text) -> bool {
    message.sender.as_ref().is_some_and(|s| s.name == *name)
}
