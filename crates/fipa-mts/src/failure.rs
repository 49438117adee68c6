//! Notices of failure: what a message transport service tells the sender of a letter that it could
//! not deliver (SC00067F section 4, SC00023K section 5).
//!
//! Written as the standard has it, with the reason as a term of SL0; read as it is written here, by
//! JADE and by `fipa_services`, which puts a message into the content instead.

use bytes::Bytes;
use fipa_acl::{AgentId, Expression, Message, Performative, Text};
use fipa_codec::{Limits, decode_message_prefix};
use fipa_sl::{Content, Functional, Term, agent_id};

/// The ontology of what services and agents tell each other about the platform.
const ONTOLOGY: &str = "fipa-agent-management";

/// The proposition about a letter that was not delivered.
const MTS_ERROR: &str = "MTS-error";

/// The reason that is a text for people.
const INTERNAL_ERROR: &str = "internal-error";

/// The parameter by which a sender says that it wants no notice.
const IGNORE_FAILURE: &str = "JADE-ignore-failure";

/// A notice of failure that came: which service could not deliver a message, to whom, and why.
///
/// ```
/// use fipa_acl::{Message, Performative};
/// use fipa_mts::DeliveryFailure;
///
/// let notice = Message::new(Performative::Failure)
///     .from_agent("mts@robot2")
///     .ontology("fipa-agent-management")
///     .content(
///         "((action (agent-identifier :name mts@robot2) \
///            (deliver (agent-identifier :name b@robot2))) \
///           (MTS-error (agent-identifier :name b@robot2) (internal-error \"no such agent\")))",
///     );
/// let failure = DeliveryFailure::of(&notice).unwrap();
/// assert_eq!(failure.receivers[0].name, "b@robot2");
/// assert_eq!(failure.to_string(), "mts@robot2 could not deliver it to b@robot2: no such agent");
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeliveryFailure {
    /// The service that gave up, if the notice names its sender.
    pub service: Option<AgentId>,
    /// Who did not get the message. `fipa_services` names all whom the letter was for.
    pub receivers: Vec<AgentId>,
    /// Why, in words.
    pub reason: Text,
}

impl DeliveryFailure {
    /// What a message tells, if it is a notice of failure. What an agent says about its own failure
    /// is none.
    pub fn of(message: &Message) -> Option<DeliveryFailure> {
        let content = message.content.as_ref()?;
        if message.performative != Performative::Failure {
            return None;
        }
        let (receivers, reason) = told_in_sl(content).or_else(|| {
            let ours = |ontology: &Expression| ontology.to_string().eq_ignore_ascii_case(ONTOLOGY);
            let of_services = message.ontology.as_ref().is_some_and(ours);
            of_services.then(|| told_by_message(content))?
        })?;
        Some(DeliveryFailure {
            service: message.sender.clone(),
            receivers,
            reason,
        })
    }
}

impl std::fmt::Display for DeliveryFailure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let service = self.service.as_ref().map(|service| service.name.as_str());
        let names: Vec<&str> = self.receivers.iter().map(|r| r.name.as_str()).collect();
        let (service, to) = (service.unwrap_or("a service"), names.join(" "));
        write!(f, "{service} could not deliver it to {to}: {}", self.reason)
    }
}

/// `(… (MTS-error RECEIVER (internal-error "why")))`, or another reason in the place of the last.
fn told_in_sl(content: &Bytes) -> Option<(Vec<AgentId>, Text)> {
    let content = Content::parse(content, &fipa_sl::Limits::default()).ok()?;
    let mut errors = content
        .expressions()
        .filter_map(|expression| expression.functional(MTS_ERROR));
    let error = errors.next()?.positional();
    let receiver = agent_id(error.first()?).ok()?;
    let reason = error.get(1)?;
    let text = match reason
        .functional(INTERNAL_ERROR)
        .map(Functional::positional)
    {
        Some([text]) => text.as_text(),
        _ => None,
    };
    let text = text.unwrap_or_else(|| Text::from(reason.to_string()));
    Some((vec![receiver], text))
}

/// `(inform … :content "description: why\ndelivery path: …" :language internal-error)`: a message as
/// the content, in string form.
fn told_by_message(content: &Bytes) -> Option<(Vec<AgentId>, Text)> {
    let string = fipa_acl::Representation::String;
    let (told, _) = decode_message_prefix(&string, content, &Limits::default()).ok()?;
    let of_service = told.language.as_ref()?.to_string();
    if of_service.trim_matches('"') != INTERNAL_ERROR {
        return None;
    }
    let text = told.content_str()?;
    let lines: Vec<&str> = text.lines().map(|line| line.trim()).collect();
    let reason = lines.join(", ");
    let reason = reason.strip_prefix("description: ").unwrap_or(&reason);
    Some((told.receiver, Text::from(reason)))
}

/// Whether the sender of a message is to be told that it was not delivered: not of a failure, nor
/// where it does not want to know.
pub(crate) fn is_wanted(message: &Message) -> bool {
    let ignores = |name: &str, value: &Expression| {
        let value = value.to_string();
        name.eq_ignore_ascii_case(IGNORE_FAILURE)
            && value
                .trim_matches(['"', '(', ')'])
                .eq_ignore_ascii_case("true")
    };
    let mut parameters = message.user_defined.iter();
    message.performative != Performative::Failure
        && !parameters.any(|parameter| ignores(&parameter.name, &parameter.value))
}

/// The notice of `service` to `sender` that its message did not get to a receiver.
pub(crate) fn notice(
    service: &Text,
    sender: &AgentId,
    failed: &Message,
    receiver: &Text,
    why: &str,
) -> Message {
    let service = AgentId::new(service.clone());
    let receiver = Term::from(&AgentId::new(receiver.clone()));
    let deliver = Functional::new("deliver", [receiver.clone()]);
    let action = Functional::action(Term::from(&service), deliver.into());
    let reason = Functional::new(INTERNAL_ERROR, [Term::text(why)]);
    let error = Functional::new(MTS_ERROR, [receiver, reason.into()]);
    let mut notice = Message::new(Performative::Failure)
        .from_agent(service)
        .to(sender.clone())
        .ontology(ONTOLOGY)
        .language("fipa-sl0")
        .content(Content::new(action).and(error).to_bytes());
    notice.conversation_id = failed.conversation_id.clone();
    notice.protocol = failed.protocol.clone();
    notice.in_reply_to = failed.reply_with.clone();
    notice
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recorded(name: &str) -> Bytes {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/vectors/");
        Bytes::from(std::fs::read(format!("{folder}{name}")).unwrap())
    }

    fn message(representation: fipa_acl::Representation, octets: &Bytes) -> Message {
        let read = decode_message_prefix(&representation, octets, &Limits::default());
        read.unwrap().0
    }

    #[test]
    fn what_was_written_is_read_again_and_looks_as_the_standard_has_it() {
        let failed = Message::new(Performative::Request)
            .from_agent("a@r1")
            .to("b@r2")
            .protocol("fipa-request")
            .conversation_id("c-1")
            .reply_with("r-1");
        let sender = AgentId::new("a@r1").address("tcp://10.0.0.1:1");
        let told = notice(
            &"mts@r2".into(),
            &sender,
            &failed,
            &"b@r2".into(),
            "it is gone",
        );
        assert_eq!(
            told.content_str(),
            Some(
                "((action (agent-identifier :name mts@r2) (deliver (agent-identifier :name b@r2))) \
                 (MTS-error (agent-identifier :name b@r2) (internal-error \"it is gone\")))"
            )
        );
        assert_eq!(told.performative, Performative::Failure);
        assert_eq!(told.sender, Some(AgentId::new("mts@r2")));
        assert_eq!(told.receiver, [sender]);
        assert_eq!(told.ontology, Some("fipa-agent-management".into()));
        assert_eq!(told.language, Some("fipa-sl0".into()));
        assert_eq!(told.conversation_id, failed.conversation_id);
        assert_eq!(told.protocol, failed.protocol);
        assert_eq!(told.in_reply_to, failed.reply_with);
        assert_eq!(told.reply_with, None);
        let read = DeliveryFailure::of(&told).unwrap();
        assert_eq!(read.receivers, [AgentId::new("b@r2")]);
        assert_eq!(read.reason, "it is gone");
        assert!(!is_wanted(&told));
    }

    #[test]
    fn notices_of_fipa_services_are_understood_in_every_representation() {
        use fipa_acl::Representation::{BitEfficient, String, Xml};
        for (representation, name) in [
            (BitEfficient, "bitefficient"),
            (String, "string"),
            (Xml, "xml"),
        ] {
            let octets = recorded(&format!("fipa_acl/mts_error_failure.{name}.bin"));
            let read = DeliveryFailure::of(&message(representation, &octets)).unwrap();
            assert_eq!(
                read.to_string(),
                "mts-0 could not deliver it to agent9: \
                 message delivery failed, delivery path: mts-0"
            );
        }
    }

    #[test]
    fn notices_that_fipa_services_sent_name_all_receivers() {
        let expected = [
            ("02", &["unregistered-1", "unregistered-2"][..]),
            ("07", &["odd-sig"]),
            ("08", &["fail-x"]),
        ];
        for (number, names) in expected {
            let octets = recorded(&format!("mts/sent_{number}_to_agent-a.bin"));
            let letter = fipa_codec::decode_letter(&octets, &Limits::default()).unwrap();
            let read =
                fipa_codec::decode_payload(&letter.envelope, &letter.payload, &Limits::default());
            let failure = DeliveryFailure::of(&read.unwrap()).unwrap();
            let told: Vec<&str> = failure.receivers.iter().map(|r| r.name.as_str()).collect();
            assert_eq!(told, names);
        }
    }

    #[test]
    fn notices_of_jade_are_understood() {
        for name in [
            "unknown-agent",
            "unknown-agent-inform",
            "unknown-agent-nocontent",
        ] {
            let octets = recorded(&format!("jade/in_{name}.reply.acl"));
            let notice = message(fipa_acl::Representation::String, &octets);
            let read = DeliveryFailure::of(&notice).unwrap();
            assert_eq!(read.service.as_ref().unwrap().name, "ams@platA");
            assert_eq!(read.receivers[0].name, "nobody@platA");
            assert!(read.reason.starts_with("Agent not found"), "{read}");
        }
    }

    #[test]
    fn an_agent_that_tells_of_its_own_failure_gives_no_notice() {
        let said = |content: &'static str| {
            Message::new(Performative::Failure)
                .ontology(ONTOLOGY)
                .content(content)
        };
        for content in [
            "((action (agent-identifier :name df@x) (register x)) already-registered)",
            "(inform :content \"all is well\")",
            "((MTS-error))",
            "",
        ] {
            assert_eq!(DeliveryFailure::of(&said(content)), None, "{content}");
        }
        let inform = Message::new(Performative::Inform)
            .content("((MTS-error (agent-identifier :name b) (internal-error x)))");
        assert_eq!(DeliveryFailure::of(&inform), None);
    }

    #[test]
    fn a_sender_that_does_not_want_to_know_is_not_told() {
        let asked = |value: &str| {
            let message = Message::new(Performative::Inform);
            is_wanted(&message.user_defined("X-JADE-ignore-failure", value))
        };
        assert!(!asked("true"));
        assert!(!asked("TRUE"));
        assert!(asked("false"));
        assert!(is_wanted(&Message::new(Performative::Inform)));
    }
}
