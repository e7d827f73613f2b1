//! The techniques that contribute: all of them, or a single one, to see which light it finds.

use crate::error::Result;
use crate::integrator::settings::{PathLimits, Source};

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
    /// If a parameter has another type, or there is no such technique for paths within the limits.
    pub fn read(source: &mut dyn Source, limits: PathLimits) -> Result<Self> {
        let weighted = source.boolean("weighted", true)?;
        let Some(text) = source.text("technique")? else {
            return match source.has("weighted") {
                true => Err(source.error("weighted", "needs a technique, such as 2,3")),
                false => Ok(Techniques::All),
            };
        };
        let numbers: Vec<u32> = text.split(',').map_while(|number| number.trim().parse().ok()).collect();
        let technique = match numbers[..] {
            [light, camera] if text.split(',').count() == 2 => Technique { light, camera },
            _ => {
                let expected =
                    "expected the numbers of vertices of the light path and of the camera path, such as 2,3";
                return Err(source.refusal("technique", expected));
            }
        };
        let edges = technique.light.saturating_add(technique.camera).saturating_sub(1);
        if technique.camera == 0 || edges == 0 || (edges == 1 && technique.light > 0) {
            let expected = "expected a camera path of at least one vertex, and an emitter that the camera sees (0,2) or \
                            a path with a surface in between";
            return Err(source.refusal("technique", expected));
        }
        if !limits.allows(edges) {
            let message = format!("its paths have {edges} edges, which is more than max_depth");
            return Err(source.error("technique", &message));
        }
        Ok(if weighted { Techniques::Weighted(technique) } else { Techniques::Alone(technique) })
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
