//! The order within the layers: such that few arrows cross.

use super::layers::Layers;

const SWEEPS: usize = 8;

/// Orders to begin with.
const TRIES: usize = 60;

/// Items of pictures for which more than one is tried: counting crossings takes time with the
/// square of them.
const FEW: usize = 400;

/// The items next to each one, in the layer above and in the one below.
pub(super) struct Neighbours {
    pub(super) above: Vec<Vec<usize>>,
    pub(super) below: Vec<Vec<usize>>,
}

impl Neighbours {
    pub(super) fn of(layers: &Layers) -> Neighbours {
        let mut above = vec![Vec::new(); layers.items.len()];
        let mut below = vec![Vec::new(); layers.items.len()];
        for pair in layers.chains.iter().flat_map(|chain| chain.windows(2)) {
            if let [top, bottom] = pair {
                below[*top].push(*bottom);
                above[*bottom].push(*top);
            }
        }
        Neighbours { above, below }
    }
}

/// Sorts each layer by where the neighbours of its items are, down and up, beginning with several
/// orders, and keeps the best.
pub(super) fn arrange(layers: &mut Layers, neighbours: &Neighbours) {
    if layers.items.len() > FEW {
        return sweep(layers, neighbours, |_| {});
    }
    let mut fewest = crossings(layers, neighbours);
    let mut best = layers.rows.clone();
    let mut dice = Dice(1);
    for attempt in 0..TRIES {
        if fewest == 0 {
            break;
        }
        if attempt > 0 {
            layers.rows.iter_mut().for_each(|row| dice.shuffle(row));
        }
        sweep(layers, neighbours, |layers| {
            let found = crossings(layers, neighbours);
            if found < fewest {
                fewest = found;
                best.clone_from(&layers.rows);
            }
        });
    }
    layers.rows = best;
}

fn sweep(layers: &mut Layers, neighbours: &Neighbours, mut look: impl FnMut(&Layers)) {
    let count = layers.rows.len();
    for sweep in 0..SWEEPS {
        let down = sweep % 2 == 0;
        for step in 1..count {
            let row = if down { step } else { count - 1 - step };
            let beside = if down {
                &neighbours.above
            } else {
                &neighbours.below
            };
            sort(layers, row, beside);
        }
        look(layers);
    }
}

/// Numbers that look random and are the same for every picture.
struct Dice(u64);

impl Dice {
    fn shuffle(&mut self, row: &mut [usize]) {
        for place in (1..row.len()).rev() {
            // Knuth's linear congruential generator (MMIX).
            self.0 = self
                .0
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            row.swap(place, (self.0 >> 33) as usize % (place + 1));
        }
    }
}

fn sort(layers: &mut Layers, row: usize, beside: &[Vec<usize>]) {
    let places = places(layers);
    let middle = |item: usize| {
        let neighbours = &beside[item];
        if neighbours.is_empty() {
            return places[item];
        }
        let sum: f64 = neighbours.iter().map(|neighbour| places[*neighbour]).sum();
        sum / neighbours.len() as f64
    };
    layers.rows[row].sort_by(|a, b| middle(*a).total_cmp(&middle(*b)));
}

/// Where each item is in its layer, from 0 to 1.
fn places(layers: &Layers) -> Vec<f64> {
    let mut places = vec![0.0; layers.items.len()];
    for row in &layers.rows {
        for (place, item) in row.iter().enumerate() {
            places[*item] = (place as f64 + 0.5) / row.len() as f64;
        }
    }
    places
}

fn crossings(layers: &Layers, neighbours: &Neighbours) -> usize {
    let places = places(layers);
    let mut crossings = 0;
    for row in &layers.rows {
        let pairs = row.iter().flat_map(|top| {
            neighbours.below[*top]
                .iter()
                .map(move |bottom| (*top, *bottom))
        });
        let pairs: Vec<(f64, f64)> = pairs
            .map(|(top, bottom)| (places[top], places[bottom]))
            .collect();
        for (number, a) in pairs.iter().enumerate() {
            let others = pairs.iter().skip(number + 1);
            crossings += others.filter(|b| (a.0 - b.0) * (a.1 - b.1) < 0.0).count();
        }
    }
    crossings
}

#[cfg(test)]
mod tests {
    use super::super::graph::Graph;
    use super::*;
    use crate::builtin;

    #[test]
    fn nothing_crosses_where_nothing_needs_to() {
        for name in [
            "fipa-request",
            "fipa-contract-net",
            "fipa-subscribe",
            "fipa-propose",
        ] {
            let mut layers = Layers::of(&Graph::of(&builtin(name).unwrap()));
            let neighbours = Neighbours::of(&layers);
            arrange(&mut layers, &neighbours);
            assert_eq!(crossings(&layers, &neighbours), 0, "{name}");
        }
    }
}
