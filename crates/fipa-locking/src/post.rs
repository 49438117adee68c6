use std::collections::VecDeque;

use fipa_acl::{AgentId, Message, Performative, Text};

use crate::Output;

/// Writes messages and keeps what is to be done.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Post {
    pub(crate) name: Text,
    /// Messages so far: each takes a number, and the first of a conversation names it.
    counter: u64,
    pub(crate) outputs: VecDeque<Output>,
}

impl Post {
    pub(crate) fn new(name: Text, counter: u64) -> Post {
        Post {
            name,
            counter,
            outputs: VecDeque::new(),
        }
    }

    #[cfg(test)]
    pub(crate) fn counter(&self) -> u64 {
        self.counter
    }

    #[cfg(test)]
    pub(crate) fn set_counter(&mut self, counter: u64) {
        self.counter = counter;
    }

    /// The first message of a new conversation.
    pub(crate) fn open(&mut self, act: Performative, protocol: &'static str) -> Message {
        let conversation = format!("{}_{}", self.name, self.counter);
        self.continued(act, protocol, &conversation)
    }

    /// A message of a conversation that somebody opened.
    pub(crate) fn continued(
        &mut self,
        act: Performative,
        protocol: &'static str,
        conversation: &str,
    ) -> Message {
        self.counter = self.counter.wrapping_add(1);
        Message::new(act)
            .from_agent(self.name.clone())
            .protocol(Text::from_static(protocol))
            .conversation_id(conversation)
    }

    pub(crate) fn send(&mut self, message: Message, to: impl IntoIterator<Item = Text>) {
        let receiver: Vec<AgentId> = to.into_iter().map(AgentId::new).collect();
        if !receiver.is_empty() {
            let message = Message {
                receiver,
                ..message
            };
            self.put(Output::Send(message));
        }
    }

    pub(crate) fn put(&mut self, output: Output) {
        self.outputs.push_back(output);
    }
}
