//! Materials: what a surface is made of, as plain data.

pub use crate::bsdf::microfacet::Distribution;

use crate::color::Rgb;
use crate::ids::{MaterialId, TextureId};

/// A parameter that is the same everywhere, or read from a texture.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub enum Input<T> {
    /// The same everywhere.
    Constant(T),
    /// The texture's value at the point: its colour, or the luminance where a number is wanted.
    Texture(TextureId),
}

impl<T> From<T> for Input<T> {
    fn from(value: T) -> Self {
        Input::Constant(value)
    }
}

impl<T: Copy> Input<T> {
    /// The value, if it is the same everywhere.
    pub fn constant(&self) -> Option<T> {
        match self {
            Input::Constant(value) => Some(*value),
            Input::Texture(_) => None,
        }
    }

    /// The texture, if there is one.
    pub fn texture(&self) -> Option<TextureId> {
        match self {
            Input::Constant(_) => None,
            Input::Texture(id) => Some(*id),
        }
    }
}

/// The normals of microfacets: their distribution and roughness.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Roughness {
    /// The family.
    pub distribution: Distribution,
    /// Roughness along the surface's u and v directions, positive.
    pub alpha: [Input<f32>; 2],
    /// Whether to sample the visible normals (else all normals of the distribution).
    pub sample_visible: bool,
}

/// A boundary between two dielectrics.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Interface {
    /// Index of refraction on the side that the normal points away from.
    pub int_ior: f32,
    /// Index of refraction on the side that the normal points to.
    pub ext_ior: f32,
    /// A factor on the reflection, 1 in nature.
    pub specular_reflectance: Input<Rgb>,
}

impl Interface {
    /// The inner index over the outer one.
    pub fn eta(&self) -> f32 {
        self.int_ior / self.ext_ior
    }
}

/// A conductor's complex index of refraction relative to the outside, and a factor on its reflection.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Metal {
    /// Real part.
    pub eta: Input<Rgb>,
    /// Imaginary part (absorption), not negative.
    pub k: Input<Rgb>,
    /// A factor on the reflection, 1 in nature.
    pub specular_reflectance: Input<Rgb>,
}

/// A material, as a scene names it.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub enum Material {
    /// Ideal Lambertian reflection.
    Diffuse {
        /// Share of the light that is reflected, in [0, 1].
        reflectance: Input<Rgb>,
    },
    /// A smooth conductor.
    Conductor(Metal),
    /// A rough conductor of microfacets.
    RoughConductor(Metal, Roughness),
    /// A smooth boundary between two dielectrics, and a factor on the transmission.
    Dielectric(Interface, Input<Rgb>),
    /// A pane of a dielectric without thickness, and a factor on the transmission.
    ThinDielectric(Interface, Input<Rgb>),
    /// A boundary of microfacets between two dielectrics, and a factor on the transmission.
    RoughDielectric(Interface, Input<Rgb>, Roughness),
    /// A diffuse base under a smooth dielectric coat.
    Plastic(Interface, Coated),
    /// A diffuse base under a rough dielectric coat.
    RoughPlastic {
        /// The coat.
        interface: Interface,
        /// The base.
        base: Coated,
        /// Distribution of the coat's microfacet normals.
        distribution: Distribution,
        /// Roughness of the coat, positive.
        alpha: f32,
        /// As for [`Roughness`].
        sample_visible: bool,
    },
    /// The "principled" model. [Burley 2012, 2015]
    Principled(Box<Principled>),
    /// The "principled" model for sheets without thickness.
    PrincipledThin(Box<PrincipledThin>),
    /// A part of the surface is not there.
    Mask {
        /// The share that is there, in [0, 1].
        opacity: Input<f32>,
        /// What that is made of.
        inner: MaterialId,
    },
    /// Two materials in parts.
    Blend {
        /// The share of the second, in [0, 1].
        weight: Input<f32>,
        /// The two.
        inner: [MaterialId; 2],
    },
    /// A material whose normals are bent by a height field.
    BumpMap {
        /// The height.
        height: TextureId,
        /// Factor on the height.
        scale: f32,
        /// How the bent normals are used.
        bending: Bending,
        /// What bends.
        inner: MaterialId,
    },
    /// A material whose normals are given by a texture.
    NormalMap {
        /// The local normals n as colours (n + 1) / 2.
        normals: TextureId,
        /// How the bent normals are used.
        bending: Bending,
        /// What bends.
        inner: MaterialId,
    },
    /// One-sided materials on the front and on the back of the surface.
    TwoSided([MaterialId; 2]),
    /// Nothing: light passes.
    Null,
}

/// What lies under a dielectric coat.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Coated {
    /// Reflectance of the base.
    pub diffuse_reflectance: Input<Rgb>,
    /// Whether the colour changes as light is scattered between base and coat.
    pub nonlinear: bool,
}

/// How bent normals are used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Bending {
    /// Whether a normal that looks away from the viewer is mirrored to look at him. [Schüßler 2017]
    pub flip_invalid: bool,
    /// Whether the terminator is softened. [Estevez 2019]
    pub soften: bool,
}

/// Parameters of the principled model, each in [0, 1] but where it says otherwise.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Principled {
    /// Colour of the surface.
    pub base_color: Input<Rgb>,
    /// Square root of the microfacets' roughness.
    pub roughness: Input<f32>,
    /// How much the highlights are stretched.
    pub anisotropic: Input<f32>,
    /// How much it is a metal.
    pub metallic: Input<f32>,
    /// How much of the rest transmits light.
    pub spec_trans: Input<f32>,
    /// Index of refraction of the inside over the outside, greater than 0.
    pub eta: f32,
    /// How much the dielectric reflection takes the base colour.
    pub spec_tint: Input<f32>,
    /// Reflection at grazing angles, as of cloth.
    pub sheen: Input<f32>,
    /// How much the sheen takes the base colour.
    pub sheen_tint: Input<f32>,
    /// How much the diffuse reflection is as flat as of thin subsurface scattering.
    pub flatness: Input<f32>,
    /// Strength of a second, clear coat.
    pub clearcoat: Input<f32>,
    /// Gloss of the clear coat.
    pub clearcoat_gloss: Input<f32>,
}

/// Parameters of the principled model for thin sheets, each in [0, 1] but where it says otherwise.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct PrincipledThin {
    /// Colour of the surface.
    pub base_color: Input<Rgb>,
    /// Square root of the microfacets' roughness.
    pub roughness: Input<f32>,
    /// How much the highlights are stretched.
    pub anisotropic: Input<f32>,
    /// How much is transmitted specularly.
    pub spec_trans: Input<f32>,
    /// Index of refraction, greater than 0.
    pub eta: Input<f32>,
    /// How much the dielectric reflection takes the base colour.
    pub spec_tint: Input<f32>,
    /// Reflection at grazing angles.
    pub sheen: Input<f32>,
    /// How much the sheen takes the base colour.
    pub sheen_tint: Input<f32>,
    /// How flat the diffuse reflection is.
    pub flatness: Input<f32>,
    /// How much of the diffuse light is transmitted: 0 none, 1 half, 2 all.
    pub diff_trans: Input<f32>,
}

impl Material {
    /// The materials that it is made of.
    pub fn inner(&self) -> &[MaterialId] {
        match self {
            Material::Mask { inner, .. }
            | Material::BumpMap { inner, .. }
            | Material::NormalMap { inner, .. } => std::slice::from_ref(inner),
            Material::Blend { inner, .. } | Material::TwoSided(inner) => inner,
            _ => &[],
        }
    }

    /// The textures that it reads, by its own parameters.
    pub fn textures(&self) -> impl Iterator<Item = TextureId> {
        let mut found = Vec::new();
        let mut color = |input: &Input<Rgb>| found.extend(input.texture());
        match self {
            Material::Diffuse { reflectance } => color(reflectance),
            Material::Conductor(metal) => metal.colors().iter().for_each(color),
            Material::RoughConductor(metal, roughness) => {
                metal.colors().iter().for_each(color);
                found.extend(roughness.alpha.iter().filter_map(Input::texture));
            }
            Material::Dielectric(interface, transmittance)
            | Material::ThinDielectric(interface, transmittance) => {
                [interface.specular_reflectance, *transmittance].iter().for_each(color);
            }
            Material::RoughDielectric(interface, transmittance, roughness) => {
                [interface.specular_reflectance, *transmittance].iter().for_each(color);
                found.extend(roughness.alpha.iter().filter_map(Input::texture));
            }
            Material::Plastic(interface, base) | Material::RoughPlastic { interface, base, .. } => {
                [interface.specular_reflectance, base.diffuse_reflectance].iter().for_each(color);
            }
            Material::Principled(p) => {
                color(&p.base_color);
                let numbers = [
                    p.roughness,
                    p.anisotropic,
                    p.metallic,
                    p.spec_trans,
                    p.spec_tint,
                    p.sheen,
                    p.sheen_tint,
                    p.flatness,
                    p.clearcoat,
                    p.clearcoat_gloss,
                ];
                found.extend(numbers.iter().filter_map(Input::texture));
            }
            Material::PrincipledThin(p) => {
                color(&p.base_color);
                let numbers = [
                    p.roughness,
                    p.anisotropic,
                    p.spec_trans,
                    p.eta,
                    p.spec_tint,
                    p.sheen,
                    p.sheen_tint,
                    p.flatness,
                    p.diff_trans,
                ];
                found.extend(numbers.iter().filter_map(Input::texture));
            }
            Material::Mask { opacity: share, .. } | Material::Blend { weight: share, .. } => {
                found.extend(share.texture());
            }
            Material::BumpMap { height: texture, .. } | Material::NormalMap { normals: texture, .. } => {
                found.push(*texture);
            }
            Material::TwoSided(_) | Material::Null => {}
        }
        found.into_iter()
    }

    /// Whether light may pass through it, by itself (not by what it is made of).
    pub fn transmits(&self) -> bool {
        match self {
            Material::Dielectric(..)
            | Material::ThinDielectric(..)
            | Material::RoughDielectric(..)
            | Material::PrincipledThin(_)
            | Material::Mask { .. }
            | Material::Null => true,
            Material::Principled(p) => p.spec_trans != Input::Constant(0.0),
            _ => false,
        }
    }

    /// The name of its kind in the scene language.
    pub fn kind(&self) -> &'static str {
        match self {
            Material::Diffuse { .. } => "diffuse",
            Material::Conductor(_) => "conductor",
            Material::RoughConductor(..) => "roughconductor",
            Material::Dielectric(..) => "dielectric",
            Material::ThinDielectric(..) => "thindielectric",
            Material::RoughDielectric(..) => "roughdielectric",
            Material::Plastic(..) => "plastic",
            Material::RoughPlastic { .. } => "roughplastic",
            Material::Principled(_) => "principled",
            Material::PrincipledThin(_) => "principledthin",
            Material::Mask { .. } => "mask",
            Material::Blend { .. } => "blendbsdf",
            Material::BumpMap { .. } => "bumpmap",
            Material::NormalMap { .. } => "normalmap",
            Material::TwoSided(_) => "twosided",
            Material::Null => "null",
        }
    }
}

impl Metal {
    fn colors(&self) -> [Input<Rgb>; 3] {
        [self.eta, self.k, self.specular_reflectance]
    }
}
