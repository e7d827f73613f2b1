//! The choice of an emitter for a surface point, by a tree over all emitters. [Conty Estevez and Kulla 2018]
//!
//! A node of the tree has up to sixteen children, each an emitter or another node. A child is chosen in proportion to
//! an estimate of the irradiance that it causes at the point. Emitters at infinity are not in the tree; they have an
//! estimate of their own. A small fraction of the samples is distributed equally over all emitters, because the
//! estimate does not include occlusion: the emitter with the smallest estimate may be the only visible one.
//!
//! The probability of a choice is known for any emitter and point, as multiple importance sampling requires.

mod bounds;
mod build;
mod extent;

pub use bounds::{Cone, LightBounds};
pub use extent::Extent;

use super::Light;
use crate::math::{LANES, Vec3, Vec3x16, f32x16, lanes};
use crate::sampling::hash;
use bounds::LightBoundsX16;

/// The fraction of the samples that is distributed equally over all emitters.
const UNIFORM_FRACTION: f64 = 0.05;
/// If there are emitters of both kinds, the least fraction of the other samples for those in the tree, and for those at
/// infinity.
const LEAST_FRACTION: f64 = 0.2;

/// A choice among the emitters of a scene.
pub struct LightSelection {
    /// The emitters that emit anything, by index.
    emitters: Vec<u32>,
    /// The location of each emitter of the scene.
    locations: Vec<Location>,
    /// The nodes; the first is the root.
    nodes: Vec<Node>,
    /// The emitters at infinity and their irradiance.
    infinite: Vec<(u32, f32)>,
    /// The sum of the irradiances of the emitters at infinity.
    infinite_sum: f32,
}

/// A node of the tree.
struct Node {
    /// The bounds of the children.
    bounds: LightBoundsX16,
    /// The children.
    children: [Child; LANES],
    /// The number of children.
    count: usize,
    /// The parent and the position among its children; unused at the root.
    parent: (u32, u32),
}

/// A child of a node.
#[derive(Clone, Copy)]
enum Child {
    None,
    Emitter(u32),
    Node(u32),
}

/// Where an emitter is.
#[derive(Clone, Copy)]
enum Location {
    /// Nowhere: it emits nothing.
    Dark,
    /// In the tree: its node, and its position among the children.
    Tree(u32, u32),
    /// At infinity, with this irradiance.
    Infinity(f32),
}

/// A chosen emitter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// The index of the emitter.
    pub emitter: usize,
    /// The probability of the choice.
    pub pmf: f32,
}

impl LightSelection {
    /// Creates the selection among the given emitters. Emitters without power are never chosen.
    pub fn new(lights: &[Light]) -> Self {
        let mut selection = LightSelection {
            emitters: Vec::new(),
            locations: vec![Location::Dark; lights.len()],
            nodes: Vec::new(),
            infinite: Vec::new(),
            infinite_sum: 0.0,
        };
        let mut finite = Vec::new();
        for (i, light) in lights.iter().enumerate().filter(|(_, light)| light.power().luminance() > 0.0) {
            selection.emitters.push(i as u32);
            match light.extent() {
                Extent::Finite(bounds) => finite.push((i as u32, bounds)),
                Extent::Infinite(irradiance) => {
                    let irradiance = irradiance.min(1e30);
                    selection.infinite.push((i as u32, irradiance));
                    selection.locations[i] = Location::Infinity(irradiance);
                }
            }
        }
        selection.infinite_sum = selection.infinite.iter().map(|(_, irradiance)| irradiance).sum();
        selection.build(&mut finite);
        selection
    }

    /// Returns the only emitter that is ever chosen, if there is only one.
    #[inline]
    pub fn only(&self) -> Option<usize> {
        match self.emitters[..] {
            [emitter] => Some(emitter as usize),
            _ => None,
        }
    }

    /// Chooses an emitter for the point `p` with a random number `u` in [0, 1); `None` if nothing emits.
    pub fn sample(&self, p: Vec3, u: f32) -> Option<Choice> {
        match self.emitters[..] {
            [] => return None,
            [emitter] => return Some(Choice { emitter: emitter as usize, pmf: 1.0 }),
            _ => {}
        }
        let mut u = extended(u, p);
        let count = self.emitters.len();
        if u < UNIFORM_FRACTION {
            let i = (u / UNIFORM_FRACTION * count as f64) as usize;
            let emitter = self.emitters[i.min(count - 1)] as usize;
            return Some(Choice { emitter, pmf: self.pmf(emitter, p) });
        }
        u = (u - UNIFORM_FRACTION) / (1.0 - UNIFORM_FRACTION);
        let (emitter, probability) = self.sample_by_light(p, u);
        Some(Choice { emitter: emitter as usize, pmf: self.mixed(probability) })
    }

    /// Chooses an emitter for each point, for the lanes in the mask `active`. Returns the emitters' indices, their
    /// probabilities, and the mask of the lanes with a choice.
    #[inline]
    pub fn sample_x16(&self, p: Vec3x16, u: f32x16, active: u32) -> ([usize; LANES], f32x16, u32) {
        match &self.nodes[..] {
            [root] if self.emitters.len() <= LANES && self.emitters.len() > 1 => {
                self.sample_among(root, p, u, active)
            }
            _ => {
                let (mut emitters, mut pmf, mut chosen) = ([0; LANES], [0.0; LANES], 0);
                for i in lanes::bits(active) {
                    if let Some(choice) = self.sample(p.lane(i), u.as_array()[i]) {
                        (emitters[i], pmf[i]) = (choice.emitter, choice.pmf);
                        chosen |= 1 << i;
                    }
                }
                (emitters, f32x16::new(pmf), chosen)
            }
        }
    }

    /// Chooses among a few emitters, with one point in each lane.
    fn sample_among(&self, root: &Node, p: Vec3x16, u: f32x16, active: u32) -> ([usize; LANES], f32x16, u32) {
        let mut weights = [f32x16::ZERO; LANES];
        let mut total = f32x16::ZERO;
        for (i, weight) in weights[..root.count].iter_mut().enumerate() {
            *weight = root.bounds.splat_lane(i).importance(p);
            total += *weight;
        }
        let lit = total.simd_gt(f32x16::ZERO);
        let least = f32x16::splat(LEAST_FRACTION as f32);
        let sum = f32x16::splat(self.infinite_sum);
        let share = match self.infinite[..] {
            [] => f32x16::ZERO,
            _ => lit.select((sum / (sum + total)).max(least), f32x16::ONE).min(f32x16::ONE - least),
        };
        let uniform = f32x16::splat((UNIFORM_FRACTION / self.emitters.len() as f64) as f32);
        let by_light = f32x16::splat(1.0 - UNIFORM_FRACTION as f32);
        let scale = lit.select(by_light * (f32x16::ONE - share), f32x16::ZERO);
        // Where all weights are 0, the quotient below must not be 0 / 0.
        let total = lit.select(total, f32x16::ONE);
        let dark =
            lit.select(f32x16::ZERO, by_light * (f32x16::ONE - share) / f32x16::splat(root.count as f32));
        let mut chosen = Chosen { u, ..Chosen::default() };
        for (child, weight) in root.children.iter().zip(weights).take(root.count) {
            if let Child::Emitter(emitter) = child {
                chosen.consider(*emitter, uniform + weight / total * scale + dark);
            }
        }
        for (emitter, irradiance) in &self.infinite {
            let part = f32x16::splat(self.part_of_infinite(*irradiance) as f32);
            chosen.consider(*emitter, uniform + by_light * share * part);
        }
        (chosen.emitters.as_array().map(|i| i as usize), chosen.pmf, active)
    }

    /// Returns the probability with which [`sample`](Self::sample) chooses an emitter for the point `p`.
    pub fn pmf(&self, emitter: usize, p: Vec3) -> f32 {
        if self.only() == Some(emitter) {
            return 1.0;
        }
        let root = self.root_weights(p);
        let share = self.share_at_infinity(root.as_ref());
        let by_light = match (self.locations[emitter], &root) {
            (Location::Tree(node, position), Some(root)) => {
                (1.0 - share) * self.probability_in_tree(root, node, position, p)
            }
            (Location::Infinity(irradiance), _) => share * self.part_of_infinite(irradiance),
            _ => return 0.0,
        };
        self.mixed(by_light)
    }

    /// Returns the probability of an emitter that is chosen with the given probability by irradiance.
    #[inline]
    fn mixed(&self, by_light: f64) -> f32 {
        let uniform = 1.0 / self.emitters.len() as f64;
        (UNIFORM_FRACTION * uniform + (1.0 - UNIFORM_FRACTION) * by_light) as f32
    }

    /// Returns the weights of the root's children; `None` if all emitters are at infinity.
    fn root_weights(&self, p: Vec3) -> Option<Weights> {
        self.nodes.first().map(|root| Weights::new(root, p))
    }

    /// Returns the fraction of the samples for emitters at infinity, given the weights of the root's children.
    fn share_at_infinity(&self, root: Option<&Weights>) -> f64 {
        let infinite = f64::from(self.infinite_sum);
        match root {
            _ if self.infinite.is_empty() => 0.0,
            None => 1.0,
            Some(root) if root.total > 0.0 => {
                (infinite / (infinite + root.total)).clamp(LEAST_FRACTION, 1.0 - LEAST_FRACTION)
            }
            Some(_) => 1.0 - LEAST_FRACTION,
        }
    }

    /// Chooses by irradiance. Returns the emitter and its probability.
    fn sample_by_light(&self, p: Vec3, mut u: f64) -> (u32, f64) {
        let root = self.root_weights(p);
        let share = self.share_at_infinity(root.as_ref());
        if u < share {
            u /= share;
            let mut below = 0.0;
            for (i, (emitter, irradiance)) in self.infinite.iter().enumerate() {
                let part = self.part_of_infinite(*irradiance);
                below += part;
                if u < below || i + 1 == self.infinite.len() {
                    return (*emitter, share * part);
                }
            }
        }
        u = (u - share) / (1.0 - share);
        let mut probability = 1.0 - share;
        let (mut node, mut weights) = (&self.nodes[0], root.expect("an emitter is in the tree"));
        loop {
            let (position, rest) = weights.sample(u);
            u = rest;
            probability *= weights.probability(position);
            node = match node.children[position] {
                Child::Emitter(emitter) => return (emitter, probability),
                Child::Node(next) => &self.nodes[next as usize],
                Child::None => unreachable!("the position is below the number of children"),
            };
            weights = Weights::new(node, p);
        }
    }

    /// Returns the part of an emitter among those at infinity.
    fn part_of_infinite(&self, irradiance: f32) -> f64 {
        match self.infinite_sum > 0.0 {
            true => f64::from(irradiance) / f64::from(self.infinite_sum),
            false => 1.0 / self.infinite.len() as f64,
        }
    }

    /// Returns the probability with which the tree chooses the child at a position of a node, given the weights of the
    /// root's children.
    fn probability_in_tree(&self, root: &Weights, mut node: u32, mut position: u32, p: Vec3) -> f64 {
        let mut probability = 1.0;
        while node != 0 {
            let inner = &self.nodes[node as usize];
            probability *= Weights::new(inner, p).probability(position as usize);
            (node, position) = inner.parent;
        }
        probability * root.probability(position as usize)
    }
}

/// A choice in each lane.
#[derive(Default)]
struct Chosen {
    /// Random numbers.
    u: f32x16,
    /// The sum of the probabilities so far.
    below: f32x16,
    /// Indices of emitters.
    emitters: f32x16,
    /// Their probabilities.
    pmf: f32x16,
    /// Mask of the lanes whose choice is final.
    done: f32x16,
}

impl Chosen {
    /// Chooses an emitter in the lanes whose number is in its interval. The last emitter gets the rest.
    #[inline(always)]
    fn consider(&mut self, emitter: u32, probability: f32x16) {
        self.emitters = self.done.select(self.emitters, f32x16::splat(emitter as f32));
        self.pmf = self.done.select(self.pmf, probability);
        self.below += probability;
        self.done |= self.u.simd_lt(self.below);
    }
}

/// The weights of a node's children for a point.
struct Weights {
    weights: [f32; LANES],
    count: usize,
    total: f64,
}

impl Weights {
    #[inline]
    fn new(node: &Node, p: Vec3) -> Self {
        let weights = *node.bounds.importance(Vec3x16::splat(p)).as_array();
        let total = weights[..node.count].iter().map(|w| f64::from(*w)).sum();
        Weights { weights, count: node.count, total }
    }

    /// Returns the probability of a child. If all are dark, they are equal.
    #[inline]
    fn probability(&self, i: usize) -> f64 {
        match self.total > 0.0 {
            true => f64::from(self.weights[i]) / self.total,
            false => 1.0 / self.count as f64,
        }
    }

    /// Chooses a child, and returns it with the random number rescaled to [0, 1).
    #[inline]
    fn sample(&self, u: f64) -> (usize, f64) {
        let (total, equal) = if self.total > 0.0 { (self.total, 0.0) } else { (self.count as f64, 1.0) };
        let target = u * total;
        let (mut below, mut last) = (0.0, (0, 0.0, 1.0));
        for (i, weight) in self.weights[..self.count].iter().enumerate() {
            let weight = f64::from(*weight) + equal;
            if weight > 0.0 {
                last = (i, below, weight);
                if target < below + weight {
                    break;
                }
            }
            below += weight;
        }
        let (i, below, weight) = last;
        (i, ((target - below) / weight).clamp(0.0, 1f64.next_down()))
    }
}

/// Returns a number whose leading bits are those of `u`. The other bits are a hash of `u` and `p`, because a choice
/// among many emitters needs more bits than `u` has.
#[inline]
fn extended(u: f32, p: Vec3) -> f64 {
    let [low, _, _] = hash::pcg3d(u.to_bits() ^ p.x.to_bits(), p.y.to_bits(), p.z.to_bits());
    // Random numbers below 2^-8 are multiples of 2^-32, others of 2^-24.
    let step = if u < 1.0 / 256.0 { 32 } else { 24 };
    (f64::from(u) + f64::from(low) * 0.5f64.powi(step + 32)).min(1f64.next_down())
}
