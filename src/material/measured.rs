//! `measured`: reflection from the tables of a file.

use super::{Inputs, Plugin, Prepared, Source};
use crate::bsdf::{Bsdf, Measured as Tables};
use crate::error::Result;
use crate::ids::TextureId;
use std::sync::Arc;

/// Reflection from the tables of a file. [Dupuy and Jakob 2018]
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Measured {
    /// The tables.
    pub tables: Arc<Tables>,
}

impl Plugin for Measured {
    const NAME: &'static str = "measured";

    fn read(source: &mut dyn Source) -> Result<Self> {
        Ok(Measured { tables: source.measurement("filename")? })
    }

    fn textures(&self) -> Vec<TextureId> {
        Vec::new()
    }

    fn has_tangents(&self) -> bool {
        self.tables.is_anisotropic()
    }

    fn bsdf<'a>(&'a self, _: &'a Prepared, _: &Inputs<'_>) -> Bsdf<'a> {
        Bsdf::Measured(&self.tables)
    }
}
