use std::time::Duration;

use bytes::{Buf, Bytes, BytesMut};
use fipa_acl::Text;
use fipa_directory::Now;

use crate::check::{Check, Head};
use crate::incoming::Incoming;
use crate::lanes::{Lanes, Reading};
use crate::outgoing::Outgoing;
use crate::run::Run;
use crate::{
    Frame, FrameError, Hello, LANES, LetterFrame, PREAMBLE, ReceiverOutcome, Role, WrittenOutcomes,
};

/// Octets of a frame beside the letter in it, at most.
const FRAME_OVERHEAD: usize = 64 << 10;

/// Octets of a frame that holds no letter, at most.
const MAX_CONTROL_FRAME: usize = 4 << 20;

/// What a link is made with.
#[derive(Clone, Debug)]
pub struct LinkConfig {
    /// Who we are.
    pub hello: Hello,
    /// How long the partner may take for its preamble and hello.
    pub hello_timeout: Duration,
    /// The pause between heartbeats while letters flow.
    pub heartbeat_busy: Duration,
    /// The pause between heartbeats while none flowed for a minute.
    pub heartbeat_idle: Duration,
    /// Whether the connection has streams beside the main one, for letters.
    pub lanes: bool,
}

impl LinkConfig {
    /// The usual times: 5 s for the hello, a heartbeat each 2 s, or each 10 s when idle.
    pub fn new(hello: Hello) -> LinkConfig {
        LinkConfig {
            hello,
            hello_timeout: Duration::from_secs(5),
            heartbeat_busy: Duration::from_secs(2),
            heartbeat_idle: Duration::from_secs(10),
            lanes: false,
        }
    }
}

/// One end of a link: octets in and frames out, frames in and octets out.
///
/// It greets, keeps the heartbeat, and tells when the partner falls silent. What the frames mean
/// is for its owner.
#[derive(Debug)]
pub struct Link {
    config: LinkConfig,
    stage: Stage,
    out: Outgoing,
    reading: Reading,
    lanes: Option<Box<Lanes>>,
    last_heard: Duration,
    last_sent: Duration,
    /// The last heartbeat of ours; before the link is open, when it was made.
    last_ping: Duration,
    last_letter: Option<Duration>,
    misses: u32,
    silent: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Preamble,
    Hello,
    Open,
}

/// What a link has to tell.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// The partner has said who it is: the link is open.
    Opened(Hello),
    /// A frame other than hello and heartbeat.
    Frame(Frame),
    /// Three heartbeats in a row were missed.
    Silent,
    /// The partner is heard again after it was silent.
    Heard,
}

/// A link that cannot go on.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LinkError {
    /// The first octets are not those of a link.
    #[error("the other side does not speak the fipa stream link")]
    Preamble,
    /// The framing is of another version.
    #[error("the other side speaks version {0} of the stream link, this is version 1")]
    Version(u8),
    /// The partner did not say hello in time.
    #[error("the other side accepted the connection and said nothing")]
    NoHello,
    /// A frame is larger than agreed.
    #[error("a frame of {0} octets is larger than allowed")]
    TooLarge(usize),
    /// A checksum does not fit.
    #[error("what came was changed on its way: a checksum does not fit")]
    Corrupt,
    /// A frame cannot be read.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// Another frame came where the hello belongs, or a second hello.
    #[error("a frame came out of order")]
    Order,
    /// Six heartbeats in a row were missed.
    #[error("the other side has fallen silent")]
    Dead,
}

impl Link {
    /// A link over a stream that was just connected; preamble and hello wait to be written.
    pub fn new(config: LinkConfig, now: Now) -> Link {
        let mut link = Link::silent(config, now);
        link.send(now, Frame::Hello(link.config.hello.clone()));
        // They are said; there may be thousands of links.
        link.config.hello.endpoints = Vec::new();
        link
    }

    /// The end of a link that is not wanted: preamble and goodbye wait to be written, and nothing of
    /// the hello.
    pub fn refusal(config: LinkConfig, now: Now, reason: impl Into<Text>) -> Link {
        let mut link = Link::silent(config, now);
        link.goodbye(now, reason);
        link
    }

    fn silent(config: LinkConfig, now: Now) -> Link {
        let mut link = Link {
            stage: Stage::Preamble,
            out: Outgoing::default(),
            reading: Reading::default(),
            lanes: config.lanes.then(Box::default),
            last_heard: now.mono,
            last_sent: now.mono,
            last_ping: now.mono,
            last_letter: None,
            misses: 0,
            silent: false,
            config,
        };
        link.out.push_octets(&PREAMBLE);
        link
    }

    /// Takes the first whole frame from `received`; what is left there is the beginning of the
    /// next. `None`: more octets are needed. To be called again until it says so.
    pub fn receive(
        &mut self,
        now: Now,
        received: &mut BytesMut,
    ) -> Result<Option<Event>, LinkError> {
        if self.hears(now, received) {
            return Ok(Some(Event::Heard));
        }
        if self.stage == Stage::Preamble && !take_preamble(received)? {
            return Ok(None);
        }
        if self.stage == Stage::Preamble {
            self.stage = Stage::Hello;
        }
        self.take_frames(now, None, received)
    }

    /// The same for what came on a lane. While [`is_held`](Self::is_held), what is left there is
    /// taken when more has come on the main stream.
    pub fn receive_on(
        &mut self,
        now: Now,
        lane: usize,
        received: &mut BytesMut,
    ) -> Result<Option<Event>, LinkError> {
        if self.hears(now, received) {
            return Ok(Some(Event::Heard));
        }
        self.take_frames(now, Some(lane), received)
    }

    /// Whether what comes on a lane waits for what comes on the main stream.
    pub fn is_held(&self, lane: usize) -> bool {
        self.waits(Some(lane))
    }

    /// Takes the whole frames of letters and receipts at the beginning of what was received, if
    /// there are any: all else, and all that comes over a link with lanes, is for
    /// [`receive`](Self::receive).
    pub fn receive_run(&mut self, now: Now, received: &mut BytesMut) -> Option<Run> {
        let at_rest = self.stage == Stage::Open && self.reading.incoming.is_none();
        if !at_rest || self.silent || self.lanes.is_some() {
            return None;
        }
        let mut octets = 0;
        let mut has_letters = false;
        while let Some(rest) = received.get(octets..)
            && let Ok(Some(head)) = Head::read(rest)
            && let Some(frame) = self.frame_in_run(&head)
            && frame <= rest.len()
        {
            has_letters |= head.kind == Frame::LETTER;
            octets += frame;
        }
        if octets == 0 {
            return None;
        }
        self.last_heard = now.mono;
        self.misses = 0;
        if has_letters {
            self.last_letter = Some(now.mono);
        }
        Some(Run::new(received.split_to(octets).freeze()))
    }

    /// Octets of a frame, if it is a letter or receipt as it should be.
    fn frame_in_run(&self, head: &Head) -> Option<usize> {
        let limit = match head.kind {
            Frame::LETTER => self.letter_limit(),
            Frame::RECEIPT => MAX_CONTROL_FRAME,
            _ => return None,
        };
        let allowed = head.length <= limit && (head.sum.is_some() || !self.out.checked);
        head.frame().filter(|_| allowed)
    }

    /// Queues a frame.
    pub fn send(&mut self, now: Now, frame: Frame) {
        if matches!(frame, Frame::Letter(_)) {
            self.last_letter = Some(now.mono);
        }
        self.last_sent = now.mono;
        if let Some(lanes) = &mut self.lanes
            && let Some(before) = lanes.sends_on_main(&frame)
        {
            self.out.push(before);
        }
        self.out.push(frame);
    }

    fn send_heartbeat(&mut self, now: Now, frame: Frame) {
        self.last_sent = now.mono;
        self.out.push_heartbeat(frame);
    }

    /// Queues a letter, on this lane if the link has any.
    pub fn send_letter(&mut self, now: Now, lane: usize, letter: LetterFrame) {
        let Some(lanes) = self.lanes.as_mut().filter(|_| lane < LANES) else {
            return self.send(now, Frame::Letter(letter));
        };
        (self.last_letter, self.last_sent) = (Some(now.mono), now.mono);
        let before = lanes.sends_letter(lane);
        if let Some(out) = lanes.out.get_mut(lane) {
            out.checked = self.out.checked;
            before.into_iter().for_each(|frame| out.push(frame));
            out.push_packed(letter);
        }
    }

    /// Queues a [`Frame::Receipt`].
    pub fn send_receipt(&mut self, now: Now, id: u64, outcomes: &[ReceiverOutcome]) {
        self.last_sent = now.mono;
        self.out.push_receipt(id, outcomes);
    }

    /// Queues a [`Frame::Receipt`] whose outcomes are written already.
    pub fn send_written_receipt(&mut self, now: Now, id: u64, outcomes: &WrittenOutcomes) {
        self.last_sent = now.mono;
        self.out.push_written_receipt(id, &outcomes.0);
    }

    /// Queues a [`Frame::Letter`] on a link without lanes: its number and milliseconds, and something
    /// in front of the letter.
    pub fn pass_letter(&mut self, now: Now, head: (u64, u32), front: &[u8], letter: &Bytes) {
        self.last_letter = Some(now.mono);
        self.last_sent = now.mono;
        self.out.push_letter(head, front, letter);
    }

    /// The next octets to write.
    pub fn poll_transmit(&mut self) -> Option<Bytes> {
        self.out.pop()
    }

    /// The next octets to write on a lane.
    pub fn poll_transmit_on(&mut self, lane: usize) -> Option<Bytes> {
        self.lanes.as_mut()?.out.get_mut(lane)?.pop()
    }

    /// Whether letters of each urgency go on a stream of their own.
    pub fn has_lanes(&self) -> bool {
        self.lanes.is_some()
    }

    /// Octets that wait to be written.
    pub fn queued(&self) -> usize {
        let lanes = self.lanes.iter().flat_map(|lanes| &lanes.out);
        self.out.octets() + lanes.map(Outgoing::octets).sum::<usize>()
    }

    /// Octets that wait before a letter that would be sent on this lane.
    pub fn queued_on(&self, lane: usize) -> usize {
        let lanes = self.lanes.as_ref();
        let out = lanes.and_then(|lanes| lanes.out.get(lane));
        out.unwrap_or(&self.out).octets()
    }

    /// When the partner was heard last, on the clock of [`Now::mono`].
    pub fn last_heard(&self) -> Duration {
        self.last_heard
    }

    /// When [`handle_timeout`](Self::handle_timeout) wants to be called, on the clock of
    /// [`Now::mono`].
    pub fn poll_timeout(&self) -> Duration {
        match self.stage {
            // A partner that is busy with sending a large letter must hear of us meanwhile.
            Stage::Open => self.miss_at().min(self.last_sent + self.heartbeat()),
            _ => self.last_ping + self.config.hello_timeout,
        }
    }

    /// Sends the heartbeat that is due. An event when the partner has just become silent, an error
    /// when it is to be given up.
    pub fn handle_timeout(&mut self, now: Now) -> Result<Option<Event>, LinkError> {
        if now.mono < self.poll_timeout() {
            return Ok(None);
        }
        if self.stage != Stage::Open {
            return Err(LinkError::NoHello);
        }
        if now.mono >= self.miss_at() && self.last_ping > self.last_heard {
            self.misses += 1;
        }
        if self.misses >= 6 {
            return Err(LinkError::Dead);
        }
        self.last_ping = now.mono;
        self.send_heartbeat(now, Frame::Ping(now.mono.as_millis() as u64));
        if self.misses >= 3 && !self.silent {
            self.silent = true;
            return Ok(Some(Event::Silent));
        }
        Ok(None)
    }

    /// Queues a goodbye; the owner closes the stream once everything is written.
    pub fn goodbye(&mut self, now: Now, reason: impl Into<Text>) {
        self.send(now, Frame::Goodbye(reason.into()));
    }

    /// When the heartbeat that was sent last counts as missed, unless something is heard.
    fn miss_at(&self) -> Duration {
        self.last_heard.max(self.last_ping) + self.heartbeat()
    }

    fn heartbeat(&self) -> Duration {
        let busy = self
            .last_letter
            .is_some_and(|at| self.last_heard < at + Duration::from_secs(60));
        if busy {
            self.config.heartbeat_busy
        } else {
            self.config.heartbeat_idle
        }
    }

    /// Octets of the largest frame of a letter.
    fn letter_limit(&self) -> usize {
        usize::try_from(self.config.hello.max_letter)
            .unwrap_or(usize::MAX)
            .saturating_add(FRAME_OVERHEAD)
    }

    /// Notes that something has come; whether the partner was silent before.
    fn hears(&mut self, now: Now, received: &BytesMut) -> bool {
        if received.is_empty() {
            return false;
        }
        self.last_heard = now.mono;
        self.misses = 0;
        std::mem::take(&mut self.silent)
    }

    fn take_frames(
        &mut self,
        now: Now,
        lane: Option<usize>,
        received: &mut BytesMut,
    ) -> Result<Option<Event>, LinkError> {
        while !self.waits(lane)
            && let Some(frame) = self.take_frame(now, lane, received)?
        {
            if let Some(lanes) = &mut self.lanes {
                lanes.heard(lane, &frame);
            }
            if let Some(event) = self.accept(now, lane, frame)? {
                return Ok(Some(event));
            }
        }
        Ok(None)
    }

    /// Whether a stream waits for another.
    fn waits(&self, lane: Option<usize>) -> bool {
        let Some(lanes) = &self.lanes else {
            return false;
        };
        let reading = match lane {
            Some(lane) => lanes.reading.get(lane),
            None => Some(&self.reading),
        };
        reading.is_none_or(|reading| lanes.is_held(lane, reading))
    }

    fn reading(&mut self, lane: Option<usize>) -> &mut Reading {
        let lanes = self.lanes.as_mut();
        let own = lane.and_then(|lane| lanes?.reading.get_mut(lane));
        own.unwrap_or(&mut self.reading)
    }

    fn take_frame(
        &mut self,
        now: Now,
        lane: Option<usize>,
        received: &mut BytesMut,
    ) -> Result<Option<Frame>, LinkError> {
        let reading = self.reading(lane);
        if let Some(incoming) = &mut reading.incoming {
            let whole = match incoming.take(received) {
                true => reading.incoming.take(),
                false => None,
            };
            self.last_letter = Some(now.mono);
            return whole.map(Incoming::finish).transpose();
        }
        let Some(head) = Head::read(received)? else {
            return Ok(None);
        };
        let (kind, length) = (head.kind, head.length);
        // Whatever came before the goodbye, that is the end.
        if self.out.checked && head.sum.is_none() && kind != Frame::GOODBYE {
            return Err(LinkError::Corrupt);
        }
        let limit = match kind {
            Frame::LETTER => self.letter_limit(),
            // Only a program watches, and is told of letters.
            Frame::SNIFFED if self.config.hello.role == Role::Program => self.letter_limit(),
            _ => MAX_CONTROL_FRAME,
        };
        let Some(octets) = head.frame().filter(|_| length <= limit) else {
            return Err(LinkError::TooLarge(length));
        };
        if received.len() < octets {
            // Its sender keeps the heartbeat of letters; so do we while it is on its way.
            if kind == Frame::LETTER && self.stage == Stage::Open {
                self.last_letter = Some(now.mono);
                self.reading(lane).incoming = Incoming::begin(&head, octets, received);
            }
            return Ok(None);
        }
        received.advance(head.size);
        let body = received.split_to(octets - head.size).freeze();
        let mut check = Check::new(head.sum);
        check.add(&body);
        check.finish()?;
        Ok(Some(Frame::decode(kind, body)?))
    }

    fn accept(
        &mut self,
        now: Now,
        lane: Option<usize>,
        frame: Frame,
    ) -> Result<Option<Event>, LinkError> {
        if lane.is_some() && !matches!(frame, Frame::Letter(_) | Frame::After(_)) {
            return Err(LinkError::Order);
        }
        match (self.stage, frame) {
            (_, Frame::After(count)) if lane.is_some() || self.stage == Stage::Open => {
                self.reading(lane).wait_for(count);
                Ok(None)
            }
            (Stage::Hello, Frame::Hello(hello)) => {
                self.stage = Stage::Open;
                self.last_ping = now.mono;
                self.out.checked = hello.checks && self.config.hello.checks;
                Ok(Some(Event::Opened(hello)))
            }
            (Stage::Hello, frame @ Frame::Goodbye(_)) => Ok(Some(Event::Frame(frame))),
            (Stage::Open, Frame::Ping(nonce)) => {
                self.send_heartbeat(now, Frame::Pong(nonce));
                Ok(None)
            }
            (Stage::Open, Frame::Pong(_) | Frame::Unknown(_)) => Ok(None),
            (Stage::Open, Frame::Hello(_)) | (Stage::Hello | Stage::Preamble, _) => {
                Err(LinkError::Order)
            }
            (Stage::Open, frame) => {
                if matches!(frame, Frame::Letter(_)) {
                    self.last_letter = Some(now.mono);
                }
                Ok(Some(Event::Frame(frame)))
            }
        }
    }
}

/// Whether the preamble was there and is taken; an error as soon as the octets differ from it.
fn take_preamble(received: &mut BytesMut) -> Result<bool, LinkError> {
    let magic = PREAMBLE.len() - 1;
    let given = received.len().min(magic);
    if received[..given] != PREAMBLE[..given] {
        return Err(LinkError::Preamble);
    }
    match received.get(magic) {
        None => Ok(false),
        Some(version) if *version == PREAMBLE[magic] => {
            received.advance(PREAMBLE.len());
            Ok(true)
        }
        Some(version) => Err(LinkError::Version(*version)),
    }
}
