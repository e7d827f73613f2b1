//! A resolved scene file: objects with typed properties in an arena.

use super::xml::Spot;
use crate::color::spectrum::Spectrum;
use crate::error::{Error, Kind, Result};
use crate::math::{DAffine3, DVec3, Motion};
use crate::util::wording;
use crate::util::wording::quoted;
use std::collections::HashMap;

/// Index of an object in its [`Graph`].
pub type ObjectId = usize;

/// The greatest length of a chain of objects inside objects.
const MAX_CHAIN: usize = 100;
/// The greatest number of unknown ids in an error.
const MAX_UNKNOWN: usize = 10;

/// The classes of objects: the names of the elements that declare one.
pub const CLASSES: [&str; 13] = [
    "scene",
    "shape",
    "bsdf",
    "emitter",
    "sensor",
    "film",
    "rfilter",
    "sampler",
    "integrator",
    "texture",
    "medium",
    "phase",
    "volume",
];

/// The value of a property.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// A whole number.
    Integer(i64),
    /// A number.
    Float(f64),
    /// A text.
    Text(String),
    /// A boolean.
    Boolean(bool),
    /// A linear Rec.709 colour.
    Rgb([f64; 3]),
    /// A spectrum in the scene file.
    Spectrum(Spectrum),
    /// A spectrum in a separate file.
    SpectrumFile(String),
    /// A point or vector.
    Vector(DVec3),
    /// A transformation.
    Transform(DAffine3),
    /// A transformation that changes over time.
    Animation(Motion),
}

/// A property of an object.
#[derive(Clone, Debug)]
pub struct Property {
    /// Its name, in the current scene language.
    pub name: String,
    /// The name of its element.
    pub tag: String,
    /// Its value.
    pub value: Value,
    /// Its position in the file.
    pub spot: Spot,
}

impl Property {
    /// Creates an error about the property, at its place.
    pub fn error(&self, message: impl Into<String>) -> Error {
        Error::scene(message).about(format!("<{} name=\"{}\">", self.tag, self.name)).at(self.spot.place())
    }
}

/// An object inside another, declared there or referenced.
#[derive(Clone, Debug)]
pub struct Child {
    /// Its name in the other object; usually none.
    pub name: Option<String>,
    /// The object.
    pub object: ObjectId,
    /// The position of the declaration or reference.
    pub spot: Spot,
}

/// An object of the scene: a plugin with its properties and the objects inside it.
#[derive(Clone, Debug)]
pub struct Object {
    /// One of [`CLASSES`].
    pub class: String,
    /// The name of its plugin; `scene` for the scene itself.
    pub plugin: String,
    /// Whether its file is older than version 2.
    pub old: bool,
    /// Its id for references; may be empty.
    pub id: String,
    /// Its properties in file order.
    pub properties: Vec<Property>,
    /// The objects inside it in file order.
    pub children: Vec<Child>,
    /// Its position in the file.
    pub spot: Spot,
}

impl Object {
    /// Returns the object's name in messages: `<bsdf type="diffuse">`.
    pub fn thing(&self) -> String {
        match self.class.as_str() {
            "scene" => "<scene>".to_owned(),
            class => format!("<{class} type=\"{}\">", self.plugin),
        }
    }

    /// Creates an error about the object, at its place.
    pub fn error(&self, message: impl Into<String>) -> Error {
        Error::scene(message).about(self.thing()).at(self.spot.place())
    }

    /// Creates an error about an object that the scene language has and Buffon does not.
    pub fn unsupported(&self, message: impl Into<String>) -> Error {
        Error { kind: Kind::Unsupported, ..self.error(message) }
    }
}

/// A reference whose target is not found yet.
#[derive(Debug)]
struct Reference {
    from: ObjectId,
    slot: usize,
    id: String,
}

/// A second id of an object.
#[derive(Debug)]
struct Alias {
    id: String,
    second: String,
    spot: Spot,
}

/// The objects of a scene file; the first is the scene.
#[derive(Debug, Default)]
pub struct Graph {
    /// The objects, in file order.
    pub objects: Vec<Object>,
    ids: HashMap<String, ObjectId>,
    references: Vec<Reference>,
    aliases: Vec<Alias>,
}

impl Graph {
    /// Adds an object.
    ///
    /// # Errors
    /// If its id exists already.
    pub fn add(&mut self, object: Object) -> Result<ObjectId> {
        let index = self.objects.len();
        if !object.id.is_empty() {
            if let Some(&other) = self.ids.get(&object.id) {
                let other = Error::scene("the other one")
                    .about(self.objects[other].thing())
                    .at(self.objects[other].spot.place());
                let message = format!("the id {} is given twice", quoted(&object.id));
                return Err(object.error(message).with_others(vec![other]));
            }
            self.ids.insert(object.id.clone(), index);
        }
        self.objects.push(object);
        Ok(index)
    }

    /// Adds a reference from an object to an id, which may be declared later.
    pub fn refer(&mut self, from: ObjectId, name: Option<String>, spot: Spot, id: &str) {
        let children = &mut self.objects[from].children;
        self.references.push(Reference { from, slot: children.len(), id: id.to_owned() });
        children.push(Child { name, object: usize::MAX, spot });
    }

    /// Adds a second id for the object of an id, which may be declared later.
    pub fn alias(&mut self, id: &str, second: &str, spot: Spot) {
        self.aliases.push(Alias { id: id.to_owned(), second: second.to_owned(), spot });
    }

    /// Finds the targets of all references. If unknown ids are tolerated, their references are removed, and the errors
    /// are returned.
    ///
    /// # Errors
    /// If there are unknown ids (the first ten in one error, each with the nearest known one), an alias whose id exists
    /// already, a cycle of references, or objects nested more than 100 levels deep.
    pub fn link(&mut self, tolerates_unknown: bool) -> Result<Vec<Error>> {
        for Alias { id, second, spot } in std::mem::take(&mut self.aliases) {
            let Some(&target) = self.ids.get(&id) else { return Err(self.unknown("alias", &id, &spot)) };
            if self.ids.insert(second.clone(), target).is_some() {
                let error = Error::scene(format!("the id {} is taken", quoted(&second)));
                return Err(error.about(format!("<alias as=\"{second}\">")).at(spot.place()));
            }
        }
        let mut unknown = Vec::new();
        let mut dangling = Vec::new();
        for Reference { from, slot, id } in std::mem::take(&mut self.references) {
            match self.ids.get(&id) {
                Some(&target) => self.objects[from].children[slot].object = target,
                None => {
                    unknown.push(self.unknown("ref", &id, &self.objects[from].children[slot].spot));
                    dangling.push((from, slot));
                    if unknown.len() == MAX_UNKNOWN && !tolerates_unknown {
                        break;
                    }
                }
            }
        }
        if !unknown.is_empty() && !tolerates_unknown {
            return Err(unknown.remove(0).with_others(unknown));
        }
        dangling.sort_unstable();
        for (from, slot) in dangling.into_iter().rev() {
            self.objects[from].children.remove(slot);
        }
        self.check_chains()?;
        Ok(unknown)
    }

    /// Creates the error for an id that no object has.
    fn unknown(&self, tag: &str, id: &str, spot: &Spot) -> Error {
        let near = wording::did_you_mean(id, self.ids.keys().map(String::as_str));
        let message = format!("no object has the id {}{near}", quoted(id));
        Error::scene(message).about(format!("<{tag} id=\"{id}\">")).at(spot.place())
    }

    /// Returns an error if there are cycles or long chains. An object is removed after all that contain it, so each
    /// object that remains is in a cycle or inside one.
    fn check_chains(&self) -> Result<()> {
        let mut containers = vec![0usize; self.objects.len()];
        for child in self.objects.iter().flat_map(|o| &o.children) {
            containers[child.object] += 1;
        }
        let mut depth = vec![1; self.objects.len()];
        let mut ready: Vec<_> = (0..self.objects.len()).filter(|i| containers[*i] == 0).collect();
        while let Some(i) = ready.pop() {
            if depth[i] > MAX_CHAIN {
                return Err(self.objects[i].error(format!("nested deeper than {MAX_CHAIN} levels")));
            }
            for child in &self.objects[i].children {
                let c = child.object;
                depth[c] = depth[c].max(depth[i] + 1);
                containers[c] -= 1;
                if containers[c] == 0 {
                    ready.push(c);
                }
            }
        }
        match containers.iter().position(|c| *c > 0) {
            Some(start) => Err(self.cycle_error(start, &containers)),
            None => Ok(()),
        }
    }

    /// Creates the error for a cycle that contains or reaches `start`: follows the containers among the remaining
    /// objects until one repeats.
    fn cycle_error(&self, start: ObjectId, containers: &[usize]) -> Error {
        let container = |inner: ObjectId| {
            let holds = |o: &Object| o.children.iter().any(|c| c.object == inner);
            self.objects.iter().enumerate().position(|(i, o)| containers[i] > 0 && holds(o))
        };
        let mut path = vec![start];
        while let Some(next) = container(path[path.len() - 1]) {
            if let Some(at) = path.iter().position(|p| *p == next) {
                path.drain(..at);
                break;
            }
            path.push(next);
        }
        path.reverse();
        path.push(path[0]);
        let name = |i: &ObjectId| match self.objects[*i].id.as_str() {
            "" => self.objects[*i].thing(),
            id => quoted(id),
        };
        let shown: Vec<_> = path.iter().take(10).map(name).collect();
        self.objects[path[0]].error(format!("it contains itself: {}", shown.join(" contains ")))
    }
}
