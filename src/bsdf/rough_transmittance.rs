//! Tables of the transmittance of rough dielectric boundaries.

use super::facet::Facet;
use super::fresnel;
use super::microfacet::{Distribution, Microfacets, beckmann_slope_across, beckmann_slope_along};
use crate::math::{Vec2, Vec3};
use crate::sampling::warp;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// The transmittance of a rough dielectric boundary from outside, and its diffuse reflectance from inside.
///
/// The scene language defines the values of a rough plastic by a quadrature: Gauss quadrature over the unit square,
/// mapped to visible facets. Its error is up to 8·10⁻⁴, and the values here have the same error.
#[derive(Clone, Debug, PartialEq)]
pub struct RoughTransmittance {
    /// The transmittance at equally spaced cosines in [0, 1].
    external: [f32; RESOLUTION],
    /// The fraction of diffuse light from inside that is reflected back.
    internal: f32,
}

const RESOLUTION: usize = 64;

impl RoughTransmittance {
    /// Returns the table for the given parameters, which is computed at the first call only.
    pub fn shared(distribution: Distribution, alpha: f32, eta: f32) -> Arc<Self> {
        type Parameters = (Distribution, [u32; 2]);
        static TABLES: Mutex<BTreeMap<Parameters, Arc<RoughTransmittance>>> = Mutex::new(BTreeMap::new());
        let parameters = (distribution, [alpha, eta].map(f32::to_bits));
        let tables = || TABLES.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(table) = tables().get(&parameters) {
            return table.clone();
        }
        // Without the lock, because a thread that waits for others may be given another material to prepare.
        let table = Arc::new(RoughTransmittance::new(distribution, alpha, eta));
        tables().entry(parameters).or_insert(table).clone()
    }

    /// Integrates over the visible facets, which takes about a tenth of a second on one thread. `eta` is the index
    /// below relative to that outside.
    pub fn new(distribution: Distribution, alpha: f32, eta: f32) -> Self {
        let facets = Microfacets { distribution, alpha_x: alpha, alpha_y: alpha, sample_visible: true };
        // Uses more nodes where total internal reflection causes a kink.
        let rule = |eta: f32| gauss(if eta > 1.0 { 32 } else { 128 });
        let (outside, inside) = (rule(eta), rule(1.0 / eta));
        let at = |i: usize| {
            let cos = (i as f32 / (RESOLUTION - 1) as f32).max(1e-6);
            let reflected = 2.0 * f64::from(cos) * reflectance(&facets, cos, 1.0 / eta, &inside);
            (transmittance(&facets, cos, eta, &outside) as f32, reflected)
        };
        let (external, reflected): (Vec<f32>, Vec<f64>) = (0..RESOLUTION).into_par_iter().map(at).unzip();
        // A mean of samples that includes both ends. It is not a proper quadrature, but the definition of the scene
        // language.
        let internal = reflected.iter().sum::<f64>() / RESOLUTION as f64;
        RoughTransmittance {
            external: external.try_into().expect("one value for each cosine"),
            internal: internal as f32,
        }
    }

    /// Returns the fraction of light at the cosine `cos` outside that enters, interpolated linearly.
    #[inline]
    pub fn external(&self, cos: f32) -> f32 {
        let x = cos * (RESOLUTION - 1) as f32;
        let i = (x as usize).min(RESOLUTION - 2);
        let w = x - i as f32;
        self.external[i] * (1.0 - w) + self.external[i + 1] * w
    }

    /// Returns the fraction of diffuse light outside that enters.
    pub fn external_mean(&self) -> f32 {
        let n = 2 * RESOLUTION;
        let term = |i: usize| {
            let cos = (i as f32 + 0.5) / n as f32;
            2.0 * cos * self.external(cos) / n as f32
        };
        (0..n).map(term).sum()
    }

    /// Returns the fraction of diffuse light from inside that is reflected back.
    pub fn internal(&self) -> f32 {
        self.internal
    }
}

fn transmittance(facets: &Microfacets, cos: f32, eta: f32, rule: &[(f64, f64)]) -> f64 {
    mean_over_facets(facets, cos, rule, |wo, m| {
        let r = fresnel::dielectric(wo.dot(m).max(0.0), eta);
        Facet::refract(wo, m, r.cos_t, eta).map_or(0.0, |(wi, _)| (1.0 - r.reflectance) * facets.g1(wi, m))
    })
}

fn reflectance(facets: &Microfacets, cos: f32, eta: f32, rule: &[(f64, f64)]) -> f64 {
    mean_over_facets(facets, cos, rule, |wo, m| {
        let r = fresnel::dielectric(wo.dot(m).max(0.0), eta).reflectance;
        Facet::mirror(wo, m).map_or(0.0, |(wi, _)| r * facets.g1(wi, m))
    })
}

/// Returns the mean of a function of `wo` and a facet over the facets that are visible at the cosine `cos`.
fn mean_over_facets(
    facets: &Microfacets,
    cos: f32,
    rule: &[(f64, f64)],
    value: impl Fn(Vec3, Vec3) -> f32,
) -> f64 {
    let wo = Vec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
    let alpha = facets.alpha_x;
    let v = Vec3::new(alpha * wo.x, 0.0, wo.z).normalize();
    // Each of Beckmann's slopes depends on one of the random numbers only.
    let slopes: Vec<[f32; 2]> = match facets.distribution {
        Distribution::Ggx => Vec::new(),
        Distribution::Beckmann => {
            let slopes = |u: f64| [beckmann_slope_along(v.z, v.x, u as f32), beckmann_slope_across(u as f32)];
            rule.iter().map(|&(u, _)| slopes(u)).collect()
        }
    };
    let mut sum = 0.0;
    for (i, &(x, weight_x)) in rule.iter().enumerate() {
        for (j, &(y, weight_y)) in rule.iter().enumerate() {
            let slope = match facets.distribution {
                Distribution::Ggx => ggx_slopes(v, Vec2::new(x as f32, y as f32)),
                Distribution::Beckmann => Vec2::new(slopes[i][0], slopes[j][1]),
            };
            let m = Vec3::new(-alpha * slope.x, -alpha * slope.y, 1.0).normalize();
            sum += weight_x * weight_y * f64::from(value(wo, m));
        }
    }
    sum
}

/// Samples the slopes of a visible facet with unit roughness seen from `v` at the azimuth 0, by the projected
/// hemisphere. [Heitz 2018]
fn ggx_slopes(v: Vec3, u: Vec2) -> Vec2 {
    let p = warp::square_to_disk(u);
    let s = 0.5 * (1.0 + v.z);
    let y = (1.0 - s) * (1.0 - p.x * p.x).max(0.0).sqrt() + s * p.y;
    let z = (1.0 - p.x * p.x - y * y).max(0.0).sqrt();
    Vec2::new(v.z * y - v.x * z, p.x) / (v.x * y + v.z * z)
}

/// Returns nodes and weights of Gauss quadrature on [0, 1]: the roots of a Legendre polynomial, by Newton's method.
fn gauss(n: u32) -> Vec<(f64, f64)> {
    let root = |i: u32| {
        let mut x = (std::f64::consts::PI * (f64::from(i) + 0.75) / (f64::from(n) + 0.5)).cos();
        let mut derivative = 1.0;
        // With this initial value, each step doubles the number of correct digits.
        for _ in 0..6 {
            let (mut p, mut previous) = (x, 1.0);
            for k in 2..=n {
                let k = f64::from(k);
                (p, previous) = (((2.0 * k - 1.0) * x * p - (k - 1.0) * previous) / k, p);
            }
            derivative = f64::from(n) * (x * p - previous) / (x * x - 1.0);
            x -= p / derivative;
        }
        (0.5 * (1.0 + x), 1.0 / ((1.0 - x * x) * derivative * derivative))
    };
    (0..n).map(root).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gauss_integrates_polynomials() {
        for n in [2, 32, 128] {
            let rule = gauss(n);
            for power in [0, 1, 2, 3] {
                let integral: f64 = rule.iter().map(|(x, w)| w * x.powi(power)).sum();
                assert!((integral - 1.0 / f64::from(power + 1)).abs() < 1e-12, "{n} {power} {integral}");
            }
        }
    }

    /// Smooth boundaries have the transmittance of the Fresnel equations. In equilibrium, entering and leaving light
    /// are equal.
    #[test]
    fn a_smooth_boundary_is_fresnels() {
        let eta = 1.5;
        for distribution in [Distribution::Beckmann, Distribution::Ggx] {
            let table = RoughTransmittance::new(distribution, 1e-4, eta);
            for cos in [1.0, 0.6, 0.2] {
                let exact = 1.0 - fresnel::dielectric(cos, eta).reflectance;
                assert!((table.external(cos) - exact).abs() < 2e-3, "{cos}: {} {exact}", table.external(cos));
            }
            let leaving = 1.0 - table.internal();
            assert!((leaving - table.external_mean() / (eta * eta)).abs() < 1e-2, "{leaving}");
        }
    }
}
