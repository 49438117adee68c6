use bytes::{BufMut, Bytes, BytesMut};
use fipa_acl::Text;
use fipa_directory::InstanceId;

use crate::wire::{FrameError, Reader, put_list, put_text};

/// Who speaks on a link: the first frame in each direction.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Hello {
    /// The version of the frames' meaning. A newer peer must be understood by an older one.
    pub version: u16,
    /// Daemon or program.
    pub role: Role,
    /// This run of the speaker.
    pub instance: InstanceId,
    /// The name of its message transport service, or of the program.
    pub name: Text,
    /// The fleet that it belongs to; links between different scopes are refused.
    pub scope: Text,
    /// Where it takes letters.
    pub endpoints: Vec<Text>,
    /// Octets of the largest letter that it takes.
    pub max_letter: u64,
    /// Its clock, in milliseconds since 1970-01-01T00:00:00Z.
    pub unix_millis: i64,
    /// Whether it wants checksums in the frames that follow, and writes them if the other side
    /// wants them, too.
    pub checks: bool,
}

/// The bit for [`Hello::checks`].
const CHECKS: u8 = 1;

/// What kind of partner speaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// A message transport service.
    Daemon,
    /// A program that attaches agents to its daemon.
    Program,
}

impl Hello {
    /// The version that this crate speaks.
    pub const VERSION: u16 = 1;

    pub(crate) fn put(&self, out: &mut BytesMut) {
        let begin = out.len();
        out.put_u16(self.version);
        out.put_u8(match self.role {
            Role::Daemon => 0,
            Role::Program => 1,
        });
        out.put_slice(self.instance.as_bytes());
        put_text(out, &self.name);
        put_text(out, &self.scope);
        put_list(out, &self.endpoints, |out, endpoint| {
            put_text(out, endpoint)
        });
        out.put_u64(self.max_letter);
        out.put_i64(self.unix_millis);
        out.put_u8(if self.checks { CHECKS } else { 0 });
        let sum = crc32fast::hash(&out[begin..]);
        out.put_u32(sum);
    }

    pub(crate) fn read(body: Bytes) -> Result<Hello, FrameError> {
        let mut reader = Reader::new(body.clone(), "hello");
        let mut hello = Hello {
            version: reader.u16()?,
            role: match reader.u8()? {
                0 => Role::Daemon,
                1 => Role::Program,
                _ => return Err(reader.undefined()),
            },
            instance: reader.instance()?,
            name: reader.text()?,
            scope: reader.text()?,
            endpoints: reader.list(Reader::text)?,
            max_letter: reader.u64()?,
            unix_millis: reader.i64()?,
            checks: false,
        };
        // Older ones end here.
        if !reader.is_empty() {
            hello.checks = reader.u8()? & CHECKS != 0;
            reader.check(&body)?;
        }
        Ok(hello)
    }
}
