//! Pictures: whole, legible, and in the languages of other tools.

use fipa_protocol::draw::{dot, mermaid, svg};
use fipa_protocol::{Library, Limits, Protocol, builtin, load};

/// A box of a picture.
#[derive(Clone, Copy, Debug)]
struct Box {
    left: f64,
    top: f64,
    right: f64,
    bottom: f64,
}

impl Box {
    fn meets(&self, other: &Box) -> bool {
        self.left < other.right
            && other.left < self.right
            && self.top < other.bottom
            && other.top < self.bottom
    }

    fn holds(&self, other: &Box) -> bool {
        self.left <= other.left
            && other.right <= self.right
            && self.top <= other.top
            && other.bottom <= self.bottom
    }
}

fn attribute<'a>(tag: &'a str, name: &str) -> &'a str {
    let (_, rest) = tag
        .split_once(&format!(" {name}=\""))
        .unwrap_or_else(|| panic!("{name}: {tag}"));
    rest.split_once('"').unwrap().0
}

fn number(tag: &str, name: &str) -> f64 {
    attribute(tag, name).parse().unwrap()
}

/// The words within the group of the picture, and the boxes of the states.
fn parts(picture: &str) -> (Vec<(String, Box)>, Vec<Box>) {
    let (_, group) = picture.split_once("<g ").unwrap();
    let (group, _) = group.split_once("</g>").unwrap();
    let words = group.split("<text").skip(1).map(|rest| {
        let (tag, rest) = rest.split_once('>').unwrap();
        let (text, _) = rest.split_once("</text>").unwrap();
        let letter = if attribute(tag, "class") == "note" {
            5.8
        } else {
            7.0
        };
        let width = text.replace("&amp;", "&").chars().count() as f64 * letter;
        let (x, y) = (number(tag, "x"), number(tag, "y"));
        let left = if attribute(tag, "text-anchor") == "middle" {
            x - width / 2.0
        } else {
            x
        };
        let words = Box {
            left,
            right: left + width,
            top: y - 10.0,
            bottom: y + 3.0,
        };
        (text.to_owned(), words)
    });
    let states = group.split("<rect").skip(1).map(|rest| {
        let (left, top) = (number(rest, "x"), number(rest, "y"));
        Box {
            left,
            top,
            right: left + number(rest, "width"),
            bottom: top + number(rest, "height"),
        }
    });
    (words.collect(), states.collect())
}

fn assert_legible(protocol: &Protocol) {
    let name = protocol.name();
    let picture = svg(protocol);
    load("picture", picture.as_bytes(), &Limits::default())
        .unwrap_or_else(|error| panic!("{name}: {error}"));
    let (words, states) = parts(&picture);
    let size: Vec<f64> = attribute(&picture, "viewBox")
        .split(' ')
        .map(|n| n.parse().unwrap())
        .collect();
    for (at, (text, place)) in words.iter().enumerate() {
        for (other, beside) in words.iter().skip(at + 1) {
            assert!(!place.meets(beside), "{name}: {text:?} is on {other:?}");
        }
        for state in &states {
            assert!(
                !place.meets(state) || state.holds(place),
                "{name}: {text:?} crosses a border"
            );
        }
        assert!(
            place.left >= 0.0 && place.right <= size[2],
            "{name}: {text:?} is cut off"
        );
    }
    for (_, state) in protocol.states().filter(|(_, state)| state.is_declared()) {
        let drawn = words
            .iter()
            .filter(|(text, _)| *state.id() == *text.as_str());
        assert!(drawn.count() >= 1, "{name}: {} is missing", state.id());
    }
}

#[test]
fn no_words_are_on_others_and_every_state_is_there() {
    for protocol in Library::builtin().protocols() {
        assert_legible(protocol);
    }
}

#[test]
fn a_protocol_of_many_states_is_drawn_too() {
    let mut text = String::from("<scxml>");
    for n in 0..40 {
        let targets = [(n * 7 + 3) % 40, (n + 1) % 40, (n * 3) % 40];
        let transitions: String = ["inform", "agree", "refuse"]
            .iter()
            .zip(targets)
            .map(|(act, target)| {
                format!("<transition performative='{act}' from='A' to='B' target='s{target}'/>")
            })
            .collect();
        text.push_str(&format!("<state id='s{n}'>{transitions}</state>"));
    }
    text.push_str("<final id='end'/></scxml>");
    let loaded = load("many", text.as_bytes(), &Limits::default()).unwrap();
    assert_legible(&loaded.protocol.unwrap());
}

#[test]
fn names_are_escaped() {
    let text = r#"<scxml name="a &lt;&amp;&quot; b"><state id="&lt;x&gt; &quot;\"><transition event="inform" from="A&amp;B" to="C;D" target="z"/></state><final id="z"/></scxml>"#;
    let protocol = load("x", text.as_bytes(), &Limits::default())
        .unwrap()
        .protocol
        .unwrap();
    assert_legible_xml(&svg(&protocol));
    assert!(
        dot(&protocol).contains(r#"s0 [label="<x> \"\\"]"#),
        "{}",
        dot(&protocol)
    );
    assert!(
        mermaid(&protocol).contains(r##"state "#60;x#62; #34;\" as s0"##),
        "{}",
        mermaid(&protocol)
    );
}

fn assert_legible_xml(picture: &str) {
    load("picture", picture.as_bytes(), &Limits::default()).unwrap();
    assert!(picture.contains("&lt;x&gt; &quot;\\</text>"));
}

#[test]
fn graphviz_and_mermaid_are_told_the_same() {
    let propose = builtin("fipa-propose").unwrap();
    assert_eq!(
        dot(&propose),
        r#"digraph "fipa-propose" {
  rankdir=TB;
  node [shape=box, style=rounded, fontname="sans-serif"];
  edge [fontname="sans-serif", fontsize=11];
  initial [shape=point, label=""];
  s0 [label="start"];
  s1 [label="proposed"];
  s2 [label="accepted", peripheries=2];
  s3 [label="rejected", peripheries=2];
  initial -> s0;
  s0 -> s1 [label="propose\ninitiator → participant"];
  s1 -> s2 [label="accept-proposal\nparticipant → initiator"];
  s1 -> s3 [label="reject-proposal\nparticipant → initiator"];
}
"#
    );
    assert_eq!(
        mermaid(&propose),
        r#"stateDiagram-v2
    state "start" as s0
    state "proposed" as s1
    state "accepted" as s2
    state "rejected" as s3
    [*] --> s0
    s0 --> s1 : propose<br/>initiator → participant
    s1 --> s2 : accept-proposal<br/>participant → initiator
    s1 --> s3 : reject-proposal<br/>participant → initiator
    s2 --> [*]
    s3 --> [*]
"#
    );
}

#[test]
fn an_act_that_a_state_and_the_outer_one_take_is_drawn_once() {
    let text = r#"<scxml name="n"><state id="a"><transition event="cfp" target="in"/></state>
      <state id="out"><transition event="propose refuse" target="in"/>
        <state id="in"><transition event="propose" target="in"/><transition event="inform" target="z"/></state>
      </state><final id="z"/></scxml>"#;
    let loaded = load("n", text.as_bytes(), &Limits::default()).unwrap();
    let drawn = mermaid(&loaded.protocol.unwrap());
    assert!(drawn.contains(" : propose or refuse<br/>"), "{drawn}");
}
