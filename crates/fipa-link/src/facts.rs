use bytes::{BufMut, BytesMut};
use fipa_acl::Text;
use fipa_directory::InstanceId;

use crate::wire::{FrameError, Reader, put_list, put_text};

/// What a service knows of itself and of others, for people who look for a fault.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Facts {
    /// This run of it.
    pub instance: InstanceId,
    /// The name of the service.
    pub name: Text,
    /// The fleet that it belongs to.
    pub scope: Text,
    /// Where it says that it is reached.
    pub endpoints: Vec<Text>,
    /// The UDP port at which it speaks mDNS; `None`: it speaks none.
    pub mdns_port: Option<u16>,
    /// Agents that are not announced to C++ robots, and why.
    pub left_out: Vec<(Text, Text)>,
    /// The others.
    pub peers: Vec<PeerFacts>,
}

/// What a service knows of another one, or of an address at which it looks for one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PeerFacts {
    /// The run of it; `None` while nobody has answered at the address.
    pub instance: Option<InstanceId>,
    /// Its name; empty while it is not known.
    pub name: Text,
    /// Where it is dialled, best first.
    pub addresses: Vec<Text>,
    /// Whether mDNS tells of it.
    pub announced: bool,
    /// For how many milliseconds nothing has come over the link with it; `None`: there is none.
    pub heard_millis: Option<u64>,
    /// Why it is not linked.
    pub error: Text,
}

impl Facts {
    pub(crate) fn put(&self, out: &mut BytesMut) {
        out.put_slice(self.instance.as_bytes());
        put_text(out, &self.name);
        put_text(out, &self.scope);
        put_list(out, &self.endpoints, |out, endpoint| {
            put_text(out, endpoint)
        });
        // Nobody speaks at port 0.
        out.put_u16(self.mdns_port.unwrap_or_default());
        put_list(out, &self.left_out, |out, (name, reason)| {
            put_text(out, name);
            put_text(out, reason);
        });
        put_list(out, &self.peers, PeerFacts::put);
    }

    pub(crate) fn read(mut reader: Reader) -> Result<Facts, FrameError> {
        Ok(Facts {
            instance: reader.instance()?,
            name: reader.text()?,
            scope: reader.text()?,
            endpoints: reader.list(Reader::text)?,
            mdns_port: Some(reader.u16()?).filter(|port| *port != 0),
            left_out: reader.list(|reader| Ok((reader.text()?, reader.text()?)))?,
            peers: reader.list(PeerFacts::read)?,
        })
    }
}

impl PeerFacts {
    fn put(out: &mut BytesMut, peer: &PeerFacts) {
        out.put_u8(
            u8::from(peer.instance.is_some())
                | u8::from(peer.announced) << 1
                | u8::from(peer.heard_millis.is_some()) << 2,
        );
        if let Some(instance) = peer.instance {
            out.put_slice(instance.as_bytes());
        }
        put_text(out, &peer.name);
        put_list(out, &peer.addresses, |out, address| put_text(out, address));
        if let Some(millis) = peer.heard_millis {
            out.put_u64(millis);
        }
        put_text(out, &peer.error);
    }

    fn read(reader: &mut Reader) -> Result<PeerFacts, FrameError> {
        let flags = reader.u8()?;
        let instance = match flags & 1 {
            0 => None,
            _ => Some(reader.instance()?),
        };
        Ok(PeerFacts {
            instance,
            name: reader.text()?,
            addresses: reader.list(Reader::text)?,
            announced: flags & 2 != 0,
            heard_millis: match flags & 4 {
                0 => None,
                _ => Some(reader.u64()?),
            },
            error: reader.text()?,
        })
    }
}
