//! The message transport protocol over HTTP (FIPA SC00084F): one POST a letter, envelope and
//! payload as the two parts of its body.
//!
//! ```text
//!   HttpServer: POST ─▶ both parts ─▶ HttpReceiver ─▶ 200, 400, 503       GET ─▶ description
//!   HttpClient: letter ─▶ idle or new connection ─▶ POST ─▶ head of the answer ─▶ 200, or why not
//! ```
//!
//! **Knows** HTTP as JADE speaks it, connections, limits and time limits. **Never knows** what an
//! envelope says. 200 means that the letter was taken over, not that an agent has it.

mod client;
mod multipart;
mod response;
mod server;

pub use client::{HttpClient, HttpLetter, PostError};
pub use server::{HttpLimits, HttpReceiver, HttpRefusal, HttpServer, Posted};
