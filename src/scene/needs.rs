//! What a scene needs; what it does not need is not sampled, traced, allocated or built.

use std::fmt;

/// The features that a scene uses, found out when it is compiled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Needs {
    /// Some emitter can be sampled: next-event estimation is worth its rays.
    pub emitter_sampling: bool,
    /// Some emitter can be hit by a scattered ray.
    pub hit_emitters: bool,
    /// Rays that leave the scene bring light.
    pub environment: bool,
    /// Some material has a finite lobe that emitters can be sampled for.
    pub finite_lobes: bool,
    /// Some material scatters into Dirac deltas only.
    pub specular_lobes: bool,
    /// The most Dirac deltas that a material has among its lobes: above 0 there may be caustics.
    pub deltas: u32,
    /// Some material chooses among lobes.
    pub lobe_choice: bool,
    /// Some material depends on the tangents of the surface.
    pub tangents: bool,
    /// Some material is not the same everywhere: textures are read, or materials combined, at each point.
    pub varying_materials: bool,
    /// Something moves while the shutter is open, be it the camera alone.
    pub time: bool,
    /// Surfaces move while the shutter is open.
    pub motion: bool,
    /// Some surface has holes: hits are filtered.
    pub holes: bool,
    /// Some shapes stand in the world as instances.
    pub instances: bool,
}

impl Needs {
    /// The features with their names, in a fixed order.
    pub fn list(&self) -> [(&'static str, bool); 13] {
        [
            ("emitter_sampling", self.emitter_sampling),
            ("hit_emitters", self.hit_emitters),
            ("environment", self.environment),
            ("finite_lobes", self.finite_lobes),
            ("specular_lobes", self.specular_lobes),
            ("delta_lobes", self.deltas > 0),
            ("lobe_choice", self.lobe_choice),
            ("tangents", self.tangents),
            ("varying_materials", self.varying_materials),
            ("time", self.time),
            ("motion", self.motion),
            ("holes", self.holes),
            ("instances", self.instances),
        ]
    }
}

impl fmt::Display for Needs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let used: Vec<_> = self.list().into_iter().filter_map(|(name, used)| used.then_some(name)).collect();
        f.write_str(&if used.is_empty() { "nothing".to_string() } else { used.join(", ") })
    }
}
