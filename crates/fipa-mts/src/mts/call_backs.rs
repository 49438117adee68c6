//! Whether others reach us: a service that asks by its link is called back where it says it is, and
//! told how that went.
//!
//! ```text
//!   program ── ask ──▶ its service ── ask, with its endpoints ──▶ other service ──▶ dials them
//!   program ◀─ answer ── its service ◀────────── answer ────────────┘
//! ```
//!
//! So that nobody has others look for open ports, only addresses are called that are on the very
//! host at the other end of the link, and few a minute.

use std::collections::{HashMap, VecDeque};
use std::net::IpAddr;
use std::time::Duration;

use fipa_acl::Text;
use fipa_directory::{Address, InstanceId, Now};
use fipa_link::{AskCallBack, CallBack, CallBackResult, CalledBack, Frame};

use super::Mts;
use crate::machine::{ConnId, Output};

/// Times that anybody is called back within [`WINDOW`], at most.
const MOST_CALLS: usize = 10;
const WINDOW: Duration = Duration::from_secs(60);

/// Addresses that are called each time, at most.
const MOST_ADDRESSES: usize = 8;

/// Questions that wait for the answer of another service, at most: an old one never answers.
const MOST_ASKED: usize = 1000;

#[derive(Debug, Default)]
pub(super) struct CallBacks {
    /// What others were asked, by the number of the request.
    asked: HashMap<u64, (Asker, InstanceId)>,
    /// The calls that are under way.
    calls: HashMap<u64, Calling>,
    /// When others were called back lately.
    lately: VecDeque<Duration>,
}

/// Who wants to know.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Asker {
    /// A program, with the number of its request.
    Program(ConnId, u64),
    /// Whoever runs this service, with a ticket.
    Ticket(u64),
}

/// Somebody who is called back.
#[derive(Debug)]
struct Calling {
    conn: ConnId,
    request: u64,
    untried: Vec<CallBack>,
}

impl CallBacks {
    /// Whether somebody may be called now; if so, that is noted.
    fn admit(&mut self, now: Now) -> bool {
        while let Some(first) = self.lately.front()
            && *first + WINDOW <= now.mono
        {
            self.lately.pop_front();
        }
        let admitted = self.lately.len() < MOST_CALLS;
        if admitted {
            self.lately.push_back(now.mono);
        }
        admitted
    }
}

impl Mts {
    /// Has the service `whom` call this one back; answered by [`Output::CalledBack`], unless it is
    /// too old or falls silent.
    pub fn ask_call_back(&mut self, now: Now, ticket: u64, whom: InstanceId) {
        self.pass_call_back_on(now, Asker::Ticket(ticket), whom);
    }

    pub(super) fn pass_call_back_on(&mut self, now: Now, asker: Asker, whom: InstanceId) {
        let link = self.peers.get(whom).and_then(|peer| peer.links.first());
        let Some(conn) = link.copied() else {
            let reason = "there is no link with it";
            return self.tell_asker(now, asker, refusal(reason.into()));
        };
        if self.call_backs.asked.len() >= MOST_ASKED {
            let reason = "too many of these questions wait for their answers";
            return self.tell_asker(now, asker, refusal(reason.into()));
        }
        let request = self.id();
        self.call_backs.asked.insert(request, (asker, whom));
        let same_host = self.conns.get(&conn).is_some_and(|open| open.same_host);
        let ask = AskCallBack {
            request,
            whom: self.config.instance,
            addresses: self.endpoints_for(same_host),
        };
        self.send(now, conn, Frame::AskCallBack(ask));
    }

    /// Another service has called us, or not.
    pub(super) fn was_called_back(&mut self, now: Now, by: InstanceId, called: CalledBack) {
        let asked = self.call_backs.asked.get(&called.request);
        if asked.is_none_or(|(_, whom)| *whom != by) {
            return;
        }
        if let Some((asker, _)) = self.call_backs.asked.remove(&called.request) {
            self.tell_asker(now, asker, called);
        }
    }

    /// A program has ended, which does not want to know any more.
    pub(super) fn forget_call_backs(&mut self, program: ConnId) {
        let its = |asker: &Asker| matches!(asker, Asker::Program(conn, _) if *conn == program);
        self.call_backs.asked.retain(|_, (asker, _)| !its(asker));
    }

    /// The link with another service has ended, over which its answers would have come.
    pub(super) fn end_call_backs(&mut self, now: Now, whom: InstanceId) {
        let asked = self.call_backs.asked.iter();
        let lost = asked.filter(|(_, (_, asked))| *asked == whom);
        let lost: Vec<u64> = lost.map(|(request, _)| *request).collect();
        for request in lost {
            if let Some((asker, _)) = self.call_backs.asked.remove(&request) {
                self.tell_asker(now, asker, refusal("the link with it has ended".into()));
            }
        }
    }

    /// Another service wants to be called.
    pub(super) fn call_back(
        &mut self,
        now: Now,
        conn: ConnId,
        instance: InstanceId,
        ask: AskCallBack,
    ) {
        let open = self.conns.get(&conn);
        let remote: Option<Address> = open.and_then(|open| open.remote.parse().ok());
        let mut addresses = Vec::new();
        let mut untried = Vec::new();
        for text in ask.addresses.into_iter().take(MOST_ADDRESSES) {
            match text.parse::<Address>() {
                Ok(address) if remote.as_ref().is_some_and(|r| is_same_host(r, &address)) => {
                    addresses.push(address);
                }
                _ => untried.push(CallBack {
                    address: text,
                    result: CallBackResult::Untried,
                    reason: Text::from_static("the link does not come from this address"),
                }),
            }
        }
        let request = ask.request;
        if addresses.is_empty() {
            let called = CalledBack {
                request,
                refusal: Text::default(),
                calls: untried,
            };
            return self.send(now, conn, Frame::CalledBack(called));
        }
        if !self.call_backs.admit(now) {
            let reason = format!("it has called others back {MOST_CALLS} times within a minute");
            let called = CalledBack {
                request,
                ..refusal(reason.into())
            };
            return self.send(now, conn, Frame::CalledBack(called));
        }
        let call = self.id();
        let calling = Calling {
            conn,
            request,
            untried,
        };
        self.call_backs.calls.insert(call, calling);
        self.outputs.push_back(Output::CallBack {
            call,
            whom: instance,
            addresses,
        });
    }

    /// The service that had asked was called.
    pub(super) fn answer_call_back(&mut self, now: Now, call: u64, mut calls: Vec<CallBack>) {
        let Some(calling) = self.call_backs.calls.remove(&call) else {
            return;
        };
        calls.extend(calling.untried);
        let called = CalledBack {
            request: calling.request,
            refusal: Text::default(),
            calls,
        };
        self.send(now, calling.conn, Frame::CalledBack(called));
    }

    fn tell_asker(&mut self, now: Now, asker: Asker, mut called: CalledBack) {
        match asker {
            Asker::Ticket(ticket) => self
                .outputs
                .push_back(Output::CalledBack { ticket, called }),
            Asker::Program(conn, request) => {
                called.request = request;
                self.send(now, conn, Frame::CalledBack(called));
            }
        }
    }
}

fn refusal(refusal: Text) -> CalledBack {
    CalledBack {
        request: 0,
        refusal,
        calls: Vec::new(),
    }
}

/// Whether both are ports of links at one IP address.
fn is_same_host(one: &Address, other: &Address) -> bool {
    let ip = |address: &Address| match address {
        Address::Tcp { host, .. } | Address::Quic { host, .. } => host.parse::<IpAddr>().ok(),
        Address::Http { .. } | Address::Unix(_) | Address::Other { .. } => None,
    };
    ip(one).is_some_and(|one| ip(other) == Some(one))
}
