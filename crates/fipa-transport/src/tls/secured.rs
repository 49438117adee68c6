use std::io::{self, BufRead, IoSlice, Read, Write};
use std::mem::MaybeUninit;
use std::net::Shutdown;
use std::pin::Pin;
use std::task::{Context, Poll, ready};

use bytes::BytesMut;
use fipa_fleet::Refusal;
use rustls::{AlertDescription, Connection, Error};
use socket2::SockRef;
use tokio::io::{AsyncRead, ReadBuf};
use tokio::net::TcpStream;

use super::gate::Verdict;

/// Octets that are read at once from the socket.
const CHUNK: usize = 32 << 10;

/// A TCP stream under TLS, after the handshake.
#[derive(Debug)]
pub(crate) struct Secured {
    stream: TcpStream,
    session: Connection,
    /// Whose certificate the other side showed.
    name: String,
    /// What was read from the socket and not taken by the session yet.
    sealed: Vec<u8>,
}

/// A socket that is read and written as much as it allows at once.
struct Socket<'a>(&'a TcpStream);

impl Read for Socket<'_> {
    fn read(&mut self, room: &mut [u8]) -> io::Result<usize> {
        self.0.try_read(room)
    }
}

impl Write for Socket<'_> {
    fn write(&mut self, octets: &[u8]) -> io::Result<usize> {
        self.0.try_write(octets)
    }

    fn write_vectored(&mut self, parts: &[IoSlice<'_>]) -> io::Result<usize> {
        self.0.try_write_vectored(parts)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Greets until both sides have shown who they are.
pub(super) async fn shake_hands(
    stream: TcpStream,
    mut session: Connection,
    verdict: &Verdict,
) -> io::Result<Secured> {
    loop {
        while session.wants_write() {
            match session.write_tls(&mut Socket(&stream)) {
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                    stream.writable().await?;
                }
                written => drop(written?),
            }
        }
        if !session.is_handshaking() {
            break;
        }
        stream.readable().await?;
        match session.read_tls(&mut Socket(&stream)) {
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => continue,
            Ok(0) => {
                let said = "the other side ended the connection in the middle of the TLS handshake";
                return Err(io::Error::new(io::ErrorKind::ConnectionAborted, said));
            }
            read => drop(read?),
        }
        if let Err(error) = session.process_new_packets() {
            // The alert tells the other side; if it does not get it, it sees the end.
            let _ = session.write_tls(&mut Socket(&stream));
            return Err(io::Error::other(explain(&error, verdict)));
        }
    }
    let name = verdict
        .name()
        .ok_or_else(|| io::Error::other(Refusal::NoCertificate))?;
    Ok(Secured {
        stream,
        session,
        name,
        sealed: Vec::new(),
    })
}

/// What went wrong in a handshake, for people.
fn explain(error: &Error, verdict: &Verdict) -> String {
    match (verdict.refusal(), error) {
        (Some(refusal), _) => refusal.to_string(),
        (None, Error::NoCertificatesPresented) => Refusal::NoCertificate.to_string(),
        (None, Error::DecryptError) => "its handshake was not made for this connection: it is a \
             recording, or it was altered on its way"
            .to_owned(),
        (None, Error::InvalidCertificate(_)) => {
            "it does not have the key of the certificate that it showed".to_owned()
        }
        (None, Error::InvalidMessage(_)) => {
            "it does not speak TLS, so it belongs to no fleet".to_owned()
        }
        (None, other) => broken(other),
    }
}

/// What went wrong with a session, for people.
fn broken(error: &Error) -> String {
    let Error::AlertReceived(alert) = error else {
        return format!("TLS: {error}");
    };
    of_alert(*alert)
}

/// What the other side has against us.
pub(crate) fn of_alert(alert: AlertDescription) -> String {
    let why = match alert {
        AlertDescription::UnknownCA => "it is of another fleet",
        AlertDescription::CertificateExpired => "it has expired, or is not valid yet by its clock",
        AlertDescription::CertificateRevoked => "it is revoked",
        AlertDescription::AccessDenied => "it is not let in there",
        other => return format!("the other side broke off: TLS alert {other:?}"),
    };
    format!("the other side does not accept our certificate: {why}")
}

impl Secured {
    /// Whose certificate the other side showed, and whose key it has.
    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// The certificate that the other side showed (DER).
    pub(crate) fn certificate(&self) -> Option<&[u8]> {
        let shown = self.session.peer_certificates()?;
        shown.first().map(AsRef::as_ref)
    }

    pub(crate) fn stream(&self) -> &TcpStream {
        &self.stream
    }

    pub(crate) fn poll_read_ready(&mut self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        let waits = match self.session.reader().fill_buf() {
            Err(error) => error.kind() != io::ErrorKind::WouldBlock,
            Ok(_) => true,
        };
        if waits || !self.sealed.is_empty() {
            return Poll::Ready(Ok(()));
        }
        self.stream.poll_read_ready(cx)
    }

    /// Reads into the room that there is; whether it was filled.
    pub(crate) fn poll_read(
        &mut self,
        cx: &mut Context<'_>,
        buffer: &mut BytesMut,
    ) -> Poll<io::Result<bool>> {
        let room = buffer.capacity() - buffer.len();
        let full = buffer.capacity();
        let sealed = std::mem::take(&mut self.sealed);
        let mut rest = sealed.as_slice();
        let opened = self.open(&mut rest, buffer, full);
        self.sealed = rest.to_vec();
        if opened? || buffer.len() > full - room {
            return Poll::Ready(Ok(buffer.len() == full));
        }
        if self.has_ended() {
            return Poll::Ready(Err(io::ErrorKind::UnexpectedEof.into()));
        }
        let mut chunk = [MaybeUninit::uninit(); CHUNK];
        let mut chunk = ReadBuf::uninit(&mut chunk);
        ready!(Pin::new(&mut self.stream).poll_read(cx, &mut chunk))?;
        let mut rest = chunk.filled();
        if rest.is_empty() {
            // The end of the socket: whether it is that of the stream, the session knows.
            self.session.read_tls(&mut rest)?;
            self.process()?;
            return match self.session.reader().fill_buf() {
                Ok([]) => Poll::Ready(Err(io::ErrorKind::UnexpectedEof.into())),
                _ => Poll::Ready(Err(io::Error::new(
                    io::ErrorKind::ConnectionAborted,
                    "the connection was cut off",
                ))),
            };
        }
        let full_now = self.open(&mut rest, buffer, full)?;
        self.sealed = rest.to_vec();
        self.flush()?;
        Poll::Ready(match (full_now, buffer.len() == full - room) {
            (true, _) => Ok(true),
            // A part of a record: there is nothing to hand on, and nobody has to wait.
            (false, true) if !self.has_ended() => Ok(false),
            (false, true) => Err(io::ErrorKind::UnexpectedEof.into()),
            (false, false) => Ok(false),
        })
    }

    /// Whether the other side has said that nothing follows, and all before that was read.
    fn has_ended(&mut self) -> bool {
        matches!(self.session.reader().fill_buf(), Ok([]))
    }

    /// Opens what is sealed until the buffer holds `full` octets. Whether it does.
    fn open(&mut self, sealed: &mut &[u8], buffer: &mut BytesMut, full: usize) -> io::Result<bool> {
        loop {
            while buffer.len() < full {
                let mut reader = self.session.reader();
                let Ok(octets @ [_, ..]) = reader.fill_buf() else {
                    break;
                };
                let taken = octets.len().min(full - buffer.len());
                buffer.extend_from_slice(&octets[..taken]);
                reader.consume(taken);
            }
            if buffer.len() == full {
                return Ok(true);
            }
            if sealed.is_empty() || self.has_ended() {
                return Ok(false);
            }
            self.session.read_tls(sealed)?;
            self.process()?;
        }
    }

    fn process(&mut self) -> io::Result<()> {
        match self.session.process_new_packets() {
            Ok(_) => Ok(()),
            Err(error) => {
                let _ = self.session.write_tls(&mut Socket(&self.stream));
                Err(io::Error::other(broken(&error)))
            }
        }
    }

    pub(crate) fn poll_write_ready(&self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        self.stream.poll_write_ready(cx)
    }

    /// Takes as much as there is room for: what was taken may still wait, see
    /// [`flush`](Self::flush).
    pub(crate) fn try_write_vectored(&mut self, parts: &[IoSlice<'_>]) -> io::Result<usize> {
        let taken = self.session.writer().write_vectored(parts)?;
        let blocked = self.flush()?;
        match (taken, blocked) {
            (0, true) => Err(io::ErrorKind::WouldBlock.into()),
            (0, false) => self.session.writer().write_vectored(parts),
            (taken, _) => Ok(taken),
        }
    }

    /// Hands what was taken to the socket; whether some of it waits.
    pub(crate) fn flush(&mut self) -> io::Result<bool> {
        while self.session.wants_write() {
            match self.session.write_tls(&mut Socket(&self.stream)) {
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(true),
                written => drop(written?),
            }
        }
        Ok(false)
    }

    /// Says that nothing follows, so that the end is told from a connection that was cut off.
    pub(crate) fn end_writing(&mut self) -> io::Result<()> {
        self.session.send_close_notify();
        self.flush()?;
        SockRef::from(&self.stream).shutdown(Shutdown::Write)
    }
}
