//! `twosided`: one-sided materials on the front and on the back of the surface.

use super::coating::transmits;
use super::{Context, Material, Materials, Plugin, Prepared, Sampling, Scattering, Source};
use crate::error::Result;
use crate::ids::MaterialId;

/// One-sided materials on the front and on the back of the surface.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct TwoSided {
    /// The materials of the front and of the back.
    pub sides: [MaterialId; 2],
}

impl TwoSided {
    /// Returns a two-sided material with the same material on both sides.
    pub fn same(side: MaterialId) -> Self {
        TwoSided { sides: [side; 2] }
    }
}

impl Plugin for TwoSided {
    const NAME: &'static str = "twosided";

    /// Reads one material for both sides or one for each.
    fn read(source: &mut dyn Source) -> Result<Self> {
        let inner = source.inner(1, 2)?;
        let sides = [inner[0], inner[inner.len() - 1]].map(|side| match &source.materials()[side.index()] {
            Material::TwoSided(inner) => inner.sides[0],
            _ => side,
        });
        if sides.iter().any(|side| transmits(source.materials(), *side)) {
            return Err(source.object_error("a material that transmits light cannot be made two-sided"));
        }
        Ok(TwoSided { sides })
    }

    fn inner(&self) -> &[MaterialId] {
        &self.sides
    }

    fn sampling(&self, _: &Prepared, all: &Materials) -> Sampling {
        let [front, back] = self.sides.map(|side| all.sampling(side));
        Sampling { lobes: front.lobes.or(back.lobes), chooses_lobe: front.chooses_lobe || back.chooses_lobe }
    }

    fn scattering<'a>(&'a self, _: &'a Prepared, context: &Context<'a>) -> Scattering<'a> {
        context.both_sides(|side, context| context.scattering(self.sides[side]).bsdf)
    }
}
