//! What a ray of each candidate costs as a whole. Costs are constants or come from a file, never from the clock during
//! a render, so the choice of an integrator is the same in every run.

use crate::error::{Error, Result};
use crate::util::wording::did_you_mean;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// The table for scenes without media that are rendered, relative to `path`: means over the scenes of decision 0087.
const SURFACES: [(&str, f64); 6] =
    [("path", 1.0), ("bdpt", 1.9), ("sppm", 2.1), ("vcm", 2.55), ("irrcache", 2.1), ("photonmapper", 2.5)];
/// The table for scenes with media, relative to `volpath`: means over the scenes of decision 0096.
const MEDIA: [(&str, f64); 2] = [("volpath", 1.0), ("bdpt", 1.5)];

/// The integrators whose cost is 1, each in its table.
const UNITS: [&str; 2] = ["path", "volpath"];

/// What everything costs for each unit of the cost of the rays, by the names of integrators.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Costs {
    /// In scenes without media that are rendered, relative to `path`.
    #[serde(default)]
    pub surfaces: BTreeMap<String, f64>,
    /// In scenes with media, relative to `volpath`.
    #[serde(default)]
    pub media: BTreeMap<String, f64>,
}

impl Default for Costs {
    fn default() -> Self {
        let table =
            |entries: &[(&str, f64)]| entries.iter().map(|(name, cost)| ((*name).into(), *cost)).collect();
        Costs { surfaces: table(&SURFACES), media: table(&MEDIA) }
    }
}

impl Costs {
    /// Reads the tables of a file. An integrator that it does not name keeps its default.
    ///
    /// # Errors
    /// If the file cannot be read, or names an unknown integrator or a cost that is not positive and finite.
    pub fn read(path: &Path) -> Result<Self> {
        let refuse = |why: String| Error::usage(why).in_file(path);
        let text = std::fs::read(path).map_err(|e| refuse(format!("cannot be read: {e}")))?;
        let read: Costs =
            serde_json::from_slice(&text).map_err(|e| refuse(format!("is no table of costs: {e}")))?;
        let mut costs = Costs::default();
        for (table, entries) in [(&mut costs.surfaces, read.surfaces), (&mut costs.media, read.media)] {
            for (name, cost) in entries {
                let Some(own) = table.get_mut(&name) else {
                    let near = did_you_mean(&name, table.keys().map(String::as_str));
                    return Err(refuse(format!("has a cost of \"{name}\", which is never chosen{near}")));
                };
                if !(cost > 0.0 && cost.is_finite()) {
                    return Err(refuse(format!("has the cost {cost} of {name}, expected a positive number")));
                }
                if UNITS.contains(&name.as_str()) && cost != 1.0 {
                    return Err(refuse(format!(
                        "has the cost {cost} of {name}, which is the unit: expected 1"
                    )));
                }
                *own = cost;
            }
        }
        Ok(costs)
    }

    /// Returns the text of a file that [`read`](Self::read) reads.
    pub fn to_json(&self) -> String {
        let text = serde_json::to_string_pretty(self).expect("a table is no cycle");
        format!("{text}\n")
    }

    /// Returns the cost of a candidate.
    pub fn of(&self, name: &str, in_media: bool) -> f64 {
        let table = if in_media { &self.media } else { &self.surfaces };
        table.get(name).copied().unwrap_or(1.0)
    }
}
