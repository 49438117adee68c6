use fipa_acl::{Message, Performative, Text};

use crate::{LockView, wire};

pub(crate) const PROTOCOL: &str = "dlm_list";

/// Why an answer to [`list_query`] cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ListError {
    /// It is another message.
    #[error("this is no answer to a query for locks")]
    Other,
    /// A line is malformed.
    #[error("line {line}: {what}")]
    Line {
        /// The line, counted from 1.
        line: usize,
        /// What is wrong with it.
        what: &'static str,
    },
}

/// Asks an agent for the resources that it owns; [`read_list`] reads the answer.
pub fn list_query(to: impl Into<Text>) -> Message {
    let query = Message::new(Performative::QueryRef).to(to.into());
    query.protocol(Text::from_static(PROTOCOL))
}

pub(crate) fn answer(query: &Message, views: &[LockView]) -> Message {
    let lines: Vec<String> = views.iter().map(line).collect();
    query.reply(Performative::Inform).content(lines.join("\n"))
}

fn line(view: &LockView) -> String {
    let fencing = view.fencing.map(|number| number.to_string());
    let mut words = vec![
        fencing.unwrap_or_else(|| wire::NOBODY.to_owned()),
        word(view.holder.as_deref().unwrap_or(wire::NOBODY)),
        view.waiting.len().to_string(),
    ];
    words.extend(view.waiting.iter().map(|name| word(name)));
    words.push(view.resource.to_string());
    words.join(" ")
}

/// Names have no blanks, but what others send may.
fn word(name: &str) -> String {
    name.replace(char::is_whitespace, "?")
}

/// Reads the answer to [`list_query`]: the resources of its sender.
///
/// # Errors
/// It is another message, or malformed.
pub fn read_list(answer: &Message) -> Result<Vec<LockView>, ListError> {
    let listed = answer.protocol.as_deref() == Some(PROTOCOL);
    let sender = answer.sender.as_ref();
    let sender = sender.filter(|_| listed && answer.performative == Performative::Inform);
    let owner = &sender.ok_or(ListError::Other)?.name;
    let text = match &answer.content {
        Some(_) => answer.content_str().ok_or(ListError::Line {
            line: 1,
            what: "it is not UTF-8",
        })?,
        None => "",
    };
    if text.is_empty() {
        return Ok(Vec::new());
    }
    let lines = text.split('\n').enumerate();
    let read = lines.map(|(at, line)| {
        read_line(owner, line).map_err(|what| ListError::Line { line: at + 1, what })
    });
    read.collect()
}

fn read_line(owner: &Text, line: &str) -> Result<LockView, &'static str> {
    let mut rest = line;
    let mut next = |what: &'static str| {
        let (word, behind) = rest.split_once(' ').ok_or(what)?;
        rest = behind;
        if word.is_empty() { Err(what) } else { Ok(word) }
    };
    let fencing = match next("there is no number")? {
        wire::NOBODY => None,
        number => Some(number.parse().map_err(|_| "the number is none")?),
    };
    let holder = Some(next("there is no holder")?).filter(|name| *name != wire::NOBODY);
    let count = next("it is not said how many wait")?;
    let count: usize = count.parse().map_err(|_| "how many wait is no number")?;
    let mut waiting = Vec::new();
    for _ in 0..count {
        waiting.push(Text::from(next("fewer wait than are said to")?));
    }
    if !wire::is_resource(rest) {
        return Err("there is no resource");
    }
    Ok(LockView {
        resource: Text::from(rest),
        owner: owner.detached(),
        holder: holder.map(Text::from),
        waiting,
        fencing,
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn views() -> impl Strategy<Value = Vec<LockView>> {
        let name = || "[a-z][a-z0-9@.]{0,8}".prop_map(Text::from);
        let view = (
            "[^\n]{1,12}".prop_map(Text::from),
            proptest::option::of(name()),
            proptest::collection::vec(name(), 0..4),
            proptest::option::of(any::<u64>()),
        );
        let view = view.prop_map(|(resource, holder, waiting, fencing)| LockView {
            resource,
            owner: Text::from_static("o"),
            holder,
            waiting,
            fencing,
        });
        proptest::collection::vec(view, 0..4)
    }

    fn answered(content: &str) -> Message {
        let query = list_query("o").from_agent("a");
        answer(&query, &[])
            .from_agent("o")
            .content(content.to_owned())
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(views in views()) {
            let query = list_query("o").from_agent("a");
            let answer = answer(&query, &views).from_agent("o");
            prop_assert_eq!(read_list(&answer).unwrap(), views);
        }

        #[test]
        fn nothing_that_comes_breaks_the_reader(content in "[-a 0-9\n]{0,40}") {
            let _ = read_list(&answered(&content));
        }
    }

    #[test]
    fn what_is_malformed_is_named_with_its_line() {
        for (content, line, what) in [
            ("1 - 0 door\n", 2, "there is no number"),
            ("x - 0 door", 1, "the number is none"),
            ("1 - 9 a b door", 1, "fewer wait than are said to"),
            (
                "1 - 99999999999999999999 door",
                1,
                "how many wait is no number",
            ),
            ("1 - 0 ", 1, "there is no resource"),
        ] {
            let error = read_list(&answered(content)).unwrap_err();
            assert_eq!(error, ListError::Line { line, what }, "{content:?}");
        }
        let other = Message::new(Performative::Inform).from_agent("o");
        assert_eq!(read_list(&other), Err(ListError::Other));
    }
}
