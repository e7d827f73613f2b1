//! Shapes and groups of shapes.

use super::{Builder, unknown_plugin};
use crate::error::Result;
use crate::loader::curves::{self, CurveFormat};
use crate::loader::height_field;
use crate::loader::mesh::{self, Format};
use crate::loader::mitsuba::graph::ObjectId;
use crate::loader::mitsuba::props::Props;
use crate::loader::volume;
use crate::math::{DAffine3, DVec3};
use crate::scene::description::{PlacedGroup, PlacedShape};
use crate::shape::{Mesh, SdfNormals, Shape};

pub const SUPPORTED: [&str; 16] = [
    "bsplinecurve",
    "cube",
    "cylinder",
    "disk",
    "hair",
    "heightfield",
    "instance",
    "linearcurve",
    "merge",
    "obj",
    "ply",
    "rectangle",
    "sdfgrid",
    "serialized",
    "shapegroup",
    "sphere",
];
const MITSUBA: [&str; 3] = ["blender", "ellipsoids", "ellipsoidsmesh"];
/// The greatest relative difference of the axes of a sphere's transformation. It is greater than the difference in a
/// matrix that is printed with six digits.
const SPHERE_TOLERANCE: f64 = 1e-4;

impl Builder<'_> {
    /// Returns an error if there is a sensor inside something that is not a single shape.
    fn refuse_sensor(&self, props: &Props) -> Result<()> {
        match props.child("sensor")? {
            Some(sensor) => {
                let message = format!("expected it inside a shape, found it inside {}", props.object.thing());
                Err(self.graph.objects[sensor].error(message))
            }
            None => Ok(()),
        }
    }

    /// Adds a shape, an instance of a group, or the shapes of a `merge`.
    ///
    /// # Errors
    /// As for [`instantiate`](super::instantiate).
    pub fn shape(&mut self, object: ObjectId) -> Result<()> {
        match self.graph.objects[object].plugin.as_str() {
            "instance" => self.instance(object),
            "shapegroup" => self.group(object).map(drop),
            _ => {
                let mut shapes = Vec::new();
                self.meters.clear();
                self.placed_shapes(object, &mut shapes)?;
                let first = self.loaded.description.shapes.len();
                self.loaded.description.shapes.extend(shapes);
                for (sensor, at) in std::mem::take(&mut self.meters) {
                    let added = self.sensor(sensor, Some(first + at));
                    self.or_stand_in(added, "left out", |_| ())?;
                }
                Ok(())
            }
        }
    }

    /// Returns the index of a group. Each group is instantiated once.
    fn group(&mut self, object: ObjectId) -> Result<usize> {
        if let Some(group) = self.groups.get(&object) {
            return Ok(*group);
        }
        let props = Props::new(self.graph, object);
        let mut shapes = Vec::new();
        self.refuse_sensor(&props)?;
        self.meters.clear();
        for child in self.once(&props, "shape") {
            let inner = &self.graph.objects[child];
            if matches!(inner.plugin.as_str(), "instance" | "shapegroup") {
                return Err(inner.error("a shapegroup cannot contain groups or instances"));
            }
            self.placed_shapes(child, &mut shapes)?;
        }
        if shapes.is_empty() {
            return Err(props.object.error("expected shapes inside it"));
        }
        if let Some(&(sensor, _)) = self.meters.first() {
            return Err(self.graph.objects[sensor].error("a shape inside a group cannot have a sensor"));
        }
        self.finish(props);
        let groups = &mut self.loaded.description.groups;
        groups.push(shapes);
        self.groups.insert(object, groups.len() - 1);
        Ok(groups.len() - 1)
    }

    /// Adds an instance of a group.
    fn instance(&mut self, object: ObjectId) -> Result<()> {
        let props = Props::new(self.graph, object);
        self.refuse_sensor(&props)?;
        let inside = props.child("shape")?;
        let inside = inside.ok_or_else(|| props.object.error("expected a shapegroup inside it"))?;
        if self.graph.objects[inside].plugin != "shapegroup" {
            return Err(self.graph.objects[inside].error("expected a shapegroup inside an instance"));
        }
        let group = self.group(inside)?;
        let to_world = props.motion()?;
        let (name, place) = (props.object.id.clone(), Some(props.object.spot.place()));
        self.finish(props);
        self.loaded.description.instances.push(PlacedGroup { name, place, group, to_world });
        Ok(())
    }

    /// Adds a shape with its material and emitter to `out`, or the shapes of a `merge`.
    fn placed_shapes(&mut self, object: ObjectId, out: &mut Vec<PlacedShape>) -> Result<()> {
        let props = Props::new(self.graph, object);
        if props.object.plugin == "merge" {
            self.refuse_sensor(&props)?;
            for child in self.once(&props, "shape") {
                let inner = &self.graph.objects[child];
                if matches!(inner.plugin.as_str(), "instance" | "shapegroup") {
                    return Err(inner.error("only shapes can be merged"));
                }
                self.placed_shapes(child, out)?;
            }
            self.finish(props);
            return Ok(());
        }
        let motion = props.motion()?;
        let to_world = motion.at(0.0);
        let shape = match props.object.plugin.as_str() {
            "obj" => self.mesh(&props, Format::Obj, &to_world)?,
            "ply" => self.mesh(&props, Format::Ply, &to_world)?,
            "serialized" => {
                let shape_index =
                    props.integer("shape_index", 0..=i64::from(u32::MAX))?.unwrap_or(0) as usize;
                self.mesh(&props, Format::Serialized { shape_index }, &to_world)?
            }
            "rectangle" => Shape::Rectangle,
            "cube" => Shape::Cube,
            "disk" => Shape::Disk,
            "sphere" => sphere(&props, &to_world)?,
            "cylinder" => cylinder(&props)?,
            "sdfgrid" => self.sdf_grid(&props)?,
            "heightfield" => self.height_field(&props)?,
            "linearcurve" => self.curves(&props, CurveFormat::Linear)?,
            "bsplinecurve" => self.curves(&props, CurveFormat::BSpline)?,
            "hair" => {
                self.ignore(&props, &["angle_threshold"], "all segments are kept");
                self.ignore(&props, &["reduction"], "all hairs are rendered");
                self.curves(&props, CurveFormat::Hair { radius: props.positive("radius", 0.025)? })?
            }
            _ => return Err(unknown_plugin(props.object, &SUPPORTED, &MITSUBA)),
        };
        let emission = match props.child("emitter")? {
            Some(emitter) => Some(self.area_emitter(emitter)?),
            None => None,
        };
        let material = match props.child("bsdf")? {
            Some(bsdf) => self.material(bsdf)?,
            None => self.default_material(emission.is_some()),
        };
        let boundary = self.boundary(&props)?;
        if let Some(texture) = props.child("texture")?.filter(|_| props.object.plugin != "heightfield") {
            return Err(super::unsupported(&self.graph.objects[texture]));
        }
        if let Some(sensor) = props.child("sensor")? {
            if matches!(shape, Shape::Curves(_) | Shape::SdfGrid(_)) {
                let message = "only a rectangle, disk, sphere, cylinder or mesh can have a sensor";
                return Err(self.graph.objects[sensor].error(message));
            }
            if motion.fixed().is_none() {
                return Err(self.graph.objects[sensor].error("a shape that moves cannot have a sensor"));
            }
            self.meters.push((sensor, out.len()));
        }
        self.ignore(&props, &["silhouette_sampling_weight"], "nothing here differentiates images");
        let flip_normals = props.boolean("flip_normals", false)?;
        let place = Some(props.object.spot.place());
        let name = props.object.id.clone();
        self.finish(props);
        let shape =
            PlacedShape { name, place, shape, to_world: motion, flip_normals, material, emission, boundary };
        out.push(shape);
        Ok(())
    }

    /// Reads a mesh from a file; returns an empty mesh if the file is missing.
    fn mesh(&mut self, props: &Props, format: Format, to_world: &DAffine3) -> Result<Shape> {
        let options = mesh::Options {
            face_normals: props.boolean("face_normals", false)?,
            // v points up in OBJ and down in an image, so it is flipped by default, as in Mitsuba.
            flip_tex_coords: match format {
                Format::Obj => props.boolean("flip_tex_coords", true)?,
                Format::Ply => props.boolean("flip_tex_coords", false)?,
                Format::Serialized { .. } => false,
            },
        };
        let Some(path) = self.find_file(props, "filename")? else { return Ok(Shape::Mesh(Mesh::default())) };
        let (mesh, _) = mesh::load(&path, format, options, to_world, self.memory, &mut self.loaded.warnings)?;
        Ok(Shape::Mesh(mesh))
    }

    /// Reads curves from a file; returns none if the file is missing.
    fn curves(&mut self, props: &Props, format: CurveFormat) -> Result<Shape> {
        let found = self.find_file(props, "filename")?;
        let curves = found.map(|path| curves::load(&path, format, self.memory)).transpose()?;
        Ok(Shape::Curves(curves.unwrap_or_default()))
    }

    /// Reads the image of a height field, which is its own or that of a texture inside it; returns an empty mesh if the
    /// file is missing.
    fn height_field(&mut self, props: &Props) -> Result<Shape> {
        let smooth = props.boolean("shading_normals", true)?;
        let scale = props.float("scale")?.unwrap_or(1.0) as f32;
        self.ignore(props, &["width", "height"], "the heights are the pixels of an image");
        self.approximate("heightfield: each cell is rendered as two triangles");
        let bitmap = props.child("texture")?.map(|texture| Props::new(self.graph, texture));
        let (source, raw) = match &bitmap {
            Some(texture) if props.has("filename") => {
                return Err(texture.object.error("expected either a filename or a texture, found both"));
            }
            Some(texture) if texture.object.plugin != "bitmap" => {
                return Err(texture.object.unsupported("expected a bitmap: its pixels are the heights"));
            }
            Some(texture) => (texture, texture.boolean("raw", false)?),
            None => (props, false),
        };
        let Some(path) = self.find_file(source, "filename")? else { return Ok(Shape::Mesh(Mesh::default())) };
        let image = self.image(&path, raw).map_err(|error| match error.place {
            Some(_) => error,
            None => source.error("filename", &error.message),
        })?;
        let mesh = height_field::mesh(&path, &image, scale, smooth, self.memory)?;
        Ok(Shape::Mesh(mesh))
    }

    /// Reads a grid of signed distances from a file; returns an empty mesh if the file is missing.
    fn sdf_grid(&mut self, props: &Props) -> Result<Shape> {
        let normals = [("smooth", SdfNormals::Smooth), ("analytic", SdfNormals::Analytic)];
        let normals = props.choice("normals", &normals, SdfNormals::default())?;
        let found = self.find_file(props, "filename")?;
        let grid = found.map(|path| volume::load_distances(&path, normals, self.memory)).transpose()?;
        Ok(grid.map_or_else(|| Shape::Mesh(Mesh::default()), Shape::SdfGrid))
    }
}

fn cylinder(props: &Props) -> Result<Shape> {
    let radius = props.positive("radius", 1.0)?;
    let p0 = props.point("p0")?.unwrap_or(DVec3::ZERO).as_vec3();
    let p1 = props.point("p1")?.unwrap_or(DVec3::Z).as_vec3();
    if !(p0.is_finite() && p1.is_finite() && p0 != p1) {
        return Err(props.object.error("expected two different, finite ends p0 and p1"));
    }
    Ok(Shape::Cylinder { p0, p1, radius })
}

fn sphere(props: &Props, to_world: &DAffine3) -> Result<Shape> {
    let radius = props.positive("radius", 1.0)?;
    let center = props.point("center")?.unwrap_or(DVec3::ZERO).as_vec3();
    if !center.is_finite() {
        return Err(props.refusal("center", "expected a point in the range of 32-bit floats"));
    }
    let m = to_world.matrix3;
    let scale = m.x_axis.length();
    let off = [m.y_axis.length() - scale, m.z_axis.length() - scale];
    let lean = [m.x_axis.dot(m.y_axis), m.y_axis.dot(m.z_axis), m.z_axis.dot(m.x_axis)].map(|d| d / scale);
    if off.iter().chain(&lean).any(|d| d.abs() > SPHERE_TOLERANCE * scale) {
        return Err(props.error("to_world", "a sphere cannot be scaled differently along different axes"));
    }
    Ok(Shape::Sphere { center, radius })
}
