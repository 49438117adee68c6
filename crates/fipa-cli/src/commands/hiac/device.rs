//! `fipa hiac device`: an employee on a link, to try an employer with.

use hiac::content::MessageKind;
use hiac::links::{Endpoint, Node, NodeEvent};
use hiac::station::{Event, Region, Role, Sender, StationConfig};
use serde_json::{Value, json};

use crate::Failure;
use crate::attached::{self, print_json, print_line};

/// The memory at address 0, in octets, and the semaphores.
const MEMORY: usize = 256;
const SEMAPHORES: u16 = 8;

/// The options of `fipa hiac device`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Where the employer is: tcp://HOST:PORT, tcp://HOST:PORT?listen, tls://HOST:PORT?ca=FILE,
    /// tls://HOST:PORT?listen&cert=FILE&key=FILE or serial:///dev/...?baud=115200
    #[arg(value_name = "URL", value_parser = endpoint)]
    pub url: Endpoint,
    /// What it is called; at most 14 octets are told
    #[arg(long, value_name = "N")]
    pub name: Option<String>,
    /// One JSON object a line
    #[arg(long)]
    pub json: bool,
}

fn endpoint(url: &str) -> Result<Endpoint, String> {
    let endpoint: Endpoint = url
        .parse()
        .map_err(|error: hiac::links::EndpointError| error.to_string())?;
    Ok(Endpoint {
        role: Role::Employee,
        ..endpoint
    })
}

/// Is a device until interrupted.
pub(super) fn run(args: &Args) -> Result<(), Failure> {
    attached::run(async {
        let interrupted = attached::interrupted()?;
        tokio::pin!(interrupted);
        let mut node = Node::new(StationConfig {
            name: args.name.clone(),
            semaphores: SEMAPHORES,
            memory: vec![Region::new(0, MEMORY)],
            ..StationConfig::default()
        });
        let bound = node.open(&args.url).await;
        let bound = bound.map_err(|error| {
            Failure::environment(format_args!("cannot bind {}: {error}", args.url))
        })?;
        if let Some(bound) = bound {
            let line = json!({"event": "listening", "url": bound.to_string()});
            tell(args, &line)?;
        }
        loop {
            let event = tokio::select! {
                event = node.next() => event,
                () = &mut interrupted => return Ok(()),
            };
            if let Some(line) = happened(&mut node, &event) {
                tell(args, &line)?;
            }
        }
    })
}

/// Answers what is asked, and says what happened.
fn happened(node: &mut Node, event: &NodeEvent) -> Option<Value> {
    let event = match event {
        NodeEvent::Station(event) => event,
        NodeEvent::Failed(endpoint, reason) => {
            let url = endpoint.to_string();
            return Some(json!({"event": "unreachable", "url": url, "reason": reason}));
        }
        NodeEvent::Opened(_) | NodeEvent::Closed(..) => return None,
    };
    if let Event::Message {
        from,
        kind,
        reference,
        octets,
    } = event
    {
        answer(node, from, *kind, *reference, octets);
    }
    Some(match event {
        Event::Connected { own, partner, .. } => {
            json!({"event": "connected", "address": own.to_string(), "employer": partner.to_string()})
        }
        Event::Moved { own, partner, .. } => {
            json!({"event": "moved", "address": own.to_string(), "employer": partner.to_string()})
        }
        Event::Disconnected { partner, .. } => {
            json!({"event": "disconnected", "employer": partner.to_string()})
        }
        Event::Message {
            from, kind, octets, ..
        } => json!({
            "event": word(*kind),
            "from": from.address.to_string(),
            "text": String::from_utf8_lossy(octets),
            "data": hexadecimal(octets),
        }),
        Event::Signal {
            from,
            number,
            arguments,
        } => json!({
            "event": "signal",
            "from": from.address.to_string(),
            "number": number,
            "data": hexadecimal(arguments),
        }),
        Event::MemoryWritten {
            by,
            address,
            length,
        } => json!({
            "event": "written",
            "from": by.to_string(),
            "address": address,
            "length": length,
        }),
        _ => return None,
    })
}

/// A question is answered with its own octets, and a command with a reference as well.
fn answer(node: &mut Node, from: &Sender, kind: MessageKind, reference: u8, octets: &[u8]) {
    let asks = match kind {
        MessageKind::Question => true,
        MessageKind::Command => reference != 0,
        _ => false,
    };
    if asks {
        let now = node.now();
        // A connection that is gone takes the question with it.
        let _ = node
            .station()
            .reply(now, from, MessageKind::Answer, reference, octets);
    }
}

fn word(kind: MessageKind) -> &'static str {
    match kind {
        MessageKind::Information => "information",
        MessageKind::Command => "command",
        MessageKind::Question => "question",
        MessageKind::Answer => "answer",
        MessageKind::Warning => "warning",
    }
}

fn hexadecimal(octets: &[u8]) -> String {
    octets.iter().map(|octet| format!("{octet:02x}")).collect()
}

fn tell(args: &Args, line: &Value) -> Result<(), Failure> {
    if args.json {
        return print_json(line);
    }
    let values = line.as_object().into_iter().flatten();
    let words: Vec<String> = values
        .filter(|(key, _)| *key != "data")
        .map(|(key, value)| match (key.as_str(), value.as_str()) {
            ("event", Some(word)) => word.to_owned(),
            (key, Some(text)) => format!("{key} {text:?}"),
            (key, None) => format!("{key} {value}"),
        })
        .collect();
    print_line(words.join("  "))
}
