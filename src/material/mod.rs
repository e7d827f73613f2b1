//! Materials: what a surface is made of, as plain data.

pub use crate::bsdf::microfacet::Distribution;

use crate::color::Rgb;
use crate::ids::MaterialId;

/// A material, as a scene names it.
#[derive(Clone, Debug, PartialEq)]
pub enum Material {
    /// Ideal Lambertian reflection.
    Diffuse {
        /// Share of the light that is reflected, in [0, 1].
        reflectance: Rgb,
    },
    /// A smooth conductor.
    Conductor {
        /// Real part of the index of refraction relative to the outside.
        eta: Rgb,
        /// Imaginary part (absorption), not negative.
        k: Rgb,
        /// A factor on the reflection, 1 in nature.
        specular_reflectance: Rgb,
    },
    /// A rough conductor of microfacets.
    RoughConductor {
        /// Distribution of the microfacet normals.
        distribution: Distribution,
        /// Roughness along the surface's u and v directions, positive.
        alpha: [f32; 2],
        /// Whether to sample the visible normals (else all normals of the distribution).
        sample_visible: bool,
        /// As for [`Conductor`](Self::Conductor).
        eta: Rgb,
        /// As for [`Conductor`](Self::Conductor).
        k: Rgb,
        /// As for [`Conductor`](Self::Conductor).
        specular_reflectance: Rgb,
    },
    /// A smooth boundary between two dielectrics.
    Dielectric {
        /// Index of refraction on the side that the normal points away from.
        int_ior: f32,
        /// Index of refraction on the side that the normal points to.
        ext_ior: f32,
        /// A factor on the reflection, 1 in nature.
        specular_reflectance: Rgb,
        /// A factor on the transmission, 1 in nature.
        specular_transmittance: Rgb,
    },
    /// The same one-sided material on both sides of the surface.
    TwoSided(MaterialId),
}
