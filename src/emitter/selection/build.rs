//! Building the tree of emitters.

use super::bounds::{LightBounds, LightBoundsX16};
use super::{Child, LightSelection, Location, Node};
use crate::math::LANES;

/// The number of bins along an axis.
const BINS: usize = 12;

/// The index of an emitter and its bounds.
type Entry = (u32, LightBounds);

impl LightSelection {
    /// Builds the tree over all emitters with bounds.
    pub(super) fn build(&mut self, entries: &mut [Entry]) {
        if !entries.is_empty() {
            self.node(entries, (0, 0));
        }
    }

    /// Adds a node over the entries, and returns its index.
    fn node(&mut self, entries: &mut [Entry], parent: (u32, u32)) -> u32 {
        let index = self.nodes.len() as u32;
        self.nodes.push(Node {
            bounds: LightBoundsX16::none(),
            children: [Child::None; LANES],
            count: 0,
            parent,
        });
        let mut bounds = LightBoundsX16::none();
        let mut children = [Child::None; LANES];
        let clusters = clusters(entries);
        let count = clusters.len();
        for (i, cluster) in clusters.into_iter().enumerate() {
            bounds.set_lane(i, &union(cluster));
            children[i] = match cluster {
                [(emitter, _)] => {
                    self.locations[*emitter as usize] = Location::Tree(index, i as u32);
                    Child::Emitter(*emitter)
                }
                _ => Child::Node(self.node(cluster, (index, i as u32))),
            };
        }
        let node = &mut self.nodes[index as usize];
        (node.bounds, node.children, node.count) = (bounds, children, count);
        index
    }
}

/// Divides the entries into at most sixteen clusters: the most costly cluster is split until there are so many.
fn clusters(entries: &mut [Entry]) -> Vec<&mut [Entry]> {
    if entries.len() <= LANES {
        return entries.chunks_mut(1).collect();
    }
    let mut clusters = vec![(f32::INFINITY, entries)];
    while clusters.len() < LANES {
        let most =
            |(i, cluster): (usize, &(f32, &mut [Entry]))| (cluster.1.len() > 1).then_some((i, cluster.0));
        let Some((worst, _)) =
            clusters.iter().enumerate().filter_map(most).max_by(|a, b| a.1.total_cmp(&b.1))
        else {
            break;
        };
        let (_, cluster) = clusters.swap_remove(worst);
        let (left, right) = split(cluster);
        clusters.extend([left, right].map(|part| (union(part).cost(), part)));
    }
    clusters.into_iter().map(|(_, cluster)| cluster).collect()
}

/// Splits a cluster of at least two entries where the sum of the parts' costs is least.
fn split(entries: &mut [Entry]) -> (&mut [Entry], &mut [Entry]) {
    let center = |entry: &Entry| entry.1.bounds.center();
    let low = entries.iter().map(center).reduce(|a, b| a.min(b)).unwrap_or_default();
    let high = entries.iter().map(center).reduce(|a, b| a.max(b)).unwrap_or_default();
    let mut best: Option<(f32, usize, usize)> = None;
    for axis in 0..3 {
        let scale = BINS as f32 / (high[axis] - low[axis]);
        if !(scale > 0.0 && scale.is_finite()) {
            continue;
        }
        let bin = |entry: &Entry| (((center(entry)[axis] - low[axis]) * scale) as usize).min(BINS - 1);
        let mut bins: [Option<LightBounds>; BINS] = [None; BINS];
        for entry in entries.iter() {
            let bin = &mut bins[bin(entry)];
            *bin = Some(bin.map_or(entry.1, |bounds| bounds.union(&entry.1)));
        }
        for border in 1..BINS {
            let sum =
                |bins: &[Option<LightBounds>]| bins.iter().flatten().copied().reduce(|a, b| a.union(&b));
            let (Some(left), Some(right)) = (sum(&bins[..border]), sum(&bins[border..])) else { continue };
            let cost = left.cost() + right.cost();
            if best.is_none_or(|(least, ..)| cost < least) {
                best = Some((cost, axis, border));
            }
        }
    }
    let middle = match best {
        Some((_, axis, border)) => {
            let scale = BINS as f32 / (high[axis] - low[axis]);
            let is_left =
                |entry: &Entry| (((center(entry)[axis] - low[axis]) * scale) as usize).min(BINS - 1) < border;
            entries.sort_by_key(|entry| !is_left(entry));
            entries.partition_point(is_left)
        }
        None => entries.len() / 2,
    };
    entries.split_at_mut(middle)
}

/// Returns the bounds of a cluster, which is not empty.
fn union(entries: &[Entry]) -> LightBounds {
    let mut all = entries.iter().map(|(_, bounds)| *bounds);
    let first = all.next().expect("a cluster has an entry");
    all.fold(first, |sum, bounds| sum.union(&bounds))
}
