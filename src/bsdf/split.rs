//! A BSDF as the sum of a diffuse part and the rest.
//!
//! Irradiance caches provide the light of the diffuse part, for which directions do not matter. The rest is traced.

use super::two_sided::mirrored;
use super::{
    Blend, Bsdf, Diffuse, DiffuseAnd, Plastic, PolarizedPlastic, RoughPlastic, Tilted, TwoSided, fresnel,
};
use crate::color::Rgb;
use crate::math::Vec3;
use bumpalo::Bump;
use std::f32::consts::FRAC_1_PI;

/// The two parts of a BSDF; `None` for a part that scatters nothing.
#[derive(Clone, Copy, Debug)]
pub struct Split<'a> {
    /// Lambertian lobes, also under a coating.
    pub diffuse: Option<&'a Bsdf<'a>>,
    /// All other lobes.
    pub rest: Option<&'a Bsdf<'a>>,
}

/// A BSDF that scatters nothing.
static BLACK: Bsdf<'static> = Bsdf::Diffuse(Diffuse { reflectance: Rgb::BLACK });

impl<'a> Bsdf<'a> {
    /// Returns both parts, for light scattered to `wo`; new BSDFs are allocated in the arena.
    pub fn split(&'a self, wo: Vec3, arena: &'a Bump) -> Split<'a> {
        let both = |diffuse: Bsdf<'a>, rest: Bsdf<'a>| Split {
            diffuse: Some(arena.alloc(diffuse)),
            rest: Some(arena.alloc(rest)),
        };
        match self {
            Bsdf::Diffuse(b) if b.reflectance.is_black() => Split { diffuse: None, rest: None },
            Bsdf::Diffuse(_) => Split { diffuse: Some(self), rest: None },
            Bsdf::Plastic(b) if !b.diffuse_reflectance.is_black() => both(
                Bsdf::Plastic(Plastic { specular_reflectance: Rgb::BLACK, ..*b }),
                Bsdf::Plastic(Plastic { diffuse_reflectance: Rgb::BLACK, ..*b }),
            ),
            Bsdf::RoughPlastic(b) if !b.diffuse_reflectance.is_black() => both(
                Bsdf::RoughPlastic(RoughPlastic { specular_reflectance: Rgb::BLACK, ..*b }),
                Bsdf::RoughPlastic(RoughPlastic { diffuse_reflectance: Rgb::BLACK, ..*b }),
            ),
            Bsdf::PolarizedPlastic(b) if !b.diffuse_reflectance.is_black() => both(
                Bsdf::PolarizedPlastic(PolarizedPlastic { specular_reflectance: Rgb::BLACK, ..*b }),
                Bsdf::PolarizedPlastic(PolarizedPlastic { diffuse_reflectance: Rgb::BLACK, ..*b }),
            ),
            Bsdf::Phong(b) if !b.diffuse_reflectance.is_black() => both(
                Bsdf::Diffuse(Diffuse { reflectance: b.diffuse_reflectance }),
                Bsdf::Phong(DiffuseAnd { diffuse_reflectance: Rgb::BLACK, ..*b }),
            ),
            Bsdf::Ward(b) if !b.diffuse_reflectance.is_black() => both(
                Bsdf::Diffuse(Diffuse { reflectance: b.diffuse_reflectance }),
                Bsdf::Ward(DiffuseAnd { diffuse_reflectance: Rgb::BLACK, ..*b }),
            ),
            Bsdf::Blend(b) => {
                let parts = b.bsdfs.map(|bsdf| bsdf.split(wo, arena));
                let blend = |parts: [Option<&'a Bsdf<'a>>; 2]| -> Option<&'a Bsdf<'a>> {
                    parts.iter().any(Option::is_some).then(|| {
                        let bsdfs = parts.map(|part| part.unwrap_or(&BLACK));
                        &*arena.alloc(Bsdf::Blend(Blend { weight: b.weight, bsdfs }))
                    })
                };
                Split { diffuse: blend(parts.map(|p| p.diffuse)), rest: blend(parts.map(|p| p.rest)) }
            }
            Bsdf::Tilted(b) => {
                let Tilted { frame, soften, inner, .. } = *b.for_viewer(wo);
                let tilt = |inner: &'a Bsdf<'a>| -> &'a Bsdf<'a> {
                    arena.alloc(Bsdf::Tilted(Tilted { frame, soften, inner, turned: None }))
                };
                let Split { diffuse, rest } = inner.split(frame.to_local(wo), arena);
                Split { diffuse: diffuse.map(tilt), rest: rest.map(tilt) }
            }
            Bsdf::TwoSided(b) => {
                let seen = if wo.z >= 0.0 { wo } else { mirrored(wo) };
                let turn = |side: &'a Bsdf<'a>| -> &'a Bsdf<'a> {
                    arena.alloc(Bsdf::TwoSided(TwoSided { sides: [side; 2] }))
                };
                let Split { diffuse, rest } = b.sides[usize::from(wo.z < 0.0)].split(seen, arena);
                Split { diffuse: diffuse.map(turn), rest: rest.map(turn) }
            }
            _ => Split { diffuse: None, rest: Some(self) },
        }
    }

    /// Returns the radiance that a diffuse part (see [`split`](Self::split)) scatters to `wo` per unit of irradiance,
    /// sr⁻¹.
    ///
    /// It is exact for a Lambertian surface. The transmittance of a coating depends on the direction of the light;
    /// the result is that for uniform light.
    pub fn radiance_per_irradiance(&self, wo: Vec3) -> Rgb {
        match self {
            Bsdf::Diffuse(b) if wo.z > 0.0 => b.reflectance * FRAC_1_PI,
            Bsdf::Plastic(b) if wo.z > 0.0 => {
                let leaving = 1.0 - fresnel::dielectric(wo.z, b.eta).reflectance;
                let entering = 1.0 - fresnel::diffuse_reflectance(b.eta);
                b.base() * (leaving * entering * FRAC_1_PI)
            }
            Bsdf::RoughPlastic(b) if wo.z > 0.0 => {
                let (leaving, entering) = (b.transmittance.external(wo.z), b.transmittance.external_mean());
                b.base() * (leaving * entering * FRAC_1_PI)
            }
            Bsdf::PolarizedPlastic(b) if wo.z > 0.0 => {
                let entering = 1.0 - fresnel::diffuse_reflectance(b.eta);
                b.diffuse_reflectance * (b.transmittance(wo.z) * entering * FRAC_1_PI)
            }
            Bsdf::Blend(b) => {
                let [first, second] = b.bsdfs.map(|bsdf| bsdf.radiance_per_irradiance(wo));
                first * (1.0 - b.weight) + second * b.weight
            }
            Bsdf::Tilted(b) => {
                let tilt = b.for_viewer(wo);
                tilt.inner.radiance_per_irradiance(tilt.frame.to_local(wo))
            }
            Bsdf::TwoSided(b) if wo.z >= 0.0 => b.sides[0].radiance_per_irradiance(wo),
            Bsdf::TwoSided(b) => b.sides[1].radiance_per_irradiance(mirrored(wo)),
            _ => Rgb::BLACK,
        }
    }

    /// Returns the normal, in the local frame, of the surface whose irradiance determines the light scattered to
    /// `wo`.
    pub fn receiving_normal(&self, wo: Vec3) -> Vec3 {
        match self {
            Bsdf::Tilted(b) => {
                let Tilted { frame, inner, .. } = b.for_viewer(wo);
                frame.to_world(inner.receiving_normal(frame.to_local(wo)))
            }
            Bsdf::TwoSided(b) if wo.z < 0.0 => mirrored(b.sides[1].receiving_normal(mirrored(wo))),
            Bsdf::TwoSided(b) => b.sides[0].receiving_normal(wo),
            _ => Vec3::Z,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsdf::Dielectric;
    use crate::math::{Frame, Vec2};
    use crate::sampling::warp;

    fn plastic() -> Bsdf<'static> {
        Bsdf::Plastic(Plastic::new(Rgb::new(0.2, 0.5, 0.9), Rgb::WHITE, 1.5, true))
    }

    /// Returns the light from a uniform sky that a BSDF's finite lobes scatter to `wo`, by the midpoint rule.
    fn under_a_sky(bsdf: &Bsdf<'_>, wo: Vec3, side: f32) -> Rgb {
        const N: usize = 200;
        let mut sum = Rgb::BLACK;
        for i in 0..N * N {
            let u = Vec2::new((i % N) as f32 + 0.5, (i / N) as f32 + 0.5) / N as f32;
            let mut wi = warp::square_to_cosine_hemisphere(u);
            wi.z *= side;
            sum += bsdf.eval(wo, wi).f;
        }
        sum * (std::f32::consts::PI / (N * N) as f32)
    }

    #[test]
    fn the_parts_sum_to_the_whole_and_answer_a_uniform_sky() {
        let arena = Bump::new();
        let white = Bsdf::Diffuse(Diffuse { reflectance: Rgb::new(0.9, 0.8, 0.1) });
        let plastic = plastic();
        let body =
            Dielectric { eta: 1.5, specular_reflectance: Rgb::WHITE, specular_transmittance: Rgb::WHITE };
        let glass = Bsdf::Dielectric(body);
        let blend = Bsdf::Blend(Blend { weight: 0.3, bsdfs: [&plastic, &glass] });
        let sides = Bsdf::TwoSided(TwoSided { sides: [&white, &blend] });
        for (bsdf, wo) in [
            (&white, Vec3::new(0.6, 0.0, 0.8)),
            (&plastic, Vec3::new(0.6, 0.0, 0.8)),
            (&blend, Vec3::Z),
            (&sides, Vec3::new(0.0, 0.28, -0.96)),
            (&sides, Vec3::new(0.0, 0.28, 0.96)),
        ] {
            let Split { diffuse, rest } = bsdf.split(wo, &arena);
            let wi = Vec3::new(0.36, 0.48, 0.8 * wo.z.signum());
            let part = |part: Option<&Bsdf<'_>>| part.map_or(Rgb::BLACK, |b| b.eval(wo, wi).f);
            let (sum, whole) = (part(diffuse) + part(rest), bsdf.eval(wo, wi).f);
            for c in 0..3 {
                assert!((sum[c] - whole[c]).abs() <= 1e-6, "{bsdf:?}: {sum:?} of {whole:?}");
            }
            let diffuse = diffuse.expect("each has a diffuse part");
            let sky = under_a_sky(diffuse, wo, wo.z.signum());
            let answer = diffuse.radiance_per_irradiance(wo) * std::f32::consts::PI;
            for c in 0..3 {
                assert!((sky[c] - answer[c]).abs() <= 2e-3, "{bsdf:?}: {answer:?} instead of {sky:?}");
            }
            assert_eq!(diffuse.receiving_normal(wo), Vec3::new(0.0, 0.0, wo.z.signum()));
        }
        assert!(glass.split(Vec3::Z, &arena).diffuse.is_none());
        assert!(BLACK.split(Vec3::Z, &arena).diffuse.is_none());
    }

    #[test]
    fn a_tilted_surface_receives_along_its_own_normal() {
        let white = Bsdf::Diffuse(Diffuse { reflectance: Rgb::WHITE });
        let n = Vec3::new(0.6, 0.0, 0.8);
        let tilted =
            Bsdf::Tilted(Tilted { frame: Frame::from_normal(n), soften: false, inner: &white, turned: None });
        assert!((tilted.receiving_normal(Vec3::Z) - n).length() < 1e-6);
        assert!(tilted.split(Vec3::Z, &Bump::new()).rest.is_none());
    }
}
