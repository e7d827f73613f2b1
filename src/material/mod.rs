//! Materials: the surface properties of shapes, as plain data.

pub use crate::bsdf::microfacet::Distribution;

use crate::color::Rgb;
use crate::ids::{MaterialId, TextureId};

/// A parameter that is constant or read from a texture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Input<T> {
    /// The same value everywhere.
    Constant(T),
    /// The texture's value at the point: its colour, or its luminance for a scalar parameter.
    Texture(TextureId),
}

impl<T> From<T> for Input<T> {
    fn from(value: T) -> Self {
        Input::Constant(value)
    }
}

impl<T: Copy> Input<T> {
    /// Returns the value if it is constant.
    pub fn constant(&self) -> Option<T> {
        match self {
            Input::Constant(value) => Some(*value),
            Input::Texture(_) => None,
        }
    }

    /// Returns the texture if there is one.
    pub fn texture(&self) -> Option<TextureId> {
        match self {
            Input::Constant(_) => None,
            Input::Texture(id) => Some(*id),
        }
    }
}

/// A microfacet distribution and its roughness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Roughness {
    /// The family of distributions.
    pub distribution: Distribution,
    /// Roughness along the surface's u and v directions, positive.
    pub alpha: [Input<f32>; 2],
    /// Whether visible normals are sampled; otherwise all normals of the distribution.
    pub sample_visible: bool,
}

/// A boundary between two dielectrics.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interface {
    /// Index of refraction on the side opposite to the normal.
    pub int_ior: f32,
    /// Index of refraction on the side of the normal.
    pub ext_ior: f32,
    /// Factor on the reflection, physically 1.
    pub specular_reflectance: Input<Rgb>,
}

impl Interface {
    /// Returns the inner index divided by the outer one.
    pub fn eta(&self) -> f32 {
        self.int_ior / self.ext_ior
    }
}

/// A conductor's complex index of refraction relative to the outside, and a factor on its reflection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Metal {
    /// Real part.
    pub eta: Input<Rgb>,
    /// Imaginary part (absorption), not negative.
    pub k: Input<Rgb>,
    /// Factor on the reflection, physically 1.
    pub specular_reflectance: Input<Rgb>,
}

/// A material of a scene.
#[derive(Clone, Debug, PartialEq)]
pub enum Material {
    /// Ideal Lambertian reflection.
    Diffuse {
        /// Fraction of the light that is reflected, in [0, 1].
        reflectance: Input<Rgb>,
    },
    /// A smooth conductor.
    Conductor(Metal),
    /// A rough conductor with a microfacet distribution.
    RoughConductor(Metal, Roughness),
    /// A smooth boundary between two dielectrics, and a factor on the transmission.
    Dielectric(Interface, Input<Rgb>),
    /// An infinitely thin sheet of a dielectric, and a factor on the transmission.
    ThinDielectric(Interface, Input<Rgb>),
    /// A rough boundary between two dielectrics, and a factor on the transmission.
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
        /// As in [`Roughness`].
        sample_visible: bool,
    },
    /// The "principled" model. [Burley 2012, 2015]
    Principled(Box<Principled>),
    /// The "principled" model for infinitely thin sheets.
    PrincipledThin(Box<PrincipledThin>),
    /// A material with holes.
    Mask {
        /// The fraction of the surface that exists, in [0, 1].
        opacity: Input<f32>,
        /// The material of that fraction.
        inner: MaterialId,
    },
    /// A linear combination of two materials.
    Blend {
        /// The weight of the second material, in [0, 1].
        weight: Input<f32>,
        /// The two materials.
        inner: [MaterialId; 2],
    },
    /// A material with normals perturbed by a height field.
    BumpMap {
        /// The height.
        height: TextureId,
        /// Factor on the height.
        scale: f32,
        /// The treatment of perturbed normals.
        bending: Bending,
        /// The perturbed material.
        inner: MaterialId,
    },
    /// A material with normals from a texture.
    NormalMap {
        /// The local normals n as colours (n + 1) / 2.
        normals: TextureId,
        /// The treatment of perturbed normals.
        bending: Bending,
        /// The perturbed material.
        inner: MaterialId,
    },
    /// One-sided materials on the front and on the back of the surface.
    TwoSided([MaterialId; 2]),
    /// No surface: light passes unchanged.
    Null,
}

/// The diffuse base under a dielectric coat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coated {
    /// Reflectance of the base.
    pub diffuse_reflectance: Input<Rgb>,
    /// Whether the colour shifts due to multiple scattering between base and coat.
    pub nonlinear: bool,
}

/// The treatment of perturbed normals.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bending {
    /// Whether a normal that faces away from the viewer is mirrored to face the viewer. [Schüßler 2017]
    pub flip_invalid: bool,
    /// Whether the shadow terminator is softened. [Estevez 2019]
    pub soften: bool,
}

/// Parameters of the principled model, in [0, 1] unless stated otherwise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Principled {
    /// Colour of the surface.
    pub base_color: Input<Rgb>,
    /// Square root of the microfacets' roughness.
    pub roughness: Input<f32>,
    /// Anisotropy of the highlights.
    pub anisotropic: Input<f32>,
    /// Weight of the metal lobe.
    pub metallic: Input<f32>,
    /// Weight of specular transmission in the rest.
    pub spec_trans: Input<f32>,
    /// Index of refraction of the inside relative to the outside, greater than 0.
    pub eta: f32,
    /// Weight of the base colour in the dielectric reflection.
    pub spec_tint: Input<f32>,
    /// Additional reflection at grazing angles, as of cloth.
    pub sheen: Input<f32>,
    /// Weight of the base colour in the sheen.
    pub sheen_tint: Input<f32>,
    /// Weight of the approximation of thin subsurface scattering in the diffuse reflection.
    pub flatness: Input<f32>,
    /// Weight of a second, clear coat.
    pub clearcoat: Input<f32>,
    /// Gloss of the clear coat.
    pub clearcoat_gloss: Input<f32>,
}

/// Parameters of the principled model for thin sheets, in [0, 1] unless stated otherwise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrincipledThin {
    /// Colour of the surface.
    pub base_color: Input<Rgb>,
    /// Square root of the microfacets' roughness.
    pub roughness: Input<f32>,
    /// Anisotropy of the highlights.
    pub anisotropic: Input<f32>,
    /// Weight of specular transmission.
    pub spec_trans: Input<f32>,
    /// Index of refraction, greater than 0.
    pub eta: Input<f32>,
    /// Weight of the base colour in the dielectric reflection.
    pub spec_tint: Input<f32>,
    /// Additional reflection at grazing angles.
    pub sheen: Input<f32>,
    /// Weight of the base colour in the sheen.
    pub sheen_tint: Input<f32>,
    /// Weight of the approximation of thin subsurface scattering in the diffuse reflection.
    pub flatness: Input<f32>,
    /// Diffuse transmission: 0 none, 1 half, 2 all of the diffuse light.
    pub diff_trans: Input<f32>,
}

impl Material {
    /// Returns the nested materials.
    pub fn inner(&self) -> &[MaterialId] {
        match self {
            Material::Mask { inner, .. }
            | Material::BumpMap { inner, .. }
            | Material::NormalMap { inner, .. } => std::slice::from_ref(inner),
            Material::Blend { inner, .. } | Material::TwoSided(inner) => inner,
            _ => &[],
        }
    }

    /// Returns the textures used by the material's own parameters.
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

    /// Returns whether the material itself transmits light, without regard to nested materials.
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

    /// Returns the name of the material's type in the scene language.
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
