//! A station on TCP streams, bare or under TLS, and serial lines, on tokio.
//!
//! **Knows** how octets come in and go out, and what time it is. **Never knows** what a packet is
//! for: the [`Station`] says what is written where, and which streams are opened and closed.

mod endpoint;
#[cfg(feature = "tls")]
mod tls;
mod watch;

use std::boxed::Box;
use std::collections::HashMap;
use std::io;
use std::string::{String, ToString};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};
use std::vec::Vec;

use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{mpsc, oneshot};
use tokio::task::JoinSet;
use tokio_serial::SerialPortBuilderExt;

pub use self::endpoint::{Endpoint, EndpointError, Place, TlsFiles};
use self::watch::Heard;
pub use self::watch::Watcher;
use crate::Station;
use crate::station::{Event, LinkConfig, LinkId, Role, StationConfig};

/// How long a stream that could not be opened is left alone.
const PAUSE: Duration = Duration::from_secs(1);

/// How long a stream for a station that passes over is tried.
const TRANSFER: Duration = Duration::from_secs(10);

/// Events that wait to be taken; then nothing more is read.
const EVENTS: usize = 64;

/// What happens at a [`Node`].
#[derive(Debug)]
pub enum NodeEvent {
    /// The station has something to tell.
    Station(Event),
    /// A stream is open.
    Opened(LinkId),
    /// A stream has ended.
    Closed(LinkId, String),
    /// A stream could not be opened, and is tried again where it is dialled.
    Failed(Endpoint, String),
}

/// A station with its streams. They end when this is dropped.
#[derive(Debug)]
pub struct Node {
    station: Station,
    shared: Arc<Shared>,
    receiver: mpsc::Receiver<LinkEvent>,
    streams: HashMap<LinkId, Stream>,
    tasks: JoinSet<()>,
    began: Instant,
    watcher: Option<Box<dyn Watcher>>,
}

#[derive(Debug)]
struct Stream {
    /// Where its other end is.
    place: String,
    heard: Heard,
    writer: mpsc::Sender<Vec<u8>>,
    /// It ends once nothing is left to write.
    closing: bool,
    /// It ends when this goes, also in the middle of writing.
    _stop: oneshot::Sender<()>,
    /// It is worth dialling again.
    lasting: Arc<AtomicBool>,
}

#[derive(Debug)]
struct Shared {
    events: mpsc::Sender<LinkEvent>,
    last_link: AtomicU64,
}

/// What a TCP stream is under.
#[derive(Clone)]
enum Cover {
    Plain,
    #[cfg(feature = "tls")]
    Dials(tls::Dialler),
    #[cfg(feature = "tls")]
    Listens(tls::Listener),
}

impl Cover {
    fn new(place: &Place) -> io::Result<Cover> {
        match place {
            #[cfg(feature = "tls")]
            Place::TlsDial(place, files) => tls::Dialler::new(place, files).map(Cover::Dials),
            #[cfg(feature = "tls")]
            Place::TlsListen(_, files) => tls::Listener::new(files).map(Cover::Listens),
            #[cfg(not(feature = "tls"))]
            Place::TlsDial(..) | Place::TlsListen(..) => Err(io::ErrorKind::Unsupported.into()),
            _ => Ok(Cover::Plain),
        }
    }
}

#[derive(Debug)]
enum LinkEvent {
    Opened(LinkId, LinkConfig, Stream),
    Received(LinkId, Vec<u8>),
    Written(LinkId),
    Closed(LinkId, String),
    Failed(Endpoint, String),
}

impl Node {
    /// A station without streams.
    pub fn new(config: StationConfig) -> Node {
        let (events, receiver) = mpsc::channel(EVENTS);
        Node {
            station: Station::new(config),
            shared: Arc::new(Shared {
                events,
                last_link: AtomicU64::new(0),
            }),
            receiver,
            streams: HashMap::new(),
            tasks: JoinSet::new(),
            began: Instant::now(),
            watcher: None,
        }
    }

    /// Has the packets shown to somebody as they pass.
    pub fn set_watcher(&mut self, watcher: Box<dyn Watcher>) {
        self.watcher = Some(watcher);
    }

    /// Opens an endpoint, and for one that listens says where it is bound.
    ///
    /// # Errors
    /// What the system says to a listener, and files of certificates that cannot be used. Streams
    /// are tried for ever: see [`NodeEvent::Failed`].
    pub async fn open(&mut self, endpoint: &Endpoint) -> io::Result<Option<Endpoint>> {
        let shared = Arc::clone(&self.shared);
        let cover = Cover::new(&endpoint.place)?;
        let (Place::TcpListen(place) | Place::TlsListen(place, _)) = &endpoint.place else {
            self.tasks.spawn(shared.dial(endpoint.clone(), cover, None));
            return Ok(None);
        };
        let listener = TcpListener::bind(place).await?;
        let at = listener.local_addr()?.to_string();
        let bound = Endpoint {
            place: match &endpoint.place {
                Place::TlsListen(_, files) => Place::TlsListen(at, files.clone()),
                _ => Place::TcpListen(at),
            },
            ..endpoint.clone()
        };
        self.tasks
            .spawn(shared.callers(listener, bound.clone(), cover));
        Ok(Some(bound))
    }

    /// The time of the station: since this was made.
    pub fn now(&self) -> Duration {
        self.began.elapsed()
    }

    /// The station, to look at it and to send; then [`next`](Self::next) does what it wants.
    pub fn station(&mut self) -> &mut Station {
        &mut self.station
    }

    /// Works until something happens. Cancel-safe.
    pub async fn next(&mut self) -> NodeEvent {
        loop {
            self.write();
            if let Some(event) = self.station.poll_event() {
                self.obey(&event);
                return NodeEvent::Station(event);
            }
            self.close();
            let wake = self.station.poll_timeout().map(|at| self.began + at);
            let timeout = async {
                match wake {
                    Some(wake) => tokio::time::sleep_until(wake.into()).await,
                    None => std::future::pending().await,
                }
            };
            tokio::select! {
                // A sender is kept here, so the channel never ends.
                Some(event) = self.receiver.recv() => {
                    if let Some(event) = self.link_event(event) {
                        return event;
                    }
                }
                () = timeout => {
                    let now = self.now();
                    self.station.handle_timeout(now);
                }
            }
        }
    }

    /// Writes until nothing is left to write to any stream, for so long at most.
    pub async fn drain(&mut self, patience: Duration) {
        let drained = async {
            while !self.streams.keys().all(|id| self.station.is_idle(*id)) {
                self.next().await;
            }
        };
        // Whoever does not read has had its time.
        let _ = tokio::time::timeout(patience, drained).await;
    }

    fn write(&mut self) {
        for (id, stream) in &self.streams {
            if let Some(octets) = self.station.poll_transmit(*id) {
                if let Some(watcher) = &mut self.watcher {
                    let mask = self.station.mask(*id);
                    Heard::default().show(&mut **watcher, false, &stream.place, mask, &octets);
                }
                // There is room: the last was written, or the stream is ending.
                let _ = stream.writer.try_send(octets);
            }
        }
    }

    fn close(&mut self) {
        let station = &self.station;
        self.streams
            .retain(|id, stream| !(stream.closing && station.is_idle(*id)));
        // Those that have ended are not kept.
        while self.tasks.try_join_next().is_some() {}
    }

    /// What the station wants done with streams.
    fn obey(&mut self, event: &Event) {
        match event {
            Event::Close(id) => {
                if let Some(stream) = self.streams.get_mut(id) {
                    stream.closing = true;
                }
            }
            Event::Connected { link, .. } => {
                if let Some(stream) = self.streams.get(link) {
                    stream.lasting.store(true, Ordering::Relaxed);
                }
            }
            Event::Expect { place, .. } => self.pass_over(place.as_deref(), Role::Employer),
            Event::PassOver { place, .. } => self.pass_over(place.as_deref(), Role::Employee),
            _ => {}
        }
    }

    fn pass_over(&mut self, place: Option<&str>, role: Role) {
        let endpoint = place.and_then(|place| place.parse::<Endpoint>().ok());
        let dialled = |endpoint: &Endpoint| matches!(endpoint.place, Place::TcpDial(_));
        if let Some(endpoint) = endpoint.filter(dialled) {
            let endpoint = Endpoint { role, ..endpoint };
            let until = Some(Instant::now() + TRANSFER);
            self.tasks
                .spawn(Arc::clone(&self.shared).dial(endpoint, Cover::Plain, until));
        }
    }

    fn link_event(&mut self, event: LinkEvent) -> Option<NodeEvent> {
        let now = self.now();
        match event {
            LinkEvent::Opened(id, config, stream) => {
                self.streams.insert(id, stream);
                self.station.add_link(now, id, config);
                Some(NodeEvent::Opened(id))
            }
            LinkEvent::Received(id, octets) => {
                if let (Some(watcher), Some(stream)) =
                    (&mut self.watcher, self.streams.get_mut(&id))
                {
                    let mask = self.station.mask(id);
                    let heard = &mut stream.heard;
                    heard.show(&mut **watcher, true, &stream.place, mask, &octets);
                }
                self.station.received(now, id, &octets);
                None
            }
            LinkEvent::Written(id) => {
                self.station.transmitted(now, id);
                None
            }
            LinkEvent::Closed(id, reason) => {
                self.streams.remove(&id);
                self.station.remove_link(now, id);
                Some(NodeEvent::Closed(id, reason))
            }
            LinkEvent::Failed(endpoint, reason) => Some(NodeEvent::Failed(endpoint, reason)),
        }
    }
}

impl Shared {
    async fn tell(&self, event: LinkEvent) {
        // Nobody listens any more: the node is about to end.
        let _ = self.events.send(event).await;
    }

    async fn callers(self: Arc<Self>, listener: TcpListener, endpoint: Endpoint, cover: Cover) {
        let mut streams = JoinSet::new();
        loop {
            match listener.accept().await {
                Ok((stream, _)) => {
                    let (shared, cover) = (Arc::clone(&self), cover.clone());
                    let endpoint = endpoint.clone();
                    streams.spawn(async move {
                        let lasting = Arc::default();
                        if let Err(error) = shared.tcp(stream, &endpoint, &cover, lasting).await {
                            let said = error.to_string();
                            shared.tell(LinkEvent::Failed(endpoint, said)).await;
                        }
                    });
                }
                // Out of file descriptors: it does not get better by trying at once.
                Err(_) => tokio::time::sleep(PAUSE).await,
            }
            while streams.try_join_next().is_some() {}
        }
    }

    /// Opens a stream, and again when it ends; `until` then, unless there was a connection.
    async fn dial(self: Arc<Self>, endpoint: Endpoint, cover: Cover, until: Option<Instant>) {
        let lasting = Arc::new(AtomicBool::new(until.is_none()));
        let goes_on = || {
            let tried = until.is_some_and(|until| Instant::now() >= until);
            lasting.load(Ordering::Relaxed) || !tried
        };
        while goes_on() {
            let opened = match &endpoint.place {
                Place::Serial { path, baud } => {
                    let path = path.to_string_lossy();
                    match tokio_serial::new(path, *baud).open_native_async() {
                        Ok(line) => {
                            let (link, place) = (endpoint.link(), endpoint.to_string());
                            self.serve(line, place, link, Arc::clone(&lasting)).await;
                            Ok(())
                        }
                        Err(error) => Err(error.into()),
                    }
                }
                Place::TcpDial(place) | Place::TlsDial(place, _) => {
                    match TcpStream::connect(place).await {
                        Ok(stream) => {
                            let lasting = Arc::clone(&lasting);
                            self.tcp(stream, &endpoint, &cover, lasting).await
                        }
                        Err(error) => Err(error),
                    }
                }
                Place::TcpListen(_) | Place::TlsListen(..) => return,
            };
            if let Err(error) = opened {
                let said = error.to_string();
                self.tell(LinkEvent::Failed(endpoint.clone(), said)).await;
            }
            tokio::time::sleep(PAUSE).await;
        }
    }

    async fn tcp(
        &self,
        stream: TcpStream,
        endpoint: &Endpoint,
        cover: &Cover,
        lasting: Arc<AtomicBool>,
    ) -> io::Result<()> {
        // Small packets that wait for their confirmations. A stream that refuses works all the same.
        let _ = stream.set_nodelay(true);
        let link = endpoint.link();
        let scheme = match cover {
            Cover::Plain => "tcp",
            #[cfg(feature = "tls")]
            Cover::Dials(_) | Cover::Listens(_) => "tls",
        };
        let place = match stream.peer_addr() {
            Ok(peer) => std::format!("{scheme}://{peer}"),
            Err(_) => String::new(),
        };
        match cover {
            Cover::Plain => self.serve(stream, place, link, lasting).await,
            #[cfg(feature = "tls")]
            Cover::Dials(tls) => {
                let stream = tls.connect(stream).await?;
                self.serve(stream, place, link, lasting).await;
            }
            #[cfg(feature = "tls")]
            Cover::Listens(tls) => {
                let stream = tls.accept(stream).await?;
                self.serve(stream, place, link, lasting).await;
            }
        }
        Ok(())
    }

    /// Reads and writes a stream until it ends.
    async fn serve(
        &self,
        stream: impl AsyncRead + AsyncWrite + Unpin,
        place: String,
        config: LinkConfig,
        lasting: Arc<AtomicBool>,
    ) {
        let id = LinkId(self.last_link.fetch_add(1, Ordering::Relaxed) + 1);
        let (writer, to_write) = mpsc::channel(1);
        let (stop, stopped) = oneshot::channel();
        let handle = Stream {
            place,
            heard: Heard::default(),
            writer,
            closing: false,
            _stop: stop,
            lasting,
        };
        self.tell(LinkEvent::Opened(id, config, handle)).await;
        let (reading, writing) = tokio::io::split(stream);
        let reason = tokio::select! {
            error = self.read(id, reading) => error.to_string(),
            reason = self.write(id, writing, to_write) => reason,
            _ = stopped => "it was closed here".to_string(),
        };
        self.tell(LinkEvent::Closed(id, reason)).await;
    }

    async fn read(&self, id: LinkId, mut stream: impl AsyncRead + Unpin) -> io::Error {
        let mut octets = [0; 4096];
        loop {
            match stream.read(&mut octets).await {
                Ok(0) => return io::ErrorKind::UnexpectedEof.into(),
                Ok(count) => {
                    let octets = octets[..count].to_vec();
                    self.tell(LinkEvent::Received(id, octets)).await;
                }
                Err(error) => return error,
            }
        }
    }

    async fn write(
        &self,
        id: LinkId,
        mut stream: impl AsyncWrite + Unpin,
        mut to_write: mpsc::Receiver<Vec<u8>>,
    ) -> String {
        while let Some(octets) = to_write.recv().await {
            let written = async {
                stream.write_all(&octets).await?;
                stream.flush().await
            };
            if let Err(error) = written.await {
                return error.to_string();
            }
            self.tell(LinkEvent::Written(id)).await;
        }
        "it was closed here".to_string()
    }
}
