use fipa_acl::Performative;

/// The elements that are known, and what else an element can be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Tag {
    AclRepresentation,
    Addresses,
    AgentIdentifier,
    Comments,
    Content,
    ConversationId,
    Date,
    Encoding,
    Envelope,
    FipaMessage,
    From,
    InReplyTo,
    IntendedReceiver,
    Language,
    Name,
    Ontology,
    Params,
    PayloadEncoding,
    PayloadLength,
    Protocol,
    Received,
    ReceivedBy,
    ReceivedDate,
    ReceivedFrom,
    ReceivedId,
    ReceivedVia,
    Receiver,
    ReplyBy,
    ReplyTo,
    ReplyWith,
    Resolvers,
    Sender,
    To,
    TransportBehaviour,
    Url,
    UserDefined,
    /// Its name begins with `X-`: a parameter outside the standard.
    Extension,
    /// To be ignored.
    Unknown,
}

/// Octets of the longest name that is known.
pub(super) const LONGEST: usize = 19;

impl Tag {
    /// The element of this local name, in any case.
    #[inline]
    pub(super) fn of(local: &[u8]) -> Tag {
        match Tag::known(local) {
            Some(tag) => tag,
            None => Tag::of_other(local),
        }
    }

    #[inline(never)]
    fn of_other(local: &[u8]) -> Tag {
        if let [b'x' | b'X', b'-', _, ..] = local {
            return Tag::Extension;
        }
        let known = in_lower_case(local, Tag::known);
        known.unwrap_or(Tag::Unknown)
    }

    /// The element of this name in lower case.
    #[inline]
    pub(super) fn known(local: &[u8]) -> Option<Tag> {
        Some(match local {
            b"acl-representation" => Tag::AclRepresentation,
            b"addresses" => Tag::Addresses,
            b"agent-identifier" => Tag::AgentIdentifier,
            b"comments" => Tag::Comments,
            b"content" => Tag::Content,
            b"conversation-id" => Tag::ConversationId,
            b"date" => Tag::Date,
            b"encoding" => Tag::Encoding,
            b"envelope" => Tag::Envelope,
            b"fipa-message" => Tag::FipaMessage,
            b"from" => Tag::From,
            b"in-reply-to" => Tag::InReplyTo,
            b"intended-receiver" => Tag::IntendedReceiver,
            b"language" => Tag::Language,
            b"name" => Tag::Name,
            b"ontology" => Tag::Ontology,
            b"params" => Tag::Params,
            b"payload-encoding" => Tag::PayloadEncoding,
            b"payload-length" => Tag::PayloadLength,
            b"protocol" => Tag::Protocol,
            b"received" => Tag::Received,
            b"received-by" => Tag::ReceivedBy,
            b"received-date" => Tag::ReceivedDate,
            b"received-from" => Tag::ReceivedFrom,
            b"received-id" => Tag::ReceivedId,
            b"received-via" => Tag::ReceivedVia,
            b"receiver" => Tag::Receiver,
            b"reply-by" => Tag::ReplyBy,
            b"reply-to" => Tag::ReplyTo,
            b"reply-with" => Tag::ReplyWith,
            b"resolvers" => Tag::Resolvers,
            b"sender" => Tag::Sender,
            b"to" => Tag::To,
            b"transport-behaviour" => Tag::TransportBehaviour,
            b"url" => Tag::Url,
            b"user-defined" => Tag::UserDefined,
            _ => return None,
        })
    }
}

/// The act of this name in any case; `None` for one outside the standard.
///
/// Comparing with every name takes longer than reading a whole short message.
pub(super) fn act_of(name: &[u8]) -> Option<Performative> {
    standard_act(name).or_else(|| in_lower_case(name, standard_act))
}

fn standard_act(name: &[u8]) -> Option<Performative> {
    Some(match name {
        b"accept-proposal" => Performative::AcceptProposal,
        b"agree" => Performative::Agree,
        b"cancel" => Performative::Cancel,
        b"cfp" => Performative::Cfp,
        b"confirm" => Performative::Confirm,
        b"disconfirm" => Performative::Disconfirm,
        b"failure" => Performative::Failure,
        b"inform" => Performative::Inform,
        b"inform-if" => Performative::InformIf,
        b"inform-ref" => Performative::InformRef,
        b"not-understood" => Performative::NotUnderstood,
        b"propagate" => Performative::Propagate,
        b"propose" => Performative::Propose,
        b"proxy" => Performative::Proxy,
        b"query-if" => Performative::QueryIf,
        b"query-ref" => Performative::QueryRef,
        b"refuse" => Performative::Refuse,
        b"reject-proposal" => Performative::RejectProposal,
        b"request" => Performative::Request,
        b"request-when" => Performative::RequestWhen,
        b"request-whenever" => Performative::RequestWhenever,
        b"subscribe" => Performative::Subscribe,
        _ => return None,
    })
}

fn in_lower_case<T>(name: &[u8], find: impl FnOnce(&[u8]) -> Option<T>) -> Option<T> {
    let mut buffer = [0; LONGEST];
    let lower = buffer.get_mut(..name.len())?;
    lower.copy_from_slice(name);
    lower.make_ascii_lowercase();
    find(lower)
}
