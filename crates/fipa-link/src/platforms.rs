use bytes::{BufMut, BytesMut};
use fipa_acl::Text;
use fipa_directory::InstanceId;

use crate::wire::{FrameError, Reader, put_list, put_part, put_text};

/// A platform that the speaker has an open link with, or the speaker itself.
///
/// It says where to dial, not what to believe: who hears of a platform knows its agents only once
/// it has a link of its own. Each stands behind its length, so that later versions can add to it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct KnownPlatform {
    /// This run of it.
    pub instance: InstanceId,
    /// The name of its message transport service.
    pub name: Text,
    /// The fleet that it belongs to.
    pub scope: Text,
    /// Where it takes letters, best first.
    pub addresses: Vec<Text>,
    /// For how many milliseconds the speaker has heard nothing from it.
    pub age_millis: u64,
}

impl KnownPlatform {
    pub(crate) fn put(out: &mut BytesMut, platform: &KnownPlatform) {
        put_part(out, |out| {
            out.put_slice(platform.instance.as_bytes());
            put_text(out, &platform.name);
            put_text(out, &platform.scope);
            put_list(out, &platform.addresses, |out, address| {
                put_text(out, address);
            });
            out.put_u64(platform.age_millis);
        });
    }

    pub(crate) fn read(reader: &mut Reader) -> Result<KnownPlatform, FrameError> {
        let mut reader = reader.part()?;
        Ok(KnownPlatform {
            instance: reader.instance()?,
            name: reader.text()?,
            scope: reader.text()?,
            addresses: reader.list(Reader::text)?,
            age_millis: reader.u64()?,
        })
    }
}
