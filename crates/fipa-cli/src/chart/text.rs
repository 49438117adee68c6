//! A chart as text of a hundred columns.

use super::{Arrow, Chart, Step, width, wrapped};

/// Columns of a chart, unless it has so many lifelines that they do not fit.
const COLUMNS: usize = 100;

/// Columns from one lifeline to the next, at least and if there is room.
const NARROW: usize = 6;
const WIDE: usize = 24;

/// Columns of what is said about an arrow, at most.
const REMARK: usize = 72;

/// Draws a chart as text. Its lines end without blanks.
///
/// ```
/// use fipa_cli::chart::{Arrow, Chart, Step, to_text};
///
/// let arrow = Arrow { from: "a".into(), to: "b".into(), label: "request".into(), ..Arrow::default() };
/// let chart = Chart { title: "c-1".into(), steps: vec![Step::Arrow(arrow)] };
/// let text = to_text(&chart);
/// assert_eq!(text.lines().nth(3).unwrap(), "│ request               │");
/// assert_eq!(text.lines().nth(4).unwrap(), "├──────────────────────▶│");
/// ```
pub fn to_text(chart: &Chart) -> String {
    let names = chart.lifelines();
    let layout = Layout::new(chart, &names);
    let mut lines = vec![chart.title.clone(), String::new()];
    lines.extend(layout.heads(&names));
    for step in &chart.steps {
        match step {
            Step::Note(note) => lines.extend(layout.note(note)),
            Step::Arrow(arrow) => lines.extend(layout.arrow(arrow, &names)),
        }
    }
    lines.push(layout.line().finish());
    lines.iter().map(|line| format!("{line}\n")).collect()
}

/// Where the lifelines are.
struct Layout {
    /// Columns before the first name: the times.
    margin: usize,
    columns: Vec<usize>,
    width: usize,
}

/// A line that is being drawn.
struct Line(Vec<char>);

impl Line {
    fn put(&mut self, at: usize, text: &str) {
        for (column, letter) in text.chars().enumerate() {
            if let Some(place) = self.0.get_mut(at + column) {
                *place = letter;
            }
        }
    }

    fn finish(self) -> String {
        let line: String = self.0.into_iter().collect();
        line.trim_end().to_owned()
    }
}

impl Layout {
    fn new(chart: &Chart, names: &[&str]) -> Layout {
        let times = chart.arrows().map(|arrow| width(&arrow.at)).max();
        let margin = match times.unwrap_or(0) {
            0 => 0,
            time => time + 2,
        };
        let half = |name: Option<&&str>| name.map_or(0, |name| width(name) / 2);
        let (left, right) = (half(names.first()), half(names.last()));
        let gaps = names.len().saturating_sub(1).max(1);
        let beside = names
            .windows(2)
            .map(|pair| width(pair[0]).midpoint(width(pair[1])) + 3);
        let wanted = beside.max().unwrap_or(0).max(WIDE);
        let room = COLUMNS.saturating_sub(margin + left + right + 1) / gaps;
        let gap = wanted.min(room).max(NARROW);
        let columns: Vec<usize> = (0..names.len()).map(|n| margin + left + n * gap).collect();
        let last = columns.last().copied().unwrap_or(margin);
        Layout {
            margin,
            columns,
            width: COLUMNS.max(last + right + 2),
        }
    }

    /// A line with nothing but the lifelines.
    fn line(&self) -> Line {
        let mut line = vec![' '; self.width];
        self.columns.iter().for_each(|at| line[*at] = '│');
        Line(line)
    }

    /// The names, in as many lines as it takes.
    fn heads(&self, names: &[&str]) -> Vec<String> {
        let mut rows: Vec<Vec<(usize, usize)>> = Vec::new();
        for (n, name) in names.iter().enumerate() {
            let room = self.width.saturating_sub(width(name));
            let start = self.columns[n].saturating_sub(width(name) / 2);
            let start = start.max(self.margin).min(room);
            let is_free = |row: &&mut Vec<(usize, usize)>| {
                let (last, at) = row[row.len() - 1];
                at + width(names[last]) + 1 < start
            };
            match rows.iter_mut().find(is_free) {
                Some(row) => row.push((n, start)),
                None => rows.push(vec![(n, start)]),
            }
        }
        let mut begun = vec![false; names.len()];
        let mut lines = Vec::new();
        for row in rows {
            let mut line = self.line();
            for (n, at) in self.columns.iter().enumerate() {
                if !begun[n] {
                    line.0[*at] = ' ';
                }
            }
            for (n, start) in row {
                begun[n] = true;
                line.put(start.saturating_sub(1), &" ".repeat(width(names[n]) + 2));
                line.put(start, names[n]);
            }
            lines.push(line.finish());
        }
        lines
    }

    fn note(&self, note: &str) -> Vec<String> {
        let text = |line: String| {
            let mut drawn = self.line();
            let first = self.columns.first().copied().unwrap_or(self.margin);
            self.put_beside(&mut drawn, first + 2, &format!("── {line} ──"));
            drawn.finish()
        };
        wrapped(note, REMARK).into_iter().map(text).collect()
    }

    fn arrow(&self, arrow: &Arrow, names: &[&str]) -> Vec<String> {
        let column = |name: &str| {
            let at = names.iter().position(|other| *other == name);
            at.map_or(self.margin, |at| self.columns[at])
        };
        let (from, to) = (column(&arrow.from), column(&arrow.to));
        let beside = from.min(to) + 2;
        let mut label = self.line();
        label.put(0, &arrow.at);
        self.put_beside(&mut label, beside, &arrow.label);
        let mut lines = vec![label.finish()];
        lines.extend(self.shafts(from, to, arrow.failure.is_some()));
        for (remark, _) in arrow.remarks(REMARK) {
            let mut line = self.line();
            self.put_beside(&mut line, beside, &remark);
            lines.push(line.finish());
        }
        lines
    }

    /// Puts a text at a column, or as far left as it takes; what does not fit at all is cut off.
    fn put_beside(&self, line: &mut Line, at: usize, text: &str) {
        let at = at.min(self.width.saturating_sub(width(text) + 1));
        let at = at.max(self.margin + 1);
        line.put(at, text);
        line.put(at + width(text), " ");
    }

    fn shafts(&self, from: usize, to: usize, failed: bool) -> Vec<String> {
        let mut line = self.line();
        if from == to {
            let head = if failed { "✗─╯" } else { "◀─╯" };
            let mut back = self.line();
            line.put(from, "├──╮");
            back.put(from + 1, head);
            return vec![line.finish(), back.finish()];
        }
        let (left, right) = (from.min(to), from.max(to));
        for place in &mut line.0[left + 1..right] {
            *place = if *place == '│' { '┼' } else { '─' };
        }
        let rightwards = from < to;
        line.put(from, if rightwards { "├" } else { "┤" });
        match (failed, rightwards) {
            (true, true) => line.put(to - 1, "✗"),
            (true, false) => line.put(to + 1, "✗"),
            (false, true) => line.put(to - 1, "▶"),
            (false, false) => line.put(to + 1, "◀"),
        }
        vec![line.finish()]
    }
}

#[cfg(test)]
mod tests {
    use crate::chart::Annotation;

    use super::*;

    fn arrow(from: &str, to: &str, label: &str) -> Arrow {
        Arrow {
            from: from.into(),
            to: to.into(),
            label: label.into(),
            ..Arrow::default()
        }
    }

    fn draw(steps: Vec<Step>) -> String {
        let title = "chart".to_owned();
        let text = to_text(&Chart { title, steps });
        text.lines().for_each(|line| {
            assert!(width(line) <= COLUMNS, "{line}");
            assert_eq!(line.trim_end(), line);
        });
        text
    }

    #[test]
    fn arrows_go_both_ways_across_and_back() {
        let far = Arrow {
            at: "1.5".into(),
            ..arrow("c", "a", "inform (done)")
        };
        let text = draw(vec![
            Step::Arrow(arrow("a", "b", "request (go)")),
            Step::Arrow(arrow("b", "c", "query-ref")),
            Step::Arrow(far),
            Step::Arrow(arrow("b", "b", "inform")),
            Step::Note("three are lost".into()),
        ]);
        let wanted = "\
chart

     a                       b                       c
     │ request (go)          │                       │
     ├──────────────────────▶│                       │
     │                       │ query-ref             │
     │                       ├──────────────────────▶│
1.5  │ inform (done)         │                       │
     │◀──────────────────────┼───────────────────────┤
     │                       │ inform                │
     │                       ├──╮                    │
     │                       │◀─╯                    │
     │ ── three are lost ──  │                       │
     │                       │                       │
";
        assert_eq!(text, wanted);
    }

    #[test]
    fn what_did_not_arrive_and_what_is_against_the_rules_is_marked() {
        let failed = Arrow {
            failure: Some("timeout: robot2 gave no receipt in time".into()),
            ..arrow("a@robot1", "b@robot2", "request")
        };
        let strange = Arrow {
            annotation: Some(Annotation {
                text: "not after refuse".into(),
                violation: true,
            }),
            ..arrow("b@robot2", "a@robot1", "agree")
        };
        let fine = Arrow {
            annotation: Some(Annotation {
                text: "agreed".into(),
                violation: false,
            }),
            ..arrow("b@robot2", "a@robot1", "agree")
        };
        let text = draw([failed, strange, fine].map(Step::Arrow).to_vec());
        let wanted = "\
chart

a@robot1                b@robot2
    │ request               │
    ├──────────────────────✗│
    │ ✗ timeout: robot2 gave no receipt in time
    │ agree                 │
    │◀──────────────────────┤
    │ ✗ not after refuse    │
    │ agree                 │
    │◀──────────────────────┤
    │ · agreed              │
    │                       │
";
        assert_eq!(text, wanted);
    }

    #[test]
    fn eight_agents_with_long_names_fit_into_a_hundred_columns() {
        let name = |n: usize| format!("planner{n}@robot{n}");
        let label = "request-whenever (a content of thirty-two…)";
        let steps = (1..8).map(|n| Step::Arrow(arrow(&name(0), &name(n), label)));
        let back = (1..8).map(|n| Step::Arrow(arrow(&name(n), &name(n - 1), label)));
        let text = draw(steps.chain(back).collect());
        (0..8).for_each(|n| assert_eq!(text.matches(&name(n)).count(), 1, "{text}"));
        assert_eq!(text.matches(label).count(), 14, "{text}");
        println!("{text}");
    }

    #[test]
    fn a_chart_of_nothing_is_its_title() {
        assert_eq!(draw(Vec::new()), "chart\n\n\n");
    }
}
