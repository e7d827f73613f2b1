//! `thindielectric`: a thin pane of a dielectric.

use super::parts::read_transmittance;
use super::{Input, Inputs, Interface, Materials, Plugin, Prepared, Source};
use crate::bsdf::{self, Bsdf};
use crate::color::Rgb;
use crate::error::Result;
use crate::ids::TextureId;
use crate::texture::TexturePoint;

/// A thin pane of a dielectric.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct ThinDielectric {
    /// The boundary.
    pub interface: Interface,
    /// A factor on the transmission; 1 is physical.
    pub specular_transmittance: Input<Rgb>,
    /// Whether light passes it as through a hole, as much as is transmitted in the least channel. It is false in a
    /// description, because compilation decides.
    #[serde(skip)]
    pub passed: bool,
}

impl ThinDielectric {
    /// Returns the BSDF at a point.
    fn sheet(&self, inputs: &Inputs<'_>) -> bsdf::ThinDielectric {
        let specular_transmittance = inputs.color(&self.specular_transmittance);
        let [r, g, b] = specular_transmittance.to_array();
        bsdf::ThinDielectric {
            eta: self.interface.eta(),
            specular_reflectance: inputs.color(&self.interface.specular_reflectance),
            specular_transmittance,
            // Values outside of [0, 1], from a texture, are left to the BSDF.
            passing: if self.passed && r.max(g).max(b) <= 1.0 { r.min(g).min(b).max(0.0) } else { 0.0 },
        }
    }
}

impl Plugin for ThinDielectric {
    const NAME: &'static str = "thindielectric";

    fn read(source: &mut dyn Source) -> Result<Self> {
        let interface = Interface::read(source, "bk7")?;
        let specular_transmittance = read_transmittance(source)?;
        Ok(ThinDielectric { interface, specular_transmittance, passed: false })
    }

    fn textures(&self) -> Vec<TextureId> {
        let inputs = [self.interface.specular_reflectance, self.specular_transmittance];
        inputs.iter().filter_map(Input::texture).collect()
    }

    fn transmits(&self) -> bool {
        true
    }

    fn has_holes(&self) -> bool {
        self.passed
    }

    fn opacity(&self, all: &Materials, point: &TexturePoint<'_>, cosine: f32) -> f32 {
        self.sheet(&all.inputs(point)).opacity(cosine)
    }

    fn bsdf<'a>(&'a self, _: &'a Prepared, inputs: &Inputs<'_>) -> Bsdf<'a> {
        Bsdf::ThinDielectric(self.sheet(inputs))
    }
}
