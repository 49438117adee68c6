use fipa_acl::Performative;

use super::keywords::{Keyword, window};

macro_rules! acts {
    ($($name:literal $act:ident)*) => {
        /// The acts of the standard by their names.
        static ACTS: [(Keyword, Performative); 22] =
            [$((Keyword::new($name), Performative::$act),)*];
    };
}

acts! {
    b"accept-proposal" AcceptProposal
    b"agree" Agree
    b"cancel" Cancel
    b"cfp" Cfp
    b"confirm" Confirm
    b"disconfirm" Disconfirm
    b"failure" Failure
    b"inform" Inform
    b"inform-if" InformIf
    b"inform-ref" InformRef
    b"not-understood" NotUnderstood
    b"propagate" Propagate
    b"propose" Propose
    b"proxy" Proxy
    b"query-if" QueryIf
    b"query-ref" QueryRef
    b"refuse" Refuse
    b"reject-proposal" RejectProposal
    b"request" Request
    b"request-when" RequestWhen
    b"request-whenever" RequestWhenever
    b"subscribe" Subscribe
}

/// The act of the standard with this name in any case.
pub(super) fn act_named(name: &[u8]) -> Option<Performative> {
    let window = window(name);
    let (_, act) = ACTS
        .iter()
        .find(|(keyword, _)| keyword.len == name.len() && keyword.begins(window))?;
    Some(act.clone())
}
