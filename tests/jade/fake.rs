//! A platform that reads and writes HTTP as JADE 4.6 does, with its oddities: its server looks at
//! lines and delimiters and at no length, its answers have bodies without one, and what it does
//! not like it closes without a word.

use std::collections::HashMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, mpsc};
use std::time::Duration;

use bytes::Bytes;
use fipa::{AgentId, Letter, Message, Performative};
use fipa_codec::{
    Dialect, EnvelopeRepresentation, Limits, Output, decode_envelope, decode_payload,
    encode_message_as,
};

use crate::support::PATIENCE;

/// A letter as it was posted to the fake.
pub(crate) struct Received {
    pub(crate) letter: Letter,
    pub(crate) message: Message,
}

/// The fake, which ends with the test.
pub(crate) struct Jade {
    pub(crate) port: u16,
    name: &'static str,
    letters: Mutex<mpsc::Receiver<Received>>,
    shared: Arc<Shared>,
}

struct Shared {
    name: &'static str,
    url: String,
    letters: mpsc::Sender<Received>,
    /// What is odd in the next answers.
    mute: AtomicUsize,
    closed: AtomicBool,
    answers: bool,
    /// Agents beside the AMS, the DF and `echo`.
    others: AtomicUsize,
    /// Connections to others that are kept.
    kept: Mutex<HashMap<String, TcpStream>>,
}

impl Jade {
    /// A platform whose agents answer: its AMS, and `echo`.
    pub(crate) fn start(name: &'static str) -> Jade {
        Jade::with_answers(name, true)
    }

    /// A platform that answers nothing; the test takes what comes.
    pub(crate) fn silent(name: &'static str) -> Jade {
        Jade::with_answers(name, false)
    }

    fn with_answers(name: &'static str, answers: bool) -> Jade {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        let (sender, letters) = mpsc::channel();
        let shared = Arc::new(Shared {
            name,
            url: format!("http://127.0.0.1:{port}/acc"),
            letters: sender,
            mute: AtomicUsize::new(0),
            closed: AtomicBool::new(false),
            answers,
            others: AtomicUsize::new(0),
            kept: Mutex::default(),
        });
        let accepting = Arc::clone(&shared);
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                let shared = Arc::clone(&accepting);
                if shared.closed.load(Ordering::SeqCst) {
                    return;
                }
                std::thread::spawn(move || shared.serve(stream.unwrap()));
            }
        });
        Jade {
            port,
            name,
            letters: Mutex::new(letters),
            shared,
        }
    }

    pub(crate) fn url(&self) -> &str {
        &self.shared.url
    }

    pub(crate) fn agent(&self, local: &str) -> AgentId {
        AgentId::new(format!("{local}@{}", self.name)).address(self.url())
    }

    /// So many of the next requests are read, and their connections closed without an answer.
    pub(crate) fn close_without_answer(&self, requests: usize) {
        self.shared.mute.store(requests, Ordering::SeqCst);
    }

    /// So many more agents live there, `agent0` and so on.
    pub(crate) fn has_more_agents(&self, agents: usize) {
        self.shared.others.store(agents, Ordering::SeqCst);
    }

    /// The platform is gone.
    pub(crate) fn end(&self) {
        self.shared.closed.store(true, Ordering::SeqCst);
        let _ = TcpStream::connect(("127.0.0.1", self.port));
    }

    /// The next letter that was posted to it.
    pub(crate) fn letter(&self) -> Received {
        let letters = self.letters.lock().unwrap();
        letters.recv_timeout(PATIENCE).expect("no letter came")
    }

    /// That nothing comes for a while.
    pub(crate) fn nothing_comes(&self) {
        let letters = self.letters.lock().unwrap();
        assert!(letters.recv_timeout(Duration::from_millis(300)).is_err());
    }

    /// Sends a message as its agents do.
    pub(crate) fn send(&self, message: &Message, url: &str) {
        self.shared.send(message, url);
    }
}

impl Drop for Jade {
    fn drop(&mut self) {
        self.end();
    }
}

impl Shared {
    fn serve(self: Arc<Self>, stream: TcpStream) {
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let mut reader = BufReader::new(stream.try_clone().unwrap());
        let mut writer = stream;
        while let Some((envelope, payload)) = read_request(&mut reader) {
            if self.closed.load(Ordering::SeqCst) {
                return;
            }
            let mute = self.mute.load(Ordering::SeqCst);
            if mute > 0 {
                self.mute.store(mute - 1, Ordering::SeqCst);
                return;
            }
            // An envelope that it cannot read, it does not answer.
            let Some(received) = letter(envelope, payload) else {
                return;
            };
            let answer = "HTTP/1.1 200 OK\r\nContent-Type: text/html\r\n\
                Cache-Control: no-cache\r\nConnection: Keep-Alive\r\n\r\n\
                <html><body><h1>200 OK</h1></body></html>\r\n";
            if writer.write_all(answer.as_bytes()).is_err() {
                return;
            }
            if self.answers {
                self.answer(&received);
            }
            // The test may have ended.
            let _ = self.letters.send(received);
        }
    }

    fn answer(&self, received: &Received) {
        let Received { letter, message } = received;
        let receiver = letter.envelope.intended_receiver()[0].name.to_string();
        let content = message.content_str().unwrap_or_default();
        let (local, platform) = receiver.split_once('@').unwrap();
        let answer = |act, content: String, from: &str| {
            message
                .reply(act)
                .from_agent(
                    AgentId::new(format!("{from}@{}", self.name)).address(self.url.as_str()),
                )
                .content(content)
        };
        let answer = if platform != self.name || !["ams", "echo", "df"].contains(&local) {
            if message.performative == Performative::Failure {
                return;
            }
            let content = format!(
                "( (action ( agent-identifier :name x) (ACLMessage) ) (MTS-error ( agent-identifier \
                 :name {receiver} ) (internal-error \"Agent not found\")) )"
            );
            answer(Performative::Failure, content, "ams")
        } else if local == "echo" {
            answer(Performative::Inform, content.to_owned(), "echo")
        } else if content.contains("(get-description)") {
            let described = format!(
                "((result {} (sequence (ap-description :name \"\\\"{}\\\"\" :ap-services (sequence \
                 (ap-service :name fipa.mts.mtp.http.std :type fipa.mts.mtp.http.std :addresses \
                 (sequence {})))))))",
                action(content),
                self.name,
                self.url
            );
            answer(Performative::Inform, described, "ams")
        } else if content.contains("ams-agent-description") {
            let agents = self.agents_for(content);
            let found = format!(
                "((result {} (sequence {})))",
                action(content),
                agents.join(" ")
            );
            answer(Performative::Inform, found, "ams")
        } else {
            return;
        };
        let from = letter.envelope.from().cloned().unwrap_or_default();
        let Some(url) = from.addresses.first() else {
            return;
        };
        self.send(&answer, url);
    }

    /// The descriptions that a search gets: as many as it names; where it wants all, a hundred.
    fn agents_for(&self, search: &str) -> Vec<String> {
        let wanted = search.split(":max-results ").nth(1);
        let wanted = wanted.map_or(1, |rest| {
            let end = rest.find(|c: char| c != '-' && !c.is_ascii_digit());
            rest[..end.unwrap()].parse::<i64>().unwrap()
        });
        let others = (0..self.others.load(Ordering::SeqCst)).map(|number| format!("agent{number}"));
        let all = ["ams", "df", "echo"]
            .map(str::to_owned)
            .into_iter()
            .chain(others);
        all.take(usize::try_from(wanted).unwrap_or(100))
            .map(|local| {
                format!(
                    "(ams-agent-description :name (agent-identifier :name {local}@{} \
                     :X-JADE-agent-classname lab.Agent) :ownership NONE :state active)",
                    self.name
                )
            })
            .collect()
    }

    /// One POST a receiver, over a connection that is kept, with one line end behind the body that
    /// is not counted.
    fn send(&self, message: &Message, url: &str) {
        for receiver in &message.receiver {
            let request = request_for(message, receiver, url);
            let authority = url.strip_prefix("http://").unwrap();
            let authority = authority.split('/').next().unwrap().to_owned();
            let mut kept = self.kept.lock().unwrap();
            let mut stream = match kept.remove(&authority) {
                Some(stream) => stream,
                None => TcpStream::connect(&authority).unwrap(),
            };
            stream.set_read_timeout(Some(PATIENCE)).unwrap();
            stream.write_all(&request).unwrap();
            let mut head = Vec::new();
            while !head.ends_with(b"\r\n\r\n") {
                let mut octet = [0];
                stream.read_exact(&mut octet).expect("no answer");
                head.push(octet[0]);
            }
            let head = String::from_utf8(head).unwrap();
            assert!(head.starts_with("HTTP/1.1 200 "), "{head}");
            // Only this spelling keeps the connection.
            if head.contains("\r\nConnection: Keep-Alive\r\n") {
                kept.insert(authority, stream);
            }
        }
    }
}

/// The action within a content such as `((action X Y))`.
fn action(content: &str) -> &str {
    let inner = content.trim();
    &inner[1..inner.len() - 1]
}

/// A request as JADE writes it.
pub(crate) fn request_for(message: &Message, receiver: &AgentId, url: &str) -> Vec<u8> {
    let mut payload = Output::new();
    let representation = Dialect::Jade.message_representation();
    encode_message_as(Dialect::Jade, &representation, message, &mut payload).unwrap();
    let payload = payload.take_bytes();
    let aid = |tag: &str, agent: &AgentId| {
        let urls: String = agent
            .addresses
            .iter()
            .map(|url| format!("<url>{url}</url>"))
            .collect();
        format!(
            "<{tag}><agent-identifier><name>{}</name><addresses>{urls}</addresses>\
             </agent-identifier></{tag}>",
            agent.name
        )
    };
    let to: String = message.receiver.iter().map(|to| aid("to", to)).collect();
    let envelope = format!(
        "<?xml version=\"1.0\"?>\n<envelope><params index=\"1\">{to}{}<acl-representation>\
         fipa.acl.rep.string.std</acl-representation><payload-length>{}</payload-length>\
         <payload-encoding>UTF-8</payload-encoding><date>20261122Z064416708</date>{}\
         </params></envelope>",
        aid("from", message.sender.as_ref().unwrap()),
        payload.len(),
        aid("intended-receiver", receiver),
    );
    let boundary = "4157ea4eadd59e1d186b0b6c847c386";
    let mut body = format!(
        "This is not part of the MIME multipart encoded message.\r\n--{boundary}\r\n\
         Content-Type: application/xml\r\n\r\n{envelope}\r\n--{boundary}\r\n\
         Content-Type: fipa.acl.rep.string.std; charset=UTF-8\r\n\r\n"
    )
    .into_bytes();
    body.extend_from_slice(&payload);
    body.extend_from_slice(format!("\r\n--{boundary}--\r\n").as_bytes());
    let authority = url
        .strip_prefix("http://")
        .unwrap()
        .split('/')
        .next()
        .unwrap();
    let head = format!(
        "POST {url} HTTP/1.1\r\nCache-Control: no-cache\r\nMime-Version: 1.0\r\n\
         Host: {authority}\r\nContent-Type: multipart/mixed ; boundary=\"{boundary}\"\r\n\
         Content-Length: {}\r\nConnection: Keep-Alive\r\n\r\n",
        body.len()
    );
    [head.as_bytes(), &body, b"\r\n"].concat()
}

/// The two parts of a request, found as JADE finds them; `None` where it would close.
fn read_request(reader: &mut impl BufRead) -> Option<(Vec<u8>, Vec<u8>)> {
    let mut line = read_line(reader)?;
    while line.is_empty() {
        line = read_line(reader)?;
    }
    let words: Vec<&str> = line.split(' ').collect();
    let [method, target, version] = words[..] else {
        panic!("a start line of other than three words: {line:?}");
    };
    assert_eq!(method, "POST");
    assert!(target.starts_with("http://127.0.0.1:"), "{target}");
    assert!(version.starts_with("HTTP/1."), "{version}");
    let mut fields = Vec::new();
    loop {
        let field = read_line(reader)?;
        if field.is_empty() {
            break;
        }
        let (name, value) = field.split_once(": ").expect("a field without a blank");
        fields.push((name.to_owned(), value.to_owned()));
    }
    let names: Vec<&str> = fields.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, FIELDS);
    let value = |name: &str| &fields.iter().find(|(n, _)| n == name).unwrap().1;
    assert!(
        target.contains(&format!("//{}/", value("Host"))),
        "{target}"
    );
    let boundary = value("Content-Type").strip_prefix("multipart/mixed ; boundary=\"");
    let boundary = boundary.and_then(|quoted| quoted.strip_suffix('"'));
    let delimiter = format!("--{}", boundary.expect("no boundary in quotes"));
    let mut preamble = 0;
    loop {
        let line = read_line(reader)?;
        preamble += line.len() + 2;
        if line == delimiter {
            break;
        }
    }
    assert_eq!(read_line(reader)?, "Content-Type: application/xml");
    assert_eq!(read_line(reader)?, "");
    // Line ends within the envelope are dropped.
    let (mut envelope, mut head) = (Vec::new(), 0);
    loop {
        let line = read_line(reader)?;
        head += line.len() + 2;
        if line == delimiter {
            break;
        }
        envelope.extend_from_slice(line.as_bytes());
    }
    // The only field: whatever stood behind it would be part of the payload.
    let kind = read_line(reader)?;
    assert!(kind.starts_with("Content-Type: "), "{kind}");
    assert_eq!(read_line(reader)?, "");
    let end = format!("\r\n{delimiter}--");
    let mut payload = Vec::new();
    while !payload.ends_with(end.as_bytes()) {
        let mut octet = [0];
        reader.read_exact(&mut octet).ok()?;
        payload.push(octet[0]);
    }
    let counted = preamble + "Content-Type: application/xml\r\n\r\n".len() + head;
    let counted = counted + kind.len() + 4 + payload.len() + 2;
    assert_eq!(value("Content-Length"), &counted.to_string());
    payload.truncate(payload.len() - end.len());
    // What a payload begins with that is no message would be eaten.
    assert!(!payload.starts_with(b"\r") && !payload.starts_with(b"\n"));
    assert_ne!(payload.last(), Some(&b'\r'), "its end would not be seen");
    assert_eq!(read_line(reader)?, "");
    Some((envelope, payload))
}

/// The fields of a request of its own kind, in their order.
const FIELDS: [&str; 6] = [
    "Cache-Control",
    "Mime-Version",
    "Host",
    "Content-Type",
    "Content-Length",
    "Connection",
];

/// A line that ends in CR and LF.
fn read_line(reader: &mut impl BufRead) -> Option<String> {
    let mut line = Vec::new();
    while !line.ends_with(b"\r\n") {
        let read = reader.read_until(b'\n', &mut line).ok()?;
        if read == 0 {
            return None;
        }
    }
    line.truncate(line.len() - 2);
    String::from_utf8(line).ok()
}

fn letter(envelope: Vec<u8>, payload: Vec<u8>) -> Option<Received> {
    let text = String::from_utf8(envelope.clone()).unwrap();
    assert!(text.is_ascii(), "only Latin-1 is read: {text}");
    assert_eq!(text.matches("<params").count(), 1, "{text}");
    assert_eq!(text.matches("<intended-receiver>").count(), 1, "{text}");
    let (envelope, payload) = (Bytes::from(envelope), Bytes::from(payload));
    let limits = Limits::default();
    assert_eq!(
        EnvelopeRepresentation::detect(&envelope),
        Some(EnvelopeRepresentation::Xml)
    );
    let (envelope, _) = decode_envelope(&envelope, &limits).ok()?;
    assert_eq!(envelope.payload_length(), Some(payload.len() as u64));
    let date = text.split("<date>").nth(1).unwrap();
    assert!(date.as_bytes()[8].is_ascii_alphabetic(), "{text}");
    let message = decode_payload(&envelope, &payload, &limits).unwrap();
    let letter = Letter { envelope, payload };
    Some(Received { letter, message })
}
