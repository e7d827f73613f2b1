//! The conversion of elements to objects: parameters, includes, folders, references, typed values, old versions.

use super::graph::{CLASSES, Graph, Object, ObjectId, Property, Value};
use super::parameters::Parameters;
use super::xml::{self, Attribute, Element};
use super::{transform, upgrade, values};
use crate::color::spectrum::{Spectrum, VISIBLE, black_body};
use crate::error::{Error, Kind, Result};
use crate::loader::files::Folders;
use crate::loader::{LoadOptions, Tolerance, framing, tolerated};
use crate::math::{DAffine3, Motion};
use crate::memory::Budget;
use crate::util::wording;
use crate::util::wording::quoted;
use std::path::{Path, PathBuf};

/// The version of the scene language that Buffon supports.
const CURRENT_MAJOR: u32 = 3;
/// The greatest depth of files that include files.
const MAX_INCLUDES: usize = 32;
/// The greatest number of files of a scene. A file counts as often as it is included.
const MAX_FILES: usize = 10_000;
/// The greatest number of elements of all files of a scene.
const MAX_ELEMENTS: usize = 50_000_000;

/// Elements that are a property, and elements that are neither a property nor an object.
const PROPERTY_TAGS: [&str; 12] = [
    "integer",
    "float",
    "string",
    "boolean",
    "rgb",
    "srgb",
    "spectrum",
    "blackbody",
    "point",
    "vector",
    "transform",
    "animation",
];
const OTHER_TAGS: [&str; 5] = ["ref", "default", "include", "path", "alias"];

/// A resolved scene file.
#[derive(Debug)]
pub struct Resolved {
    /// Its objects.
    pub graph: Graph,
    /// The folders in which its other files are searched for.
    pub folders: Folders,
    /// Warnings about what was ignored.
    pub warnings: Vec<Error>,
    /// Notes about what was upgraded.
    pub notes: Vec<String>,
    /// The errors that were tolerated.
    pub tolerated: Vec<Error>,
}

/// Reads a scene file and the files that it includes.
///
/// # Errors
/// If anything is malformed, unknown or inconsistent, with its place.
pub fn resolve(path: &Path, options: &LoadOptions, memory: &Budget) -> Result<Resolved> {
    let mut resolver = Resolver {
        memory,
        tolerance: options.tolerance,
        parameters: Parameters::new(&options.defines),
        including: Vec::new(),
        files: 0,
        elements: 0,
        nesting: 0,
        out: Resolved {
            graph: Graph::default(),
            folders: Folders::new(path, &options.search_paths),
            warnings: Vec::new(),
            notes: Vec::new(),
            tolerated: Vec::new(),
        },
    };
    resolver.file(path, None, None)?;
    let unknown = resolver.out.graph.link(options.tolerance == Tolerance::Everything)?;
    resolver.out.tolerated.extend(unknown.into_iter().map(|error| tolerated(error, "left out")));
    resolver.out.warnings.extend(resolver.parameters.unused());
    Ok(resolver.out)
}

/// Returns an error if an element lacks a required attribute or has an unknown one.
pub fn check_attributes(element: &Element, required: &[&str], optional: &[&str]) -> Result<()> {
    let known = || required.iter().chain(optional).copied();
    if let Some(missing) = required.iter().find(|name| element.attribute(name).is_none()) {
        return Err(element.error(format!("the attribute {missing} is missing")));
    }
    match element.attributes.iter().find(|a| known().all(|name| name != a.name)) {
        Some(unknown) => {
            let near = wording::did_you_mean(&unknown.name, known());
            Err(element.error(format!("unknown attribute {}{near}", unknown.name)))
        }
        None => Ok(()),
    }
}

struct Resolver<'m> {
    memory: &'m Budget,
    tolerance: Tolerance,
    parameters: Parameters,
    including: Vec<PathBuf>,
    files: usize,
    elements: usize,
    nesting: usize,
    out: Resolved,
}

/// The context of an element.
#[derive(Clone, Copy)]
struct Context {
    /// The object that contains it.
    parent: ObjectId,
    /// Whether its file is older than version 2.
    old: bool,
}

impl Resolver<'_> {
    /// Reads a file. Its objects are added to `parent`, under `name` if the file is a single object. Without a parent,
    /// the file is the scene itself.
    fn file(&mut self, path: &Path, parent: Option<ObjectId>, name: Option<&Attribute>) -> Result<()> {
        let identity = path.canonicalize().unwrap_or_else(|_| path.to_path_buf());
        if self.including.contains(&identity) {
            return Err(Error::scene("the file includes itself").in_file(path));
        }
        if self.including.len() >= MAX_INCLUDES {
            return Err(
                Error::scene(format!("files are included more than {MAX_INCLUDES} deep")).in_file(path)
            );
        }
        let mut root =
            xml::parse(path, crate::loader::read_text(path, self.memory)?, &mut self.out.warnings)?;
        self.including.push(identity);
        self.files += 1;
        if self.files > MAX_FILES {
            return Err(Error::scene(format!("more than {MAX_FILES} files are included")).in_file(path));
        }
        self.substitute(&mut root)?;
        root.attributes.extend(name.cloned());
        let old = self.version(&root)?;
        match parent {
            Some(parent) if root.tag == "scene" => self.children(root, Context { parent, old })?,
            Some(parent) => self.object(root, Some(Context { parent, old }), old)?,
            None => self.object(root, None, old)?,
        }
        self.including.pop();
        Ok(())
    }

    /// Returns whether the file of a root element is older than version 2.
    fn version(&mut self, root: &Element) -> Result<bool> {
        let Some(text) = root.attribute("version") else {
            return Err(
                root.error(format!("the attribute version is missing, e.g. version=\"{CURRENT_MAJOR}.0.0\""))
            );
        };
        let major =
            text.split('.').map(str::parse::<u32>).collect::<Result<Vec<_>, _>>().map(|numbers| numbers[0]);
        let major = major
            .map_err(|_| root.error(format!("expected a version such as 3.0.0, found {}", quoted(text))))?;
        if major > CURRENT_MAJOR {
            self.out.warnings.push(
                root.error(format!("the file is of version {text}; Buffon speaks version {CURRENT_MAJOR}")),
            );
        }
        if major < 2 {
            let file = root.spot.file().display();
            self.out
                .notes
                .push(format!("{file}: upgraded from version {text}: camelCase names became snake_case"));
        }
        Ok(major < 2)
    }

    /// Replaces the parameters in an element's attributes.
    fn substitute(&mut self, element: &mut Element) -> Result<()> {
        self.elements += 1;
        if self.elements > MAX_ELEMENTS {
            return Err(element.error(format!("the scene has more than {MAX_ELEMENTS} elements")));
        }
        for i in 0..element.attributes.len() {
            if element.attributes[i].value.contains('$') {
                let value = self.parameters.substitute(&element.attributes[i].value);
                element.attributes[i].value = value.map_err(|e| element.error(e))?;
            }
        }
        Ok(())
    }

    /// Reads an object, whose parameters are substituted already, and its contents.
    fn object(&mut self, element: Element, around: Option<Context>, old: bool) -> Result<()> {
        let is_scene = element.tag == "scene";
        if around.is_none() && !is_scene {
            return Err(element.error("expected <scene> as the outermost element"));
        }
        if around.is_some() && is_scene {
            return Err(element.error("a scene cannot be inside another object"));
        }
        let required: &[&str] = if is_scene { &[] } else { &["type"] };
        check_attributes(&element, required, &["version", "id", "name", "type"])?;
        let plugin = element.attribute("type").unwrap_or("scene").to_owned();
        let id = element.attribute("id").unwrap_or_default().to_owned();
        let object = Object {
            class: if element.tag == "spectrum" { "texture".to_owned() } else { element.tag.clone() },
            plugin,
            old,
            id,
            properties: Vec::new(),
            children: Vec::new(),
            spot: element.spot.clone(),
        };
        let index = self.out.graph.add(object)?;
        if let Some(context) = around {
            let name = self.child_name(&element, context);
            let child = super::graph::Child { name, object: index, spot: element.spot.clone() };
            self.out.graph.objects[context.parent].children.push(child);
        }
        self.nesting += 1;
        if self.nesting > xml::MAX_DEPTH {
            return Err(element.error(format!("nested deeper than {} levels", xml::MAX_DEPTH)));
        }
        self.children(element, Context { parent: index, old })?;
        if old {
            upgrade::defaults(&mut self.out.graph.objects[index]);
        }
        self.nesting -= 1;
        Ok(())
    }

    /// Returns the name that an element gives to an object inside another.
    fn child_name(&self, element: &Element, context: Context) -> Option<String> {
        let name = element.attribute("name")?;
        let plugin = &self.out.graph.objects[context.parent].plugin;
        Some(if context.old { upgrade::property(plugin, name) } else { name.to_owned() })
    }

    /// Reads the elements inside an object.
    fn children(&mut self, element: Element, context: Context) -> Result<()> {
        for mut child in element.children {
            self.substitute(&mut child)?;
            match child.tag.as_str() {
                "default" => {
                    check_attributes(&child, &["name", "value"], &[])?;
                    let (name, value) = (child.attribute("name"), child.attribute("value"));
                    let name =
                        name.filter(|n| !n.is_empty()).ok_or_else(|| child.error("the name is empty"))?;
                    self.parameters.set_default(name, value.unwrap_or_default());
                    no_children(&child)?;
                }
                "include" => self.include(&child, context)?,
                "path" => self.path(&child, context)?,
                "alias" => {
                    check_attributes(&child, &["id", "as"], &[])?;
                    let (id, second) = (child.attribute("id"), child.attribute("as"));
                    self.out.graph.alias(
                        id.unwrap_or_default(),
                        second.unwrap_or_default(),
                        child.spot.clone(),
                    );
                    no_children(&child)?;
                }
                "ref" => {
                    check_attributes(&child, &["id"], &["name"])?;
                    let name = self.child_name(&child, context);
                    let id = child.attribute("id").unwrap_or_default();
                    self.out.graph.refer(context.parent, name, child.spot.clone(), id);
                    no_children(&child)?;
                }
                "spectrum" if child.attribute("type").is_some() => {
                    self.object(child, Some(context), context.old)?
                }
                tag if CLASSES.contains(&tag) => self.object(child, Some(context), context.old)?,
                tag if PROPERTY_TAGS.contains(&tag) => {
                    let read = self.property(child, context);
                    self.or_left_out(read)?;
                }
                _ => self.or_left_out(Err(unknown_tag(&child)))?,
            }
        }
        Ok(())
    }

    /// Records an error that is tolerated; returns any other.
    fn or_left_out(&mut self, result: Result<()>) -> Result<()> {
        match result {
            Err(error) if self.tolerance.covers(&error) => {
                self.out.tolerated.push(tolerated(error, "left out"));
                Ok(())
            }
            other => other,
        }
    }

    fn include(&mut self, element: &Element, context: Context) -> Result<()> {
        check_attributes(element, &["filename"], &["name"])?;
        no_children(element)?;
        let name = element.attribute("filename").unwrap_or_default();
        let found = self.out.folders.find(element.spot.file(), name);
        let path = found.ok_or_else(|| element.error(format!("there is no file {}", quoted(name))))?;
        let named = element.attributes.iter().find(|a| a.name == "name");
        self.file(&path, Some(context.parent), named).map_err(|e| match e.place {
            // The error is about the whole file, so the message also says which element includes it.
            Some(ref place) if place.line == 0 => {
                element.error(format!("{}: {}", place.file.display(), e.message))
            }
            _ => e,
        })
    }

    fn path(&mut self, element: &Element, context: Context) -> Result<()> {
        check_attributes(element, &["value"], &[])?;
        no_children(element)?;
        if self.out.graph.objects[context.parent].class != "scene" {
            return Err(element.error("a folder can only be added to the scene"));
        }
        let name = element.attribute("value").unwrap_or_default();
        let found = self.out.folders.find(element.spot.file(), name).filter(|p| p.is_dir());
        let folder =
            found.ok_or_else(|| element.error(format!("the folder {} does not exist", quoted(name))))?;
        self.out.folders.prepend(folder);
        Ok(())
    }

    /// Reads a property of an object.
    fn property(&mut self, element: Element, context: Context) -> Result<()> {
        let tag = element.tag.clone();
        match tag.as_str() {
            "transform" | "animation" => check_attributes(&element, &["name"], &[])?,
            "point" | "vector" => check_attributes(&element, &["name"], &["x", "y", "z", "value"])?,
            "spectrum" => check_attributes(&element, &["name"], &["value", "filename"])?,
            "blackbody" => check_attributes(&element, &["name", "temperature"], &["scale"])?,
            _ => check_attributes(&element, &["name", "value"], &[])?,
        }
        let text = element.attribute("value").unwrap_or_default();
        let value = match tag.as_str() {
            "integer" => values::integer(text).map(Value::Integer),
            "float" => values::float(text).map(Value::Float),
            "string" => Ok(Value::Text(text.to_owned())),
            "boolean" => values::boolean(text).map(Value::Boolean),
            "rgb" => values::rgb(text).map(Value::Rgb),
            "srgb" => values::srgb(text).map(Value::Rgb),
            "blackbody" => blackbody(&element),
            // Before version 2, a spectrum of three values was linear sRGB.
            "spectrum" if context.old && values::floats(text).is_ok_and(|v| v.len() == 3) => {
                values::rgb(text).map(Value::Rgb)
            }
            "spectrum" => spectrum(&element),
            "transform" => return self.transform(element, context),
            "animation" => return self.animation(element, context),
            _ => point(&element),
        };
        let value = value.map_err(|message| element.error(message))?;
        no_children(&element)?;
        self.add_property(&element, value, context)
    }

    fn transform(&mut self, mut element: Element, context: Context) -> Result<()> {
        let whole = self.product(&mut element, context)?;
        self.add_property(&element, Value::Transform(whole), context)
    }

    /// Returns the product of the transformations inside an element.
    fn product(&mut self, element: &mut Element, context: Context) -> Result<DAffine3> {
        let mut whole = DAffine3::IDENTITY;
        for mut child in std::mem::take(&mut element.children) {
            self.substitute(&mut child)?;
            let tag = if context.old { upgrade::tag(&child.tag) } else { &child.tag }.to_owned();
            if !transform::TAGS.contains(&tag.as_str()) {
                let near = wording::did_you_mean(&tag, transform::TAGS);
                return Err(child.error(format!("unknown transformation{near}")));
            }
            whole = transform::step(&tag, &child)? * whole;
            no_children(&child)?;
        }
        framing::check_invertible(&whole).map_err(|message| element.error(message))?;
        Ok(whole)
    }

    /// Reads transformations at key times: `<transform time="...">` elements.
    fn animation(&mut self, mut element: Element, context: Context) -> Result<()> {
        let mut keys = Vec::new();
        for mut child in std::mem::take(&mut element.children) {
            self.substitute(&mut child)?;
            if child.tag != "transform" {
                return Err(child.error("expected <transform time=\"...\"> inside an animation"));
            }
            check_attributes(&child, &["time"], &[])?;
            let time = values::float(child.attribute("time").unwrap_or_default());
            let time = time.map_err(|message| child.error(message))?;
            if keys.last().is_some_and(|(last, _)| *last >= time) {
                return Err(child.error("expected times that increase"));
            }
            keys.push((time, self.product(&mut child, context)?));
        }
        let motion =
            Motion::new(keys).ok_or_else(|| element.error("expected at least one transform inside it"))?;
        self.add_property(&element, Value::Animation(motion), context)
    }

    fn add_property(&mut self, element: &Element, value: Value, context: Context) -> Result<()> {
        let object = &mut self.out.graph.objects[context.parent];
        let name = element.attribute("name").unwrap_or_default();
        let name = if context.old { upgrade::property(&object.plugin, name) } else { name.to_owned() };
        let property = Property { name, tag: element.tag.clone(), value, spot: element.spot.clone() };
        if object.properties.iter().any(|p| p.name == property.name) {
            let thing = object.thing();
            return Err(property.error(format!("given twice in {thing}")));
        }
        object.properties.push(property);
        Ok(())
    }
}

/// Reads a point or vector: `x`, `y` and `z`, or `value`.
fn point(element: &Element) -> Result<Value, String> {
    let axes = ["x", "y", "z"].map(|name| element.attribute(name));
    match (element.attribute("value"), axes) {
        (Some(text), [None, None, None]) => values::triple(text).map(|v| Value::Vector(v.into())),
        (None, [Some(x), Some(y), Some(z)]) => {
            Ok(Value::Vector([values::float(x)?, values::float(y)?, values::float(z)?].into()))
        }
        _ => Err("expected either value or x, y and z".to_owned()),
    }
}

/// Reads a spectrum: `value` or `filename`.
fn spectrum(element: &Element) -> Result<Value, String> {
    match (element.attribute("value"), element.attribute("filename")) {
        (Some(text), None) => values::spectrum(text).map(Value::Spectrum),
        (None, Some(file)) => Ok(Value::SpectrumFile(file.to_owned())),
        _ => Err("expected either value or filename".to_owned()),
    }
}

/// Reads the spectrum of a black body: `temperature` in K, and a factor `scale`.
fn blackbody(element: &Element) -> Result<Value, String> {
    let text = element.attribute("temperature").unwrap_or_default().trim();
    let temperature = values::float(text.trim_end_matches(['K', 'k']))?;
    let scale = element.attribute("scale").map_or(Ok(1.0), values::float)?;
    if temperature <= 0.0 {
        return Err(format!("expected a temperature above 0, found {text}"));
    }
    let samples = black_body(temperature, VISIBLE).into_iter().map(|(nm, radiance)| (nm, scale * radiance));
    Ok(Value::Spectrum(Spectrum::from_samples(samples.collect())?))
}

/// Returns an error if an element contains elements.
fn no_children(element: &Element) -> Result<()> {
    match element.children.first() {
        Some(child) => Err(child.error(format!("{} cannot have elements inside it", element.thing()))),
        None => Ok(()),
    }
}

fn unknown_tag(element: &Element) -> Error {
    if transform::TAGS.contains(&element.tag.as_str()) {
        return element.error("a transformation belongs inside a <transform>");
    }
    let known = CLASSES.iter().chain(&PROPERTY_TAGS).chain(&OTHER_TAGS).copied();
    let near = wording::did_you_mean(&element.tag, known);
    Error { kind: Kind::Unsupported, ..element.error(format!("unknown element{near}")) }
}
