//! EDCP, the link layer: packets in a stream of octets.
//!
//! Octets from F8 on are codes; inside a packet they stand as EXCH and a substitute. A stream may
//! begin anywhere and lose anything: the next SPKG is the beginning of the next packet.

use crate::Buffer;

/// Start of packet.
pub const SPKG: u8 = 0xF8;
/// End of packet.
pub const EPKG: u8 = 0xF9;
/// The next octet stands for one of the codes.
pub const EXCH: u8 = 0xFC;

/// What a partner sends when it has nothing to say.
pub const ALIVE: [u8; 2] = [SPKG, EPKG];

/// The upper five bits of a substitute, and where they are.
const SUBSTITUTE: u8 = 0b1100_1000;
const UPPER: u8 = 0b1111_1000;

/// The octets of the link for those of a packet; none of a packet gives [`ALIVE`].
pub fn escaped(packet: impl IntoIterator<Item = u8>) -> impl Iterator<Item = u8> {
    let inner = packet.into_iter().flat_map(|octet| {
        let code = octet >= SPKG;
        let exchange = code.then_some(EXCH);
        let octet = if code {
            SUBSTITUTE | (octet & !UPPER)
        } else {
            octet
        };
        exchange.into_iter().chain(core::iter::once(octet))
    });
    core::iter::once(SPKG)
        .chain(inner)
        .chain(core::iter::once(EPKG))
}

/// What an octet of the link completed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event<'a> {
    /// A packet, from PV to CHK.
    Packet(&'a [u8]),
    /// The partner is there: a packet without octets.
    Alive,
    /// A packet has begun before this one was finished. These octets of it came.
    Unfinished(&'a [u8]),
    /// The packet does not fit into the buffer, which holds its beginning.
    TooLong(&'a [u8]),
}

/// What was ignored or dropped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Octets outside of packets.
    pub noise: u32,
    /// Reserved codes, and EXCH without a substitute, in packets.
    pub ignored: u32,
    /// Packets that another one cut off.
    pub unfinished: u32,
    /// Packets that did not fit.
    pub too_long: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// Before an SPKG.
    Outside,
    /// Behind a packet that was too long.
    Dropping,
    Inside,
    /// Behind an EXCH.
    Exchanging,
}

/// Finds the packets in the octets of a link, one octet at a time.
#[derive(Clone, Debug)]
pub struct Decoder<B> {
    buffer: B,
    state: State,
    /// The buffer holds what an event has shown.
    shown: bool,
    heard: u32,
    counters: Counters,
}

impl<B: Buffer> Decoder<B> {
    /// A decoder at the beginning of a stream, whose buffer has room for the longest packet.
    pub const fn new(buffer: B) -> Decoder<B> {
        Decoder {
            buffer,
            state: State::Outside,
            shown: false,
            heard: 0,
            counters: Counters {
                noise: 0,
                ignored: 0,
                unfinished: 0,
                too_long: 0,
            },
        }
    }

    /// Takes in an octet. What it completed is shown until the next one.
    pub fn push(&mut self, octet: u8) -> Option<Event<'_>> {
        if self.shown {
            self.buffer.clear();
            self.shown = false;
        }
        match (self.state, octet) {
            (State::Exchanging, octet) if octet & UPPER == SUBSTITUTE => {
                self.state = State::Inside;
                self.take(octet | UPPER)
            }
            (State::Exchanging, octet) => {
                // The EXCH is ignored, and the octet is taken as if it had come alone.
                count(&mut self.counters.ignored);
                self.state = State::Inside;
                self.code_or_octet(octet)
            }
            (State::Inside, octet) => self.code_or_octet(octet),
            (State::Outside | State::Dropping, SPKG) => {
                self.begin();
                None
            }
            (State::Outside, _) => {
                count(&mut self.counters.noise);
                None
            }
            (State::Dropping, _) => None,
        }
    }

    /// The stream has ended. A packet that has begun is unfinished.
    pub fn end(&mut self) -> Option<Event<'_>> {
        let open = matches!(self.state, State::Inside | State::Exchanging);
        self.state = State::Outside;
        if self.shown {
            self.buffer.clear();
        }
        self.shown = true;
        if !open {
            return None;
        }
        count(&mut self.counters.unfinished);
        Some(Event::Unfinished(self.buffer.octets()))
    }

    /// Counts what shows that the partner is there: each SPKG and each octet of a packet, not
    /// noise. Wraps around.
    pub fn heard(&self) -> u32 {
        self.heard
    }

    /// What was ignored or dropped so far.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    fn begin(&mut self) {
        self.state = State::Inside;
        self.heard = self.heard.wrapping_add(1);
    }

    /// An octet inside a packet.
    fn code_or_octet(&mut self, octet: u8) -> Option<Event<'_>> {
        match octet {
            SPKG => {
                count(&mut self.counters.unfinished);
                self.begin();
                self.shown = true;
                Some(Event::Unfinished(self.buffer.octets()))
            }
            EPKG => {
                self.state = State::Outside;
                self.shown = true;
                Some(match self.buffer.octets() {
                    [] => Event::Alive,
                    octets => Event::Packet(octets),
                })
            }
            EXCH => {
                self.state = State::Exchanging;
                None
            }
            _ if octet > SPKG => {
                count(&mut self.counters.ignored);
                None
            }
            _ => self.take(octet),
        }
    }

    fn take(&mut self, octet: u8) -> Option<Event<'_>> {
        self.heard = self.heard.wrapping_add(1);
        if self.buffer.push(octet) {
            return None;
        }
        count(&mut self.counters.too_long);
        self.state = State::Dropping;
        self.shown = true;
        Some(Event::TooLong(self.buffer.octets()))
    }
}

fn count(counter: &mut u32) {
    *counter = counter.wrapping_add(1);
}
