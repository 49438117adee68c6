//! States in layers, one below the other, so that nearly all arrows point down; what an arrow says,
//! and the places where it passes a layer, are items in layers of their own.

use std::collections::HashMap;

use super::graph::Graph;

/// Items of a picture that is laid out with care; beyond, arrows pass below what is in their way.
const MANY: usize = 20_000;

/// What has a place in a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Item {
    State(usize),
    /// What the arrow of this number says.
    Label(usize),
    /// Where the arrow of this number passes.
    Bend(usize),
}

pub(super) struct Layers {
    pub(super) items: Vec<Item>,
    /// The items of each layer, from left to right.
    pub(super) rows: Vec<Vec<usize>>,
    /// For each arrow the items that it passes, from top to bottom; none for one that stays.
    pub(super) chains: Vec<Vec<usize>>,
    /// Whether an arrow points up.
    pub(super) upward: Vec<bool>,
}

impl Layers {
    pub(super) fn of(graph: &Graph) -> Layers {
        let upward = upward(graph);
        let ends = |number: usize| {
            let edge = &graph.edges[number];
            match upward[number] {
                true => (edge.to, edge.from),
                false => (edge.from, edge.to),
            }
        };
        let depth = depths(graph, ends);
        let mut layers = Layers {
            items: (0..graph.nodes.len()).map(Item::State).collect(),
            rows: Vec::new(),
            chains: vec![Vec::new(); graph.edges.len()],
            upward: upward.clone(),
        };
        for (node, depth) in depth.iter().enumerate() {
            layers.put(2 * depth, node);
        }
        let length = |number: usize| {
            let (top, bottom) = ends(number);
            2 * depth[bottom].saturating_sub(depth[top])
        };
        let bends: usize = (0..graph.edges.len()).map(length).sum();
        for (number, is_upward) in upward.iter().enumerate() {
            let (top, bottom) = ends(number);
            if top == bottom {
                continue;
            }
            let mut chain = vec![top];
            // An arrow that points up says it where it begins, too.
            let (first, last) = (2 * depth[top] + 1, 2 * depth[bottom] - 1);
            let label = if *is_upward { last } else { first };
            for layer in first..=last {
                if layer == label || bends < MANY {
                    let item = if layer == label {
                        Item::Label(number)
                    } else {
                        Item::Bend(number)
                    };
                    layers.items.push(item);
                    let at = layers.items.len() - 1;
                    layers.put(layer, at);
                    chain.push(at);
                }
            }
            chain.push(bottom);
            layers.chains[number] = chain;
        }
        layers
    }

    fn put(&mut self, layer: usize, item: usize) {
        while self.rows.len() <= layer {
            self.rows.push(Vec::new());
        }
        self.rows[layer].push(item);
    }
}

/// The arrows that would close a circle, seen from the initial state.
fn upward(graph: &Graph) -> Vec<bool> {
    #[derive(Clone, Copy, PartialEq)]
    enum Seen {
        No,
        Open,
        Done,
    }
    let mut leaving: HashMap<usize, Vec<usize>> = HashMap::new();
    for (number, edge) in graph.edges.iter().enumerate() {
        leaving.entry(edge.from).or_default().push(number);
    }
    let mut upward = vec![false; graph.edges.len()];
    let mut seen = vec![Seen::No; graph.nodes.len()];
    let starts = std::iter::once(graph.initial).chain(0..graph.nodes.len());
    for start in starts {
        if seen[start] != Seen::No {
            continue;
        }
        // A state, and how many of its arrows were followed.
        let mut path = vec![(start, 0)];
        seen[start] = Seen::Open;
        while let Some((node, followed)) = path.last_mut() {
            let next = leaving.get(node).and_then(|edges| edges.get(*followed));
            *followed += 1;
            let Some(number) = next else {
                seen[*node] = Seen::Done;
                path.pop();
                continue;
            };
            let to = graph.edges[*number].to;
            match seen[to] {
                Seen::No => {
                    seen[to] = Seen::Open;
                    path.push((to, 0));
                }
                Seen::Open => upward[*number] = to != *node,
                Seen::Done => {}
            }
        }
    }
    upward
}

/// How far below the top each state is: below all from which arrows point to it.
fn depths(graph: &Graph, ends: impl Fn(usize) -> (usize, usize)) -> Vec<usize> {
    let count = graph.nodes.len();
    let mut below: Vec<Vec<usize>> = vec![Vec::new(); count];
    let mut above = vec![0_usize; count];
    for (top, bottom) in (0..graph.edges.len())
        .map(ends)
        .filter(|(top, bottom)| top != bottom)
    {
        below[top].push(bottom);
        above[bottom] += 1;
    }
    let mut depth = vec![0; count];
    let mut ready: Vec<usize> = (0..count).filter(|node| above[*node] == 0).collect();
    while let Some(node) = ready.pop() {
        for next in &below[node] {
            depth[*next] = depth[*next].max(depth[node] + 1);
            above[*next] -= 1;
            if above[*next] == 0 {
                ready.push(*next);
            }
        }
    }
    depth
}
