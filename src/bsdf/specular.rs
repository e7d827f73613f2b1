//! Enumeration of the Dirac deltas of a BSDF, for ray trees.

use super::two_sided::mirrored;
use super::{Bsdf, Lobe, fresnel, mask};
use crate::color::Rgb;
use crate::math::{Vec2, Vec3};

/// A Dirac delta: a direction from which a finite fraction of the radiance is scattered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpecularLobe {
    /// The direction, of unit length.
    pub wi: Vec3,
    /// Fraction of the radiance from `wi` that is scattered to `wo`.
    pub weight: Rgb,
    /// Index of refraction on the side of `wi` relative to that on the side of `wo`; 1 for a reflection.
    pub eta: f32,
}

/// The largest number below 1, which chooses the last lobe.
const LAST: f32 = 1f32.next_down();

impl Bsdf<'_> {
    /// Calls `found` for every Dirac delta of light scattered to `wo`, reflections before transmissions. Their sum is
    /// the expected value of the specular samples of [`sample`](Self::sample).
    pub fn specular_lobes(&self, wo: Vec3, found: &mut dyn FnMut(SpecularLobe)) {
        match self {
            Bsdf::Null => self.choice(wo, 0.0, 1.0, found),
            Bsdf::Conductor(_) => self.choice(wo, 0.0, 1.0, found),
            Bsdf::Dielectric(b) => self.two_choices(wo, b.reflection_probability(wo), found),
            Bsdf::ThinDielectric(b) => self.two_choices(wo, b.reflection_probability(wo), found),
            Bsdf::RoughDielectric(b) if b.is_passing() => self.choice(wo, 0.0, 1.0, found),
            Bsdf::Plastic(b) if wo.z > 0.0 => {
                let r = fresnel::dielectric(wo.z, b.eta).reflectance;
                self.choice(wo, 0.0, b.specular_probability(r), found);
            }
            Bsdf::Blend(b) => {
                for (bsdf, share) in b.bsdfs.into_iter().zip([1.0 - b.weight, b.weight]) {
                    bsdf.specular_lobes(wo, &mut |lobe| found(lobe.scaled(share)));
                }
            }
            Bsdf::Coating(b) => b.specular_lobes(wo, found),
            Bsdf::Mask(b) => {
                b.inner.specular_lobes(wo, &mut |lobe| found(lobe.scaled(b.opacity)));
                let hole = mask::unscattered(wo);
                found(
                    SpecularLobe { wi: hole.wi, weight: hole.weight, eta: hole.eta }.scaled(1.0 - b.opacity),
                );
            }
            Bsdf::Tilted(b) => {
                let tilt = b.for_viewer(wo);
                tilt.inner.specular_lobes(tilt.frame.to_local(wo), &mut |lobe| {
                    let wi = tilt.frame.to_world(lobe.wi);
                    if wi.z * lobe.wi.z > 0.0 {
                        found(SpecularLobe { wi, weight: lobe.weight * tilt.shadowing(wi), ..lobe });
                    }
                });
            }
            Bsdf::TwoSided(b) if wo.z >= 0.0 => b.sides[0].specular_lobes(wo, found),
            Bsdf::TwoSided(b) => b.sides[1].specular_lobes(mirrored(wo), &mut |lobe| {
                found(SpecularLobe { wi: mirrored(lobe.wi), ..lobe });
            }),
            Bsdf::Diffuse(_) | Bsdf::RoughConductor(_) | Bsdf::RoughDielectric(_) | Bsdf::Plastic(_) => {}
            Bsdf::RoughPlastic(_) | Bsdf::Principled(_) | Bsdf::PrincipledThin(_) => {}
            Bsdf::PolarizedPlastic(_) | Bsdf::Hair(_) | Bsdf::Measured(_) => {}
            Bsdf::DiffuseTransmitter(_) | Bsdf::RoughDiffuse(_) | Bsdf::Phong(_) | Bsdf::Ward(_) => {}
        }
    }

    /// Enumerates the two lobes of a boundary that samples the first with the probability `first`.
    fn two_choices(&self, wo: Vec3, first: f32, found: &mut dyn FnMut(SpecularLobe)) {
        self.choice(wo, 0.0, first, found);
        self.choice(wo, LAST, 1.0 - first, found);
    }

    /// Returns the lobe chosen by `u_lobe`, which has the given probability.
    fn choice(&self, wo: Vec3, u_lobe: f32, probability: f32, found: &mut dyn FnMut(SpecularLobe)) {
        if probability > 0.0
            && let Some(sample) = self.sample(wo, u_lobe, Vec2::splat(0.5))
            && sample.lobe == Lobe::Specular
        {
            found(SpecularLobe { wi: sample.wi, weight: sample.weight * probability, eta: sample.eta });
        }
    }
}

impl SpecularLobe {
    /// Returns the lobe with its weight multiplied by `share`.
    fn scaled(self, share: f32) -> Self {
        SpecularLobe { weight: self.weight * share, ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsdf::{Blend, Dielectric, Diffuse, Mask, Plastic, ThinDielectric, Tilted, TwoSided};
    use crate::math::Frame;

    fn glass() -> Dielectric {
        let (reflectance, transmittance) = (Rgb::new(0.9, 0.8, 1.0), Rgb::new(0.5, 1.0, 0.7));
        Dielectric { eta: 1.5, specular_reflectance: reflectance, specular_transmittance: transmittance }
    }

    /// Returns the directions of the specular samples of [`Bsdf::sample`] over a fine grid of `u_lobe`, with the sums
    /// of their weights.
    fn sampled(bsdf: &Bsdf<'_>, wo: Vec3) -> Vec<(Vec3, [f64; 3])> {
        let n = 1 << 16;
        let mut found: Vec<(Vec3, [f64; 3])> = Vec::new();
        for k in 0..n {
            let Some(sample) = bsdf.sample(wo, (k as f32 + 0.5) / n as f32, Vec2::splat(0.5)) else {
                continue;
            };
            if sample.lobe == Lobe::Specular {
                let weight = sample.weight.to_array().map(|w| f64::from(w) / f64::from(n));
                match found.iter_mut().find(|(wi, _)| (*wi - sample.wi).length() < 1e-5) {
                    Some((_, sum)) => (0..3).for_each(|c| sum[c] += weight[c]),
                    None => found.push((sample.wi, weight)),
                }
            }
        }
        found
    }

    #[test]
    fn lobes_are_the_expectation_of_specular_samples() {
        let thin = Bsdf::ThinDielectric(ThinDielectric {
            eta: 1.5,
            specular_reflectance: Rgb::WHITE,
            specular_transmittance: Rgb::new(1.0, 0.5, 0.25),
            passing: 0.0,
        });
        let solid = Bsdf::Dielectric(glass());
        let plastic = Bsdf::Plastic(Plastic::new(Rgb::new(0.5, 0.2, 0.1), Rgb::WHITE, 1.5, false));
        let diffuse = Bsdf::Diffuse(Diffuse { reflectance: Rgb::WHITE });
        let frame = Frame::from_normal(Vec3::new(0.2, 0.1, 1.0).normalize());
        let tilted = Bsdf::Tilted(Tilted { frame, soften: true, inner: &plastic, turned: None });
        let blend = Bsdf::Blend(Blend { weight: 0.25, bsdfs: [&diffuse, &thin] });
        let mask = Bsdf::Mask(Mask { opacity: 0.75, inner: &plastic });
        let sides = Bsdf::TwoSided(TwoSided { sides: [&diffuse, &mask] });
        for (name, bsdf, lobes_above, lobes_below) in [
            ("null", Bsdf::Null, 1, 1),
            ("diffuse", diffuse, 0, 0),
            ("glass", solid, 2, 2),
            ("thin", thin, 2, 2),
            ("plastic", plastic, 1, 0),
            ("tilted", tilted, 1, 0),
            ("blend", blend, 2, 2),
            ("mask", mask, 2, 1),
            ("two sides", sides, 0, 2),
        ] {
            for (wo, count) in
                [(Vec3::new(0.36, 0.48, 0.8), lobes_above), (Vec3::new(0.2, -0.1, -0.97), lobes_below)]
            {
                let wo = wo.normalize();
                let expected = sampled(&bsdf, wo);
                let mut lobes = Vec::new();
                bsdf.specular_lobes(wo, &mut |lobe| lobes.push(lobe));
                assert_eq!((lobes.len(), expected.len()), (count, count), "{name} {wo}");
                for lobe in lobes {
                    let (_, weight) = expected
                        .iter()
                        .find(|(wi, _)| (*wi - lobe.wi).length() < 1e-5)
                        .unwrap_or_else(|| panic!("{name}: no samples along {}", lobe.wi));
                    for c in 0..3 {
                        let difference = (f64::from(lobe.weight[c]) - weight[c]).abs();
                        assert!(difference < 1e-4, "{name} {wo}: {:?} against {weight:?}", lobe.weight);
                    }
                }
            }
        }
    }

    #[test]
    fn total_internal_reflection_is_one_lobe() {
        let mut lobes = Vec::new();
        let wo = Vec3::new(0.8, 0.0, -0.6);
        Bsdf::Dielectric(glass()).specular_lobes(wo, &mut |lobe| lobes.push(lobe));
        let expected =
            SpecularLobe { wi: Vec3::new(-0.8, 0.0, -0.6), weight: Rgb::new(0.9, 0.8, 1.0), eta: 1.0 };
        assert_eq!(lobes, [expected]);
    }
}
