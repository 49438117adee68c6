use std::fmt::Write;

use super::graph::{Edge, Graph};
use crate::protocol::Protocol;

/// The protocol in the language of Graphviz.
pub fn dot(protocol: &Protocol) -> String {
    let graph = Graph::of(protocol);
    let mut text = format!(
        "digraph {} {{\n  rankdir=TB;\n  node [shape=box, style=rounded, fontname=\"sans-serif\"];\n  \
         edge [fontname=\"sans-serif\", fontsize=11];\n  initial [shape=point, label=\"\"];\n",
        quoted(&[protocol.name()])
    );
    for (number, node) in graph.nodes.iter().enumerate() {
        let mut lines = vec![node.id.as_str()];
        lines.extend(node.notes.iter().map(String::as_str));
        let borders = if node.is_final { ", peripheries=2" } else { "" };
        // Writing to a string cannot fail.
        let _ = writeln!(text, "  s{number} [label={}{borders}];", quoted(&lines));
    }
    let _ = writeln!(text, "  initial -> s{};", graph.initial);
    for edge in &graph.edges {
        let lines = lines(edge);
        let lines: Vec<&str> = lines.iter().map(String::as_str).collect();
        let _ = writeln!(
            text,
            "  s{} -> s{} [label={}];",
            edge.from,
            edge.to,
            quoted(&lines)
        );
    }
    text.push_str("}\n");
    text
}

/// The protocol as a state diagram of Mermaid.
pub fn mermaid(protocol: &Protocol) -> String {
    let graph = Graph::of(protocol);
    let mut text = String::from("stateDiagram-v2\n");
    for (number, node) in graph.nodes.iter().enumerate() {
        let notes = node
            .notes
            .iter()
            .map(|note| format!("<br/>{}", plain(note)));
        let notes: String = notes.collect();
        let _ = writeln!(
            text,
            "    state \"{}{notes}\" as s{number}",
            plain(&node.id)
        );
    }
    let _ = writeln!(text, "    [*] --> s{}", graph.initial);
    for edge in &graph.edges {
        let lines: Vec<String> = lines(edge).iter().map(|line| plain(line)).collect();
        let _ = writeln!(
            text,
            "    s{} --> s{} : {}",
            edge.from,
            edge.to,
            lines.join("<br/>")
        );
    }
    for (number, _) in graph
        .nodes
        .iter()
        .enumerate()
        .filter(|(_, node)| node.is_final)
    {
        let _ = writeln!(text, "    s{number} --> [*]");
    }
    text
}

fn lines(edge: &Edge) -> Vec<String> {
    let says = edge.says.iter();
    says.flat_map(|saying| [saying.acts.clone(), saying.parties.clone()])
        .collect()
}

/// Lines as one string of Graphviz.
fn quoted(lines: &[&str]) -> String {
    let escaped = lines
        .iter()
        .map(|line| line.replace('\\', "\\\\").replace('"', "\\\""));
    format!("\"{}\"", escaped.collect::<Vec<_>>().join("\\n"))
}

/// Without the signs that mean something to Mermaid.
fn plain(text: &str) -> String {
    let mut plain = String::new();
    for c in text.chars() {
        match c {
            '"' | '#' | ';' | ':' | '<' | '>' | '&' | '{' | '}' | '%' | '\n' => {
                let _ = write!(plain, "#{};", u32::from(c));
            }
            c => plain.push(c),
        }
    }
    plain
}
