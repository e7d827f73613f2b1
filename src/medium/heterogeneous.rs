//! Media with coefficients that depend on the point.

use super::{Phase, Stream, Volume};
use crate::color::Rgb;
use crate::math::{self, DVec3, Vec3};

/// The number of cells of a grid that share a bound of the extinction, along each axis.
const SHARED: usize = 8;
/// The greatest number of bounds along each axis.
const MOST_BOUNDS: usize = 128;

/// The greatest transmittance at which a flight that is not sampled may end by Russian roulette.
const ROULETTE: f64 = 0.1;

/// A medium with coefficients that depend on the point. It is in the box that contains the grid of the extinction and
/// is aligned with the axes of world space. Outside of it there is vacuum.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Heterogeneous {
    /// The extinction coefficient by channel, in inverse world-space units, divided by `scale`.
    sigma_t: Volume,
    /// The ratio of the scattering coefficient to the extinction coefficient.
    albedo: Volume,
    /// The factor of the extinction coefficient.
    scale: f32,
    /// The phase function.
    pub phase: Phase,
    /// Upper bounds of the extinction, which follow from the rest.
    #[serde(skip)]
    bounds: Bounds,
}

/// Upper bounds of the extinction in the equal parts of a box.
#[derive(Clone, Debug, Default, PartialEq)]
struct Bounds {
    /// The box of the medium in world space.
    world: [DVec3; 2],
    /// A box that contains it, in local coordinates of the extinction, which is divided into parts.
    local: [DVec3; 2],
    /// The number of parts along each axis.
    size: [usize; 3],
    /// The bounds; x is the fastest axis.
    values: Vec<f32>,
}

/// A part of a ray.
#[derive(Clone, Copy, Debug)]
pub struct Segment {
    /// The origin.
    pub origin: Vec3,
    /// The unit direction.
    pub direction: Vec3,
    /// The length, which may be infinite.
    pub length: f64,
}

/// A point at which light may be scattered or absorbed.
#[derive(Clone, Copy, Debug)]
pub struct Tentative {
    /// The distance from the segment's origin.
    pub distance: f64,
    /// The density of such points per unit length.
    pub majorant: f64,
    /// The extinction coefficients, at most `majorant`.
    pub sigma_t: [f64; 3],
    /// The scattering coefficients.
    pub sigma_s: [f64; 3],
}

impl Heterogeneous {
    /// Creates a medium.
    pub fn new(sigma_t: Volume, albedo: Volume, scale: f32, phase: Phase) -> Self {
        let bounds = Bounds::of(&sigma_t, scale);
        Heterogeneous { sigma_t, albedo, scale, phase, bounds }
    }

    /// Returns the box of the medium in world space.
    pub fn world_box(&self) -> math::Bounds {
        math::Bounds::of(self.bounds.world.map(|p| p.as_vec3()))
    }

    /// Returns whether the coefficients are finite.
    pub fn is_finite(&self) -> bool {
        self.bounds.values.iter().all(|bound| bound.is_finite())
    }

    /// Returns whether the medium scatters light in any channel.
    pub fn scatters(&self) -> bool {
        !self.albedo.constant_value().is_some_and(|albedo| albedo.is_black())
    }

    /// Follows a path with the throughput `beta`. Returns the distance at which the medium scatters it, if it does, and
    /// the factor of the throughput up to there. If `sampled` is false, only the transmittance counts.
    ///
    /// The flight visits points whose density is a bound of the extinction of all channels. At each, it is scattered
    /// or goes on, with probabilities in proportion to the sum of the channels of the throughput after either. [Kutz
    /// et al. 2017, spectral tracking] Thus that sum does not grow.
    pub fn track(
        &self,
        segment: &Segment,
        beta: Rgb,
        sampled: bool,
        random: &mut Stream,
    ) -> (Option<f64>, Rgb) {
        let samples = sampled && self.scatters();
        let beta = beta.to_array().map(f64::from);
        let (mut end, mut factors) = (None, [1.0; 3]);
        // Two streams, because both closures need numbers.
        let mut decisions = random.other();
        self.visit(
            segment,
            || random.uniform(),
            |at| {
                let null = at.sigma_t.map(|sigma| at.majorant - sigma);
                let weight = |sigma: &[f64; 3]| (0..3).map(|c| beta[c] * factors[c] * sigma[c]).sum::<f64>();
                let (scatters, passes) = (if samples { weight(&at.sigma_s) } else { 0.0 }, weight(&null));
                let probability = if scatters > 0.0 { scatters / (scatters + passes) } else { 0.0 };
                let ends = probability > 0.0 && decisions.uniform() < probability;
                let (sigma, probability) =
                    if ends { (at.sigma_s, probability) } else { (null, 1.0 - probability) };
                for c in 0..3 {
                    factors[c] *= sigma[c] / (at.majorant * probability);
                }
                if ends {
                    end = Some(at.distance);
                    return false;
                }
                let largest = factors.iter().copied().fold(0.0, f64::max);
                if largest < ROULETTE && !samples && largest > 0.0 {
                    let survival = largest / ROULETTE;
                    let survives = decisions.uniform() < survival;
                    factors = factors.map(|f| if survives { f / survival } else { 0.0 });
                }
                factors.iter().any(|f| *f > 0.0)
            },
        );
        (end, factors.map(|factor| factor as f32).into())
    }

    /// Visits random points of a segment, in order, until `visit` returns false. Their density per unit length is a
    /// bound of the extinction in the surroundings, and the points are independent: a Poisson process. [Woodcock 1965;
    /// Szirmay-Kalos et al. 2011] `uniform` returns independent uniform numbers in (0, 1).
    pub fn visit(
        &self,
        segment: &Segment,
        mut uniform: impl FnMut() -> f64,
        mut visit: impl FnMut(&Tentative) -> bool,
    ) {
        let origin = segment.origin.as_dvec3();
        let Some(range) = crossing(self.bounds.world, origin, segment) else { return };
        let (local, direction) =
            (self.sigma_t.local(origin), self.sigma_t.local_direction(segment.direction));
        let mut walk = Walk::new(&self.bounds, local, direction, range);
        let mut depth = -uniform().ln();
        loop {
            let majorant = f64::from(self.bounds.values[walk.index()]);
            let exit = walk.exit();
            loop {
                let next = walk.t + depth / majorant;
                // Without extinction, the next point is infinitely far.
                if next >= exit {
                    depth -= majorant * (exit - walk.t);
                    break;
                }
                walk.t = next;
                let at = self.tentative(segment, next, (local + direction * next, majorant), &mut uniform);
                if !visit(&at) {
                    return;
                }
                depth = -uniform().ln();
            }
            if !walk.advance() {
                return;
            }
        }
    }

    /// The extinction is random. Its mean is that at the point; what depends on it is linear.
    fn tentative(
        &self,
        segment: &Segment,
        distance: f64,
        (local, majorant): (DVec3, f64),
        uniform: impl FnOnce() -> f64,
    ) -> Tentative {
        let of_extinction = self.sigma_t.sample_at_local(local, uniform) * self.scale;
        let p = segment.origin.as_dvec3() + segment.direction.as_dvec3() * distance;
        let albedo: Rgb = match self.albedo.constant_value() {
            Some(albedo) => albedo,
            None => self.albedo.at_local(self.albedo.local(p)),
        };
        let sigma_t = of_extinction.to_array().map(|sigma| f64::from(sigma).min(majorant));
        let albedo = albedo.to_array();
        let sigma_s = [0, 1, 2].map(|c| sigma_t[c] * f64::from(albedo[c]));
        Tentative { distance, majorant, sigma_t, sigma_s }
    }
}

impl Bounds {
    fn of(sigma_t: &Volume, scale: f32) -> Self {
        let world = sigma_t.world_box();
        let local = sigma_t.local_box(world);
        let [low, high] = local;
        let cells = sigma_t.size();
        let size = [0, 1, 2].map(|axis| {
            let cells = cells[axis] as f64 * (high[axis] - low[axis]);
            ((cells / SHARED as f64).ceil() as usize).clamp(1, MOST_BOUNDS)
        });
        let corner = |i: [usize; 3]| {
            let [x, y, z] = [0, 1, 2].map(|axis| i[axis] as f64 / size[axis] as f64);
            low + (high - low) * DVec3::new(x, y, z)
        };
        let mut values = Vec::with_capacity(size.iter().product());
        for z in 0..size[2] {
            for y in 0..size[1] {
                for x in 0..size[0] {
                    let part = [corner([x, y, z]), corner([x + 1, y + 1, z + 1])];
                    values.push(sigma_t.bound(part) * scale);
                }
            }
        }
        Bounds { world, local, size, values }
    }
}

/// Returns the range of distances at which a segment is in a box; `None` if it is empty.
fn crossing([low, high]: [DVec3; 2], origin: DVec3, segment: &Segment) -> Option<[f64; 2]> {
    let (mut start, mut end) = (0.0f64, segment.length);
    for axis in 0..3 {
        let (o, d) = (origin[axis], f64::from(segment.direction[axis]));
        if d == 0.0 {
            if o < low[axis] || o > high[axis] {
                return None;
            }
            continue;
        }
        let (near, far) = ((low[axis] - o) / d, (high[axis] - o) / d);
        start = start.max(near.min(far));
        end = end.min(near.max(far));
    }
    (start < end).then_some([start, end])
}

/// The way of a ray through the equal parts of a box. [Amanatides and Woo 1987]
struct Walk {
    size: [usize; 3],
    part: [usize; 3],
    /// The current distance.
    t: f64,
    /// The distance at which the ray leaves the box or ends.
    end: f64,
    /// The distance at which the ray leaves the current part, along each axis.
    next: [f64; 3],
    /// The distance between two borders of parts, along each axis.
    step: [f64; 3],
    forward: [bool; 3],
}

impl Walk {
    /// Starts in the part in which a ray in local coordinates is at the first of two distances.
    fn new(bounds: &Bounds, origin: DVec3, direction: DVec3, [t, end]: [f64; 2]) -> Self {
        let size = bounds.size;
        let [low, high] = bounds.local;
        let width = |axis: usize| (high[axis] - low[axis]) / size[axis] as f64;
        let at = origin + direction * t;
        let forward = [0, 1, 2].map(|axis| direction[axis] > 0.0);
        let part = [0, 1, 2].map(|axis| {
            let i = (at[axis] - low[axis]) / width(axis);
            (i.max(0.0) as usize).min(size[axis] - 1)
        });
        let next = [0, 1, 2].map(|axis| {
            let border = low[axis] + (part[axis] + usize::from(forward[axis])) as f64 * width(axis);
            if direction[axis] == 0.0 { f64::INFINITY } else { (border - origin[axis]) / direction[axis] }
        });
        let step = [0, 1, 2].map(|axis| width(axis) / direction[axis].abs());
        Walk { size, part, t, end, next, step, forward }
    }

    fn index(&self) -> usize {
        let [x, y, z] = self.part;
        (z * self.size[1] + y) * self.size[0] + x
    }

    /// Returns the distance at which the ray leaves the current part.
    fn exit(&self) -> f64 {
        self.next.into_iter().fold(self.end, f64::min)
    }

    /// Goes to the next part; returns false if the ray leaves the box or ends.
    fn advance(&mut self) -> bool {
        self.t = self.t.max(self.exit());
        if self.t >= self.end {
            return false;
        }
        let axis = (0..3).min_by(|a, b| self.next[*a].total_cmp(&self.next[*b])).expect("three axes");
        self.next[axis] += self.step[axis];
        let last = if self.forward[axis] { self.size[axis] - 1 } else { 0 };
        if self.part[axis] == last {
            // The rest, if there is one, is a rounding error.
            return false;
        }
        if self.forward[axis] {
            self.part[axis] += 1
        } else {
            self.part[axis] -= 1
        }
        true
    }
}
