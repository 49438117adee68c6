//! One stream: what comes, and what waits to be written.

use std::io;
use std::sync::{Mutex, PoisonError};

use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::sync::Notify;

use super::{LinkEvent, Shared};
use crate::{Place, Reader, UrgencyQueue};

/// A message that waits, with its ticket.
type Waiting = (String, Option<u64>);

/// What waits to be written to a stream.
#[derive(Debug, Default)]
pub(super) struct Lane {
    queue: Mutex<UrgencyQueue<Waiting>>,
    filled: Notify,
}

impl Lane {
    /// Adds a message. If one had to be dropped, the ticket that it had.
    pub(super) fn push(
        &self,
        urgency: u8,
        text: String,
        ticket: Option<u64>,
    ) -> Option<Option<u64>> {
        let mut queue = self.queue.lock().unwrap_or_else(PoisonError::into_inner);
        let dropped = queue.push(urgency, (text, ticket));
        self.filled.notify_one();
        dropped.map(|(_, ticket)| ticket)
    }

    async fn next(&self) -> Waiting {
        loop {
            let next = {
                let mut queue = self.queue.lock().unwrap_or_else(PoisonError::into_inner);
                queue.pop()
            };
            match next {
                Some(next) => return next,
                None => self.filled.notified().await,
            }
        }
    }
}

/// Reads and writes until the stream ends; why it did.
pub(super) async fn serve(
    shared: &Shared,
    place: Place,
    stream: impl AsyncRead + AsyncWrite + Unpin,
    lane: &Lane,
) -> io::Error {
    let (reading, writing) = tokio::io::split(stream);
    tokio::select! {
        error = read(shared, place, reading) => error,
        error = write(shared, lane, writing) => error,
    }
}

async fn read(shared: &Shared, place: Place, mut stream: impl AsyncRead + Unpin) -> io::Error {
    let mut reader = Reader::new();
    let mut octets = [0; 2048];
    loop {
        match stream.read(&mut octets).await {
            Ok(0) => {
                reader.end();
                shared.read(place, &mut reader).await;
                return io::Error::new(io::ErrorKind::UnexpectedEof, "the other end closed it");
            }
            Ok(count) => {
                reader.push(&octets[..count]);
                shared.read(place, &mut reader).await;
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return error,
        }
    }
}

async fn write(shared: &Shared, lane: &Lane, mut stream: impl AsyncWrite + Unpin) -> io::Error {
    loop {
        let (text, ticket) = lane.next().await;
        let written = async {
            stream.write_all(text.as_bytes()).await?;
            stream.flush().await
        };
        let result = written.await;
        if let Some(ticket) = ticket {
            let told = match &result {
                Ok(()) => Ok(()),
                Err(error) => Err(error.to_string()),
            };
            shared.tell(LinkEvent::Written(ticket, told)).await;
        }
        if let Err(error) = result {
            return error;
        }
    }
}
