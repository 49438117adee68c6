//! The sockets and serial lines of a text platform, on tokio.
//!
//! **Knows** how octets come in and go out, and what waits for a slow line. **Never knows** what a
//! message is for: it hands each on with the place where it came from.

mod endpoint;
mod stream;

use std::collections::HashMap;
use std::io;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream, UdpSocket};
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio_serial::SerialPortBuilderExt;

pub use self::endpoint::{Endpoint, EndpointError};
use self::stream::Lane;
use crate::{Message, Place, Reader, StreamId, Unreadable};

/// How long a stream that could not be opened is left alone.
const PAUSE: Duration = Duration::from_secs(1);

/// Events that wait to be taken; then nothing more is read.
const EVENTS: usize = 256;

/// What happened at the links.
#[derive(Debug)]
pub enum LinkEvent {
    /// A stream of this endpoint is open.
    Opened {
        /// The stream.
        stream: StreamId,
        /// The endpoint that it belongs to.
        endpoint: Endpoint,
        /// Where it leads: the endpoint, or who connected there.
        place: String,
    },
    /// A message came.
    Received(Place, Message),
    /// Something came that cannot be read.
    Unreadable(Place, Unreadable),
    /// A message with a ticket was written, or will not be.
    Written(u64, Result<(), String>),
    /// A stream has ended.
    Closed(StreamId, String),
    /// A stream could not be opened; it is tried again.
    Failed(Endpoint, String),
}

/// All links of a platform. They end when this is dropped.
#[derive(Debug)]
pub struct Links {
    shared: Arc<Shared>,
    receiver: mpsc::Receiver<LinkEvent>,
    tasks: JoinSet<()>,
}

#[derive(Debug)]
struct Shared {
    events: mpsc::Sender<LinkEvent>,
    open: Mutex<Open>,
}

#[derive(Debug, Default)]
struct Open {
    last_stream: u64,
    streams: HashMap<StreamId, Arc<Lane>>,
    sockets: Vec<Arc<UdpSocket>>,
    /// By which socket an address was heard.
    heard_by: HashMap<SocketAddr, usize>,
}

/// Addresses whose socket is remembered.
const MAX_HEARD: usize = 4096;

impl Default for Links {
    fn default() -> Self {
        Links::new()
    }
}

impl Links {
    /// No links yet.
    pub fn new() -> Links {
        let (events, receiver) = mpsc::channel(EVENTS);
        Links {
            shared: Arc::new(Shared {
                events,
                open: Mutex::default(),
            }),
            receiver,
            tasks: JoinSet::new(),
        }
    }

    /// Opens an endpoint, and for a socket says where it is bound.
    ///
    /// # Errors
    /// What the system says to a socket. Streams are tried for ever: see [`LinkEvent::Failed`].
    pub async fn open(&mut self, endpoint: &Endpoint) -> io::Result<Option<Endpoint>> {
        let shared = Arc::clone(&self.shared);
        let bound = match endpoint {
            Endpoint::Udp(place) => {
                let socket = Arc::new(UdpSocket::bind(place).await?);
                let bound = Endpoint::Udp(socket.local_addr()?.to_string());
                let mut open = self.shared.open();
                let index = open.sockets.len();
                open.sockets.push(Arc::clone(&socket));
                self.tasks.spawn(shared.datagrams(socket, index));
                Some(bound)
            }
            Endpoint::TcpListen(place) => {
                let listener = TcpListener::bind(place).await?;
                let bound = Endpoint::TcpListen(listener.local_addr()?.to_string());
                let callers = shared.callers(listener, endpoint.clone());
                self.tasks.spawn(callers);
                Some(bound)
            }
            Endpoint::TcpDial(_) | Endpoint::Serial { .. } => {
                self.tasks.spawn(shared.dial(endpoint.clone()));
                None
            }
        };
        Ok(bound)
    }

    /// The next thing that happens.
    pub async fn next(&mut self) -> LinkEvent {
        // A sender is kept here, so the channel never ends.
        match self.receiver.recv().await {
            Some(event) => event,
            None => std::future::pending().await,
        }
    }

    /// Writes a message; with a ticket there is a [`LinkEvent::Written`], unless the stream ends
    /// first. On a slow stream the most urgent go first, and the least urgent are dropped.
    pub fn write(&mut self, to: Place, message: &Message, ticket: Option<u64>) {
        let text = match message.to_text() {
            Ok(text) => text,
            Err(error) => return self.written(ticket, Err(error.to_string())),
        };
        match to {
            Place::Stream(stream) => {
                let lane = self.shared.open().streams.get(&stream).map(Arc::clone);
                let dropped =
                    lane.and_then(|lane| lane.push(message.urgency.unwrap_or(0), text, ticket));
                if let Some(ticket) = dropped {
                    self.written(ticket, Err("the line is congested".to_owned()));
                }
            }
            Place::Datagram(address) => {
                let result = self.shared.send_datagram(address, &text);
                self.written(ticket, result);
            }
        }
    }

    fn written(&mut self, ticket: Option<u64>, result: Result<(), String>) {
        // Those that have ended are not kept.
        while self.tasks.try_join_next().is_some() {}
        if let Some(ticket) = ticket {
            let shared = Arc::clone(&self.shared);
            self.tasks
                .spawn(async move { shared.tell(LinkEvent::Written(ticket, result)).await });
        }
    }
}

impl Shared {
    fn open(&self) -> std::sync::MutexGuard<'_, Open> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }

    async fn tell(&self, event: LinkEvent) {
        // Nobody listens any more: the links are about to end.
        let _ = self.events.send(event).await;
    }

    /// A datagram that does not go out at once is of no use later.
    fn send_datagram(&self, to: SocketAddr, text: &str) -> Result<(), String> {
        let open = self.open();
        let index = open.heard_by.get(&to).copied().unwrap_or(0);
        let socket = open.sockets.get(index);
        let socket = socket.ok_or_else(|| "there is no socket for datagrams".to_owned())?;
        let sent = socket.try_send_to(text.as_bytes(), to);
        sent.map(drop).map_err(|error| error.to_string())
    }

    async fn datagrams(self: Arc<Self>, socket: Arc<UdpSocket>, index: usize) {
        let mut octets = vec![0; 65_536];
        loop {
            let (count, from) = match socket.recv_from(&mut octets).await {
                Ok(received) => received,
                // Somebody to whom was sent is not there. He is told from by his silence.
                Err(_) => continue,
            };
            {
                let mut open = self.open();
                if open.heard_by.len() >= MAX_HEARD {
                    open.heard_by.clear();
                }
                open.heard_by.insert(from, index);
            }
            let mut reader = Reader::new();
            reader.push(&octets[..count]);
            reader.end();
            self.read(Place::Datagram(from), reader).await;
        }
    }

    async fn read(&self, from: Place, reader: impl Iterator<Item = Result<Message, Unreadable>>) {
        for read in reader {
            let event = match read {
                Ok(message) => LinkEvent::Received(from, message),
                Err(unreadable) => LinkEvent::Unreadable(from, unreadable),
            };
            self.tell(event).await;
        }
    }

    async fn callers(self: Arc<Self>, listener: TcpListener, endpoint: Endpoint) {
        let mut streams = JoinSet::new();
        loop {
            match listener.accept().await {
                Ok((stream, from)) => {
                    let (shared, endpoint) = (Arc::clone(&self), endpoint.clone());
                    let place = format!("tcp://{from}");
                    streams.spawn(async move { shared.tcp(stream, &endpoint, place).await });
                }
                // Out of file descriptors: it does not get better by trying at once.
                Err(_) => tokio::time::sleep(PAUSE).await,
            }
            while streams.try_join_next().is_some() {}
        }
    }

    /// Opens a stream, and again when it ends.
    async fn dial(self: Arc<Self>, endpoint: Endpoint) {
        loop {
            let opened = match &endpoint {
                Endpoint::Serial { path, baud } => {
                    let path = path.to_string_lossy();
                    match tokio_serial::new(path, *baud).open_native_async() {
                        Ok(line) => {
                            self.serve(line, &endpoint, endpoint.to_string()).await;
                            Ok(())
                        }
                        Err(error) => Err(error.to_string()),
                    }
                }
                Endpoint::TcpDial(place) => match TcpStream::connect(place).await {
                    Ok(stream) => {
                        self.tcp(stream, &endpoint, endpoint.to_string()).await;
                        Ok(())
                    }
                    Err(error) => Err(error.to_string()),
                },
                Endpoint::Udp(_) | Endpoint::TcpListen(_) => return,
            };
            if let Err(error) = opened {
                self.tell(LinkEvent::Failed(endpoint.clone(), error)).await;
            }
            tokio::time::sleep(PAUSE).await;
        }
    }

    async fn tcp(&self, stream: TcpStream, endpoint: &Endpoint, place: String) {
        // Small messages that wait for their answers: without it each waits for the last one's
        // acknowledgement. A stream that refuses works all the same.
        let _ = stream.set_nodelay(true);
        self.serve(stream, endpoint, place).await;
    }

    /// Reads and writes a stream until it ends.
    async fn serve(
        &self,
        stream: impl AsyncRead + AsyncWrite + Unpin,
        endpoint: &Endpoint,
        place: String,
    ) {
        let lane = Arc::new(Lane::default());
        let id = {
            let mut open = self.open();
            open.last_stream += 1;
            let id = StreamId(open.last_stream);
            open.streams.insert(id, Arc::clone(&lane));
            id
        };
        let closing = Closing { shared: self, id };
        let endpoint = endpoint.clone();
        let opened = LinkEvent::Opened {
            stream: id,
            endpoint,
            place,
        };
        self.tell(opened).await;
        let reason = stream::serve(self, Place::Stream(id), stream, &lane).await;
        drop(closing);
        self.tell(LinkEvent::Closed(id, reason.to_string())).await;
    }
}

/// Takes a stream out of the map, also when its task is dropped.
struct Closing<'a> {
    shared: &'a Shared,
    id: StreamId,
}

impl Drop for Closing<'_> {
    fn drop(&mut self) {
        self.shared.open().streams.remove(&self.id);
    }
}
