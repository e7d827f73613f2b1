//! Free flights and scattering of sixteen paths in homogeneous media.
//!
//! All formulas are free of cancellation, so that `f32` suffices.

use super::{Homogeneous, Phase};
use crate::math::functions::{exp_x16, ln_x16};
use crate::math::lanes::{LANES, Vec3x16, bits, f32x16};
use crate::math::{FrameX16, Vec2};
use crate::sampling::hash::lower_digits_x16;
use crate::sampling::warp::{SQUARE_TO_SPHERE_PDF, sin_cos_turn_x16, square_to_sphere_x16};
use std::f32::consts::TAU;

/// The optical depth beyond which nothing is transmitted.
const OPAQUE: f32 = 87.0;

/// The coefficients of the media of sixteen paths.
pub struct CoefficientsX16 {
    /// The extinction coefficients by channel.
    pub sigma_t: [f32x16; 3],
    /// The scattering coefficients by channel.
    pub sigma_s: [f32x16; 3],
    /// Whether the extinction is the same in all channels.
    grey: bool,
}

impl CoefficientsX16 {
    /// Returns the coefficients of media. Lanes without one have vacuum.
    #[inline]
    pub fn of(media: &[Option<&Homogeneous>; LANES]) -> Self {
        let table = |medium: Option<&Homogeneous>| match medium {
            Some(Homogeneous { sigma_t, sigma_s, .. }) => [sigma_t.to_array(), sigma_s.to_array()],
            None => [[0.0; 3]; 2],
        };
        let same = |a: Option<&Homogeneous>, b: Option<&Homogeneous>| match (a, b) {
            (Some(a), Some(b)) => std::ptr::eq(a, b),
            (a, b) => a.is_none() && b.is_none(),
        };
        if media.iter().all(|medium| same(*medium, media[0])) {
            let [sigma_t, sigma_s] = table(media[0]);
            let grey = sigma_t[0] == sigma_t[1] && sigma_t[1] == sigma_t[2];
            return CoefficientsX16 {
                sigma_t: sigma_t.map(f32x16::splat),
                sigma_s: sigma_s.map(f32x16::splat),
                grey,
            };
        }
        let tables = media.map(table);
        let channel =
            |of: usize, c: usize| f32x16::new(std::array::from_fn(|lane: usize| tables[lane][of][c]));
        let [sigma_t, sigma_s] = [0, 1].map(|of| [0, 1, 2].map(|c| channel(of, c)));
        let grey = tables.iter().all(|[[r, g, b], _]| r == g && g == b);
        CoefficientsX16 { sigma_t, sigma_s, grey }
    }

    /// Returns a mask of the media that scatter.
    #[inline(always)]
    pub fn scatter(&self) -> f32x16 {
        let [r, g, b] = self.sigma_s.map(|sigma| sigma.simd_gt(f32x16::ZERO));
        r | g | b
    }

    /// Returns the extinction coefficients of the given channels: 0, 1 or 2.
    #[inline(always)]
    fn extinction(&self, channel: f32x16) -> f32x16 {
        let [r, g, b] = self.sigma_t;
        if self.grey {
            return r;
        }
        let (second, third) = (channel.simd_eq(f32x16::ONE), channel.simd_gt(f32x16::ONE));
        third.select(b, second.select(g, r))
    }

    /// Returns the distances at which flights end: at the optical depths `left` in the given channels. Flights that are
    /// not sampled have no end.
    #[inline(always)]
    pub fn ends(&self, channel: f32x16, left: f32x16, sampled: f32x16) -> f32x16 {
        sampled.select(left / self.extinction(channel), f32x16::splat(f32::INFINITY))
    }

    /// Returns the transmittances by channel over `lengths`, which may be infinite.
    #[inline(always)]
    pub fn transmittance(&self, lengths: f32x16) -> [f32x16; 3] {
        let zero = f32x16::ZERO;
        let of = |sigma: f32x16| {
            let depth = sigma.simd_gt(zero).select(sigma * lengths, zero);
            depth.simd_lt(f32x16::splat(OPAQUE)).select(exp_x16(-depth), zero)
        };
        let [r, g, b] = self.sigma_t;
        let first = of(r);
        if self.grey { [first; 3] } else { [first, of(g), of(b)] }
    }

    /// Returns the factors of the throughputs by channel for flights over `lengths`, which media ended by scattering in
    /// the lanes of the mask `scattered`: the transmittance, and the scattering coefficient where they scatter, divided
    /// by the probability or density over all channels, which are chosen with the probabilities `choice`.
    ///
    /// Returns the factors of `choice`, too: the results are the probabilities of the channels of flights that go on in
    /// the next medium.
    #[inline(always)]
    pub fn transport(
        &self,
        choice: &[f32x16; 3],
        lengths: f32x16,
        sampled: f32x16,
        scattered: f32x16,
    ) -> [[f32x16; 3]; 2] {
        let (zero, one) = (f32x16::ZERO, f32x16::ONE);
        // Where there is no extinction, the length may be infinite.
        let depths = self
            .sigma_t
            .map(|sigma| sigma.simd_gt(zero).select(sigma * lengths, zero).fast_min(f32x16::splat(f32::MAX)));
        let least = depths[0].fast_min(depths[1]).fast_min(depths[2]);
        // The transmittances relative to that of the clearest channel.
        let relative = match self.grey {
            true => [one; 3],
            false => depths.map(|depth| exp_x16(least - depth)),
        };
        let extinction = |c: usize| scattered.select(self.sigma_t[c], one);
        // Where all channels are the same, nothing is rounded: without absorption, throughputs stay what they are.
        let mut density = extinction(0);
        if !self.grey {
            let [r, g, b] = self.sigma_t;
            let of = |c: usize| choice[c] * extinction(c) * relative[c];
            density = (r.simd_eq(g) & g.simd_eq(b)).select(density, of(0) + of(1) + of(2));
        }
        let mut weights =
            std::array::from_fn(|c| scattered.select(self.sigma_s[c], one) * relative[c] / density);
        let mut choices = relative.map(|relative| relative / density);
        if !sampled.all() {
            let transmittance = least.simd_lt(f32x16::splat(OPAQUE)).select(exp_x16(-least), zero);
            weights = std::array::from_fn(|c| sampled.select(weights[c], relative[c] * transmittance));
            choices = choices.map(|choice| sampled.select(choice, one));
        }
        [weights, choices]
    }
}

/// The free flights of sixteen paths through one homogeneous medium after the other, until they are scattered or leave
/// the last one.
///
/// The distance is sampled by the extinction of one channel. The channel is chosen in proportion to the throughput of
/// the path, and weights divide by the density over all choices: the balance heuristic over the channels. [Veach 1997,
/// 9.2; Wilkie 2014; Miller 2019] Thus the sum of the channels of the throughput never grows in a medium. A medium
/// that only absorbs is not sampled.
#[derive(Clone, Copy, Debug)]
pub struct FlightX16 {
    /// The throughputs of the paths by channel.
    pub beta: [f32x16; 3],
    /// The probabilities of the channels.
    pub choice: [f32x16; 3],
    /// The chosen channels: 0, 1 or 2.
    pub channel: f32x16,
    /// The optical depths in these channels, over the media that scatter, after which flights end; infinite if they do
    /// not.
    pub left: f32x16,
}

impl FlightX16 {
    /// Starts flights of paths with the throughputs `beta`. The first numbers choose the channels, the others the
    /// optical depths; `at` are the starts of the rays, which determine digits beyond those of the numbers.
    #[inline(always)]
    pub fn sampled(beta: [f32x16; 3], u: [f32x16; 2], at: Vec3x16) -> Self {
        let left = optical_depths(u[1], lower_digits_x16(u[1], at));
        let choice = probabilities(&beta);
        FlightX16 { beta, choice, channel: chosen_channel(&choice, u[0]), left }
    }

    /// Continues through media over the distances `lengths`. Returns a mask of the flights that end, and the distances
    /// up to there.
    #[inline(always)]
    pub fn advance(&mut self, media: &CoefficientsX16, lengths: f32x16) -> (f32x16, f32x16) {
        let sampled = media.scatter() & self.left.simd_lt(f32x16::splat(f32::INFINITY));
        let ends = media.ends(self.channel, self.left, sampled);
        let scattered = ends.simd_lt(lengths);
        let lengths = ends.fast_min(lengths);
        let [weights, choices] = media.transport(&self.choice, lengths, sampled, scattered);
        self.beta = std::array::from_fn(|c| self.beta[c] * weights[c]);
        self.choice = std::array::from_fn(|c| self.choice[c] * choices[c]);
        let rest = self.left - media.extinction(self.channel) * lengths;
        // Rounding must not end a flight at once.
        self.left = sampled.select(rest.fast_max(f32x16::splat(f32::MIN_POSITIVE)), self.left);
        (scattered, lengths)
    }
}

/// Returns the weights of channels divided by their sum. It may be as small as numbers can be, so products with the
/// weights themselves could be 0.
#[inline(always)]
pub fn probabilities(weights: &[f32x16; 3]) -> [f32x16; 3] {
    let sum = weights[0] + weights[1] + weights[2];
    weights.map(|weight| weight / sum)
}

/// Returns channels (0, 1 or 2) chosen in proportion to `choice` by the random numbers `u`.
#[inline(always)]
pub fn chosen_channel(choice: &[f32x16; 3], u: f32x16) -> f32x16 {
    let [r, g, b] = *choice;
    let x = u * (r + g + b);
    let third = !x.simd_lt(r + g) & b.simd_gt(f32x16::ZERO);
    // Rounding must not choose a channel without throughput.
    let second = !x.simd_lt(r) & g.simd_gt(f32x16::ZERO);
    third.select(f32x16::splat(2.0), second.select(f32x16::ONE, f32x16::ZERO))
}

/// Returns −ln x for the random numbers x = u + lower, with a relative error below 10⁻⁶.
#[inline(always)]
pub fn optical_depths(u: f32x16, lower: f32x16) -> f32x16 {
    let one = f32x16::ONE;
    let upper = u.simd_ge(f32x16::HALF);
    let rest = (one - u) - lower;
    // Half of the least step makes the number positive.
    let x = upper.select(one - rest, u + (lower + f32x16::splat(2f32.powi(-58))));
    let logarithm = -ln_x16(x);
    // Near 1, the logarithm of the rounded number is corrected.
    let rounded = one - x;
    let corrected = rounded.simd_eq(f32x16::ZERO).select(rest, logarithm * (rest / rounded));
    upper.select(corrected, logarithm)
}

/// The phase functions of sixteen media.
pub struct PhaseX16<'a> {
    /// The mean cosines of deflection of the functions of [Henyey and Greenstein 1941].
    g: f32x16,
    /// Whether all are isotropic.
    isotropic: bool,
    /// All functions, and a mask of those that are others.
    phases: [&'a Phase; LANES],
    other_lanes: u32,
}

impl<'a> PhaseX16<'a> {
    /// Returns the given functions.
    #[inline]
    pub fn of(phases: &[&'a Phase; LANES]) -> Self {
        let all = (1 << LANES) - 1;
        let (g, other_lanes) = if phases.iter().all(|phase| std::ptr::eq(*phase, phases[0])) {
            let asymmetry = phases[0].asymmetry();
            (f32x16::splat(asymmetry.unwrap_or(0.0)), if asymmetry.is_some() { 0 } else { all })
        } else {
            let asymmetry = phases.map(Phase::asymmetry);
            let others = (0..LANES).map(|i| u32::from(asymmetry[i].is_none()) << i).sum();
            (f32x16::new(asymmetry.map(|g| g.unwrap_or(0.0))), others)
        };
        PhaseX16 { g, isotropic: g.simd_eq(f32x16::ZERO).all(), phases: *phases, other_lanes }
    }

    /// Returns the values for deflections from the unit directions `d` to `wi`, sr⁻¹: the densities of
    /// [`sample`](Self::sample).
    #[inline(always)]
    pub fn eval(&self, d: Vec3x16, wi: Vec3x16) -> f32x16 {
        let mut value = f32x16::splat(SQUARE_TO_SPHERE_PDF);
        if !self.isotropic {
            let (one, two, g) = (f32x16::ONE, f32x16::splat(2.0), self.g);
            // Half of the squared distance is 1 − cos; near the opposite direction, that from there is 1 + cos.
            let [versine, coversine] = [d - wi, d + wi].map(|way| f32x16::HALF * way.length_squared());
            let forward = g.simd_gt(f32x16::ZERO);
            // 1 + g² − 2g·cos is (1 − g)² + 2g (1 − cos), and (1 + g)² − 2g (1 + cos).
            let square = forward.select(
                (one - g) * (one - g) + two * g * versine,
                (one + g) * (one + g) - two * g * coversine,
            );
            value = value * ((one - g) * (one + g)) / (square * square.sqrt());
        }
        for i in bits(self.other_lanes) {
            value.as_mut_array()[i] = self.phases[i].eval(d.lane(i).dot(wi.lane(i)));
        }
        value
    }

    /// Samples directions after scattering; `d` are the unit directions before it.
    #[inline(always)]
    pub fn sample(&self, d: Vec3x16, u: [f32x16; 2]) -> Vec3x16 {
        // The direction of a lane does not depend on those of the others.
        let isotropic = self.g.simd_eq(f32x16::ZERO);
        let mut wi = Vec3x16::default();
        if isotropic.any() {
            wi = square_to_sphere_x16(u);
        }
        if !self.isotropic {
            wi = Vec3x16::select(isotropic, wi, deflected(d, self.g, u));
        }
        for i in bits(self.other_lanes) {
            let [x, y] = u.map(|u| u.as_array()[i]);
            wi.set_lane(i, self.phases[i].sample(d.lane(i), Vec2::new(x, y)));
        }
        wi
    }
}

/// Returns directions after scattering with the mean cosines `g` by the function of [Henyey and Greenstein 1941].
///
/// For the random number u, 1 − cos = 2 (1 − g)² (1 − u) (1 + gu) / s² and 1 + cos = 2 (1 + g)² u (1 − g (1 − u)) / s²
/// with s = 1 − g + 2gu. All sums are written such that nothing cancels.
#[inline(always)]
fn deflected(d: Vec3x16, g: f32x16, [u, azimuth]: [f32x16; 2]) -> Vec3x16 {
    let (one, two) = (f32x16::ONE, f32x16::splat(2.0));
    let rest = one - u;
    let forward = g.simd_gt(f32x16::ZERO);
    let s = forward.select(one - g + two * g * u, one + g - two * g * rest);
    let (back, ahead) = ((one - g) / s, (one + g) / s);
    let versine = two * back * back * rest * forward.select(one + g * u, one + g - g * rest);
    let coversine = two * ahead * ahead * u * forward.select(one - g + g * u, one - g * rest);
    let cos = versine.simd_lt(one).select(one - versine, coversine - one);
    let sin = (versine * coversine).fast_max(f32x16::ZERO).sqrt();
    let (sin_phi, cos_phi) = sin_cos_turn_x16(f32x16::splat(TAU) * azimuth);
    FrameX16::from_normal(d).to_world(Vec3x16::new(sin * cos_phi, sin * sin_phi, cos)).normalize_or_zero()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::Rgb;
    use crate::math::Vec3;
    use crate::math::lanes::each_lane;
    use crate::medium::free_flight::FreeFlight;
    use crate::sampling::hash::{digits_below, pcg3d, to_unit};

    /// The logarithm is exact for numbers that are close to 0 and to 1, and digits below those of the number count.
    #[test]
    fn optical_depths_are_logarithms() {
        let step = 2f32.powi(-24);
        for u in
            [0.0, 2f32.powi(-32), 1e-6, 0.004, 0.3, 0.5 - step, 0.5, 0.7, 0.999, 1.0 - 3.0 * step, 1.0 - step]
        {
            for digits in [0, 1 << 31, u32::MAX] {
                let lower = digits_below(u, digits);
                let found = optical_depths(f32x16::splat(u), f32x16::splat(lower)).as_array()[5];
                let x = f64::from(u) + f64::from(lower) + 2f64.powi(-58);
                let exact = if x > 0.5 { -(x - 1.0).ln_1p() } else { -x.ln() };
                assert!((f64::from(found) / exact - 1.0).abs() < 1e-6, "{u} {lower}: {found}, {exact}");
            }
        }
    }

    /// Directions and densities are those of the scalar phase functions, also in lanes of other kinds.
    #[test]
    fn directions_are_those_of_the_phase_function() {
        let d = Vec3::new(0.3, -0.7, 0.2).normalize();
        let mut phases: Vec<Phase> =
            [-0.999f32, -0.6, 0.0, 1e-6, 0.3, 0.9, 0.9999].map(|g| Phase::HenyeyGreenstein { g }).into();
        phases.push(Phase::Rayleigh);
        let lanes = PhaseX16::of(&each_lane(|i| &phases[i % phases.len()]));
        for (u, v) in [(0.0, 0.3), (1e-4, 0.9), (0.2, 0.1), (0.5, 0.6), (0.97, 0.4), (1.0 - 1e-6, 0.8)] {
            let numbers = [u, v].map(f32x16::splat);
            let found = lanes.sample(Vec3x16::splat(d), numbers);
            let values = lanes.eval(Vec3x16::splat(d), found);
            for (i, phase) in phases.iter().enumerate() {
                let exact = match phase {
                    Phase::HenyeyGreenstein { g: 0.0 } => &Phase::Isotropic,
                    phase => phase,
                };
                let exact = exact.sample(d, Vec2::new(u, v));
                let wi = found.lane(i);
                assert!((wi - exact).length() < 1e-5, "{phase:?} {u} {v}: {wi}, {exact}");
                let Some(g) = &phase.asymmetry() else { continue };
                // The deflection that the direction has, without the rounding of its cosine.
                let (g, ahead) = (f64::from(g.abs()), if *g < 0.0 { -d } else { d });
                let versine = 0.5 * (ahead - wi).as_dvec3().length_squared();
                let square = (1.0 - g) * (1.0 - g) + 2.0 * g * versine;
                let exact = (1.0 - g * g) / (4.0 * std::f64::consts::PI * square * square.sqrt());
                let found = f64::from(values.as_array()[i]);
                // Rounding turns a direction by up to 10⁻³ of the width of the narrowest lobes.
                assert!((found / exact - 1.0).abs() < 3e-3, "{phase:?} {u} {v}: {found}, {exact}");
            }
        }
        let isotropic = PhaseX16::of(&[&Phase::Isotropic; LANES]);
        let wi = isotropic.sample(Vec3x16::splat(d), [f32x16::splat(0.3); 2]).lane(1);
        assert!((wi - Phase::Isotropic.sample(d, Vec2::splat(0.3))).length() < 1e-6);
    }

    /// Ends of flights and throughputs are those of [`FreeFlight`], within 10⁻⁴, from medium to medium.
    #[test]
    fn flights_are_those_of_one_path() {
        let media = [
            ([1.0, 0.3, 4.0], [0.9, 0.3, 2.0]),
            ([0.5, 0.1, 0.0], [0.0; 3]),
            ([2.0; 3], [1.0; 3]),
            ([0.0, 2.0, 0.5], [0.0, 2.0, 0.0]),
        ];
        let media = media.map(|(sigma_t, sigma_s)| {
            let (sigma_t, sigma_s) = (Rgb::from(sigma_t), Rgb::from(sigma_s));
            Homogeneous { sigma_t, sigma_s, phase: Phase::Isotropic }
        });
        let mut ended = [0; 5];
        for i in 0..2000 {
            let [a, b, c] = pcg3d(i, 5, 7).map(to_unit);
            let beta = Rgb::new(0.7, 0.2, if i % 2 == 0 { 0.05 } else { 0.0 });
            let at = Vec3::new(c, 1.0, a);
            let mut one = FreeFlight::sampled(beta, Vec2::new(a, b), at);
            let lanes = beta.to_array().map(f32x16::splat);
            let mut sixteen = FlightX16::sampled(lanes, [a, b].map(f32x16::splat), Vec3x16::splat(at));
            let mut end = 4;
            for k in 0..4 {
                let medium = &media[(k + i as usize / 4) % 4];
                let length = 0.3 + c;
                let exact = one.advance(medium, length.into());
                // Lanes of other media do not count.
                let in_lanes = each_lane(|lane| (lane < 5).then_some(medium));
                let (scattered, lengths) =
                    sixteen.advance(&CoefficientsX16::of(&in_lanes), f32x16::splat(length));
                let distance = lengths.as_array()[3];
                // Where the last digits decide, both are right.
                let is_close = |exact: f64| (exact / f64::from(length) - 1.0).abs() < 1e-4;
                if exact.is_some() != (scattered.to_bitmask() >> 3 & 1 == 1) {
                    assert!(is_close(exact.unwrap_or(distance.into())), "{i} {k}: {exact:?}, {distance}");
                    break;
                }
                let weight = if exact.is_some() { one.scattered(medium) } else { one.passed() };
                for (found, exact) in sixteen.beta.iter().zip((beta * weight).to_array()) {
                    let found = found.as_array()[3];
                    assert!((found - exact).abs() <= 1e-4 * exact + 1e-7, "{i} {k}: {found}, {exact}");
                }
                if let Some(exact) = exact {
                    assert!((f64::from(distance) / exact - 1.0).abs() < 1e-4, "{i} {k}: {distance}, {exact}");
                    end = k;
                    break;
                }
            }
            ended[end] += 1;
        }
        assert!(ended.iter().all(|count| *count > 50), "{ended:?}");
    }
}
