//! Sampling of the distance that light travels in homogeneous media before it is scattered, for one path: what
//! [`FlightX16`](super::lanes::FlightX16) is tested against.

use super::{Homogeneous, exponentials};
use crate::color::Rgb;
use crate::math::{Vec2, Vec3};
use crate::sampling::hash::lower_digits;

/// The flight of a path along a ray through one medium after the other, until it is scattered or leaves the last one.
///
/// The distance is sampled by the extinction of one channel. The channel is chosen in proportion to the throughput of
/// the path, and weights divide by the density over all choices: the balance heuristic over the channels. [Veach 1997,
/// 9.2; Wilkie 2014; Miller 2019] Thus the sum of the channels of the throughput never grows in a medium. A medium
/// that only absorbs is not sampled.
#[derive(Clone, Copy, Debug)]
pub struct FreeFlight {
    /// The probabilities of the channels, which are the throughput of the path at the start divided by its sum.
    choice: [f64; 3],
    /// The chosen channel.
    channel: usize,
    /// The optical depth of the chosen channel, over the media that scatter, at which the flight ends; infinite if it
    /// does not.
    end: f64,
    /// The optical depths so far over the media that scatter.
    scattering: [f64; 3],
    /// The optical depths so far over all homogeneous media.
    total: [f64; 3],
}

impl FreeFlight {
    /// Starts a flight that nothing ends: only the transmittance counts.
    pub fn unscattered() -> Self {
        FreeFlight {
            choice: [1.0, 0.0, 0.0],
            channel: 0,
            end: f64::INFINITY,
            scattering: [0.0; 3],
            total: [0.0; 3],
        }
    }

    /// Starts a flight of a path with the throughput `beta`, which is not black. `u.x` chooses the channel, `u.y` the
    /// optical depth; `at` is the start of the ray, which determines digits beyond those of `u`.
    pub fn sampled(beta: Rgb, u: Vec2, at: Vec3) -> Self {
        // Half of the least step makes the number positive and the optical depth at most 34.
        let exact = |u: f32| f64::from(u) + f64::from(lower_digits(u, at)) + 2f64.powi(-58);
        let beta = beta.to_array().map(f64::from);
        let sum: f64 = beta.iter().sum();
        let choice = beta.map(|b| b / sum);
        let x = exact(u.x);
        let channel = match choice {
            [r, _, _] if x < r => 0,
            [r, g, _] if x < r + g => 1,
            [_, g, b] if b > 0.0 || g == 0.0 => 2,
            _ => 1,
        };
        let channel = if choice[channel] > 0.0 { channel } else { 0 };
        FreeFlight { choice, channel, end: -exact(u.y).ln(), ..FreeFlight::unscattered() }
    }

    /// Continues through a medium over a distance. Returns the distance after which the flight ends in it, if it does.
    pub fn advance(&mut self, medium: &Homogeneous, length: f64) -> Option<f64> {
        let sigma_t = medium.sigma_t.to_array().map(f64::from);
        let samples = medium.scatters() && self.end.is_finite();
        let left = self.end - self.scattering[self.channel];
        let ends = samples && optical_depth(sigma_t[self.channel], length) > left;
        let length = if ends { left / sigma_t[self.channel] } else { length };
        for (c, sigma) in sigma_t.into_iter().enumerate() {
            let depth = optical_depth(sigma, length);
            self.total[c] += depth;
            if samples {
                self.scattering[c] += depth;
            }
        }
        ends.then_some(length)
    }

    /// Returns the factor of the throughput if the flight ended in a medium: the scattering coefficient times the
    /// transmittance, divided by the density per unit length.
    pub fn scattered(&self, medium: &Homogeneous) -> Rgb {
        let sigma_t = medium.sigma_t.to_array().map(f64::from);
        let [scattering, total] = self.transmittances();
        let density: f64 = (0..3).map(|c| self.choice[c] * sigma_t[c] * scattering[c]).sum();
        let sigma_s = medium.sigma_s.to_array().map(f64::from);
        [0, 1, 2].map(|c| (sigma_s[c] * total[c] / density) as f32).into()
    }

    /// Returns the factor of the throughput if the flight has not ended: the transmittance, divided by the probability.
    pub fn passed(&self) -> Rgb {
        let [scattering, total] = self.transmittances();
        let probability: f64 = (0..3).map(|c| self.choice[c] * scattering[c]).sum();
        [0, 1, 2].map(|c| (total[c] / probability) as f32).into()
    }

    /// Returns the transmittances over the media that scatter, and over all homogeneous media.
    fn transmittances(&self) -> [[f64; 3]; 2] {
        let scattering = exponentials(self.scattering.map(|depth| -depth));
        let only = self.scattering == self.total;
        [scattering, if only { scattering } else { exponentials(self.total.map(|depth| -depth)) }]
    }
}

/// Returns the optical depth of a length, which may be infinite.
fn optical_depth(sigma: f64, length: f64) -> f64 {
    if sigma == 0.0 { 0.0 } else { sigma * length }
}

mod tests {
    use super::*;
    use crate::medium::Phase;
    use crate::sampling::hash::{pcg3d, to_unit};

    fn medium(sigma_t: [f32; 3], albedo: [f32; 3]) -> Homogeneous {
        let sigma_s = [0, 1, 2].map(|c| sigma_t[c] * albedo[c]);
        Homogeneous { sigma_t: sigma_t.into(), sigma_s: sigma_s.into(), phase: Phase::Isotropic }
    }

    #[test]
    fn a_medium_that_absorbs_is_not_sampled() {
        let absorbing = medium([1.0, 2.0, 0.0], [0.0; 3]);
        for u in [0.0, 0.5, 1f32.next_down()] {
            let mut flight = FreeFlight::sampled(Rgb::WHITE, Vec2::splat(u), Vec3::ONE);
            assert_eq!(flight.advance(&absorbing, 0.5), None);
            let passed = flight.passed();
            assert!((passed.r - (-0.5f32).exp()).abs() < 1e-7 && (passed.g - (-1f32).exp()).abs() < 1e-7);
            assert_eq!(passed.b, 1.0);
            // Nothing passes through an infinite length, except where there is nothing.
            assert_eq!(flight.advance(&absorbing, f64::INFINITY), None);
            assert_eq!(flight.passed(), Rgb::new(0.0, 0.0, 1.0));
        }
        // Nor is any medium, if only the transmittance counts.
        let mut flight = FreeFlight::unscattered();
        assert_eq!(flight.advance(&medium([1.0, 2.0, 0.0], [1.0; 3]), 0.5), None);
        assert!((flight.passed().g - (-1f32).exp()).abs() < 1e-7 && flight.passed().b == 1.0);
    }

    /// The mean weights over many flights are the scattered and the transmitted light by channel. The sum of the
    /// throughput never grows.
    #[test]
    fn weights_are_unbiased_and_bounded() {
        const N: u32 = 400_000;
        let media = [medium([1.0, 0.3, 4.0], [1.0, 0.9, 0.5]), medium([0.0, 2.0, 0.5], [0.0, 1.0, 1.0])];
        let absorbing = medium([0.1, 0.2, 0.4], [0.0; 3]);
        let beta = Rgb::new(0.7, 0.2, 0.05);
        let (mut scattered, mut passed) = ([[0.0; 3]; 2], [0.0; 3]);
        let mut squares = [0.0f64; 3];
        for i in 0..N {
            let [a, b, _] = pcg3d(i, 17, 3);
            let mut flight = FreeFlight::sampled(beta, Vec2::new(to_unit(a), to_unit(b)), Vec3::ONE);
            let mut after = beta;
            let legs = [(&media[0], 0.6), (&absorbing, 0.5), (&media[1], 1.2)];
            let mut to = None;
            for (k, (medium, length)) in legs.into_iter().enumerate() {
                if flight.advance(medium, length).is_some() {
                    after *= flight.scattered(medium);
                    to = Some(k / 2);
                    break;
                }
            }
            let sum = match to {
                Some(k) => &mut scattered[k],
                None => {
                    after *= flight.passed();
                    &mut passed
                }
            };
            assert!(after.r + after.g + after.b <= 0.95 * (1.0 + 1e-5), "{after:?}");
            for c in 0..3 {
                sum[c] += f64::from(after[c]);
                squares[c] += f64::from(after[c]).powi(2);
            }
        }
        for c in 0..3 {
            let n = f64::from(N);
            let depth = |m: &Homogeneous, length: f64| f64::from(m.sigma_t[c]) * length;
            let albedo = |m: &Homogeneous| f64::from(m.sigma_s[c]) / f64::from(m.sigma_t[c]).max(1e-30);
            let b = f64::from(beta[c]);
            let (first, between, second) =
                (depth(&media[0], 0.6), depth(&absorbing, 0.5), depth(&media[1], 1.2));
            let through = (-first - between).exp();
            let exact = [
                b * albedo(&media[0]) * -(-first).exp_m1(),
                b * through * albedo(&media[1]) * -(-second).exp_m1(),
                b * through * (-second).exp(),
            ];
            let found = [scattered[0][c], scattered[1][c], passed[c]].map(|sum| sum / n);
            // Five standard deviations.
            let tolerance = 5.0 * (squares[c] / n / n).sqrt() + 1e-6 * b;
            for (found, exact) in found.into_iter().zip(exact) {
                assert!((found - exact).abs() < tolerance, "channel {c}: {found}, expected {exact}");
            }
        }
    }
}
