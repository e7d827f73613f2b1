//! Materials: the scattering of surfaces, with one file per plugin of the scene language.
//!
//! The file of a plugin has its parameters with their defaults ([`Plugin::read`]), the textures and materials that it
//! refers to, and the BSDF that it makes of them at a surface point. The table at the end of this file lists the
//! plugins.

mod bending;
mod blend;
mod bump_map;
mod coating;
pub mod compiled;
mod conductor;
mod dielectric;
mod diffuse;
mod diffuse_transmitter;
mod hair;
mod mask;
mod measured;
mod mixture;
mod normal_map;
mod null;
mod parts;
mod phong;
mod plastic;
mod polarized_plastic;
mod principled;
mod principled_thin;
mod rough_coating;
mod rough_conductor;
mod rough_dielectric;
mod rough_diffuse;
mod rough_plastic;
pub mod source;
mod thin_dielectric;
mod two_sided;
mod ward;

pub use crate::bsdf::microfacet::Distribution;
pub use bending::Bending;
pub use blend::Blend;
pub use bump_map::BumpMap;
pub use coating::Coating;
pub use compiled::{Context, Inputs, MaterialPoint, Materials, Sampling, Scattering, SceneMaterial};
pub use conductor::Conductor;
pub use dielectric::Dielectric;
pub use diffuse::Diffuse;
pub use diffuse_transmitter::DiffuseTransmitter;
pub use hair::Hair;
pub use mask::Mask;
pub use measured::Measured;
pub use mixture::Mixture;
pub use normal_map::NormalMap;
pub use null::Null;
pub use parts::{Coated, DiffuseAndSpecular, Interface, Metal, Roughness};
pub use phong::Phong;
pub use plastic::Plastic;
pub use polarized_plastic::PolarizedPlastic;
pub use principled::Principled;
pub use principled_thin::PrincipledThin;
pub use rough_coating::RoughCoating;
pub use rough_conductor::RoughConductor;
pub use rough_dielectric::RoughDielectric;
pub use rough_diffuse::RoughDiffuse;
pub use rough_plastic::RoughPlastic;
pub use source::Source;
pub use thin_dielectric::ThinDielectric;
pub use two_sided::TwoSided;
pub use ward::Ward;

use crate::bsdf::{Bsdf, RoughTransmittance};
use crate::error::Result;
use crate::ids::{MaterialId, TextureId};
use crate::math::Vec2;
use crate::texture::TexturePoint;
use std::sync::Arc;

/// A parameter: a constant or a texture.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub enum Input<T> {
    /// A constant.
    Constant(T),
    /// The value of a texture at the point: its colour, or its luminance if the parameter is a number.
    Texture(TextureId),
}

impl<T> From<T> for Input<T> {
    fn from(value: T) -> Self {
        Input::Constant(value)
    }
}

impl<T: Copy> Input<T> {
    /// Returns the value, if it is constant.
    pub fn constant(&self) -> Option<T> {
        match self {
            Input::Constant(value) => Some(*value),
            Input::Texture(_) => None,
        }
    }

    /// Returns the texture, if there is one.
    pub fn texture(&self) -> Option<TextureId> {
        match self {
            Input::Constant(_) => None,
            Input::Texture(id) => Some(*id),
        }
    }
}

/// Values that a plugin computes once, when the scene is compiled.
#[derive(Clone, Debug, Default)]
pub struct Prepared {
    /// Fraction of diffuse light that a smooth coat reflects back inside.
    pub fdr_int: f32,
    /// Transmittance of a rough coat.
    pub rough: Option<Arc<RoughTransmittance>>,
}

/// A material of the scene language. A plugin with a BSDF of its own implements [`bsdf`](Self::bsdf). A plugin made of
/// other materials implements [`inner`](Self::inner), [`sampling`](Self::sampling) and
/// [`scattering`](Self::scattering).
pub trait Plugin: Sized {
    /// The name in the scene language.
    const NAME: &'static str;

    /// Reads the parameters.
    ///
    /// # Errors
    /// If a parameter has another type, is out of range or missing.
    fn read(source: &mut dyn Source) -> Result<Self>;

    /// Returns the textures of its own parameters.
    fn textures(&self) -> Vec<TextureId> {
        Vec::new()
    }

    /// Returns the materials that it is made of.
    fn inner(&self) -> &[MaterialId] {
        &[]
    }

    /// Returns whether light may pass through it, without regard to its inner materials.
    fn transmits(&self) -> bool {
        false
    }

    /// Returns whether the tangents of the shading frame matter, as for anisotropic lobes and perturbed normals.
    fn has_tangents(&self) -> bool {
        false
    }

    /// Returns whether light may pass through the surface without scattering.
    fn has_holes(&self) -> bool {
        false
    }

    /// Computes the values that are the same at all points.
    fn prepare(&self) -> Prepared {
        Prepared::default()
    }

    /// Returns the opacity of the surface at a point, for a ray that makes an angle with the given cosine, in [0, 1],
    /// with the shading normal.
    fn opacity(&self, _materials: &Materials, _point: &TexturePoint<'_>, _cosine: f32) -> f32 {
        1.0
    }

    /// Returns the lobes, which do not depend on textures, and whether sampling chooses among them.
    fn sampling(&self, prepared: &Prepared, materials: &Materials) -> Sampling {
        let point = TexturePoint::at(Vec2::ZERO);
        let bsdf = self.bsdf(prepared, &materials.inputs(&point));
        Sampling { lobes: bsdf.lobes(), chooses_lobe: bsdf.chooses_lobe() }
    }

    /// Returns the BSDF of a material without inner materials.
    fn bsdf<'a>(&'a self, _prepared: &'a Prepared, _inputs: &Inputs<'_>) -> Bsdf<'a> {
        Bsdf::Null
    }

    /// Returns the BSDF and opacity at a point. The arena holds inner BSDFs.
    fn scattering<'a>(&'a self, prepared: &'a Prepared, context: &Context<'a>) -> Scattering<'a> {
        Scattering { bsdf: self.bsdf(prepared, &context.inputs()), opacity: 1.0 }
    }
}

/// Declares [`Material`] from the table of plugins.
macro_rules! plugins {
    ($($(#[$meta:meta])* $name:ident($plugin:ty),)*) => {
        /// A material of the description.
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

            /// Reads the parameters of a plugin. Returns `None` if no plugin has the name.
            ///
            /// # Errors
            /// The errors of [`Plugin::read`].
            pub fn read(name: &str, source: &mut dyn Source) -> Result<Option<Self>> {
                Ok(match name {
                    $(<$plugin>::NAME => Some(Material::$name(<$plugin>::read(source)?)),)*
                    _ => None,
                })
            }

            /// Returns the name of the plugin in the scene language.
            pub fn kind(&self) -> &'static str {
                match self { $(Material::$name(_) => <$plugin>::NAME,)* }
            }

            /// Calls [`Plugin::textures`].
            pub fn textures(&self) -> Vec<TextureId> {
                match self { $(Material::$name(plugin) => plugin.textures(),)* }
            }

            /// Calls [`Plugin::inner`].
            pub fn inner(&self) -> &[MaterialId] {
                match self { $(Material::$name(plugin) => plugin.inner(),)* }
            }

            /// Calls [`Plugin::transmits`].
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

            fn opacity(&self, materials: &Materials, point: &TexturePoint<'_>, cosine: f32) -> f32 {
                match self { $(Material::$name(plugin) => plugin.opacity(materials, point, cosine),)* }
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

// New plugins go to the end: the hash of a scene contains the index of a plugin in this table.
plugins! {
    /// A weighted sum of two materials.
    Blend(Blend),
    /// Normals perturbed by a height field.
    BumpMap(BumpMap),
    /// A smooth conductor.
    Conductor(Conductor),
    /// A smooth boundary between two dielectrics.
    Dielectric(Dielectric),
    /// Ideal Lambertian reflection.
    Diffuse(Diffuse),
    /// A material with an opacity.
    Mask(Mask),
    /// Normals from a texture.
    NormalMap(NormalMap),
    /// No surface: light passes.
    Null(Null),
    /// A diffuse base under a smooth dielectric coat.
    Plastic(Plastic),
    /// The principled model.
    Principled(Box<Principled>),
    /// The principled model for thin surfaces.
    PrincipledThin(Box<PrincipledThin>),
    /// A conductor with microfacets.
    RoughConductor(RoughConductor),
    /// A boundary with microfacets between two dielectrics.
    RoughDielectric(RoughDielectric),
    /// A diffuse base under a rough dielectric coat.
    RoughPlastic(RoughPlastic),
    /// A thin pane of a dielectric.
    ThinDielectric(ThinDielectric),
    /// One-sided materials on the front and on the back.
    TwoSided(TwoSided),
    /// Ideal diffuse transmission.
    DiffuseTransmitter(DiffuseTransmitter),
    /// A weighted sum of materials.
    Mixture(Mixture),
    /// Diffuse reflection plus a Phong lobe.
    Phong(Phong),
    /// Diffuse reflection by a rough surface.
    RoughDiffuse(RoughDiffuse),
    /// Diffuse reflection plus the lobe of Ward.
    Ward(Ward),
    /// A material under a smooth dielectric coating.
    Coating(Coating),
    /// A fibre with an absorbing interior.
    Hair(Hair),
    /// Diffuse reflection below a boundary that also reflects.
    PolarizedPlastic(PolarizedPlastic),
    /// Reflection from the tables of a file.
    Measured(Measured),
    /// A material under a rough dielectric coating.
    RoughCoating(RoughCoating),
}
