//! `robot-actions`, a content language in which robots have each other act, as for docking under
//! guidance: text that people can read, and any system can take apart.
//!
//! ```text
//!   request     do dock(target: sherpa, emi: 2)        Content::Do
//!   query-ref   actions?            actions? dock      Content::AskActions
//!   query-ref   status?             status? 7          Content::AskStatus      (or subscribe)
//!   inform      actions                                Content::Actions
//!                 dock(target: text, emi: number) "Drive to an interface and lock it."
//!   inform      status                                 Content::Status
//!                 7 running 40% dock(target: sherpa, emi: 2)
//! ```
//!
//! **Knows** the text and its limits. **Never knows** what an action does, nor how messages travel.
//!
//! # Grammar
//!
//! ```text
//! content     = do | ask-actions | ask-status | actions | status
//! do          = "do" call
//! ask-actions = "actions?" [ name ]
//! ask-status  = "status?" [ number-of-task ]
//! actions     = "actions" *( signature [ string ] )
//! status      = "status" *( number-of-task state [ percent "%" ] call )
//! call        = name "(" [ name ":" value *( "," name ":" value ) ] ")"
//! signature   = name "(" [ name ":" kind *( "," name ":" kind ) ] ")"
//! kind        = "number" | "text" | "truth"
//! value       = number | "true" | "false" | name | string
//! state       = "waiting" | "running" | "done" | "failed" | "cancelled"
//! name        = letter *( letter | digit | "-" | "_" | "." | "@" )
//! number      = [ "-" ] 1*digit [ "." 1*digit ]
//! string      = <"> *( any character but <"> and "\" | "\\" | "\" <"> | "\n" ) <">
//! ```
//!
//! Letters and digits are those of ASCII. Blanks and ends of lines between two of these parts mean
//! nothing, but two names or numbers need one between them. No name stands twice in one call or
//! signature; a percentage is between 0 and 100.
//!
//! ```
//! use fipa_actions::{Content, Limits, parse};
//!
//! let content = parse("do dock(target: sherpa, emi: 2)", &Limits::default()).unwrap();
//! let Content::Do(action) = &content else { panic!() };
//! assert_eq!(action.name.as_str(), "dock");
//! assert_eq!(content.to_string(), "do dock(target: sherpa, emi: 2)");
//!
//! let error = parse("do dock(target sherpa)", &Limits::default()).unwrap_err();
//! assert_eq!(error.to_string(), "1:16: expected \":\", found \"sherpa\"");
//! ```

mod content;
mod parser;
mod print;
mod scanner;

pub use content::{
    Action, Content, Kind, Mismatch, Name, NotFinite, NotName, Number, Signature, Task, TaskState,
    Value,
};
pub use parser::{Limits, ParseError, parse};

/// The name of this language, for the language parameter of a message.
pub const LANGUAGE: &str = "robot-actions";
