use std::fmt::Write;

use super::graph::{Edge, Graph, Node, footnote};
use super::layers::{Item, Layers};
use super::place::{Extent, Placed, place};
use crate::protocol::{Outcome, Protocol};

const MARGIN: f64 = 24.0;
const HEAD: f64 = 64.0;
const FOOT: f64 = 34.0;
const LINE: f64 = 16.0;
/// Letters are this wide at most, on average.
const WIDE: f64 = 7.6;
const NARROW: f64 = 6.4;
/// Where the words of an arrow are broken.
const LONGEST: usize = 26;
/// Of a loop beside a state.
const LOOP: f64 = 26.0;

const STYLE: &str = "text{font-family:Helvetica,Arial,sans-serif;font-size:13px;fill:#1d2733}\
.title{font-size:17px;font-weight:bold}.note{font-size:11px;fill:#5b6877}.act{font-weight:bold}\
.arrow{fill:none;stroke:#47566a;stroke-width:1.4}.state{stroke:#47566a;stroke-width:1.4}";

/// The protocol as a picture (SVG 1.1).
pub fn svg(protocol: &Protocol) -> String {
    let graph = Graph::of(protocol);
    let placed = place(Layers::of(&graph), |item| extent(&graph, item));
    let note = footnote(protocol);
    let words = [text_width(&note, NARROW), text_width(protocol.name(), 10.0)];
    let width = words.into_iter().fold(placed.width, f64::max) + 2.0 * MARGIN;
    let height = placed.height + HEAD + FOOT + 2.0 * MARGIN;
    let mut out = Picture {
        text: String::new(),
    };
    out.add(format_args!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" \
         width=\"{width:.0}\" height=\"{height:.0}\" role=\"img\">\n<title>{}</title>\n<style>{STYLE}</style>\n\
         <defs><marker id=\"tip\" viewBox=\"0 0 10 10\" refX=\"9\" refY=\"5\" markerWidth=\"8\" markerHeight=\"8\" \
         orient=\"auto-start-reverse\"><path d=\"M0 0 10 5 0 10z\" fill=\"#47566a\"/></marker></defs>\n\
         <rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>",
        escaped(protocol.name())
    ));
    out.words(MARGIN, MARGIN + 14.0, "title", "start", protocol.name());
    // Centred in what the words may make wider.
    let left = (width - placed.width) / 2.0;
    out.add(format_args!(
        "<g transform=\"translate({left:.1} {:.1})\">",
        MARGIN + HEAD
    ));
    for (number, chain) in placed
        .layers
        .chains
        .iter()
        .enumerate()
        .filter(|(_, chain)| !chain.is_empty())
    {
        arrow(&mut out, &placed, number, chain);
    }
    for (at, item) in placed.layers.items.iter().enumerate() {
        match item {
            Item::State(number) => state(&mut out, &placed, at, &graph, *number),
            Item::Label(number) => label(
                &mut out,
                (placed.x[at], placed.y[at]),
                &graph.edges[*number],
                "middle",
            ),
            Item::Bend(_) => {}
        }
    }
    let (x, y) = (placed.x[graph.initial], top_of(&placed, graph.initial));
    out.add(format_args!(
        "<circle cx=\"{x:.1}\" cy=\"{:.1}\" r=\"5\" fill=\"#47566a\"/>\
         <path class=\"arrow\" d=\"M{x:.1} {:.1}V{y:.1}\" marker-end=\"url(#tip)\"/>",
        y - 34.0,
        y - 30.0
    ));
    out.add(format_args!("</g>"));
    out.words(MARGIN, height - MARGIN, "note", "start", &note);
    out.add(format_args!("</svg>"));
    out.text
}

struct Picture {
    text: String,
}

impl Picture {
    fn add(&mut self, what: std::fmt::Arguments<'_>) {
        // Writing to a string cannot fail.
        let _ = writeln!(self.text, "{what}");
    }

    fn words(&mut self, x: f64, y: f64, class: &str, anchor: &str, words: &str) {
        let words = escaped(words);
        self.add(format_args!(
            "<text x=\"{x:.1}\" y=\"{y:.1}\" class=\"{class}\" text-anchor=\"{anchor}\">{words}</text>"
        ));
    }
}

fn extent(graph: &Graph, item: Item) -> Extent {
    match item {
        Item::State(number) => {
            let (width, height) = box_of(&graph.nodes[number]);
            let mut extent = Extent {
                left: width / 2.0,
                right: width / 2.0,
                height,
                body: height,
            };
            if let Some(edge) = own_loop(graph, number) {
                let (wide, high) = label_size(edge);
                extent.right += LOOP + 6.0 + wide;
                extent.height = height.max(high);
            }
            extent
        }
        Item::Label(number) => {
            let (width, height) = label_size(&graph.edges[number]);
            Extent {
                left: width / 2.0,
                right: width / 2.0,
                height,
                body: height,
            }
        }
        Item::Bend(_) => Extent {
            left: 4.0,
            right: 4.0,
            height: 0.0,
            body: 0.0,
        },
    }
}

fn own_loop(graph: &Graph, number: usize) -> Option<&Edge> {
    graph
        .edges
        .iter()
        .find(|edge| (edge.from, edge.to) == (number, number))
}

/// Width and height of the box of a state.
fn box_of(node: &Node) -> (f64, f64) {
    let notes = node.notes.iter().map(|note| text_width(note, NARROW));
    let width = notes.fold(text_width(&node.id, WIDE), f64::max).max(50.0);
    (width + 24.0, 20.0 + LINE * (1 + node.notes.len()) as f64)
}

/// The lines that an arrow says, and their classes.
fn lines(edge: &Edge) -> Vec<(String, &'static str)> {
    let mut lines = Vec::new();
    for saying in &edge.says {
        lines.extend(wrapped(&saying.acts).into_iter().map(|line| (line, "act")));
        lines.push((saying.parties.clone(), "note"));
    }
    lines
}

fn label_size(edge: &Edge) -> (f64, f64) {
    let lines = lines(edge);
    let width = |(line, class): &(String, &str)| match *class {
        "act" => text_width(line, WIDE),
        _ => text_width(line, NARROW),
    };
    (
        lines.iter().map(width).fold(0.0, f64::max),
        LINE * lines.len() as f64 + 4.0,
    )
}

fn text_width(text: &str, letter: f64) -> f64 {
    text.chars().count() as f64 * letter
}

/// A text in lines that are broken between words.
fn wrapped(text: &str) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split(' ') {
        match lines.last_mut() {
            Some(line) if line.chars().count() + word.chars().count() < LONGEST => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

fn label(out: &mut Picture, (x, y): (f64, f64), edge: &Edge, anchor: &str) {
    let lines = lines(edge);
    let mut y = y - LINE * lines.len() as f64 / 2.0 + 12.0;
    for (line, class) in lines {
        out.words(x, y, class, anchor, &line);
        y += LINE;
    }
}

fn state(out: &mut Picture, placed: &Placed, at: usize, graph: &Graph, number: usize) {
    let node = &graph.nodes[number];
    let (width, height) = box_of(node);
    let (x, y) = (placed.x[at], placed.y[at]);
    let fill = match node.outcome.filter(|_| node.is_final) {
        Some(Outcome::Done) => "#e3f4e4",
        Some(Outcome::Refused) => "#fdf1d6",
        Some(Outcome::Failed | Outcome::TimedOut | Outcome::PeerLost) => "#fbe3e1",
        Some(Outcome::Cancelled) => "#ececf1",
        None => "#eef4fb",
    };
    let frame = |out: &mut Picture, by: f64, fill: &str| {
        out.add(format_args!(
            "<rect class=\"state\" x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" rx=\"9\" fill=\"{fill}\"/>",
            x - width / 2.0 + by,
            y - height / 2.0 + by,
            width - 2.0 * by,
            height - 2.0 * by
        ));
    };
    frame(out, 0.0, fill);
    if node.is_final {
        frame(out, 3.5, "none");
    }
    let mut line = y - LINE * node.notes.len() as f64 / 2.0 + 4.5;
    out.words(x, line, "", "middle", &node.id);
    for note in &node.notes {
        line += LINE;
        out.words(x, line, "note", "middle", note);
    }
    if let Some(edge) = own_loop(graph, number) {
        let right = x + width / 2.0;
        out.add(format_args!(
            "<path class=\"arrow\" d=\"M{right:.1} {:.1}c{LOOP} -12 {LOOP} 28 0 16\" marker-end=\"url(#tip)\"/>",
            y - 8.0
        ));
        label(out, (right + LOOP + 2.0, y), edge, "start");
    }
}

/// An arrow from item to item: sideways between the layers only, and interrupted by what it says.
fn arrow(out: &mut Picture, placed: &Placed, number: usize, chain: &[usize]) {
    let upward = placed.layers.upward[number];
    let label = chain
        .iter()
        .position(|item| placed.layers.items[*item] == Item::Label(number));
    let label = label.unwrap_or(0);
    for (part, items) in [&chain[..=label], &chain[label..]].into_iter().enumerate() {
        let mut path = String::new();
        for (place, pair) in items.windows(2).enumerate() {
            let [top, bottom] = *pair else { continue };
            let from = (port(placed, number, top, bottom), bottom_of(placed, top));
            let to = (port(placed, number, bottom, top), top_of(placed, bottom));
            if place == 0 {
                let _ = write!(path, "M{:.1} {:.1}", from.0, from.1);
            }
            let (start, end) = (placed.layer[top].1, placed.layer[bottom].0);
            let half = (start + end) / 2.0;
            let _ = write!(
                path,
                "V{start:.1}C{:.1} {half:.1} {:.1} {half:.1} {:.1} {end:.1}V{:.1}",
                from.0, to.0, to.0, to.1
            );
        }
        let tip = match (upward, part) {
            (true, 0) => " marker-start=\"url(#tip)\"",
            (false, 1) => " marker-end=\"url(#tip)\"",
            _ => "",
        };
        out.add(format_args!("<path class=\"arrow\" d=\"{path}\"{tip}/>"));
    }
}

/// Where an arrow meets an item, on the side of its neighbour: at a state, arrows stand side by side
/// in the order of what they lead to.
fn port(placed: &Placed, number: usize, item: usize, neighbour: usize) -> f64 {
    let x = placed.x[item];
    if !matches!(placed.layers.items[item], Item::State(_)) {
        return x;
    }
    let is_below = placed.y[neighbour] > placed.y[item];
    let chains = placed
        .layers
        .chains
        .iter()
        .enumerate()
        .filter(|(_, chain)| !chain.is_empty());
    let mut others: Vec<(usize, usize)> = chains
        .filter_map(|(other, chain)| {
            let next = match is_below {
                true if chain.first() == Some(&item) => chain.get(1),
                false if chain.last() == Some(&item) => {
                    chain.len().checked_sub(2).and_then(|at| chain.get(at))
                }
                _ => None,
            };
            next.map(|next| (other, *next))
        })
        .collect();
    others.sort_by(|a, b| placed.x[a.1].total_cmp(&placed.x[b.1]));
    let count = others.len() as f64;
    let place = others
        .iter()
        .position(|(other, _)| *other == number)
        .unwrap_or(0) as f64;
    let room = 2.0 * placed.extents[item].left - 24.0;
    let between = (room / count).min(22.0);
    x + (place - (count - 1.0) / 2.0) * between
}

fn top_of(placed: &Placed, item: usize) -> f64 {
    placed.y[item] - placed.extents[item].body / 2.0
}

fn bottom_of(placed: &Placed, item: usize) -> f64 {
    placed.y[item] + placed.extents[item].body / 2.0
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}
