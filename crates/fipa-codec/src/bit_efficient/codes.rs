use fipa_acl::{Performative, Text};

macro_rules! acts {
    ($($code:literal $act:ident)*) => {
        /// The code of an act (SC00069G, MessageType), or the name of one outside the standard.
        pub(super) fn code_of(act: &Performative) -> Result<u8, &Text> {
            match act {
                $(Performative::$act => Ok($code),)*
                Performative::Other(name) => Err(name),
            }
        }

        /// The act of the standard with this code.
        pub(super) fn act_of(code: u8) -> Option<Performative> {
            match code {
                $($code => Some(Performative::$act),)*
                _ => None,
            }
        }
    };
}

acts! {
    0x01 AcceptProposal
    0x02 Agree
    0x03 Cancel
    0x04 Cfp
    0x05 Confirm
    0x06 Disconfirm
    0x07 Failure
    0x08 Inform
    0x09 InformIf
    0x0a InformRef
    0x0b NotUnderstood
    0x0c Propagate
    0x0d Propose
    0x0e Proxy
    0x0f QueryIf
    0x10 QueryRef
    0x11 Refuse
    0x12 RejectProposal
    0x13 Request
    0x14 RequestWhen
    0x15 RequestWhenever
    0x16 Subscribe
}
