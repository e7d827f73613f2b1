//! Converts objects to the scene's plain data, in one file for each family of plugins.

mod bsdfs;
mod colours;
mod daylight;
mod emitters;
mod films;
mod integrators;
mod media;
#[cfg(test)]
mod reference;
mod samplers;
mod sensors;
mod shapes;
mod source;
mod textures;

use super::graph::{Graph, Object, ObjectId};
use super::props::Props;
use super::resolve::Resolved;
use crate::emitter::Emitter;
use crate::error::{Error, Kind, Result};
use crate::ids::{MaterialId, MediumId, TextureId};
use crate::image::TextureImage;
use crate::loader::files::Folders;
use crate::loader::{LoadOptions, Loaded, NO_MEDIA, Tolerance, framing, judge_of_media, tolerated};
use crate::memory::Budget;
use crate::sensor::SensorSettings;
use crate::util::wording;
use source::ObjectSource;
use std::collections::{HashMap, HashSet};
use std::path::PathBuf;
use std::sync::Arc;

/// Converts a resolved scene file to a scene.
///
/// # Errors
/// If a plugin is unknown, a value is out of range, a feature is not supported, the scene does not fit into memory, or
/// files are missing (all of them in one error).
pub fn instantiate(resolved: Resolved, options: &LoadOptions, memory: &Budget) -> Result<Loaded> {
    let Resolved { graph, folders, warnings, notes, tolerated } = resolved;
    let loaded = Loaded { warnings, notes, tolerated, ..Loaded::default() };
    let mut builder = Builder {
        graph: &graph,
        folders: &folders,
        memory,
        tolerance: options.tolerance,
        replaces_sampler: options.replaces_sampler,
        sensor: options.sensor,
        loaded,
        materials: HashMap::new(),
        media: HashMap::new(),
        renders_media: false,
        textures: HashMap::new(),
        images: HashMap::new(),
        groups: HashMap::new(),
        meters: Vec::new(),
        finished: HashSet::new(),
        default_materials: [None; 2],
        missing: Vec::new(),
    };
    builder.scene(options.integrator.as_deref())?;
    if options.tolerance == Tolerance::Everything {
        builder.loaded.tolerated.append(&mut builder.missing);
    }
    if !builder.missing.is_empty() {
        let first = builder.missing.remove(0);
        return Err(first.with_others(builder.missing));
    }
    Ok(Loaded { files: folders.found(), ..builder.loaded })
}

/// A scene under construction.
struct Builder<'g> {
    graph: &'g Graph,
    folders: &'g Folders,
    memory: &'g Budget,
    tolerance: Tolerance,
    replaces_sampler: bool,
    /// The only sensor that is used, if it is known.
    sensor: Option<usize>,
    loaded: Loaded,
    materials: HashMap<ObjectId, MaterialId>,
    media: HashMap<ObjectId, MediumId>,
    /// Whether the integrator of the scene, or the one in its place, renders media.
    renders_media: bool,
    textures: HashMap<ObjectId, TextureId>,
    /// The images of each file, with and without decoding of its values (`raw`).
    images: HashMap<(PathBuf, bool), Arc<TextureImage>>,
    groups: HashMap<ObjectId, usize>,
    /// The sensors inside the shapes of the current list, with the index of the shape in it.
    meters: Vec<(ObjectId, usize)>,
    finished: HashSet<ObjectId>,
    /// The materials of shapes that name none: of those that do not emit, and of those that do.
    default_materials: [Option<MaterialId>; 2],
    missing: Vec<Error>,
}

impl<'g> Builder<'g> {
    /// Instantiates the contents of the scene itself, each object once.
    fn scene(&mut self, replacement: Option<&str>) -> Result<()> {
        let graph = self.graph;
        let props = Props::new(graph, 0);
        if let Some(integrator) = props.child("integrator")? {
            self.loaded.integrator = self.scene_integrator(integrator, replacement)?;
        } else if replacement.is_none() {
            self.note("the scene names no integrator: path is used");
        }
        let judge = judge_of_media(&self.loaded.integrator, replacement);
        self.renders_media = judge.renders_media();
        if judge.ignores_media() && self.has_media() {
            self.note(NO_MEDIA);
        }
        for (i, sensor) in self.once(&props, "sensor").into_iter().enumerate() {
            let added = match self.sensor(sensor, None) {
                Err(error) if self.sensor.is_some_and(|used| used != i) => {
                    self.note(format!("sensor {i} is not used: {}", error.message));
                    self.loaded.description.sensors.push(SensorSettings::default());
                    continue;
                }
                added => added,
            };
            self.or_stand_in(added, "left out", |_| ())?;
        }
        for bsdf in self.once(&props, "bsdf") {
            self.material(bsdf)?;
        }
        for emitter in self.once(&props, "emitter") {
            let added = self.emitter(emitter);
            self.or_stand_in(added, "left out", |_| ())?;
        }
        for shape in self.once(&props, "shape") {
            let added = self.shape(shape);
            self.or_stand_in(added, "left out", |_| ())?;
        }
        for texture in self.once(&props, "texture") {
            self.texture(texture)?;
        }
        for medium in self.once(&props, "medium") {
            self.medium(medium)?;
        }
        for class in ["volume", "phase"] {
            props.children(class);
        }
        self.finish(props);
        let sensors = self.loaded.description.sensors.len();
        if sensors > 1 {
            self.note(format!("the scene has {sensors} sensors: --sensor chooses, the first is number 0"));
        }
        if self.loaded.description.sensors.is_empty() {
            match framing::camera_for(&self.loaded.description) {
                Some(sensor) => {
                    self.note(format!("the scene has no sensor: everything is {}", framing::VIEW));
                    self.loaded.description.sensors.push(sensor);
                }
                None => self.loaded.warnings.push(graph.objects[0].error("the scene has no sensor")),
            }
        }
        Ok(())
    }

    /// Returns the result, or a stand-in if its error is tolerated. Such an error is recorded with its consequence.
    fn or_stand_in<T>(
        &mut self,
        result: Result<T>,
        consequence: &str,
        stand_in: impl FnOnce(&mut Self) -> T,
    ) -> Result<T> {
        match result {
            Err(error) if self.tolerance.covers(&error) => {
                self.loaded.tolerated.push(tolerated(error, consequence));
                Ok(stand_in(self))
            }
            other => other,
        }
    }

    /// Returns the objects of a class in the scene, without duplicates.
    fn once(&self, props: &Props, class: &str) -> Vec<ObjectId> {
        let all = props.children(class).into_iter().map(|child| child.object);
        let mut seen = HashSet::new();
        all.filter(|object| seen.insert(*object)).collect()
    }

    /// Collects the warnings about the unused properties of an object, once for an object that is used twice.
    fn finish(&mut self, props: Props) {
        if props.object.old {
            self.ignore(&props, &WITHOUT_EFFECT, "it does not change the image");
        }
        if self.finished.insert(props.id) {
            self.loaded.warnings.extend(props.finish());
        }
    }

    /// Adds a note unless it exists already.
    fn note(&mut self, text: impl Into<String>) {
        let text = text.into();
        if !self.loaded.notes.contains(&text) {
            self.loaded.notes.push(text);
        }
    }

    /// Adds a note about what is not rendered as the file asks for, unless it exists already.
    fn approximate(&mut self, text: impl Into<String>) {
        let text = text.into();
        if !self.loaded.approximations.contains(&text) {
            self.loaded.approximations.push(text);
        }
    }

    /// Accepts properties that make no difference in Buffon, with a note that says why.
    fn ignore(&mut self, props: &Props, names: &[&'static str], why: &str) {
        for name in names {
            if props.find(name).is_some() {
                let thing = props.object.thing();
                self.note(format!("{thing}: {name} is ignored: {why}"));
            }
        }
    }

    /// Adds an emitter that is not a shape.
    fn add_emitter(&mut self, emitter: Emitter) {
        self.loaded.description.emitters.push(emitter);
    }

    /// Returns the file of a property; `None` if it is missing, which is recorded.
    fn find_file(&mut self, props: &Props, name: &'static str) -> Result<Option<std::path::PathBuf>> {
        let Some(text) = props.text(name)? else {
            return Err(props.object.error(format!("the property {name} is missing")));
        };
        let property = props
            .find(name)
            .map(|p| p.error(format!("there is no file {}", crate::util::wording::quoted(text))));
        let found = self.folders.find(props.object.spot.file(), text);
        if found.is_none() {
            self.missing.extend(property);
        }
        Ok(found)
    }
}

/// Creates the error for a plugin that cannot be used: known to Mitsuba but not supported, or unknown.
fn unknown_plugin(object: &Object, supported: &[&str], mitsuba: &[&str]) -> Error {
    if mitsuba.contains(&object.plugin.as_str()) {
        return unsupported(object);
    }
    let near = wording::did_you_mean(&object.plugin, supported.iter().chain(mitsuba).copied());
    Error { kind: Kind::Unsupported, ..object.error(format!("unknown {}{near}", object.class)) }
}

/// Properties of objects of Mitsuba 0.6 that change the noise or the speed, and not the image, in snake_case.
const WITHOUT_EFFECT: [&str; 8] = [
    "attach_log",
    "cache",
    "high_quality_edges",
    "kd_intersection_cost",
    "kd_traversal_cost",
    "max_anisotropy",
    "sampling_weight",
    "specular_sampling_weight",
];

/// Creates the error for a plugin that Mitsuba has and Buffon does not.
fn unsupported(object: &Object) -> Error {
    object.unsupported(format!("this {} is not supported", object.class))
}
