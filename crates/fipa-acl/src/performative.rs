use std::fmt;

use crate::Text;

macro_rules! performatives {
    ($($(#[$doc:meta])* $variant:ident $name:literal)*) => {
        /// The kind of communicative act (FIPA SC00037J): the 22 of the standard, or another word.
        ///
        /// ```
        /// use fipa_acl::Performative;
        /// assert_eq!(Performative::from("QUERY-REF"), Performative::QueryRef);
        /// assert_eq!(Performative::QueryRef.as_str(), "query-ref");
        /// assert_eq!(Performative::from("Shout").as_str(), "Shout");
        /// ```
        #[derive(Clone, Debug, PartialEq, Eq, Hash)]
        pub enum Performative {
            $($(#[$doc])* $variant,)*
            /// Any other word, kept as it came.
            Other(Text),
        }

        impl Performative {
            /// The 22 acts of the standard in its (alphabetical) order, which is that of their
            /// bit-efficient codes 1 to 22.
            pub const STANDARD: [Performative; 22] = [$(Performative::$variant,)*];

            /// The name in lower case, as the standard writes it.
            pub fn as_str(&self) -> &str {
                match self {
                    $(Performative::$variant => $name,)*
                    Performative::Other(name) => name,
                }
            }
        }
    };
}

performatives! {
    /// Accept an earlier proposal to perform an action.
    AcceptProposal "accept-proposal"
    /// Agree to perform a requested action.
    Agree "agree"
    /// Withdraw an earlier request.
    Cancel "cancel"
    /// Call for proposals to perform an action.
    Cfp "cfp"
    /// Tell someone unsure that a proposition is true.
    Confirm "confirm"
    /// Tell someone who believes a proposition that it is false.
    Disconfirm "disconfirm"
    /// Tell that an action was attempted and failed, and why.
    Failure "failure"
    /// Tell that a proposition is true.
    Inform "inform"
    /// Tell whether a proposition is true.
    InformIf "inform-if"
    /// Tell the object that matches a description.
    InformRef "inform-ref"
    /// Tell that a received act was not understood, and why.
    NotUnderstood "not-understood"
    /// Pass the embedded message on to agents that match a description.
    Propagate "propagate"
    /// Propose to perform an action under conditions.
    Propose "propose"
    /// Select agents that match a description and send them the embedded message.
    Proxy "proxy"
    /// Ask whether a proposition is true.
    QueryIf "query-if"
    /// Ask for the object that matches a referential expression.
    QueryRef "query-ref"
    /// Refuse to perform an action, and why.
    Refuse "refuse"
    /// Reject a proposal during a negotiation.
    RejectProposal "reject-proposal"
    /// Ask to perform an action.
    Request "request"
    /// Ask to perform an action when a proposition becomes true.
    RequestWhen "request-when"
    /// Ask to perform an action each time a proposition becomes true.
    RequestWhenever "request-whenever"
    /// Ask to be told the value of a reference whenever it changes.
    Subscribe "subscribe"
}

impl Performative {
    /// The standard act of this name, in any case; `None` for another word.
    pub fn standard(name: &str) -> Option<Performative> {
        Performative::STANDARD
            .into_iter()
            .find(|act| act.as_str().eq_ignore_ascii_case(name))
    }
}

impl From<Text> for Performative {
    fn from(name: Text) -> Performative {
        Performative::standard(&name).unwrap_or(Performative::Other(name))
    }
}

impl From<&str> for Performative {
    fn from(name: &str) -> Performative {
        Performative::from(Text::from(name))
    }
}

impl fmt::Display for Performative {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}
