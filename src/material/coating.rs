//! `coating`: a material under a smooth dielectric coating.

use super::{Context, Input, Interface, Material, Materials, Plugin, Prepared, Sampling, Scattering, Source};
use crate::bsdf::{self, Bsdf, Lobes, RoughBoundary};
use crate::color::Rgb;
use crate::color::spectrum::Quantity;
use crate::error::Result;
use crate::ids::{MaterialId, TextureId};

/// A material under a smooth dielectric coating.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Coating {
    /// The boundary.
    pub interface: Interface,
    /// The thickness of the coating, in the inverse unit of `sigma_a`.
    pub thickness: f32,
    /// The absorption coefficient of the coating.
    pub sigma_a: Input<Rgb>,
    /// The material below.
    pub inner: MaterialId,
}

impl Coating {
    /// Returns the BSDF at a point, with the facets of the boundary if it is rough.
    pub(super) fn coated<'a>(
        &'a self,
        rough: Option<RoughBoundary<'a>>,
        context: &Context<'a>,
    ) -> Scattering<'a> {
        let inputs = context.inputs();
        let coating = bsdf::Coating {
            eta: self.interface.eta(),
            depth: inputs.color(&self.sigma_a) * self.thickness,
            specular_reflectance: inputs.color(&self.interface.specular_reflectance),
            rough,
            inner: context.arena.alloc(context.inner(self.inner).bsdf),
        };
        Scattering { bsdf: Bsdf::Coating(coating), opacity: 1.0 }
    }
}

impl Plugin for Coating {
    const NAME: &'static str = "coating";

    fn read(source: &mut dyn Source) -> Result<Self> {
        let inner = source.only_inner()?;
        if transmits(source.materials(), inner) {
            return Err(source.object_error("a material that transmits light cannot be coated"));
        }
        Ok(Coating {
            interface: Interface::read(source, "bk7")?,
            thickness: read_thickness(source)?,
            sigma_a: source.color("sigma_a", Quantity::Unbounded, 0.0)?,
            inner,
        })
    }

    fn textures(&self) -> Vec<TextureId> {
        let inputs = [self.interface.specular_reflectance, self.sigma_a];
        inputs.iter().filter_map(Input::texture).collect()
    }

    fn inner(&self) -> &[MaterialId] {
        std::slice::from_ref(&self.inner)
    }

    fn sampling(&self, _: &Prepared, all: &Materials) -> Sampling {
        let lobes = all.sampling(self.inner).lobes.and(Lobes::deltas(1));
        Sampling { lobes, chooses_lobe: true }
    }

    fn scattering<'a>(&'a self, _: &'a Prepared, context: &Context<'a>) -> Scattering<'a> {
        self.coated(None, context)
    }
}

fn read_thickness(source: &mut dyn Source) -> Result<f32> {
    let thickness = source.float("thickness")?.unwrap_or(1.0) as f32;
    match (0.0..f32::INFINITY).contains(&thickness) {
        true => Ok(thickness),
        false => Err(source.refusal("thickness", "expected a number of at least 0")),
    }
}

/// Returns whether light may pass through a material.
pub(super) fn transmits(materials: &[Material], id: MaterialId) -> bool {
    let material = &materials[id.index()];
    material.transmits() || material.inner().iter().any(|inner| transmits(materials, *inner))
}
