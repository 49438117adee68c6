//! Where everything is: items as near as they can be to those above and below without meeting
//! others of their layer.

use super::arrange::{Neighbours, arrange};
use super::layers::{Item, Layers};

const ROUNDS: usize = 60;
const GAP: f64 = 26.0;
/// Between layers; arrows go sideways there only.
const STEP: f64 = 30.0;

/// How large an item is, from its own middle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Extent {
    pub(super) left: f64,
    pub(super) right: f64,
    pub(super) height: f64,
    /// The height of what arrows lead to.
    pub(super) body: f64,
}

pub(super) struct Placed {
    pub(super) layers: Layers,
    pub(super) extents: Vec<Extent>,
    /// The middle of each item.
    pub(super) x: Vec<f64>,
    pub(super) y: Vec<f64>,
    /// The top and the bottom of the layer of each item.
    pub(super) layer: Vec<(f64, f64)>,
    pub(super) width: f64,
    pub(super) height: f64,
}

pub(super) fn place(mut layers: Layers, extent: impl Fn(Item) -> Extent) -> Placed {
    let neighbours = Neighbours::of(&layers);
    arrange(&mut layers, &neighbours);
    let extents: Vec<Extent> = layers.items.iter().map(|item| extent(*item)).collect();
    let x = columns(&layers, &neighbours, &extents);
    let count = layers.items.len();
    let (mut y, mut layer) = (vec![0.0; count], vec![(0.0, 0.0); count]);
    let mut top = 0.0;
    for row in &layers.rows {
        let height = row
            .iter()
            .map(|item| extents[*item].height)
            .fold(0.0, f64::max);
        for item in row {
            y[*item] = top + height / 2.0;
            layer[*item] = (top, top + height);
        }
        top += height + STEP;
    }
    let width = (0..count)
        .map(|item| x[item] + extents[item].right)
        .fold(0.0, f64::max);
    Placed {
        layers,
        extents,
        x,
        y,
        layer,
        width,
        height: top - STEP,
    }
}

fn columns(layers: &Layers, neighbours: &Neighbours, extents: &[Extent]) -> Vec<f64> {
    let mut x = vec![0.0; layers.items.len()];
    for row in &layers.rows {
        let wanted = vec![0.0; row.len()];
        set(row, &wanted, layers, extents, &mut x);
    }
    for round in 0..ROUNDS {
        let rows: Vec<&Vec<usize>> = match round % 2 {
            0 => layers.rows.iter().collect(),
            _ => layers.rows.iter().rev().collect(),
        };
        for row in rows {
            let wanted: Vec<f64> = row
                .iter()
                .map(|item| middle(*item, round, layers, neighbours, &x))
                .collect();
            set(row, &wanted, layers, extents, &mut x);
        }
    }
    let left = (0..x.len())
        .map(|item| x[item] - extents[item].left)
        .fold(f64::INFINITY, f64::min);
    if left.is_finite() {
        x.iter_mut().for_each(|x| *x -= left);
    }
    x
}

/// Where an item would like to be: amid those above and below; in the first rounds amid those that
/// were placed before. What an arrow passes is drawn to the same arrow more than to states.
fn middle(item: usize, round: usize, layers: &Layers, neighbours: &Neighbours, x: &[f64]) -> f64 {
    let (above, below) = (&neighbours.above[item], &neighbours.below[item]);
    let early = round + ROUNDS / 3 < ROUNDS;
    let (above, below) = match (early, round % 2) {
        (true, 0) if !above.is_empty() => (&above[..], &[][..]),
        (true, 1) if !below.is_empty() => (&[][..], &below[..]),
        _ => (&above[..], &below[..]),
    };
    let is_state = |item: usize| matches!(layers.items[item], Item::State(_));
    let weight = |other: usize| {
        if is_state(item) || is_state(other) {
            1.0
        } else {
            6.0
        }
    };
    let others = above.iter().chain(below);
    let sum: f64 = others.clone().map(|other| weight(*other)).sum();
    if sum == 0.0 {
        return x[item];
    }
    others.map(|other| weight(*other) * x[*other]).sum::<f64>() / sum
}

/// Places a row as near to what is wanted as the widths allow: items that would meet are moved
/// together, to where the least is moved (isotonic regression).
fn set(row: &[usize], wanted: &[f64], layers: &Layers, extents: &[Extent], x: &mut [f64]) {
    // Of each item, how far it is from the first one at least.
    let mut offsets = Vec::with_capacity(row.len());
    let mut offset = 0.0;
    for (place, item) in row.iter().enumerate() {
        if let Some(before) = place.checked_sub(1).map(|before| row[before]) {
            offset += extents[before].right + GAP + extents[*item].left;
        }
        offsets.push(offset);
    }
    // Groups of items that touch: where they want to be, how much, and how many they are.
    let mut groups: Vec<(f64, f64, usize)> = Vec::new();
    for ((item, wanted), offset) in row.iter().zip(wanted).zip(&offsets) {
        let weight = match layers.items[*item] {
            Item::Bend(_) => 6.0,
            Item::Label(_) => 2.0,
            Item::State(_) => 1.0,
        };
        groups.push((wanted - offset, weight, 1));
        while let [.., (first, heavy, many), (second, weight, count)] = groups[..] {
            if first <= second {
                break;
            }
            groups.truncate(groups.len() - 2);
            let sum = heavy + weight;
            groups.push(((first * heavy + second * weight) / sum, sum, many + count));
        }
    }
    let placed = groups
        .iter()
        .flat_map(|(at, _, count)| std::iter::repeat_n(*at, *count));
    for ((item, at), offset) in row.iter().zip(placed).zip(&offsets) {
        x[*item] = at + offset;
    }
}
