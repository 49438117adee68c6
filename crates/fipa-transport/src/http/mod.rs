//! The message transport protocol over HTTP (FIPA SC00084F): one POST a letter, envelope and
//! payload as the two parts of its body.
//!
//! ```text
//!   HttpServer: POST ─▶ both parts ─▶ HttpReceiver ─▶ 200, 400, 503       GET ─▶ description
//!   HttpClient: letter ─▶ idle or new connection ─▶ POST ─▶ head of the answer ─▶ 200, or why not
//!               letters in a series ─▶ one connection ─▶ POST, POST, POST … ─▶ the answers to them
//! ```
//!
//! JADE wants one request at a time on a connection. Our server says by `X-Ahead` in its answers how
//! many may be on their way; letters that are posted so have numbers (`X-Letter`), by which it knows
//! those that are posted again when a connection breaks. On a radio with a long way there and back
//! this is the difference between one letter and 64 for each.
//!
//! **Knows** HTTP as JADE speaks it, connections, limits and time limits. **Never knows** what an
//! envelope says. 200 means that the letter was taken over, not that an agent has it.

mod client;
mod multipart;
mod request;
mod response;
mod series;
mod server;

pub use client::{HttpClient, PostError, TakenOver};
pub use request::{HttpLetter, LetterNumber};
pub use server::{HttpLimits, HttpReceiver, HttpRefusal, HttpServer, Posted};
