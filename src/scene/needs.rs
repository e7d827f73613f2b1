//! The features that a scene uses. Unused features are not sampled, traced, allocated or built.

use std::fmt;

/// The features that a scene uses, determined during compilation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Needs {
    /// Some emitter can be sampled, so next-event estimation is useful.
    pub emitter_sampling: bool,
    /// Some emitter can be hit by a scattered ray.
    pub hit_emitters: bool,
    /// Some emitter cannot be hit, because it is a point or its light is parallel.
    pub delta_emitters: bool,
    /// Rays that leave the scene carry light.
    pub environment: bool,
    /// Some material has a finite lobe, for which emitters can be sampled.
    pub finite_lobes: bool,
    /// Some material has only Dirac deltas.
    pub specular_lobes: bool,
    /// The greatest number of Dirac deltas in a material. If it is above 0, caustics are possible.
    pub deltas: u32,
    /// Some material's sampling chooses among lobes.
    pub lobe_choice: bool,
    /// Some material may have a glossy lobe, for which emitters are chosen.
    pub gloss: bool,
    /// Some material depends on the tangents of the surface.
    pub tangents: bool,
    /// Some material varies over the surface: textures are read, or materials combined, at each point.
    pub varying_materials: bool,
    /// Something moves during the shutter interval, possibly only the camera.
    pub time: bool,
    /// Surfaces move during the shutter interval.
    pub motion: bool,
    /// Some surface has holes, so hits are filtered.
    pub holes: bool,
    /// Some shapes are instanced.
    pub instances: bool,
}

impl Needs {
    /// Returns the features with their names, in a fixed order.
    pub fn list(&self) -> [(&'static str, bool); 15] {
        [
            ("emitter_sampling", self.emitter_sampling),
            ("hit_emitters", self.hit_emitters),
            ("delta_emitters", self.delta_emitters),
            ("environment", self.environment),
            ("finite_lobes", self.finite_lobes),
            ("specular_lobes", self.specular_lobes),
            ("delta_lobes", self.deltas > 0),
            ("lobe_choice", self.lobe_choice),
            ("gloss", self.gloss),
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
    /// Writes the features in plain words.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let words = self.list().into_iter().zip(WORDS);
        let used: Vec<_> = words.filter_map(|((_, used), words)| used.then_some(words)).collect();
        f.write_str(&if used.is_empty() { "nothing".to_string() } else { used.join(", ") })
    }
}

/// The features in plain words, in the order of [`Needs::list`].
const WORDS: [&str; 15] = [
    "lights that are sampled",
    "lights that paths can hit",
    "lights at points or with parallel rays",
    "an environment",
    "diffuse or glossy surfaces",
    "surfaces that only mirror or refract",
    "mirrors or smooth glass",
    "materials of several parts",
    "glossy surfaces and several lights",
    "anisotropic or bumpy surfaces",
    "textures or blends",
    "a shutter",
    "moving surfaces",
    "holes",
    "instances",
];
