//! Materials: what a surface is made of, one plugin of the scene language per file.
//!
//! A plugin's file has its parameters and their defaults ([`Plugin::read`]), the textures and materials that it
//! refers to, and the BSDF that it makes of them at a surface point. The table at the end of this file names the
//! plugins.

mod bending;
mod blend;
mod bump_map;
pub mod compiled;
mod conductor;
mod dielectric;
mod diffuse;
mod mask;
mod normal_map;
mod null;
mod parts;
mod plastic;
mod principled;
mod principled_thin;
mod rough_conductor;
mod rough_dielectric;
mod rough_plastic;
pub mod source;
mod thin_dielectric;
mod two_sided;

pub use crate::bsdf::microfacet::Distribution;
pub use bending::Bending;
pub use blend::Blend;
pub use bump_map::BumpMap;
pub use compiled::{Context, Inputs, MaterialPoint, Materials, Sampling, Scattering, SceneMaterial};
pub use conductor::Conductor;
pub use dielectric::Dielectric;
pub use diffuse::Diffuse;
pub use mask::Mask;
pub use normal_map::NormalMap;
pub use null::Null;
pub use parts::{Coated, Interface, Metal, Roughness};
pub use plastic::Plastic;
pub use principled::Principled;
pub use principled_thin::PrincipledThin;
pub use rough_conductor::RoughConductor;
pub use rough_dielectric::RoughDielectric;
pub use rough_plastic::RoughPlastic;
pub use source::Source;
pub use thin_dielectric::ThinDielectric;
pub use two_sided::TwoSided;

use crate::bsdf::{Bsdf, RoughTransmittance};
use crate::error::Result;
use crate::ids::{MaterialId, TextureId};
use crate::math::Vec2;
use crate::texture::TexturePoint;
use std::sync::Arc;

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

/// What a plugin computes once, when the scene is compiled.
#[derive(Clone, Debug, Default)]
pub struct Prepared {
    /// Share of diffuse light that a smooth coat reflects back inside.
    pub fdr_int: f32,
    /// What a rough coat lets pass.
    pub rough: Option<Arc<RoughTransmittance>>,
}

/// A material of the scene language. Plugins that scatter by themselves implement [`bsdf`](Self::bsdf); those that
/// are made of other materials implement [`inner`](Self::inner), [`sampling`](Self::sampling) and
/// [`scattering`](Self::scattering).
pub trait Plugin: Sized {
    /// Its name in the scene language.
    const NAME: &'static str;

    /// Reads its parameters.
    ///
    /// # Errors
    /// If a parameter has another type, is out of range or missing.
    fn read(source: &mut dyn Source) -> Result<Self>;

    /// Returns the textures that it reads, by its own parameters.
    fn textures(&self) -> Vec<TextureId> {
        Vec::new()
    }

    /// Returns the materials that it is made of.
    fn inner(&self) -> &[MaterialId] {
        &[]
    }

    /// Returns whether light may pass through it, by itself (not by what it is made of).
    fn transmits(&self) -> bool {
        false
    }

    /// Returns whether the tangents of the shading frame matter: for lobes that are stretched and normals that are
    /// bent.
    fn has_tangents(&self) -> bool {
        false
    }

    /// Returns whether light may pass as if there were no surface.
    fn has_holes(&self) -> bool {
        false
    }

    /// Computes what is the same at all points.
    fn prepare(&self) -> Prepared {
        Prepared::default()
    }

    /// Returns the share of the surface that is there.
    fn opacity(&self, _materials: &Materials, _point: &TexturePoint<'_>) -> f32 {
        1.0
    }

    /// Returns the lobes, which no texture changes, and whether sampling chooses among them.
    fn sampling(&self, prepared: &Prepared, materials: &Materials) -> Sampling {
        let point = TexturePoint::at(Vec2::ZERO);
        let bsdf = self.bsdf(prepared, &materials.inputs(&point));
        Sampling { lobes: bsdf.lobes(), chooses_lobe: bsdf.chooses_lobe() }
    }

    /// Returns the BSDF of a material that is not made of others.
    fn bsdf<'a>(&'a self, _prepared: &'a Prepared, _inputs: &Inputs<'_>) -> Bsdf<'a> {
        Bsdf::Null
    }

    /// Returns what scatters at a point. What it refers to lives in the arena.
    fn scattering<'a>(&'a self, prepared: &'a Prepared, context: &Context<'a>) -> Scattering<'a> {
        Scattering { bsdf: self.bsdf(prepared, &context.inputs()), opacity: 1.0 }
    }
}

/// Declares [`Material`] from the table of plugins.
macro_rules! plugins {
    ($($(#[$meta:meta])* $name:ident($plugin:ty),)*) => {
        /// A material, as a scene names it.
        #[derive(Clone, Debug, PartialEq, serde::Serialize)]
        pub enum Material {
            $($(#[$meta])* $name($plugin),)*
        }

        $(impl From<$plugin> for Material {
            fn from(plugin: $plugin) -> Self {
                Material::$name(plugin)
            }
        })*

        impl Material {
            /// The names of all plugins.
            pub const NAMES: &[&str] = &[$(<$plugin>::NAME),*];

            /// Reads the parameters of a plugin; `None` if there is none of the name.
            ///
            /// # Errors
            /// As for [`Plugin::read`].
            pub fn read(name: &str, source: &mut dyn Source) -> Result<Option<Self>> {
                Ok(match name {
                    $(<$plugin>::NAME => Some(Material::$name(<$plugin>::read(source)?)),)*
                    _ => None,
                })
            }

            /// The name of its kind in the scene language.
            pub fn kind(&self) -> &'static str {
                match self { $(Material::$name(_) => <$plugin>::NAME,)* }
            }

            /// As [`Plugin::textures`].
            pub fn textures(&self) -> Vec<TextureId> {
                match self { $(Material::$name(plugin) => plugin.textures(),)* }
            }

            /// As [`Plugin::inner`].
            pub fn inner(&self) -> &[MaterialId] {
                match self { $(Material::$name(plugin) => plugin.inner(),)* }
            }

            /// As [`Plugin::transmits`].
            pub fn transmits(&self) -> bool {
                match self { $(Material::$name(plugin) => plugin.transmits(),)* }
            }

            fn has_tangents(&self) -> bool {
                match self { $(Material::$name(plugin) => plugin.has_tangents(),)* }
            }

            fn has_holes(&self) -> bool {
                match self { $(Material::$name(plugin) => plugin.has_holes(),)* }
            }

            fn prepare(&self) -> Prepared {
                match self { $(Material::$name(plugin) => plugin.prepare(),)* }
            }

            fn opacity(&self, materials: &Materials, point: &TexturePoint<'_>) -> f32 {
                match self { $(Material::$name(plugin) => plugin.opacity(materials, point),)* }
            }

            fn sampling(&self, prepared: &Prepared, materials: &Materials) -> Sampling {
                match self { $(Material::$name(plugin) => plugin.sampling(prepared, materials),)* }
            }

            fn bsdf<'a>(&'a self, prepared: &'a Prepared, inputs: &Inputs<'_>) -> Bsdf<'a> {
                match self { $(Material::$name(plugin) => plugin.bsdf(prepared, inputs),)* }
            }

            fn scattering<'a>(&'a self, prepared: &'a Prepared, context: &Context<'a>) -> Scattering<'a> {
                match self { $(Material::$name(plugin) => plugin.scattering(prepared, context),)* }
            }
        }
    };
}

plugins! {
    /// Two materials in parts.
    Blend(Blend),
    /// Normals bent by a height field.
    BumpMap(BumpMap),
    /// A smooth conductor.
    Conductor(Conductor),
    /// A smooth boundary between two dielectrics.
    Dielectric(Dielectric),
    /// Ideal Lambertian reflection.
    Diffuse(Diffuse),
    /// A part of the surface is not there.
    Mask(Mask),
    /// Normals given by a texture.
    NormalMap(NormalMap),
    /// Nothing: light passes.
    Null(Null),
    /// A diffuse base under a smooth dielectric coat.
    Plastic(Plastic),
    /// The principled model.
    Principled(Box<Principled>),
    /// The principled model for sheets without thickness.
    PrincipledThin(Box<PrincipledThin>),
    /// A conductor of microfacets.
    RoughConductor(RoughConductor),
    /// A boundary of microfacets between two dielectrics.
    RoughDielectric(RoughDielectric),
    /// A diffuse base under a rough dielectric coat.
    RoughPlastic(RoughPlastic),
    /// A pane of a dielectric without thickness.
    ThinDielectric(ThinDielectric),
    /// One-sided materials on front and back.
    TwoSided(TwoSided),
}
