//! Groups of parameters that several plugins have in common.

use super::source::{NumberOrName, Read, Source};
use super::{Input, Inputs};
use crate::bsdf::empirical::DiffuseAnd;
use crate::bsdf::fresnel::ConductorFresnel;
use crate::bsdf::microfacet::{Distribution, Microfacets};
use crate::color::conductors::{self, ComplexIor};
use crate::color::spectrum::Quantity;
use crate::color::{Rgb, ior};
use crate::error::Result;
use crate::ids::TextureId;
use crate::util::wording::{did_you_mean, quoted};

/// The minimum roughness. Squares of smaller values leave the range of `f32`.
pub(super) const LEAST_ALPHA: f32 = 1e-4;
/// The default conductor: a perfect mirror.
const DEFAULT_CONDUCTOR: &str = "none";

/// The distribution and roughness of microfacet normals.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Roughness {
    /// The family of distributions.
    pub distribution: Distribution,
    /// Roughness along the surface's u and v directions, positive.
    pub alpha: [Input<f32>; 2],
    /// Whether sampling is from the visible normals; if not, it is from all normals of the distribution.
    pub sample_visible: bool,
}

impl Roughness {
    pub(super) fn read(source: &mut dyn Source) -> Result<Self> {
        let alpha = match (source.has("alpha"), source.has("alpha_u"), source.has("alpha_v")) {
            (_, false, false) => [alpha(source, "alpha")?; 2],
            (false, true, true) => [alpha(source, "alpha_u")?, alpha(source, "alpha_v")?],
            _ => return Err(source.object_error("expected either alpha or both alpha_u and alpha_v")),
        };
        let distribution = read_distribution(source)?;
        Ok(Roughness { distribution, alpha, sample_visible: source.boolean("sample_visible", true)? })
    }

    pub(super) fn textures(&self) -> impl Iterator<Item = TextureId> {
        self.alpha.iter().filter_map(Input::texture)
    }

    pub(super) fn is_anisotropic(&self) -> bool {
        self.alpha[0] != self.alpha[1]
    }

    pub(super) fn at(&self, inputs: &Inputs<'_>) -> Microfacets {
        let [alpha_x, alpha_y] = self.alpha.map(|alpha| inputs.number(&alpha).max(LEAST_ALPHA));
        Microfacets { distribution: self.distribution, alpha_x, alpha_y, sample_visible: self.sample_visible }
    }
}

fn alpha(source: &mut dyn Source, name: &'static str) -> Result<Input<f32>> {
    source.number(name, 0.1, 0.0..=f32::MAX)
}

/// Reads the roughness of a surface on which it is the same everywhere: at least 10⁻⁴. That of a texture is its mean.
pub(super) fn read_alpha(source: &mut dyn Source) -> Result<f32> {
    let alpha = match alpha(source, "alpha")? {
        Input::Constant(alpha) => alpha,
        Input::Texture(id) => {
            source.approximate("alpha: a texture is rendered as its mean");
            source.texture_mean(id)
        }
    };
    Ok(alpha.max(LEAST_ALPHA))
}

pub(super) fn read_distribution(source: &mut dyn Source) -> Result<Distribution> {
    // The roughness of the distributions of Phong and of Ashikhmin and Shirley in Mitsuba 0.6 is that of Beckmann's.
    const SIMILAR: [&str; 2] = ["phong", "as"];
    let name = source.text("distribution")?.unwrap_or_default().to_ascii_lowercase();
    if SIMILAR.contains(&name.as_str()) {
        source.approximate(&format!("the distribution {name} of microfacets is rendered as beckmann"));
        return Ok(Distribution::Beckmann);
    }
    let words = [("beckmann", Distribution::Beckmann), ("ggx", Distribution::Ggx)];
    source.choice("distribution", &words, Distribution::Beckmann)
}

/// A boundary between two dielectrics.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Interface {
    /// Index of refraction on the side that the normal points away from.
    pub int_ior: f32,
    /// Index of refraction on the side that the normal points to.
    pub ext_ior: f32,
    /// A factor on the reflection; 1 is physical.
    pub specular_reflectance: Input<Rgb>,
}

impl Interface {
    /// Reads a boundary. The default is `inside` against air.
    pub(super) fn read(source: &mut dyn Source, inside: &str) -> Result<Self> {
        Ok(Interface {
            int_ior: read_ior(source, "int_ior", inside)?,
            ext_ior: read_ior(source, "ext_ior", "air")?,
            specular_reflectance: source.reflectance("specular_reflectance", 1.0)?,
        })
    }

    /// Returns the inner index divided by the outer one.
    pub fn eta(&self) -> f32 {
        self.int_ior / self.ext_ior
    }
}

/// Reads an index of refraction: a number or the name of a dielectric.
pub(super) fn read_ior(source: &mut dyn Source, name: &'static str, default: &str) -> Result<f32> {
    match source.number_or_name(name)? {
        None => ior::dielectric(default)
            .ok_or_else(|| source.object_error(&format!("unknown dielectric {}", quoted(default)))),
        Some(NumberOrName::Number) => source.positive(name, 1.0),
        Some(NumberOrName::Name(text)) => ior::dielectric(&text).ok_or_else(|| {
            let near = did_you_mean(&text, ior::dielectric_names());
            source.refusal(name, &format!("expected a number or the name of a dielectric{near}"))
        }),
    }
}

/// Reads a factor on the transmission.
pub(super) fn read_transmittance(source: &mut dyn Source) -> Result<Input<Rgb>> {
    source.reflectance("specular_transmittance", 1.0)
}

/// A conductor's complex index of refraction relative to the outside, and a factor on its reflection.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Metal {
    /// Real part.
    pub eta: Input<Rgb>,
    /// Imaginary part (absorption), not negative.
    pub k: Input<Rgb>,
    /// A factor on the reflection; 1 is physical.
    pub specular_reflectance: Input<Rgb>,
}

impl Metal {
    /// Reads `material` by name, or `eta` and `k`.
    pub(super) fn read(source: &mut dyn Source) -> Result<Self> {
        let specular_reflectance = source.reflectance("specular_reflectance", 1.0)?;
        let name = source.text("material")?;
        let [eta, k] =
            [source.color("eta", Quantity::Index, 0.0)?, source.color("k", Quantity::Unbounded, 1.0)?];
        let given = ["eta", "k"].into_iter().find(|name| source.has(name));
        let [mut eta, mut k] = match (name, given) {
            (Some(_), Some(other)) => {
                return Err(source.error(other, "expected either material or eta and k, found both"));
            }
            (None, Some(_)) => [eta, k],
            (name, None) => {
                let name = name.as_deref().unwrap_or(DEFAULT_CONDUCTOR);
                let ComplexIor { eta, k } = conductors::conductor(name).ok_or_else(|| {
                    let near = did_you_mean(name, conductors::conductor_names());
                    source.refusal("material", &format!("expected the name of a conductor{near}"))
                })?;
                [eta.into(), k.into()]
            }
        };
        // In Mitsuba 0.6, the indices are those of the metal alone.
        if source.has("ext_eta") {
            let outside = read_ior(source, "ext_eta", "air")?;
            for input in [&mut eta, &mut k] {
                if let Input::Constant(value) = input {
                    *value *= 1.0 / outside;
                }
            }
        }
        Ok(Metal { eta, k, specular_reflectance })
    }

    pub(super) fn textures(&self) -> impl Iterator<Item = TextureId> {
        [self.eta, self.k, self.specular_reflectance].into_iter().filter_map(|input| input.texture())
    }

    pub(super) fn fresnel(&self, inputs: &Inputs<'_>) -> ConductorFresnel {
        ConductorFresnel { eta: inputs.color(&self.eta), k: inputs.color(&self.k) }
    }
}

/// The base under a dielectric coat.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Coated {
    /// Reflectance of the base.
    pub diffuse_reflectance: Input<Rgb>,
    /// Whether scattering between base and coat changes the colour.
    pub nonlinear: bool,
}

impl Coated {
    pub(super) fn read(source: &mut dyn Source) -> Result<Self> {
        Ok(Coated {
            diffuse_reflectance: source.reflectance("diffuse_reflectance", 0.5)?,
            nonlinear: source.boolean("nonlinear", false)?,
        })
    }
}

/// The reflectances of a diffuse part and a specular lobe.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct DiffuseAndSpecular {
    /// Reflectance of the diffuse part.
    pub diffuse_reflectance: Input<Rgb>,
    /// A factor on the lobe.
    pub specular_reflectance: Input<Rgb>,
}

impl DiffuseAndSpecular {
    pub(super) fn read(source: &mut dyn Source) -> Result<Self> {
        Ok(DiffuseAndSpecular {
            diffuse_reflectance: source.reflectance("diffuse_reflectance", 0.5)?,
            specular_reflectance: source.reflectance("specular_reflectance", 0.2)?,
        })
    }

    pub(super) fn textures(&self) -> impl Iterator<Item = TextureId> {
        [self.diffuse_reflectance, self.specular_reflectance].into_iter().filter_map(|input| input.texture())
    }

    /// Returns the BSDF with the given lobe. If the reflectances sum to more than 1 in any channel, both are reduced
    /// so that no light is created.
    pub(super) fn with<L>(&self, lobe: L, inputs: &Inputs<'_>) -> DiffuseAnd<L> {
        let [diffuse, specular] =
            [self.diffuse_reflectance, self.specular_reflectance].map(|input| inputs.color(&input));
        let scale = 1.0 / (diffuse + specular).max_component().max(1.0);
        DiffuseAnd { diffuse_reflectance: diffuse * scale, specular_reflectance: specular * scale, lobe }
    }
}
