//! A chart as SVG. Letters all have one width, so that what fits is known without a font.

use std::fmt::Write;

use super::{Arrow, Chart, Step, width, wrapped};

/// Width of a letter, and height of a line of text. Fonts differ a little.
const LETTER: f64 = 7.4;
const LINE: f64 = 15.0;

/// What is free around the drawing and between two charts.
const MARGIN: f64 = 16.0;

/// From one lifeline to the next, at least.
const GAP: f64 = 80.0;

/// What is free beside a text on each side.
const BESIDE: f64 = 10.0;

/// How far an arrow to the same lifeline goes out.
const LOOP: f64 = 28.0;

/// Letters of what is said about an arrow, in one line.
const REMARK: usize = 40;

const STYLE: &str = "text{font:12px 'DejaVu Sans Mono',monospace;fill:#1a1a1a}\
.title{font-weight:bold}.bad{fill:#b00020}.quiet{fill:#666}\
.head{fill:#eef3f8;stroke:#4a6785}.life{stroke:#9fb2c5;stroke-dasharray:4 3}\
.shaft{stroke:#1a1a1a;fill:none}.shaft.bad{stroke:#b00020}\
.tip{fill:#1a1a1a}.tip.bad{fill:#b00020}.clear{fill:#fff}.note{fill:#fff8dc;stroke:#c9b458}";

/// Draws charts as one SVG document, one below the other.
pub fn to_svg(charts: &[Chart]) -> String {
    let mut body = String::new();
    let (mut wide, mut y) = (0.0_f64, MARGIN);
    for chart in charts {
        let drawing = Drawing::new(chart);
        wide = wide.max(drawing.width());
        y = drawing.draw(chart, y, &mut body) + MARGIN;
    }
    let (wide, high) = (wide + 2.0 * MARGIN, y);
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{wide:.0}\" height=\"{high:.0}\" \
         viewBox=\"0 0 {wide:.0} {high:.0}\">\n<style>{STYLE}</style>\n\
         <rect class=\"clear\" width=\"100%\" height=\"100%\"/>\n{body}</svg>\n"
    )
}

/// Where the lifelines of a chart are.
struct Drawing<'a> {
    names: Vec<&'a str>,
    columns: Vec<f64>,
    /// Where the rightmost thing ends.
    right: f64,
}

fn text_width(text: &str) -> f64 {
    width(text) as f64 * LETTER
}

/// What an arrow needs between its lifelines.
fn arrow_width(arrow: &Arrow) -> f64 {
    let remarks = arrow.remarks(REMARK);
    let remarks = remarks.iter().map(|(text, _)| text_width(text));
    let widest = remarks.fold(text_width(&arrow.label), f64::max);
    widest + 2.0 * BESIDE
}

impl<'a> Drawing<'a> {
    fn new(chart: &'a Chart) -> Drawing<'a> {
        let names = chart.lifelines();
        let half = |name: Option<&&str>| name.map_or(0.0, |n| text_width(n) / 2.0 + BESIDE);
        let pairs = names.windows(2);
        let beside = pairs.map(|pair| half(pair.first()) + half(pair.last()) + BESIDE);
        let mut gaps: Vec<f64> = beside.map(|gap| gap.max(GAP)).collect();
        let mut outside = half(names.last());
        for (from, to, arrow) in by_span(chart, &names) {
            let needed = arrow_width(arrow);
            if from != to {
                widen(&mut gaps[from..to], needed);
            } else if from < gaps.len() {
                // Beside it there may be another loop's text, which hangs over to the left.
                widen(&mut gaps[from..=from], needed + LOOP + BESIDE);
            } else {
                outside = outside.max(needed + LOOP);
            }
        }
        let times = chart.arrows().map(|arrow| text_width(&arrow.at));
        let times = times.fold(0.0, f64::max);
        let mut at = MARGIN + times + BESIDE + half(names.first());
        let mut columns = Vec::new();
        for n in 0..names.len() {
            columns.push(at);
            at += gaps.get(n).copied().unwrap_or_default();
        }
        let notes = chart.steps.iter().filter_map(|step| match step {
            Step::Note(note) => wrapped(note, 2 * REMARK)
                .into_iter()
                .max_by_key(|l| width(l)),
            Step::Arrow(_) => None,
        });
        let first = columns.first().copied().unwrap_or(MARGIN);
        let notes = notes.map(|note| first + text_width(&note) + 4.0 * BESIDE);
        let right = columns.last().copied().unwrap_or(MARGIN) + outside;
        let right = right.max(MARGIN + text_width(&chart.title));
        Drawing {
            right: notes.fold(right, f64::max),
            names,
            columns,
        }
    }

    fn width(&self) -> f64 {
        self.right - MARGIN
    }

    /// Draws from `top` on; where the drawing ends.
    fn draw(&self, chart: &Chart, top: f64, out: &mut String) -> f64 {
        let mut y = top + LINE;
        text(out, MARGIN, y, "start", "title", &chart.title);
        y += LINE / 2.0;
        let heads = y;
        y += 2.0 * LINE;
        let lifelines = y;
        let mut steps = String::new();
        for step in &chart.steps {
            y = match step {
                Step::Note(note) => self.note(note, y, &mut steps),
                Step::Arrow(arrow) => self.arrow(arrow, y, &mut steps),
            };
        }
        y += LINE;
        for (name, x) in self.names.iter().zip(&self.columns) {
            let wide = text_width(name) + 2.0 * BESIDE - 4.0;
            let left = x - wide / 2.0;
            let high = 1.6 * LINE;
            let _ = writeln!(
                out,
                "<line class=\"life\" x1=\"{x:.1}\" y1=\"{lifelines:.1}\" x2=\"{x:.1}\" \
                 y2=\"{y:.1}\"/>\n<rect class=\"head\" x=\"{left:.1}\" y=\"{heads:.1}\" \
                 width=\"{wide:.1}\" height=\"{high:.1}\" rx=\"3\"/>"
            );
            text(out, *x, heads + 1.1 * LINE, "middle", "", name);
        }
        out.push_str(&steps);
        y
    }

    fn note(&self, note: &str, top: f64, out: &mut String) -> f64 {
        let x = self.columns.first().copied().unwrap_or(MARGIN) + BESIDE;
        let lines = wrapped(note, 2 * REMARK);
        let widest = lines.iter().map(|line| text_width(line));
        let wide = widest.fold(0.0, f64::max) + 2.0 * BESIDE;
        let high = lines.len() as f64 * LINE + 6.0;
        let top = top + 6.0;
        let _ = writeln!(
            out,
            "<rect class=\"note\" x=\"{x:.1}\" y=\"{top:.1}\" width=\"{wide:.1}\" \
             height=\"{high:.1}\"/>"
        );
        for (n, line) in lines.iter().enumerate() {
            let y = top + (n as f64 + 1.0) * LINE - 1.0;
            text(out, x + BESIDE, y, "start", "", line);
        }
        top + high
    }

    fn arrow(&self, arrow: &Arrow, top: f64, out: &mut String) -> f64 {
        let column = |name: &str| {
            let at = self.names.iter().position(|other| *other == name);
            at.map_or(MARGIN, |at| self.columns[at])
        };
        let (from, to) = (column(&arrow.from), column(&arrow.to));
        let bad = if arrow.is_bad() { " bad" } else { "" };
        let label = top + LINE + 3.0;
        let shaft = label + 6.0;
        text(out, MARGIN, label, "start", "quiet", &arrow.at);
        let (place, anchor) = match from == to {
            true => (from + LOOP + BESIDE, "start"),
            false => (f64::midpoint(from, to), "middle"),
        };
        cleared(out, place, label, anchor, "", &arrow.label);
        let below = if from == to {
            let back = shaft + 12.0;
            let out_to = from + LOOP;
            let _ = writeln!(
                out,
                "<path class=\"shaft{bad}\" d=\"M{from:.1} {shaft:.1}H{out_to:.1}V{back:.1}\
                 H{from:.1}\"/>"
            );
            tip(out, from, back, 1.0, arrow.failure.is_some(), bad);
            back
        } else {
            let towards = if from < to { -1.0 } else { 1.0 };
            let _ = writeln!(
                out,
                "<path class=\"shaft{bad}\" d=\"M{from:.1} {shaft:.1}H{to:.1}\"/>"
            );
            tip(out, to, shaft, towards, arrow.failure.is_some(), bad);
            shaft
        };
        let remarks = arrow.remarks(REMARK);
        for (n, (remark, bad)) in remarks.iter().enumerate() {
            let class = if *bad { "bad" } else { "quiet" };
            let y = below + (n as f64 + 1.0) * LINE;
            cleared(out, place, y, anchor, class, remark);
        }
        below + remarks.len() as f64 * LINE + 5.0
    }
}

/// The end of a shaft at a lifeline: a tip, or a cross before it. `side` is where the shaft is.
fn tip(out: &mut String, x: f64, y: f64, side: f64, failed: bool, bad: &str) {
    let (up, down) = (y - 4.0, y + 4.0);
    let back = x + side * 9.0;
    if failed {
        let (near, far) = (x + side * 6.0, x + side * 14.0);
        let _ = writeln!(
            out,
            "<path class=\"shaft{bad}\" stroke-width=\"2\" d=\"M{near:.1} {up:.1}L{far:.1} \
             {down:.1}M{near:.1} {down:.1}L{far:.1} {up:.1}\"/>"
        );
    } else {
        let _ = writeln!(
            out,
            "<path class=\"tip{bad}\" d=\"M{x:.1} {y:.1}L{back:.1} {up:.1}V{down:.1}Z\"/>"
        );
    }
}

/// The arrows with the places of their ends from left to right, the shortest first.
fn by_span<'a>(chart: &'a Chart, names: &[&str]) -> Vec<(usize, usize, &'a Arrow)> {
    let place = |name: &str| names.iter().position(|other| *other == name);
    let spans = chart.arrows().filter_map(|arrow| {
        let (from, to) = (place(&arrow.from)?, place(&arrow.to)?);
        Some((from.min(to), from.max(to), arrow))
    });
    let mut spans: Vec<_> = spans.collect();
    spans.sort_by_key(|(from, to, _)| to - from);
    spans
}

/// Makes gaps wider until they are so wide together.
fn widen(gaps: &mut [f64], needed: f64) {
    let missing = needed - gaps.iter().sum::<f64>();
    if missing > 0.0 {
        let each = missing / gaps.len() as f64;
        gaps.iter_mut().for_each(|gap| *gap += each);
    }
}

/// A text on a ground of its own, so that no lifeline crosses it.
fn cleared(out: &mut String, x: f64, y: f64, anchor: &str, class: &str, line: &str) {
    let wide = text_width(line) + 4.0;
    let left = match anchor {
        "middle" => x - wide / 2.0,
        _ => x - 2.0,
    };
    let top = y - LINE + 4.0;
    let _ = writeln!(
        out,
        "<rect class=\"clear\" x=\"{left:.1}\" y=\"{top:.1}\" width=\"{wide:.1}\" \
         height=\"{:.1}\"/>",
        LINE - 1.0
    );
    text(out, x, y, anchor, class, line);
}

fn text(out: &mut String, x: f64, y: f64, anchor: &str, class: &str, line: &str) {
    if line.is_empty() {
        return;
    }
    let line = escaped(line);
    let _ = writeln!(
        out,
        "<text class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{line}</text>"
    );
}

/// A text as XML can hold it.
fn escaped(text: &str) -> String {
    let mut out = String::new();
    for letter in text.chars() {
        match letter {
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '&' => out.push_str("&amp;"),
            '\u{fffe}' | '\u{ffff}' => out.push('?'),
            letter if letter.is_control() => out.push('?'),
            letter => out.push(letter),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arrow(from: &str, to: &str, label: &str) -> Arrow {
        Arrow {
            from: from.into(),
            to: to.into(),
            label: label.into(),
            ..Arrow::default()
        }
    }

    #[test]
    fn nothing_of_a_text_is_markup() {
        let steps = vec![Step::Arrow(arrow("<a&b>", "c\u{0}", "</text>"))];
        let title = "x < y".to_owned();
        let svg = to_svg(&[Chart { title, steps }]);
        assert!(svg.contains(">&lt;a&amp;b&gt;</text>"));
        assert!(svg.contains(">c?</text>"));
        assert!(svg.contains(">&lt;/text&gt;</text>"));
        assert!(svg.contains(">x &lt; y</text>"));
    }

    #[test]
    fn lifelines_are_so_far_apart_that_names_and_labels_fit() {
        let long = "request-whenever (something long that is said)";
        let chart = Chart {
            title: String::new(),
            steps: [
                arrow("a", "b", "inform"),
                arrow("b", "c", long),
                arrow("c", "a", long),
                arrow("b", "b", long),
                arrow("a-name-of-forty-letters-@robot-of-the-year", "c", "x"),
            ]
            .map(Step::Arrow)
            .to_vec(),
        };
        let drawing = Drawing::new(&chart);
        let gap = |n: usize| drawing.columns[n + 1] - drawing.columns[n];
        assert!(gap(0) >= GAP);
        assert!(gap(1) >= LOOP + text_width(long) + 2.0 * BESIDE);
        let halves = (text_width(drawing.names[2]) + text_width(drawing.names[3])) / 2.0;
        assert!(gap(2) >= halves + 2.0 * BESIDE);
    }
}
