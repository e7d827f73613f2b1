//! BSDFs: scattering at a surface in the local frame (z = normal), without textures or a scene.
//!
//! `wo` is the known direction, `wi` the sampled one; both point away from the surface. [`Bsdf::eval`] is the bare
//! BSDF, without cosine. Densities are per unit solid angle of `wi`.

mod adjoint;
pub mod blend;
pub mod burley;
pub mod coating;
pub mod conductor;
pub mod dielectric;
pub mod diffuse;
pub mod diffuse_transmitter;
pub mod empirical;
pub mod facet;
pub mod fresnel;
pub mod hair;
pub mod lanes;
#[cfg(test)]
mod lanes_tests;
pub mod mask;
pub mod measured;
pub mod microfacet;
mod nested_lanes;
pub mod plastic;
pub mod polarized_plastic;
pub mod principled;
pub mod principled_lanes;
pub mod principled_thin;
pub mod rough_conductor;
pub mod rough_dielectric;
pub mod rough_diffuse;
pub mod rough_plastic;
pub mod rough_transmittance;
pub mod specular;
pub mod split;
pub mod thin_dielectric;
pub mod tilted;
pub mod two_sided;

pub use blend::Blend;
pub use coating::{Coating, RoughBoundary};
pub use conductor::Conductor;
pub use dielectric::Dielectric;
pub use diffuse::Diffuse;
pub use diffuse_transmitter::DiffuseTransmitter;
pub use empirical::{DiffuseAnd, Phong, Ward};
pub use hair::Hair;
pub use lanes::{BsdfEvalX16, BsdfSampleX16, BsdfX16};
pub use mask::Mask;
pub use measured::Measured;
pub use plastic::Plastic;
pub use polarized_plastic::PolarizedPlastic;
pub use principled::Principled;
pub use principled_thin::PrincipledThin;
pub use rough_conductor::RoughConductor;
pub use rough_dielectric::RoughDielectric;
pub use rough_diffuse::RoughDiffuse;
pub use rough_plastic::RoughPlastic;
pub use rough_transmittance::RoughTransmittance;
pub use specular::SpecularLobe;
pub use split::Split;
pub use thin_dielectric::ThinDielectric;
pub use tilted::Tilted;
pub use two_sided::TwoSided;

use crate::color::Rgb;
use crate::math::{Vec2, Vec3};
use microfacet::Microfacets;

/// The kind of lobe from which a direction was sampled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lobe {
    /// Wide, over the hemisphere.
    Diffuse,
    /// Concentrated around a direction, with a finite density.
    Glossy,
    /// A Dirac delta: no other technique can sample it.
    Specular,
}

/// A sampled direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfSample {
    /// The direction, of unit length.
    pub wi: Vec3,
    /// `f·|cosθ|/pdf`; for a specular lobe, its reflectance or transmittance divided by the lobe's probability.
    pub weight: Rgb,
    /// Density per unit solid angle; infinite for a specular lobe.
    pub pdf: f32,
    /// The sampled lobe.
    pub lobe: Lobe,
    /// Index of refraction on the side of `wi` relative to that on the side of `wo`; 1 for a reflection.
    pub eta: f32,
}

/// The value and density for a pair of directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfEval {
    /// The bare BSDF, sr⁻¹.
    pub f: Rgb,
    /// Density per unit solid angle with which [`Bsdf::sample`] samples `wi`.
    pub pdf: f32,
}

impl BsdfEval {
    /// No scattering.
    pub const ZERO: BsdfEval = BsdfEval { f: Rgb::BLACK, pdf: 0.0 };
}

/// A BSDF with its parameters at one surface point. A nested BSDF is a reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bsdf<'a> {
    /// No surface: all light passes unchanged.
    Null,
    /// Ideal Lambertian reflection.
    Diffuse(Diffuse),
    /// Ideal diffuse transmission.
    DiffuseTransmitter(DiffuseTransmitter),
    /// Diffuse reflection by a rough surface.
    RoughDiffuse(RoughDiffuse),
    /// Diffuse reflection plus a Phong lobe.
    Phong(DiffuseAnd<Phong>),
    /// Diffuse reflection plus the lobe of Ward.
    Ward(DiffuseAnd<Ward>),
    /// Specular reflection by a smooth conductor.
    Conductor(Conductor),
    /// Reflection by a rough conductor.
    RoughConductor(RoughConductor),
    /// Reflection and refraction at a smooth dielectric boundary.
    Dielectric(Dielectric),
    /// Reflection and unrefracted transmission by a thin sheet of a dielectric.
    ThinDielectric(ThinDielectric),
    /// Reflection and refraction at a rough dielectric boundary.
    RoughDielectric(RoughDielectric),
    /// A diffuse base under a smooth dielectric coating.
    Plastic(Plastic),
    /// A diffuse base under a rough dielectric coating.
    RoughPlastic(RoughPlastic<'a>),
    /// The principled model.
    Principled(Principled),
    /// The principled model of a thin sheet.
    PrincipledThin(PrincipledThin),
    /// Diffuse reflection below a boundary that also reflects.
    PolarizedPlastic(PolarizedPlastic),
    /// Scattering by a hair.
    Hair(Hair),
    /// Reflection from measured tables.
    Measured(&'a Measured),
    /// A linear combination of two BSDFs.
    Blend(Blend<'a>),
    /// A BSDF under a smooth dielectric coating.
    Coating(Coating<'a>),
    /// A BSDF with holes.
    Mask(Mask<'a>),
    /// A BSDF in the frame of a perturbed normal.
    Tilted(Tilted<'a>),
    /// A BSDF for each side.
    TwoSided(TwoSided<'a>),
}

/// The lobes of a BSDF.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lobes {
    /// Whether there are lobes of finite density.
    pub finite: bool,
    /// Whether one of them can be wide, over the hemisphere: true for principled BSDFs even if they are metallic.
    pub diffuse: bool,
    /// The greatest number of Dirac deltas.
    pub deltas: u32,
}

impl Lobes {
    /// Glossy lobes only.
    pub const GLOSSY: Lobes = Lobes { finite: true, diffuse: false, deltas: 0 };
    /// Lobes of finite density of which one is diffuse.
    pub const DIFFUSE: Lobes = Lobes { finite: true, diffuse: true, deltas: 0 };

    /// The given number of Dirac deltas and no other lobes.
    pub const fn deltas(deltas: u32) -> Lobes {
        Lobes { finite: false, diffuse: false, deltas }
    }

    /// Returns the lobes of a sum of two BSDFs.
    #[must_use]
    pub fn and(self, other: Lobes) -> Lobes {
        Lobes { deltas: self.deltas.saturating_add(other.deltas), ..self.or(other) }
    }

    /// Returns the lobes of either one of two BSDFs.
    #[must_use]
    pub fn or(self, other: Lobes) -> Lobes {
        Lobes {
            finite: self.finite || other.finite,
            diffuse: self.diffuse || other.diffuse,
            deltas: self.deltas.max(other.deltas),
        }
    }
}

impl Bsdf<'_> {
    /// The same BSDF, if it refers to nothing else.
    pub fn owned(self) -> Option<Bsdf<'static>> {
        Some(match self {
            Bsdf::Null => Bsdf::Null,
            Bsdf::Diffuse(b) => Bsdf::Diffuse(b),
            Bsdf::DiffuseTransmitter(b) => Bsdf::DiffuseTransmitter(b),
            Bsdf::RoughDiffuse(b) => Bsdf::RoughDiffuse(b),
            Bsdf::Phong(b) => Bsdf::Phong(b),
            Bsdf::Ward(b) => Bsdf::Ward(b),
            Bsdf::Conductor(b) => Bsdf::Conductor(b),
            Bsdf::RoughConductor(b) => Bsdf::RoughConductor(b),
            Bsdf::Dielectric(b) => Bsdf::Dielectric(b),
            Bsdf::ThinDielectric(b) => Bsdf::ThinDielectric(b),
            Bsdf::RoughDielectric(b) => Bsdf::RoughDielectric(b),
            Bsdf::Plastic(b) => Bsdf::Plastic(b),
            Bsdf::Principled(b) => Bsdf::Principled(b),
            Bsdf::PrincipledThin(b) => Bsdf::PrincipledThin(b),
            Bsdf::PolarizedPlastic(b) => Bsdf::PolarizedPlastic(b),
            Bsdf::Hair(b) => Bsdf::Hair(b),
            Bsdf::RoughPlastic(_) | Bsdf::Measured(_) | Bsdf::Blend(_) | Bsdf::Coating(_) => return None,
            Bsdf::Mask(_) | Bsdf::Tilted(_) | Bsdf::TwoSided(_) => {
                return None;
            }
        })
    }

    /// Returns the lobes that may scatter light.
    #[inline]
    pub fn lobes(&self) -> Lobes {
        match self {
            Bsdf::Null | Bsdf::Conductor(_) => Lobes::deltas(1),
            Bsdf::Dielectric(_) | Bsdf::ThinDielectric(_) => Lobes::deltas(2),
            Bsdf::Diffuse(_) | Bsdf::DiffuseTransmitter(_) | Bsdf::RoughDiffuse(_) => Lobes::DIFFUSE,
            Bsdf::Phong(_) | Bsdf::Ward(_) | Bsdf::RoughPlastic(_) | Bsdf::PolarizedPlastic(_) => {
                Lobes::DIFFUSE
            }
            Bsdf::Principled(_) | Bsdf::PrincipledThin(_) => Lobes::DIFFUSE,
            Bsdf::RoughConductor(_) | Bsdf::Hair(_) | Bsdf::Measured(_) => Lobes::GLOSSY,
            Bsdf::Plastic(_) => Lobes { deltas: 1, ..Lobes::DIFFUSE },
            Bsdf::RoughDielectric(b) if b.is_passing() => Lobes::deltas(1),
            Bsdf::RoughDielectric(_) => Lobes::GLOSSY,
            Bsdf::Blend(b) => b.bsdfs[0].lobes().and(b.bsdfs[1].lobes()),
            Bsdf::Coating(b) => b.lobes(),
            // Light through holes is a Dirac delta.
            Bsdf::Mask(b) => b.inner.lobes().and(Lobes::deltas(1)),
            Bsdf::Tilted(b) => b.inner.lobes(),
            Bsdf::TwoSided(b) => b.sides[0].lobes().or(b.sides[1].lobes()),
        }
    }

    /// Returns whether all lobes are Dirac deltas, so that [`eval`](Self::eval) is zero everywhere.
    #[inline]
    pub fn is_specular(&self) -> bool {
        !self.lobes().finite
    }

    /// Returns whether the BSDF depends on the tangents of the local frame.
    pub fn is_anisotropic(&self) -> bool {
        match self {
            Bsdf::RoughConductor(b) => b.microfacets.is_anisotropic(),
            Bsdf::RoughDielectric(b) => b.microfacets.is_anisotropic(),
            Bsdf::Ward(b) => b.lobe.microfacets.is_anisotropic(),
            Bsdf::Null | Bsdf::Diffuse(_) | Bsdf::Conductor(_) | Bsdf::Dielectric(_) => false,
            Bsdf::DiffuseTransmitter(_) | Bsdf::RoughDiffuse(_) | Bsdf::Phong(_) => false,
            Bsdf::ThinDielectric(_) | Bsdf::Plastic(_) | Bsdf::RoughPlastic(_) => false,
            Bsdf::Principled(b) => b.anisotropy != 0.0,
            Bsdf::PrincipledThin(b) => b.anisotropy != 0.0,
            Bsdf::PolarizedPlastic(b) => b.microfacets.is_anisotropic(),
            Bsdf::Hair(_) => true,
            Bsdf::Measured(b) => b.is_anisotropic(),
            Bsdf::Blend(b) => b.bsdfs.iter().any(|b| b.is_anisotropic()),
            Bsdf::Coating(b) => b.inner.is_anisotropic(),
            Bsdf::Mask(b) => b.inner.is_anisotropic(),
            Bsdf::Tilted(_) => true,
            Bsdf::TwoSided(b) => b.sides.iter().any(|b| b.is_anisotropic()),
        }
    }

    /// Returns whether light may be scattered to the other side of the surface.
    pub fn transmits(&self) -> bool {
        match self {
            Bsdf::Null | Bsdf::Dielectric(_) | Bsdf::ThinDielectric(_) | Bsdf::RoughDielectric(_) => true,
            Bsdf::DiffuseTransmitter(_) | Bsdf::Hair(_) => true,
            Bsdf::Diffuse(_) | Bsdf::Conductor(_) | Bsdf::RoughConductor(_) => false,
            Bsdf::RoughDiffuse(_) | Bsdf::Phong(_) | Bsdf::Ward(_) | Bsdf::Measured(_) => false,
            Bsdf::Plastic(_) | Bsdf::RoughPlastic(_) | Bsdf::PolarizedPlastic(_) | Bsdf::Coating(_) => false,
            Bsdf::Principled(b) => b.transmits(),
            Bsdf::PrincipledThin(b) => b.transmits(),
            Bsdf::Blend(b) => b.bsdfs.iter().any(|b| b.transmits()),
            Bsdf::Mask(b) => b.opacity < 1.0 || b.inner.transmits(),
            Bsdf::Tilted(b) => b.inner.transmits(),
            Bsdf::TwoSided(b) => b.sides.iter().any(|b| b.transmits()),
        }
    }

    /// Returns whether a BSDF that was made for one viewer differs from that for another viewer on the same side.
    pub fn depends_on_viewer(&self) -> bool {
        match self {
            Bsdf::Tilted(_) => true,
            Bsdf::Null | Bsdf::Diffuse(_) | Bsdf::DiffuseTransmitter(_) | Bsdf::RoughDiffuse(_) => false,
            Bsdf::Conductor(_) | Bsdf::RoughConductor(_) | Bsdf::Phong(_) | Bsdf::Ward(_) => false,
            Bsdf::Dielectric(_) | Bsdf::ThinDielectric(_) | Bsdf::RoughDielectric(_) => false,
            Bsdf::Plastic(_) | Bsdf::RoughPlastic(_) | Bsdf::PolarizedPlastic(_) | Bsdf::Hair(_) => false,
            Bsdf::Principled(_) | Bsdf::PrincipledThin(_) | Bsdf::Measured(_) => false,
            Bsdf::Blend(b) => b.bsdfs.iter().any(|b| b.depends_on_viewer()),
            Bsdf::Coating(b) => b.inner.depends_on_viewer(),
            Bsdf::Mask(b) => b.inner.depends_on_viewer(),
            Bsdf::TwoSided(b) => b.sides.iter().any(|b| b.depends_on_viewer()),
        }
    }

    /// Returns the width of a reflected lobe around the mirror direction of `wo`, as the roughness α of a microfacet
    /// distribution, and its approximate share of the scattered light, for the choice of emitters. `None` if there is
    /// no such lobe, or if its direction is another one.
    pub fn gloss(&self, wo: Vec3) -> Option<(f32, f32)> {
        let of =
            |microfacets: &Microfacets, share| Some((microfacets.alpha_x.max(microfacets.alpha_y), share));
        match self {
            Bsdf::RoughConductor(b) => of(&b.microfacets, 1.0),
            Bsdf::RoughPlastic(b) if wo.z > 0.0 => of(&b.microfacets, b.specular_share(wo)),
            Bsdf::PolarizedPlastic(b) if wo.z > 0.0 => of(&b.microfacets, b.specular_probability()),
            Bsdf::Ward(b) => of(&b.lobe.microfacets, b.probability()),
            // The lobe of a Phong BSDF has the width of a Beckmann distribution of this roughness.
            Bsdf::Phong(b) => Some(((2.0 / (b.lobe.exponent + 2.0)).sqrt(), b.probability())),
            Bsdf::Principled(b) if wo.z > 0.0 => of(&b.microfacets(), b.reflected_share(wo)),
            // The more important lobe of the two.
            Bsdf::Blend(b) => {
                let of = |i: usize, weight: f32| {
                    b.bsdfs[i].gloss(wo).map(|(alpha, share)| (alpha, share * weight))
                };
                let both = [of(0, 1.0 - b.weight), of(1, b.weight)];
                both.into_iter().flatten().max_by(|a, b| a.1.total_cmp(&b.1))
            }
            Bsdf::TwoSided(b) => b.sides[usize::from(wo.z < 0.0)].gloss(Vec3 { z: wo.z.abs(), ..wo }),
            Bsdf::Mask(b) => b.inner.gloss(wo),
            _ => None,
        }
    }

    /// Returns whether [`sample`](Self::sample) uses `u_lobe`.
    pub fn chooses_lobe(&self) -> bool {
        match self {
            Bsdf::Null | Bsdf::Diffuse(_) | Bsdf::Conductor(_) | Bsdf::RoughConductor(_) => false,
            Bsdf::DiffuseTransmitter(_) | Bsdf::RoughDiffuse(_) | Bsdf::Measured(_) => false,
            Bsdf::Phong(_) | Bsdf::Ward(_) | Bsdf::PolarizedPlastic(_) | Bsdf::Hair(_) => true,
            Bsdf::Dielectric(_) | Bsdf::ThinDielectric(_) | Bsdf::RoughDielectric(_) => true,
            Bsdf::Plastic(_) | Bsdf::RoughPlastic(_) | Bsdf::Principled(_) | Bsdf::PrincipledThin(_) => true,
            Bsdf::Blend(_) | Bsdf::Coating(_) | Bsdf::Mask(_) => true,
            Bsdf::Tilted(b) => b.turned.is_some() || b.inner.chooses_lobe(),
            Bsdf::TwoSided(b) => b.sides.iter().any(|b| b.chooses_lobe()),
        }
    }

    /// Returns the bare BSDF and the density of the finite lobes.
    #[inline]
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        match self {
            Bsdf::Diffuse(b) => b.eval(wo, wi),
            Bsdf::DiffuseTransmitter(b) => b.eval(wo, wi),
            Bsdf::RoughDiffuse(b) => b.eval(wo, wi),
            Bsdf::Phong(b) => b.eval(wo, wi),
            Bsdf::Ward(b) => b.eval(wo, wi),
            Bsdf::RoughConductor(b) => b.eval(wo, wi),
            Bsdf::RoughDielectric(b) => b.eval(wo, wi),
            Bsdf::Plastic(b) => b.eval(wo, wi),
            Bsdf::RoughPlastic(b) => b.eval(wo, wi),
            Bsdf::Principled(b) => b.eval(wo, wi),
            Bsdf::PrincipledThin(b) => b.eval(wo, wi),
            Bsdf::PolarizedPlastic(b) => b.eval(wo, wi),
            Bsdf::Hair(b) => b.eval(wo, wi),
            Bsdf::Measured(b) => b.eval(wo, wi),
            Bsdf::Null | Bsdf::Conductor(_) | Bsdf::Dielectric(_) | Bsdf::ThinDielectric(_) => BsdfEval::ZERO,
            Bsdf::Blend(b) => b.eval(wo, wi),
            Bsdf::Coating(b) => b.eval(wo, wi),
            Bsdf::Mask(b) => b.eval(wo, wi),
            Bsdf::Tilted(b) => b.eval(wo, wi),
            Bsdf::TwoSided(b) => b.eval(wo, wi),
        }
    }

    /// Samples a direction; `u_lobe` chooses the lobe, `u` the direction within the lobe. `None` if nothing is
    /// scattered.
    #[inline]
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        match self {
            Bsdf::Diffuse(b) => b.sample(wo, u),
            Bsdf::DiffuseTransmitter(b) => b.sample(wo, u),
            Bsdf::RoughDiffuse(b) => b.sample(wo, u),
            Bsdf::Phong(b) => b.sample(wo, u_lobe, u),
            Bsdf::Ward(b) => b.sample(wo, u_lobe, u),
            Bsdf::RoughConductor(b) => b.sample(wo, u),
            Bsdf::Conductor(b) => b.sample(wo),
            Bsdf::Dielectric(b) => b.sample(wo, u_lobe),
            Bsdf::ThinDielectric(b) => b.sample(wo, u_lobe),
            Bsdf::RoughDielectric(b) => b.sample(wo, u_lobe, u),
            Bsdf::Plastic(b) => b.sample(wo, u_lobe, u),
            Bsdf::RoughPlastic(b) => b.sample(wo, u_lobe, u),
            Bsdf::Principled(b) => b.sample(wo, u_lobe, u),
            Bsdf::PrincipledThin(b) => b.sample(wo, u_lobe, u),
            Bsdf::PolarizedPlastic(b) => b.sample(wo, u_lobe, u),
            Bsdf::Hair(b) => b.sample(wo, u_lobe, u),
            Bsdf::Measured(b) => b.sample(wo, u),
            Bsdf::Null => Some(mask::unscattered(wo)),
            Bsdf::Blend(b) => b.sample(wo, u_lobe, u),
            Bsdf::Coating(b) => b.sample(wo, u_lobe, u),
            Bsdf::Mask(b) => b.sample(wo, u_lobe, u),
            Bsdf::Tilted(b) => b.sample(wo, u_lobe, u),
            Bsdf::TwoSided(b) => b.sample(wo, u_lobe, u),
        }
    }

    /// Returns the fraction of light that is scattered along the normal under uniform illumination from all sides,
    /// for albedo images. It is exact for diffuse and specular lobes. For rough lobes it is the Fresnel term of the
    /// mean facet.
    pub fn albedo(&self) -> Rgb {
        match self {
            Bsdf::Diffuse(b) => b.reflectance,
            Bsdf::DiffuseTransmitter(b) => b.transmittance,
            Bsdf::RoughDiffuse(b) => b.reflectance,
            Bsdf::Phong(b) => b.albedo(),
            Bsdf::Ward(b) => b.albedo(),
            Bsdf::RoughConductor(b) => b.fresnel.reflectance(1.0) * b.specular_reflectance,
            Bsdf::Conductor(b) => b.fresnel.reflectance(1.0) * b.specular_reflectance,
            Bsdf::Dielectric(b) => b.albedo(),
            Bsdf::ThinDielectric(b) => b.albedo(),
            Bsdf::RoughDielectric(b) => b.albedo(),
            Bsdf::Plastic(b) => b.albedo(),
            Bsdf::RoughPlastic(b) => b.albedo(),
            Bsdf::Principled(b) => b.albedo(),
            Bsdf::PrincipledThin(b) => b.albedo(),
            Bsdf::PolarizedPlastic(b) => b.albedo(),
            Bsdf::Hair(b) => b.albedo(),
            Bsdf::Measured(b) => b.albedo(),
            Bsdf::Null => Rgb::WHITE,
            Bsdf::Blend(b) => b.albedo(),
            Bsdf::Coating(b) => b.albedo(),
            Bsdf::Mask(b) => b.inner.albedo() * b.opacity + Rgb::WHITE * (1.0 - b.opacity),
            Bsdf::Tilted(b) => b.inner.albedo(),
            Bsdf::TwoSided(b) => b.sides[0].albedo(),
        }
    }
}
