use std::collections::VecDeque;

use fipa_acl::Letter;

/// The letters that wait for one agent, bounded in number and octets.
#[derive(Debug)]
pub struct Mailbox {
    letters: VecDeque<Letter>,
    octets: usize,
    max_letters: usize,
    max_octets: usize,
}

/// A mailbox does not take the letter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the agent's mailbox is full")]
pub struct MailboxFull;

impl Mailbox {
    /// An empty mailbox for so many letters and octets of payload.
    pub fn new(max_letters: usize, max_octets: usize) -> Mailbox {
        Mailbox {
            letters: VecDeque::new(),
            octets: 0,
            max_letters,
            max_octets,
        }
    }

    /// Puts a letter in. One letter always fits into an empty mailbox.
    pub fn push(&mut self, letter: Letter) -> Result<(), MailboxFull> {
        let octets = self.octets + letter.payload.len();
        let full = self.letters.len() >= self.max_letters || octets > self.max_octets;
        if full && !self.letters.is_empty() {
            return Err(MailboxFull);
        }
        self.octets = octets;
        self.letters.push_back(letter);
        Ok(())
    }

    /// All letters, the oldest first.
    pub fn into_letters(self) -> Vec<Letter> {
        self.letters.into()
    }

    /// Takes the oldest letter out.
    pub fn pop(&mut self) -> Option<Letter> {
        let letter = self.letters.pop_front()?;
        self.octets -= letter.payload.len();
        Some(letter)
    }
}
