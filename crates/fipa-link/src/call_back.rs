use bytes::{BufMut, BytesMut};
use fipa_acl::Text;
use fipa_directory::InstanceId;

use crate::wire::{FrameError, Reader, put_list, put_text};

/// Asks for a call back, to find out whether others reach a service.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AskCallBack {
    /// Ties the answer to the request.
    pub request: u64,
    /// Of a program: the service that is to call its own. Of a service: itself.
    pub whom: InstanceId,
    /// Where the service that asks says that it is reached; of a program nothing.
    pub addresses: Vec<Text>,
}

/// What came of being called back.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CalledBack {
    /// The request.
    pub request: u64,
    /// Why nobody was called; empty if somebody was.
    pub refusal: Text,
    /// One call an address.
    pub calls: Vec<CallBack>,
}

/// A call to one address.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CallBack {
    /// The address.
    pub address: Text,
    /// How it went.
    pub result: CallBackResult,
    /// That in words; empty where all went well.
    pub reason: Text,
}

/// How a call back went.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CallBackResult {
    /// The service that had asked answered.
    Answered,
    /// The host is there, and nobody listens.
    Refused,
    /// Nobody was reached, in time or at all.
    NotReached,
    /// Somebody else accepted the connection.
    Stranger,
    /// The address was not called.
    Untried,
}

const RESULTS: [CallBackResult; 5] = [
    CallBackResult::Answered,
    CallBackResult::Refused,
    CallBackResult::NotReached,
    CallBackResult::Stranger,
    CallBackResult::Untried,
];

impl AskCallBack {
    pub(crate) fn put(&self, out: &mut BytesMut) {
        out.put_u64(self.request);
        out.put_slice(self.whom.as_bytes());
        put_list(out, &self.addresses, |out, address| put_text(out, address));
    }

    pub(crate) fn read(mut reader: Reader) -> Result<AskCallBack, FrameError> {
        Ok(AskCallBack {
            request: reader.u64()?,
            whom: reader.instance()?,
            addresses: reader.list(Reader::text)?,
        })
    }
}

impl CalledBack {
    pub(crate) fn put(&self, out: &mut BytesMut) {
        out.put_u64(self.request);
        put_text(out, &self.refusal);
        put_list(out, &self.calls, |out, call| {
            put_text(out, &call.address);
            out.put_u8(call.result as u8);
            put_text(out, &call.reason);
        });
    }

    pub(crate) fn read(mut reader: Reader) -> Result<CalledBack, FrameError> {
        Ok(CalledBack {
            request: reader.u64()?,
            refusal: reader.text()?,
            calls: reader.list(|reader| {
                Ok(CallBack {
                    address: reader.text()?,
                    result: *RESULTS
                        .get(usize::from(reader.u8()?))
                        .ok_or(reader.undefined())?,
                    reason: reader.text()?,
                })
            })?,
        })
    }
}
