//! Emitter sampling for sixteen points at a time.
//!
//! Rectangles, spheres, points, spots without texture, directional emitters, the environment and the sun are sampled in
//! parallel lanes, other emitters one lane after the other.

use super::environment::EnvironmentRadiance;
use super::environment_map::EnvMapSampleX16;
use super::selection::Cone;
use super::spherical_cap::SphericalCapX16;
use super::spherical_rectangle::{NUMBERS as RECTANGLE, RectanglePointX16, RectangleX16};
use super::{DirectionalEmitter, EmitterSample, Light, PointEmitter, ShadowTarget, SunEmitter};
use crate::math::functions::angle_x16;
use crate::math::lanes::{LANES, Vec3x16, bits, f32x16, mask_from_bits};
use crate::math::ray::{end_error_x16, offset_origin_x16, plane_error_x16};
use crate::math::robust::gamma;
use crate::math::{Vec2, Vec3};

/// An [`EmitterSample`] in each of sixteen lanes.
#[derive(Clone, Copy, Debug)]
pub struct EmitterSampleX16 {
    /// Unit directions from the receivers.
    pub wi: Vec3x16,
    /// The ends of the shadow rays; undefined for lanes `at_infinity`.
    pub target: Vec3x16,
    /// Mask of the lanes whose shadow ray has no end.
    pub at_infinity: f32x16,
    /// Incident radiance by channel.
    pub radiance: [f32x16; 3],
    /// Densities per unit solid angle.
    pub pdf: f32x16,
    /// Mask of the lanes whose light no other technique can sample.
    pub delta: f32x16,
    /// Cosines between the emitted light and the normal of the emitting surface; 1 if there is none.
    pub cosine: f32x16,
    /// Mask of the lanes with a sample.
    pub valid: f32x16,
}

impl EmitterSampleX16 {
    /// No sample in any lane.
    pub const NONE: EmitterSampleX16 = EmitterSampleX16 {
        wi: Vec3x16 { x: f32x16::ZERO, y: f32x16::ZERO, z: f32x16::ZERO },
        target: Vec3x16 { x: f32x16::ZERO, y: f32x16::ZERO, z: f32x16::ZERO },
        at_infinity: f32x16::ZERO,
        radiance: [f32x16::ZERO; 3],
        pdf: f32x16::ZERO,
        delta: f32x16::ZERO,
        cosine: f32x16::ONE,
        valid: f32x16::ZERO,
    };

    /// Replaces the samples of the lanes in a mask.
    #[inline(always)]
    fn set_lanes(&mut self, lanes: u32, other: &Self) {
        let mask = mask_from_bits(lanes);
        self.wi = Vec3x16::select(mask, other.wi, self.wi);
        self.target = Vec3x16::select(mask, other.target, self.target);
        for (channel, value) in self.radiance.iter_mut().zip(other.radiance) {
            *channel = mask.select(value, *channel);
        }
        self.at_infinity = mask.select(other.at_infinity, self.at_infinity);
        self.pdf = mask.select(other.pdf, self.pdf);
        self.delta = mask.select(other.delta, self.delta);
        self.cosine = mask.select(other.cosine, self.cosine);
        self.valid = mask.select(other.valid, self.valid);
    }

    /// Returns the sample of one lane.
    pub fn lane(&self, i: usize) -> Option<EmitterSample> {
        let is_set = |mask: &f32x16| mask.as_array()[i].to_bits() != 0;
        let target = match is_set(&self.at_infinity) {
            true => ShadowTarget::Infinity,
            false => ShadowTarget::Point(self.target.lane(i)),
        };
        is_set(&self.valid).then(|| EmitterSample {
            wi: self.wi.lane(i),
            target,
            radiance: self.radiance.each_ref().map(|channel| channel.as_array()[i]).into(),
            pdf: self.pdf.as_array()[i],
            delta: is_set(&self.delta),
            cosine: self.cosine.as_array()[i],
        })
    }

    /// Replaces the sample of one lane.
    fn set_lane(&mut self, i: usize, sample: Option<EmitterSample>) {
        let mask = |set: bool| f32::from_bits(if set { u32::MAX } else { 0 });
        self.valid.as_mut_array()[i] = mask(sample.is_some());
        let Some(sample) = sample else { return };
        let (target, at_infinity) = match sample.target {
            ShadowTarget::Point(p) => (p, false),
            ShadowTarget::Infinity => (Vec3::ZERO, true),
        };
        self.wi.set_lane(i, sample.wi);
        self.target.set_lane(i, target);
        self.at_infinity.as_mut_array()[i] = mask(at_infinity);
        for (channel, value) in self.radiance.iter_mut().zip(sample.radiance.to_array()) {
            channel.as_mut_array()[i] = value;
        }
        self.pdf.as_mut_array()[i] = sample.pdf;
        self.delta.as_mut_array()[i] = mask(sample.delta);
        self.cosine.as_mut_array()[i] = sample.cosine;
    }
}

/// Rectangular emitters, one in each lane.
struct RectanglesX16 {
    rectangle: RectangleX16,
    normal: Vec3x16,
    error: f32x16,
    inverse_area: f32x16,
    radiance: [f32x16; 3],
}

impl RectanglesX16 {
    /// Creates rectangles from the numbers of their records.
    #[inline(always)]
    fn new(n: [f32x16; RECORD]) -> Self {
        let [normal_x, normal_y, normal_z, error, inverse_area, r, g, b]: [f32x16; 8] =
            std::array::from_fn(|i| n[RECTANGLE + i]);
        RectanglesX16 {
            rectangle: RectangleX16::from_numbers(std::array::from_fn(|i| n[i])),
            normal: Vec3x16::new(normal_x, normal_y, normal_z),
            error,
            inverse_area,
            radiance: [r, g, b],
        }
    }

    /// Computes [`AreaEmitter::sample`](super::AreaEmitter::sample) in each lane.
    #[inline(always)]
    fn sample(&self, from: Vec3x16, u: [f32x16; 2]) -> EmitterSampleX16 {
        let projection = self.rectangle.projected_from(from);
        let RectanglePointX16 { p, to } = projection.sample(u);
        let distance_squared = to.length_squared();
        let wi = to * (f32x16::ONE / distance_squared.sqrt());
        let cos = -wi.dot(self.normal);
        let mut pdf = f32x16::ONE / projection.solid_angle();
        if !projection.resolved().all() {
            let by_area = self.inverse_area * distance_squared / cos.abs();
            pdf = projection.resolved().select(pdf, by_area);
        }
        EmitterSampleX16 {
            wi,
            target: offset_origin_x16(p, self.error + end_error_x16(to), self.normal, -wi),
            radiance: self.radiance,
            pdf,
            cosine: cos,
            // False if `from` is the point itself.
            valid: cos.simd_gt(f32x16::ZERO),
            ..EmitterSampleX16::NONE
        }
    }
}

/// Spherical emitters, one in each lane.
struct SpheresX16 {
    center: Vec3x16,
    radius: f32x16,
    radiance: [f32x16; 3],
}

impl SpheresX16 {
    /// Creates spheres from the numbers of their records.
    #[inline(always)]
    fn new([x, y, z, radius, r, g, b]: [f32x16; 7]) -> Self {
        SpheresX16 { center: Vec3x16::new(x, y, z), radius, radiance: [r, g, b] }
    }

    /// Computes [`AreaEmitter::sample`](super::AreaEmitter::sample) in each lane. Returns the samples and a mask of the
    /// lanes outside their sphere; the samples of the others are undefined.
    #[inline(always)]
    fn sample(&self, from: &Vec3x16, u: [f32x16; 2]) -> (EmitterSampleX16, u32) {
        let projection = SphericalCapX16::new(&self.center, self.radius, from);
        let (n, to) = projection.sample(u);
        let wi = to * (f32x16::ONE / to.length_squared().sqrt());
        let [x, y, z] = [self.center.x, self.center.y, self.center.z]
            .map(|c| (c.abs() + self.radius) * f32x16::splat(gamma(8)));
        let error = plane_error_x16(Vec3x16::new(x, y, z), n) + end_error_x16(to);
        let cosine = -wi.dot(n);
        let samples = EmitterSampleX16 {
            wi,
            target: offset_origin_x16(self.center + n * self.radius, error, n, -wi),
            radiance: self.radiance,
            pdf: projection.pdf(),
            cosine,
            valid: cosine.simd_gt(f32x16::ZERO),
            ..EmitterSampleX16::NONE
        };
        (samples, projection.outside())
    }
}

/// Point emitters and spots without texture, one in each lane.
struct PointsX16 {
    position: Vec3x16,
    /// The axis of the cone.
    axis: Vec3x16,
    /// The angle between the axis and the dark, in radians; infinite for a point emitter.
    cutoff_angle: f32x16,
    /// The angle over which the intensity falls to zero outside the beam, in radians.
    falloff: f32x16,
    intensity: [f32x16; 3],
}

impl PointsX16 {
    /// Creates points from the numbers of their records.
    #[inline(always)]
    fn new([x, y, z, axis_x, axis_y, axis_z, cutoff_angle, falloff, r, g, b]: [f32x16; 11]) -> Self {
        PointsX16 {
            position: Vec3x16::new(x, y, z),
            axis: Vec3x16::new(axis_x, axis_y, axis_z),
            cutoff_angle,
            falloff,
            intensity: [r, g, b],
        }
    }

    /// Computes [`SpotEmitter::sample`](super::SpotEmitter::sample) in each lane.
    #[inline(always)]
    fn sample(&self, from: Vec3x16) -> EmitterSampleX16 {
        let to = self.position - from;
        let distance_squared = to.length_squared();
        let wi = to / distance_squared.sqrt();
        let angle = angle_x16(wi.cross(self.axis).length_squared().sqrt(), -wi.dot(self.axis));
        let falloff = ((self.cutoff_angle - angle) / self.falloff).fast_min(f32x16::ONE);
        let radiance = self.intensity.map(|intensity| intensity * falloff / distance_squared);
        let [r, g, b] = radiance.map(|c| c.simd_ne(f32x16::ZERO));
        let all = mask_from_bits(0xffff);
        EmitterSampleX16 {
            wi,
            target: self.position,
            radiance,
            pdf: f32x16::ONE,
            delta: all,
            valid: distance_squared.simd_gt(f32x16::ZERO) & angle.simd_lt(self.cutoff_angle) & (r | g | b),
            ..EmitterSampleX16::NONE
        }
    }
}

/// Returns samples of directional emitters with the given directions of propagation and irradiance.
#[inline(always)]
fn sample_directional([x, y, z, r, g, b]: [f32x16; 6]) -> EmitterSampleX16 {
    let all = mask_from_bits(0xffff);
    EmitterSampleX16 {
        wi: -Vec3x16::new(x, y, z),
        at_infinity: all,
        radiance: [r, g, b],
        pdf: f32x16::ONE,
        delta: all,
        valid: all,
        ..EmitterSampleX16::NONE
    }
}

/// Returns samples of directions to emitters at infinity.
#[inline(always)]
fn at_infinity(EnvMapSampleX16 { wi, radiance, pdf }: EnvMapSampleX16) -> EmitterSampleX16 {
    EmitterSampleX16 {
        wi,
        at_infinity: mask_from_bits(0xffff),
        radiance,
        pdf,
        valid: pdf.simd_gt(f32x16::ZERO),
        ..EmitterSampleX16::NONE
    }
}

/// The kinds of emitters, and what the numbers of each kind are.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// A rectangle, its normal, error, inverse area and radiance.
    Rectangle,
    /// Centre, radius and radiance of a sphere.
    Sphere,
    /// The position and axis of a point or a spot, its cutoff angle, falloff and intensity.
    Point,
    /// The direction and irradiance of parallel light.
    Directional,
    /// The environment.
    Environment,
    /// The sun.
    Sun,
    /// An emitter that is sampled one lane after the other.
    Other,
}

/// The greatest number of `f32` values of a kind.
const RECORD: usize = RECTANGLE + 8;

/// The emitters of a scene, prepared for [`sample`](Self::sample).
pub struct LightLanes {
    /// The kind of each emitter, and the index of its first number.
    records: Vec<(Kind, u32)>,
    /// The numbers of all emitters.
    numbers: Vec<f32>,
    environment: Option<EnvironmentRadiance>,
    sun: Option<SunEmitter>,
}

impl LightLanes {
    /// Prepares the emitters of a scene.
    pub fn new(lights: &[Light]) -> Self {
        let mut all = LightLanes {
            records: Vec::with_capacity(lights.len()),
            numbers: Vec::new(),
            environment: None,
            sun: None,
        };
        lights.iter().for_each(|light| all.add(light));
        all
    }

    fn add(&mut self, light: &Light) {
        let mut record = |kind, parts: [&[f32]; 5]| {
            self.records.push((kind, self.numbers.len() as u32));
            parts.into_iter().for_each(|part| self.numbers.extend(part));
        };
        let area = match light {
            Light::Area(area) => Some(area),
            _ => None,
        };
        if let Some((r, radiance)) = area.and_then(|area| area.rectangle()) {
            let (numbers, normal, radiance) =
                (r.rectangle.numbers(), r.normal.to_array(), radiance.to_array());
            record(Kind::Rectangle, [&numbers, &normal, &[r.error], &[r.inverse_area], &radiance])
        } else if let Some((center, radius, radiance)) = area.and_then(|area| area.sphere()) {
            record(Kind::Sphere, [&center.to_array(), &[radius], &radiance.to_array(), &[], &[]])
        } else {
            match light {
                Light::Point(PointEmitter { position, intensity }) => {
                    let (position, intensity) = (position.to_array(), intensity.to_array());
                    record(
                        Kind::Point,
                        [&position, &[0.0, 0.0, 1.0], &[f32::INFINITY, 1.0], &intensity, &[]],
                    );
                }
                Light::Spot(spot) if !spot.has_texture() => {
                    let (Cone { axis, angle }, falloff, intensity) = spot.cone();
                    let (position, axis) = (spot.position().to_array(), axis.to_array());
                    let angles = [angle + falloff, falloff];
                    record(Kind::Point, [&position, &axis, &angles, &intensity.to_array(), &[]]);
                }
                Light::Directional(DirectionalEmitter { direction, irradiance, .. }) => {
                    let (direction, irradiance) = (direction.to_array(), irradiance.to_array());
                    record(Kind::Directional, [&direction, &irradiance, &[], &[], &[]]);
                }
                Light::Environment(environment) => {
                    record(Kind::Environment, [&[]; 5]);
                    self.environment = Some(environment.radiance.clone());
                }
                Light::Sun(sun) => {
                    record(Kind::Sun, [&[]; 5]);
                    self.sun = Some(*sun);
                }
                _ => record(Kind::Other, [&[]; 5]),
            }
        }
    }

    /// Samples a direction to emitter `emitters[i]` as seen from lane `i` of `from`, for the lanes in the mask
    /// `active`. If `compensated` is true, the samples omit the environment's light that BSDF samples find well. `one`
    /// samples the emitter of a lane that has no kernel.
    pub fn sample(
        &self,
        emitters: &[usize; LANES],
        compensated: bool,
        from: Vec3x16,
        u: [f32x16; 2],
        active: u32,
        one: impl Fn(usize, Vec2) -> Option<EmitterSample>,
    ) -> EmitterSampleX16 {
        let [mut rectangles, mut spheres, mut points, mut directional] = [0; 4];
        let [mut environments, mut suns, mut others] = [0; 3];
        for i in bits(active) {
            let lanes = match self.records[emitters[i]].0 {
                Kind::Rectangle => &mut rectangles,
                Kind::Sphere => &mut spheres,
                Kind::Point => &mut points,
                Kind::Directional => &mut directional,
                Kind::Environment => &mut environments,
                Kind::Sun => &mut suns,
                Kind::Other => &mut others,
            };
            *lanes |= 1 << i;
        }
        let mut samples = EmitterSampleX16::NONE;
        if let Some(environment) = self.environment.as_ref().filter(|_| environments != 0) {
            samples = at_infinity(environment.sample_x16(compensated, u));
            samples.valid &= mask_from_bits(environments);
        }
        if let Some(sun) = self.sun.as_ref().filter(|_| suns != 0) {
            samples.set_lanes(suns, &at_infinity(sun.sample_x16(u)));
        }
        if points != 0 {
            let found = PointsX16::new(self.gather(emitters, points)).sample(from);
            samples.set_lanes(points, &found);
        }
        if directional != 0 {
            let found = sample_directional(self.gather(emitters, directional));
            samples.set_lanes(directional, &found);
        }
        if rectangles != 0 {
            let found = RectanglesX16::new(self.gather(emitters, rectangles)).sample(from, u);
            samples.set_lanes(rectangles, &found);
        }
        if spheres != 0 {
            let (found, outside) = SpheresX16::new(self.gather(emitters, spheres)).sample(&from, u);
            samples.set_lanes(spheres & outside, &found);
            others |= spheres & !outside;
        }
        for i in bits(others) {
            let u = Vec2::new(u[0].as_array()[i], u[1].as_array()[i]);
            samples.set_lane(i, one(i, u));
        }
        samples
    }

    /// Returns the first numbers of the emitters of the lanes in a mask that is not empty. Other lanes have those of
    /// any of these emitters.
    #[inline(always)]
    fn gather<const N: usize>(&self, emitters: &[usize; LANES], lanes: u32) -> [f32x16; N] {
        let any = emitters[lanes.trailing_zeros() as usize];
        let numbers_of = |emitter: usize| {
            let start = self.records[emitter].1 as usize;
            &self.numbers[start..start + N]
        };
        let first = numbers_of(any);
        if bits(lanes).all(|i| emitters[i] == any) {
            return std::array::from_fn(|k| f32x16::splat(first[k]));
        }
        let mut numbers: [[f32; LANES]; N] = std::array::from_fn(|k| [first[k]; LANES]);
        for i in bits(lanes) {
            for (number, value) in numbers.iter_mut().zip(numbers_of(emitters[i])) {
                number[i] = *value;
            }
        }
        numbers.map(f32x16::new)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::Rgb;
    use crate::emitter::{AreaEmitter, BoundingSphere, Emission, Environment, SpotEmitter};
    use crate::math::{DAffine3, DQuat, DVec3};
    use crate::sampling::hash::{combine, to_unit};
    use crate::shape::{Shape, WorldShape};

    /// Emitters of all kinds are sampled in lanes as one by one, from near and far, and from inside.
    #[test]
    fn lanes_sample_what_the_emitters_do() {
        let mut seed = 0;
        let mut random = || {
            seed += 1;
            to_unit(combine(3, seed))
        };
        for _ in 0..500 {
            let mut centers = Vec::new();
            let mut lights = Vec::new();
            for _ in 0..3 {
                let center = Vec3::new(random(), 2.0 * random(), -random());
                let radius = 0.01 + random();
                centers.push((center, radius));
                let turn = DAffine3::from_scale_rotation_translation(
                    DVec3::splat(f64::from(radius)),
                    DQuat::from_rotation_x(6.0 * f64::from(random())),
                    center.as_dvec3(),
                );
                let sphere = WorldShape::new(Shape::Sphere { center, radius }, &DAffine3::IDENTITY, false);
                let rectangle = WorldShape::new(Shape::Rectangle, &turn, false);
                for shape in [sphere, rectangle] {
                    let emission = Emission::Constant(Rgb::new(random(), 2.0, 3.0));
                    let area = AreaEmitter::new(&shape.expect("a shape"), emission, None).expect("an area");
                    lights.push(Light::Area(Box::new(area)));
                }
            }
            let scene = BoundingSphere { center: Vec3::ZERO, radius: 3.0 };
            lights.push(Light::Environment(Environment::constant(Rgb::new(0.1, 0.2, 0.3), scene)));
            let intensity = Rgb::new(random(), 0.0, 3.0);
            lights.push(Light::Point(PointEmitter { position: Vec3::new(random(), 5.0, 0.0), intensity }));
            let direction = Vec3::new(random() - 0.5, 0.7, random()).normalize();
            lights.push(Light::Directional(DirectionalEmitter { direction, irradiance: intensity, scene }));
            let turn = DAffine3::from_rotation_x(6.0 * f64::from(random()));
            let turn = DAffine3::from_scale(DVec3::new(3.0, 1.0, 1.0)) * turn;
            let cutoff = 0.1 + random();
            for beam in [cutoff * random(), cutoff] {
                lights.push(Light::Spot(SpotEmitter::new(&turn, intensity, None, cutoff, beam)));
            }
            let emitters: [usize; LANES] =
                std::array::from_fn(|_| ((random() * lights.len() as f32) as usize).min(lights.len() - 1));
            let mut from = Vec3x16::default();
            for (i, emitter) in emitters.into_iter().enumerate() {
                let d = Vec3::new(random() - 0.5, random() - 0.5, random() - 0.5).normalize();
                let (center, radius) = centers[emitter / 2 % 3];
                from.set_lane(i, center + d * radius * [0.5, 1.0001, 1.1, 3.0, 1e4][i % 5]);
            }
            let mut numbers = || f32x16::new(std::array::from_fn(|_| random()));
            let u = [numbers(), numbers()];
            let lanes = LightLanes::new(&lights);
            let one = |i: usize, u| lights[emitters[i]].sample(from.lane(i), u, 0.0);
            let samples = lanes.sample(&emitters, false, from, u, 0xffff, one);
            for (i, emitter) in emitters.into_iter().enumerate() {
                let u = Vec2::new(u[0].as_array()[i], u[1].as_array()[i]);
                let alone = lights[emitter].sample(from.lane(i), u, 0.0);
                assert_eq!(samples.valid.to_bitmask() >> i & 1 == 1, alone.is_some());
                let Some(alone) = alone else { continue };
                assert!((samples.wi.lane(i) - alone.wi).length() < 2e-6, "{i}");
                assert!((samples.pdf.as_array()[i] / alone.pdf - 1.0).abs() < 1e-5, "{i}");
                let radiance = samples.radiance.map(|c| c.as_array()[i]);
                // The angle to the axis of a spot is another function in lanes.
                let error = if let Light::Spot(_) = lights[emitter] { 1e-3 } else { 0.0 };
                for (found, expected) in radiance.into_iter().zip(alone.radiance.to_array()) {
                    assert!((found - expected).abs() <= error * expected, "{i}: {found} {expected}");
                }
                assert_eq!(samples.delta.to_bitmask() >> i & 1 == 1, alone.delta);
                let at_infinity = samples.at_infinity.to_bitmask() >> i & 1 == 1;
                assert_eq!(at_infinity, alone.target == ShadowTarget::Infinity);
                if let ShadowTarget::Point(target) = alone.target {
                    let distance = (target - from.lane(i)).length();
                    assert!((samples.target.lane(i) - target).length() < 4e-6 * (distance + 3.0), "{i}");
                }
            }
        }
    }
}
