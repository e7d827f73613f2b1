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
mod few;
mod receiver;

pub use bounds::{Cone, LightBounds};
pub use extent::Extent;
pub use receiver::{Gloss, GlossX16, Receiver, ReceiverX16};

use super::Light;
use crate::math::{LANES, f32x16, lanes};
use crate::sampling::hash;
use bounds::LightBoundsX16;
use few::Few;

/// The fraction of the samples that is distributed equally over all emitters.
const UNIFORM_FRACTION: f64 = 1.0 / 16.0;
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
    /// The choice, if there are at least two emitters and few.
    few: Option<Few>,
    /// The emitters at infinity and their irradiance.
    infinite: Vec<(u32, f32)>,
    /// The sum of the irradiances of the emitters at infinity.
    infinite_sum: f32,
    /// Whether only the radiance of an environment in excess of its mean is sampled.
    compensated: bool,
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
    /// A random number in [0, 1) that is independent of the choice.
    pub u: f32,
}

/// A [`Choice`] in each of sixteen lanes.
#[derive(Clone, Copy, Debug)]
pub struct ChoiceX16 {
    /// The indices of the emitters.
    pub emitters: [usize; LANES],
    /// The probabilities of the choices.
    pub pmf: f32x16,
    /// Random numbers in [0, 1) that are independent of the choices.
    pub u: f32x16,
}

impl LightSelection {
    /// Creates the selection among the given emitters. Emitters without power are never chosen.
    pub fn new(lights: &[Light]) -> Self {
        Self::among(lights, |light| Some(light.extent()))
    }

    /// Creates the selection for points at which the BSDF is sampled too. Only the radiance of an environment in excess
    /// of its mean is sampled, because BSDF samples have less variance for the rest. A uniform environment is never
    /// chosen. [Karlík 2019, MIS compensation]
    /// `None` if there is no environment, because the selection is then that of [`new`](Self::new).
    pub fn compensated(lights: &[Light]) -> Option<Self> {
        let has_environment = lights.iter().any(|light| matches!(light, Light::Environment(_)));
        let selection = || Self::among(lights, Light::compensated_extent);
        has_environment.then(|| LightSelection { compensated: true, ..selection() })
    }

    /// Creates the selection among the emitters that have an extent.
    fn among(lights: &[Light], extent: impl Fn(&Light) -> Option<Extent>) -> Self {
        let mut selection = LightSelection {
            emitters: Vec::new(),
            locations: vec![Location::Dark; lights.len()],
            nodes: Vec::new(),
            few: None,
            infinite: Vec::new(),
            infinite_sum: 0.0,
            compensated: false,
        };
        let mut finite = Vec::new();
        for (i, light) in lights.iter().enumerate().filter(|(_, light)| light.power().luminance() > 0.0) {
            let Some(extent) = extent(light) else { continue };
            selection.emitters.push(i as u32);
            match extent {
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
        selection.few = selection.few();
        selection
    }

    /// Returns the choice among a few emitters; `None` if they are many or fewer than two.
    fn few(&self) -> Option<Few> {
        if !(2..=LANES).contains(&self.emitters.len()) {
            return None;
        }
        let root = self.nodes.first();
        let finite = root.iter().flat_map(|root| &root.children).filter_map(|child| match child {
            Child::Emitter(emitter) => Some(*emitter),
            _ => None,
        });
        let emitters: Vec<u32> = finite.chain(self.infinite.iter().map(|(emitter, _)| *emitter)).collect();
        let irradiance: Vec<f32> = self.infinite.iter().map(|(_, irradiance)| *irradiance).collect();
        Some(Few::new(emitters, root.map_or_else(LightBoundsX16::none, |root| root.bounds), &irradiance))
    }

    /// Returns whether only the radiance of an environment in excess of its mean is sampled.
    #[inline]
    pub fn is_compensated(&self) -> bool {
        self.compensated
    }

    /// Returns whether no emitter is ever chosen.
    pub fn is_empty(&self) -> bool {
        self.emitters.is_empty()
    }

    /// Returns the only emitter that is ever chosen, if there is only one.
    #[inline]
    pub fn only(&self) -> Option<usize> {
        match self.emitters[..] {
            [emitter] => Some(emitter as usize),
            _ => None,
        }
    }

    /// Chooses an emitter for a point with a random number `u` in [0, 1); `None` if nothing emits.
    pub fn sample(&self, at: impl Into<Receiver>, u: f32) -> Option<Choice> {
        let at = at.into();
        match self.emitters[..] {
            [] => return None,
            [emitter] => return Some(Choice { emitter: emitter as usize, pmf: 1.0, u }),
            _ => {}
        }
        if let Some(few) = &self.few {
            let choices = few.sample_x16(&ReceiverX16::splat(at), f32x16::splat(u));
            let (pmf, u) = (choices.pmf.as_array()[0], choices.u.as_array()[0]);
            return Some(Choice { emitter: choices.emitters[0], pmf, u });
        }
        // A choice among many emitters needs more digits than `u` has.
        let u = (f64::from(u) + f64::from(hash::lower_digits(u, at.p))).min(1f64.next_down());
        let count = self.emitters.len();
        if u < UNIFORM_FRACTION {
            let target = u / UNIFORM_FRACTION * count as f64;
            let emitter = self.emitters[(target as usize).min(count - 1)] as usize;
            return Some(Choice { emitter, pmf: self.pmf(emitter, at), u: below_one(target.fract()) });
        }
        let (emitter, probability, rest) =
            self.sample_by_light(at, (u - UNIFORM_FRACTION) / (1.0 - UNIFORM_FRACTION));
        Some(Choice { emitter: emitter as usize, pmf: self.mixed(probability), u: below_one(rest) })
    }

    /// Chooses an emitter for each point, for the lanes in the mask `active`; `None` if nothing emits.
    #[inline]
    pub fn sample_x16(&self, at: &ReceiverX16, u: f32x16, active: u32) -> Option<ChoiceX16> {
        if let Some(few) = &self.few {
            return Some(few.sample_x16(at, u));
        }
        if let Some(only) = self.only() {
            return Some(ChoiceX16 { emitters: [only; LANES], pmf: f32x16::ONE, u });
        }
        let (mut emitters, mut pmf, mut rest) = ([0; LANES], [0.0; LANES], [0.0; LANES]);
        for i in lanes::bits(active) {
            let choice = self.sample(at.lane(i), u.as_array()[i])?;
            (emitters[i], pmf[i], rest[i]) = (choice.emitter, choice.pmf, choice.u);
        }
        (!self.emitters.is_empty()).then_some(ChoiceX16 {
            emitters,
            pmf: f32x16::new(pmf),
            u: f32x16::new(rest),
        })
    }

    /// Computes [`pmf`](Self::pmf) for the first `count` of sixteen points.
    pub fn pmf_x16(&self, emitter: usize, at: &ReceiverX16, count: usize) -> f32x16 {
        match &self.few {
            _ if matches!(self.locations[emitter], Location::Dark) => f32x16::ZERO,
            Some(few) => few.pmf_x16(emitter, at),
            None if self.only() == Some(emitter) => f32x16::ONE,
            None => {
                let pmf = |i: usize| if i < count { self.pmf(emitter, at.lane(i)) } else { 0.0 };
                f32x16::new(std::array::from_fn(pmf))
            }
        }
    }

    /// Returns the probability with which [`sample`](Self::sample) chooses an emitter for a point.
    pub fn pmf(&self, emitter: usize, at: impl Into<Receiver>) -> f32 {
        let at = at.into();
        if let Location::Dark = self.locations[emitter] {
            return 0.0;
        }
        if self.only() == Some(emitter) {
            return 1.0;
        }
        if let Some(few) = &self.few {
            return few.pmf(emitter, at);
        }
        let root = self.root_weights(at);
        let share = self.share_at_infinity(root.as_ref());
        let by_light = match (self.locations[emitter], &root) {
            (Location::Tree(node, position), Some(root)) => {
                (1.0 - share) * self.probability_in_tree(root, node, position, at)
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
    fn root_weights(&self, at: Receiver) -> Option<Weights> {
        self.nodes.first().map(|root| Weights::new(root, at))
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

    /// Chooses by irradiance. Returns the emitter, its probability and the rest of the random number.
    fn sample_by_light(&self, at: Receiver, mut u: f64) -> (u32, f64, f64) {
        let root = self.root_weights(at);
        let share = self.share_at_infinity(root.as_ref());
        if u < share {
            u /= share;
            let mut below = 0.0;
            for (i, (emitter, irradiance)) in self.infinite.iter().enumerate() {
                let part = self.part_of_infinite(*irradiance);
                if u < below + part || i + 1 == self.infinite.len() {
                    return (*emitter, share * part, (u - below) / part);
                }
                below += part;
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
                Child::Emitter(emitter) => return (emitter, probability, u),
                Child::Node(next) => &self.nodes[next as usize],
                Child::None => unreachable!("the position is below the number of children"),
            };
            weights = Weights::new(node, at);
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
    fn probability_in_tree(&self, root: &Weights, mut node: u32, mut position: u32, at: Receiver) -> f64 {
        let mut probability = 1.0;
        while node != 0 {
            let inner = &self.nodes[node as usize];
            probability *= Weights::new(inner, at).probability(position as usize);
            (node, position) = inner.parent;
        }
        probability * root.probability(position as usize)
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
    fn new(node: &Node, at: Receiver) -> Self {
        let weights = *node.bounds.importance(&ReceiverX16::splat(at)).as_array();
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

/// Rounds a number in [0, 1] to one in [0, 1).
fn below_one(u: f64) -> f32 {
    (u as f32).clamp(0.0, 1f32.next_down())
}
