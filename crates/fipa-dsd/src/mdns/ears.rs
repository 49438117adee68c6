//! The sockets by which the directory of C++ robots is heard, asked and told.
use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, SocketAddrV4, SocketAddrV6};
use std::task::Poll;

use socket2::{Domain, Protocol, Socket, Type};
use tokio::io::ReadBuf;
use tokio::net::UdpSocket;

use crate::interface::Post;

/// The multicast group of mDNS. C++ robots have no addresses but those of IPv4.
pub(crate) const GROUP: Ipv4Addr = Ipv4Addr::new(224, 0, 0, 251);
/// The same for IPv6.
pub(crate) const GROUP_V6: Ipv6Addr = Ipv6Addr::new(0xff02, 0, 0, 0, 0, 0, 0, 0xfb);
/// The longest packet (RFC 6762 section 17).
const LONGEST: usize = 9000;
/// The buffer that the system is asked for: many robots may answer at once.
const BUFFER: usize = 4 << 20;

/// A socket for each interface.
#[derive(Debug)]
pub(super) struct Ears {
    port: u16,
    ears: Vec<Ear>,
}

#[derive(Debug)]
struct Ear {
    post: Post,
    socket: UdpSocket,
}

/// A packet that was heard.
pub(super) struct Packet {
    pub(super) octets: Vec<u8>,
    pub(super) from: SocketAddr,
    pub(super) on_loopback: bool,
}

impl Ears {
    pub(super) fn new(port: u16) -> Ears {
        let ears = Vec::new();
        Ears { port, ears }
    }

    /// Listens at these addresses and no others. Tells whether there is an address where nobody
    /// was listening before, and the error of the last one where that cannot be.
    pub(super) fn listen_at(&mut self, posts: &[Post]) -> (bool, Option<io::Error>) {
        self.ears.retain(|ear| posts.contains(&ear.post));
        let (mut new, mut failed) = (false, None);
        for post in posts {
            if self.ears.iter().any(|ear| ear.post == *post) {
                continue;
            }
            match open(post.address, self.port) {
                Ok(socket) => {
                    new = true;
                    let post = post.clone();
                    self.ears.push(Ear { post, socket });
                }
                Err(error) => failed = Some(error),
            }
        }
        (new, failed)
    }

    /// The next packet. Cancel-safe.
    pub(super) async fn hear(&self) -> Packet {
        std::future::poll_fn(|context| {
            for ear in &self.ears {
                let mut octets = [0; LONGEST];
                let mut buffer = ReadBuf::new(&mut octets);
                match ear.socket.poll_recv_from(context, &mut buffer) {
                    Poll::Ready(Ok(from)) => {
                        return Poll::Ready(Packet {
                            octets: buffer.filled().to_vec(),
                            from,
                            on_loopback: ear.post.on_loopback,
                        });
                    }
                    Poll::Ready(Err(error)) => {
                        tracing::debug!("mDNS at {}: {error}", ear.post.address);
                        context.waker().wake_by_ref();
                    }
                    Poll::Pending => {}
                }
            }
            Poll::Pending
        })
        .await
    }

    /// Sends a packet to one who asked.
    pub(super) fn send_to(&self, to: SocketAddr, packet: &[u8]) {
        let Some(ear) = self.ears.first() else {
            return;
        };
        if let Err(error) = ear.socket.try_send_to(packet, to) {
            tracing::debug!("mDNS to {to}: {error}");
        }
    }

    /// Sends a packet on all interfaces. What is lost is asked for again.
    pub(super) fn send(&self, packet: &[u8]) {
        let group = SocketAddr::from((GROUP, self.port));
        for ear in &self.ears {
            if let Err(error) = ear.socket.try_send_to(packet, group) {
                tracing::debug!("mDNS at {}: {error}", ear.post.address);
            }
        }
    }
}

/// A socket that hears what is sent to the group on the interface with this address, and sends there.
pub(crate) fn open(address: Ipv4Addr, port: u16) -> io::Result<UdpSocket> {
    let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
    socket.set_reuse_address(true)?;
    #[cfg(unix)]
    socket.set_reuse_port(true)?;
    // At the address of the group only what is sent to the group arrives: what is meant for one
    // socket of this port alone goes to the one that answers.
    #[cfg(unix)]
    let local = SocketAddrV4::new(GROUP, port);
    #[cfg(not(unix))]
    let local = SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, port);
    socket.bind(&SocketAddr::V4(local).into())?;
    // Otherwise it hears on interfaces on which other programs listen.
    #[cfg(target_os = "linux")]
    socket.set_multicast_all_v4(false)?;
    socket.join_multicast_v4(&GROUP, &address)?;
    socket.set_multicast_if_v4(&address)?;
    socket.set_multicast_ttl_v4(255)?;
    if let Err(error) = socket.set_recv_buffer_size(BUFFER) {
        tracing::debug!("mDNS at {address}: {error}");
    }
    socket.set_nonblocking(true)?;
    UdpSocket::from_std(socket.into())
}

/// The same for IPv6, on the interface with this index.
pub(crate) fn open_v6(index: u32, port: u16) -> io::Result<UdpSocket> {
    let socket = Socket::new(Domain::IPV6, Type::DGRAM, Some(Protocol::UDP))?;
    socket.set_only_v6(true)?;
    socket.set_reuse_address(true)?;
    #[cfg(unix)]
    socket.set_reuse_port(true)?;
    #[cfg(unix)]
    let local = SocketAddrV6::new(GROUP_V6, port, 0, index);
    #[cfg(not(unix))]
    let local = SocketAddrV6::new(Ipv6Addr::UNSPECIFIED, port, 0, 0);
    socket.bind(&SocketAddr::V6(local).into())?;
    #[cfg(target_os = "linux")]
    socket.set_multicast_all_v6(false)?;
    socket.join_multicast_v6(&GROUP_V6, index)?;
    socket.set_multicast_if_v6(index)?;
    socket.set_multicast_hops_v6(255)?;
    socket.set_nonblocking(true)?;
    UdpSocket::from_std(socket.into())
}
