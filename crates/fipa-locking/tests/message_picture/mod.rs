//! A picture (SVG 1.1) of the messages per entry, beside what the papers say.

use std::fmt::Write;

use fipa_locking::Algorithm;

use crate::{measure, theory};

const WIDTH: usize = 640;
/// Where the bars begin, and how long the longest one of a group is.
const LEFT: usize = 196;
const LONG: usize = 330;
const ROW: usize = 22;
const TOP: usize = 74;
const GROUP: usize = 4 * ROW + 38;

/// Pages that hold the picture have rules of their own.
const STYLE: &str = ".messages text{font:12px sans-serif;fill:#1d2733}\
.messages .head{font-weight:bold}.messages .algorithm{fill:#3b6fb6}.messages .owner{fill:#e0913a}\
.messages .probes{fill:#c3ccd6}.messages .theory{stroke:#b3202c;stroke-width:2}";

/// The picture, of what is counted now.
pub(crate) fn draw() -> String {
    let height = TOP + 3 * GROUP;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"messages\" viewBox=\"0 0 {WIDTH} {height}\" \
         width=\"{WIDTH}\" height=\"{height}\" role=\"img\">\n\
         <title>Messages of an entry, counted and by theory</title>\n<style>{STYLE}</style>\n\
         <rect width=\"{WIDTH}\" height=\"{height}\" fill=\"#fff\"/>\n"
    );
    words(
        &mut out,
        12,
        22,
        "head",
        "Messages of an entry, discovery aside",
    );
    legend(&mut out);
    for (at, n) in [3, 10, 50].into_iter().enumerate() {
        group(&mut out, TOP + at * GROUP, n);
    }
    out.push_str("</svg>\n");
    out
}

fn legend(out: &mut String) {
    let kinds = [
        ("algorithm", 12, "requests, grants, tokens"),
        ("owner", 186, "to and from the owner"),
        ("probes", 348, "probes"),
    ];
    for (class, x, text) in kinds {
        bar(out, class, x, 36, 12);
        words(out, x + 18, 48, "", text);
    }
    tick(out, 432, 34);
    words(out, 442, 48, "", "theory: 2(n-1), or n");
}

fn group(out: &mut String, top: usize, n: usize) {
    words(out, 12, top + 14, "head", &format!("n = {n}"));
    let rows = Algorithm::ALL.map(|algorithm| (algorithm, measure(n, algorithm)[0]));
    let totals = rows.map(|(_, counts)| counts.algorithm + counts.owner + counts.probes);
    let most = totals.into_iter().max().unwrap_or(1);
    let scaled = |messages: usize| messages * LONG / most;
    for (at, (algorithm, counts)) in rows.into_iter().enumerate() {
        let y = top + 22 + at * ROW;
        words(out, 12, y + 13, "", algorithm.protocol());
        let mut before = 0;
        for (class, messages) in [
            ("algorithm", counts.algorithm),
            ("owner", counts.owner),
            ("probes", counts.probes),
        ] {
            let (from, to) = (scaled(before), scaled(before + messages));
            if to > from {
                bar(out, class, LEFT + from, y, to - from);
            }
            before += messages;
        }
        tick(out, LEFT + scaled(theory(n, algorithm)), y);
        let shown = format!(
            "{} + {} + {}",
            counts.algorithm, counts.owner, counts.probes
        );
        words(out, LEFT + scaled(before) + 8, y + 13, "", &shown);
    }
}

fn bar(out: &mut String, class: &str, x: usize, y: usize, width: usize) {
    // Writing to a string does not fail.
    let _ = writeln!(
        out,
        "<rect class=\"{class}\" x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"16\"/>"
    );
}

fn tick(out: &mut String, x: usize, y: usize) {
    let _ = writeln!(
        out,
        "<path class=\"theory\" d=\"M{x} {}V{}\"/>",
        y.saturating_sub(2),
        y + 18
    );
}

fn words(out: &mut String, x: usize, y: usize, class: &str, text: &str) {
    let _ = writeln!(
        out,
        "<text class=\"{class}\" x=\"{x}\" y=\"{y}\">{text}</text>"
    );
}
