//! The techniques that contribute: all of them, or a single one, to see which light it finds.

use crate::error::Result;
use crate::integrator::settings::Source;

/// A technique: a path is joined from two subpaths. [Veach 1997, 10.2]
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Technique {
    /// The number of vertices of the light path, of which the first is on the emitter: Veach's s.
    pub light: u32,
    /// The number of vertices of the camera path, of which the first is on the lens: Veach's t.
    pub camera: u32,
}

/// The techniques that contribute.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub enum Techniques {
    /// All, with their weights.
    #[default]
    All,
    /// One, with its weight: its part of the image.
    Weighted(Technique),
    /// One, alone: an estimate of all light of paths that it can sample.
    Alone(Technique),
}

impl Techniques {
    /// Reads the parameters `technique` and `weighted`.
    ///
    /// # Errors
    /// If a parameter has another type, or there is no such technique.
    pub fn read(source: &mut dyn Source) -> Result<Self> {
        let weighted = source.boolean("weighted", true)?;
        let Some(text) = source.text("technique")? else { return Ok(Techniques::All) };
        let numbers = text.split_once(',').map(|(s, t)| (s.trim().parse(), t.trim().parse()));
        match numbers {
            Some((Ok(light), Ok(camera))) if camera > 0 && light + camera >= 2 => {
                let technique = Technique { light, camera };
                Ok(if weighted { Techniques::Weighted(technique) } else { Techniques::Alone(technique) })
            }
            _ => {
                let expected = "expected the numbers of vertices of the light path and of the camera path, such as \
                                2,3: the camera path has at least one, and both have at least two";
                Err(source.refusal("technique", expected))
            }
        }
    }

    /// Returns the weight of a contribution of the technique with `light` and `camera` vertices, whose weight among all
    /// techniques is `weight`.
    pub fn weight(self, light: u32, camera: u32, weight: f64) -> f64 {
        let technique = Technique { light, camera };
        match self {
            Techniques::All => weight,
            Techniques::Weighted(only) if only == technique => weight,
            Techniques::Alone(only) if only == technique => 1.0,
            Techniques::Weighted(_) | Techniques::Alone(_) => 0.0,
        }
    }
}

/// Returns all techniques that sample paths with the given number of edges, the one without light path first.
pub fn techniques_with_edges(edges: u32) -> impl Iterator<Item = Technique> {
    let lights = if edges == 1 { 0..1 } else { 0..edges + 1 };
    lights.map(move |light| Technique { light, camera: edges + 1 - light })
}
