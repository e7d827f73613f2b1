//! Compilation of a description to a scene: applies transforms, prepares emitters for sampling and builds the
//! accelerator.

use super::casters;
use super::description::{Description, PlacedGroup, PlacedShape};
use super::holes::OpacityFilter;
use super::media::MediaCompiler;
use super::meter::surface_of;
use super::names;
use super::{Materials, Needs, Scene, SceneNames, SceneShape};
use crate::accel::{self, AccelKind, Assembly, Geometry, GeometryFilter, Instance, MAX_STEPS};
use crate::bsdf::{Bsdf, Lobes};
use crate::color::Rgb;
use crate::emitter::lanes::LightLanes;
use crate::emitter::{
    AreaEmitter, BoundingSphere, DirectionalEmitter, Emission, Emitter, Environment, Light, LightSelection,
    PointEmitter, ProjectorEmitter, SpotEmitter, SunEmitter,
};
use crate::error::{Error, Place, Result};
use crate::ids::{EmitterId, MaterialId, ShapeId, TextureId};
use crate::material::{Input, Material, ThinDielectric};
use crate::math::{Bounds, DAffine3, Motion, Vec3};
use crate::medium::Medium;
use crate::memory::Budget;
use crate::sampling::Distribution1D;
use crate::sensor::{Camera, Projection, SensorSettings};
use crate::shape::{Shape, WorldShape};
use crate::texture::Texture;
use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;
use std::time::Instant;

/// The options of compilation.
#[derive(Clone, Copy, Debug)]
pub struct CompileOptions {
    /// The accelerator.
    pub accel: AccelKind,
    /// The number of threads that build it.
    pub threads: usize,
    /// The index of the sensor whose shutter interval is used for motion.
    pub sensor: usize,
    /// Whether rays pass thin panes as they pass holes. If not, panes scatter them.
    pub passes_panes: bool,
}

/// The diagnostics of compilation.
#[derive(Clone, Debug, Default)]
pub struct CompileReport {
    /// The number of invalid primitives (not finite, or out of range), which no ray can hit.
    pub dropped_primitives: usize,
    /// Emitters that cannot emit (no area, no power), with the reason.
    pub warnings: Vec<Error>,
    /// Time spent building the accelerator, in seconds.
    pub build_seconds: f64,
}

/// The tolerance of linear motion steps, relative to the size of the moving object.
const MOTION_TOLERANCE: f64 = 2.5e-4;

/// Compiles a description without a memory limit: see [`compile_within`].
///
/// # Errors
/// As [`compile_within`].
pub fn compile(description: Description, options: CompileOptions) -> Result<(Scene, CompileReport)> {
    compile_within(description, options, &Budget::unlimited())
}

/// Compiles a description and charges the accelerator's memory to the budget.
///
/// # Errors
/// If a transform is not finite, a sphere is scaled non-uniformly, a sensor is singular, an index is out of range, or
/// the accelerator cannot be built, for example due to the memory limit.
pub fn compile_within(
    description: Description,
    options: CompileOptions,
    memory: &Budget,
) -> Result<(Scene, CompileReport)> {
    let Description { mut materials, mut material_names, .. } = description;
    // In Mitsuba, the light of emitters that no ray can hit does not pass panes.
    let mut panes = HashMap::new();
    if options.passes_panes && !description.emitters.iter().any(Emitter::is_delta) {
        panes = add_panes(&mut materials, &mut material_names);
    }
    let mut builder = SceneCompiler {
        names: SceneNames::default(),
        materials: Arc::new(Materials::new(materials, description.textures)?),
        panes,
        shutter: description.sensors.get(options.sensor).map_or([0.0; 2], |sensor| sensor.shutter),
        shapes: Vec::new(),
        assembly: Assembly::default(),
        first_group: 0,
        lights: Vec::new(),
        media: MediaCompiler::default(),
        report: CompileReport::default(),
    };
    builder.names.set_materials(&material_names, builder.materials.len());
    for placed in description.shapes {
        builder.shape(placed)?;
    }
    builder.first_group = builder.assembly.groups.len();
    for group in description.groups {
        builder.group(group)?;
    }
    for placed in description.instances {
        builder.instance(placed)?;
    }
    builder.finish(&description.emitters, &description.sensors, description.media, options, memory)
}

/// Adds a pane that rays pass for each thin dielectric, with the same name. Returns it for each.
fn add_panes(
    materials: &mut Vec<Material>,
    names: &mut Vec<(MaterialId, String)>,
) -> HashMap<MaterialId, MaterialId> {
    let mut panes = HashMap::new();
    for i in 0..materials.len() {
        if let Material::ThinDielectric(sheet) = &materials[i] {
            let pane = ThinDielectric { passed: true, ..sheet.clone() };
            let (id, pane_id) = (MaterialId::from(i), MaterialId::from(materials.len()));
            materials.push(pane.into());
            panes.insert(id, pane_id);
            let name = names.iter().find(|(named, name)| *named == id && !name.is_empty());
            let name = name.map_or_else(|| names::of_index("material", i), |(_, name)| name.clone());
            names.push((pane_id, name));
        }
    }
    panes
}

/// A scene under construction.
struct SceneCompiler {
    names: SceneNames,
    materials: Arc<Materials>,
    /// For each thin dielectric, that which rays pass.
    panes: HashMap<MaterialId, MaterialId>,
    /// The times at which the shutter opens and closes.
    shutter: [f64; 2],
    shapes: Vec<SceneShape>,
    assembly: Assembly,
    /// The assembly's index of the description's first group. The groups before it are single moving shapes.
    first_group: usize,
    lights: Vec<Light>,
    media: MediaCompiler,
    report: CompileReport,
}

impl SceneCompiler {
    /// Adds a shape in world space. A moving shape becomes a group of its own.
    fn shape(&mut self, placed: PlacedShape) -> Result<()> {
        let steps = self.steps(&placed.to_world);
        if let [to_world] = steps[..] {
            let material = self.material_of(&placed);
            self.add_shape(placed, material, &to_world, None)?;
            return Ok(());
        }
        check_finite(&steps).map_err(|e| locate(e, &placed.name, placed.place.as_ref()))?;
        let group = self.assembly.groups.len();
        let instance = Instance::new(group as u32, &steps);
        // The vertex order of a faceted mesh defines its front side. A reflection exchanges the sides.
        let faceted = matches!(&placed.shape, Shape::Mesh(mesh) if mesh.normals.is_empty());
        let mirrored = steps[0].matrix3.determinant() < 0.0;
        let placed = PlacedShape { flip_normals: placed.flip_normals != (faceted && mirrored), ..placed };
        let material = placed.material;
        let id = self.add_shape(placed, material, &DAffine3::IDENTITY, Some(&instance))?;
        self.assembly.groups.push(vec![id.0]);
        self.assembly.instances.push(instance);
        self.names.instances.push(String::new());
        Ok(())
    }

    /// Returns the material of a shape in world space: that of a pane which rays pass, if it can be. Panes that emit or
    /// bound media scatter all rays.
    fn material_of(&self, placed: &PlacedShape) -> MaterialId {
        let is_surface = !matches!(placed.shape, Shape::Curves(_) | Shape::SdfGrid(_));
        let may_be_passed = is_surface && placed.emission.is_none() && placed.boundary.is_none();
        let pane = self.panes.get(&placed.material).filter(|_| may_be_passed);
        pane.copied().unwrap_or(placed.material)
    }

    /// Adds a group of shapes without an instance.
    fn group(&mut self, shapes: Vec<PlacedShape>) -> Result<()> {
        let mut members = Vec::with_capacity(shapes.len());
        for placed in shapes {
            let Some(to_world) = placed.to_world.fixed() else {
                let error = Error::scene("a shape inside a group cannot move by itself");
                return Err(locate(error, &placed.name, placed.place.as_ref()));
            };
            if placed.emission.is_some() {
                let error = Error::scene("a shape inside a group cannot emit light");
                return Err(locate(error, &placed.name, placed.place.as_ref()));
            }
            let material = placed.material;
            members.push(self.add_shape(placed, material, &to_world, None)?.0);
        }
        self.assembly.groups.push(members);
        Ok(())
    }

    fn instance(&mut self, placed: PlacedGroup) -> Result<()> {
        let steps = self.steps(&placed.to_world);
        let locate = |e| locate(e, &placed.name, placed.place.as_ref());
        check_finite(&steps).map_err(locate)?;
        let group = (self.first_group + placed.group) as u32;
        self.assembly.instances.push(Instance::new(group, &steps));
        self.names.instances.push(placed.name);
        Ok(())
    }

    /// Converts a motion to transforms at equally spaced times over the shutter interval.
    fn steps(&self, motion: &Motion) -> Vec<DAffine3> {
        let [open, close] = self.shutter;
        motion.steps(open, close, MOTION_TOLERANCE, MAX_STEPS)
    }

    /// Adds a shape to the list, with the given material; `motion` is that of the shape's space.
    fn add_shape(
        &mut self,
        placed: PlacedShape,
        material: MaterialId,
        to_world: &DAffine3,
        motion: Option<&Instance>,
    ) -> Result<ShapeId> {
        let PlacedShape { name, place, shape, flip_normals, emission, boundary, .. } = placed;
        let locate = |e: Error| locate(e, &name, place.as_ref());
        check_finite(std::slice::from_ref(to_world)).map_err(locate)?;
        if material.index() >= self.materials.len() {
            return Err(locate(Error::internal(format!("there is no material {}", material.0))));
        }
        let world = WorldShape::new(shape, to_world, flip_normals).map_err(locate)?;
        let emission = emission.map(|input| self.emission(input)).transpose().map_err(locate)?;
        let refused = match world {
            WorldShape::Curves(_) if emission.is_some() || !boundary.is_none() => {
                Some("curves cannot emit light or contain a medium")
            }
            WorldShape::SdfGrid(_) if emission.is_some() => Some("an sdfgrid cannot emit light"),
            _ => None,
        };
        if let Some(message) = refused {
            return Err(locate(Error::scene(message)));
        }
        let attributes = if let WorldShape::Mesh(mesh) = &world { &mesh.attributes[..] } else { &[] };
        let mut missing = BTreeSet::new();
        self.materials.attributes(material, &mut |attribute| {
            if attributes.iter().all(|a| a.name != attribute) {
                missing.insert(attribute.to_owned());
            }
        });
        for attribute in missing {
            let message =
                format!("the shape has no attribute {attribute}, which its material reads: it is black");
            self.report.warnings.push(locate(Error::scene(message)));
        }
        let mut emitter = None;
        if let Some(emission) = emission.filter(|e| !e.mean().is_black()) {
            let (triangles, most) = (world.triangle_count(), Distribution1D::MAX_ENTRIES);
            if triangles > most {
                let message =
                    format!("expected at most {most} triangles of a mesh that emits, found {triangles}");
                return Err(locate(Error::scene(message)));
            }
            match AreaEmitter::new(&world, emission, motion.cloned()) {
                Some(area) => {
                    emitter = Some(EmitterId::from(self.lights.len()));
                    self.lights.push(Light::Area(Box::new(area)));
                }
                None => self
                    .report
                    .warnings
                    .push(locate(Error::scene("the emitter has no area and emits no light"))),
            }
        }
        let id = ShapeId::from(self.shapes.len());
        let absent = emitter.is_none() && self.materials.get(material).is_absent();
        if !boundary.is_none() {
            let passed = emitter.is_none() && self.materials.get(material).holes;
            self.media.add(id, boundary, emitter.is_some(), passed.then(|| world.geometry()));
        }
        self.assembly.geometry.push(if absent { Geometry::nothing() } else { world.geometry() });
        self.shapes.push(SceneShape { world, material, described: placed.material, emitter });
        self.names.add_shape(&name);
        Ok(id)
    }

    fn emission(&self, input: Input<Rgb>) -> Result<Emission> {
        Ok(match input {
            Input::Constant(radiance) => Emission::Constant(radiance),
            Input::Texture(id) => Emission::Texture(self.texture(id)?),
        })
    }

    fn texture(&self, id: TextureId) -> Result<Arc<Texture>> {
        let texture = self.materials.textures().get(id.index()).cloned();
        texture.ok_or_else(|| Error::internal(format!("there is no texture {}", id.0)))
    }

    /// Marks the shapes with holes. Emitting shapes are not marked: they emit everywhere and must be hit everywhere.
    fn filter(&mut self) {
        let holes = |shape: &SceneShape| shape.emitter.is_none() && self.materials.get(shape.material).holes;
        let geometry: Vec<bool> = self.shapes.iter().map(holes).collect();
        if !geometry.contains(&true) {
            return;
        }
        let shape =
            |(shape, holes): (&SceneShape, &bool)| holes.then(|| (shape.world.clone(), shape.material));
        let shapes = self.shapes.iter().zip(&geometry).map(shape).collect();
        let filter = Arc::new(OpacityFilter { shapes, materials: self.materials.clone() });
        self.assembly.filter = Some(GeometryFilter { filter, geometry });
    }

    fn finish(
        mut self,
        emitters: &[Emitter],
        sensors: &[SensorSettings],
        media: Vec<Medium>,
        options: CompileOptions,
        memory: &Budget,
    ) -> Result<(Scene, CompileReport)> {
        let around = sensors.get(options.sensor).and_then(|sensor| sensor.medium);
        let emitting = (&self.lights[..], emitters);
        let media = self.media.finish(media, around, emitting, &self.assembly, options, memory)?;
        self.filter();
        let (holes, instances) = (self.assembly.filter.is_some(), self.assembly.instances.clone());
        let can_be_hit = emitters.iter().any(|emitter| !emitter.is_delta())
            || self.lights.iter().any(|light| !light.is_delta());
        let casters = if can_be_hit {
            casters::find(&self.shapes, &self.materials, &self.assembly)
        } else {
            Vec::new()
        };
        let started = Instant::now();
        let built = accel::build_within(options.accel, self.assembly.clone(), options.threads, true, memory)?;
        self.report.build_seconds = started.elapsed().as_secs_f64();
        self.report.dropped_primitives = built.dropped;
        let bounds = built.accel.bounds();
        let of_media = media.as_ref().map_or(Bounds::EMPTY, |media| media.bounds());
        let DistantEmitters { environment, sun } = self.add_emitters(emitters, bounds.union(of_media))?;
        let light_choice = choice_among(&self.lights)?;
        let camera = |(i, sensor): (usize, &SensorSettings)| match sensor.projection {
            // The others are not used.
            Projection::Surface { shape } if i == options.sensor => {
                let surface = surface_of(&self.shapes[shape]);
                let name = &self.names.shapes[shape];
                Camera::on_surface(sensor, surface.map_err(|e| e.about(format!("shape \"{name}\"")))?)
            }
            _ => Camera::for_scene(sensor, bounds),
        };
        let sensors: Vec<Camera> = sensors.iter().enumerate().map(camera).collect::<Result<_>>()?;
        let camera_moves = sensors.get(options.sensor).is_some_and(Camera::is_moving);
        let motion = instances.iter().any(Instance::is_moving);
        let has_one_ray = sensors.get(options.sensor).is_some_and(Camera::has_one_ray);
        let needs = Needs {
            // Where all samples share a ray, its time tells for which of them it passes a hole.
            time: camera_moves || motion || (holes && has_one_ray),
            motion,
            holes,
            instances: !instances.is_empty(),
            ..find_needs(&self.shapes, &self.materials, &self.lights, !light_choice.is_empty())
        };
        let [occlusion_cost, camera_path_cost] = costs(&self.shapes);
        let scene = Scene {
            shading_buckets: shading_buckets(&self.shapes, &self.materials),
            occlusion_cost,
            camera_path_cost,
            accel: built.accel,
            shapes: self.shapes,
            instances,
            materials: self.materials,
            names: self.names,
            light_selection: LightSelection::new(&self.lights),
            compensated_selection: LightSelection::compensated(&self.lights),
            light_lanes: LightLanes::new(&self.lights),
            lights: self.lights,
            light_choice,
            environment,
            sun,
            sensors,
            bounds,
            casters,
            needs,
            media,
        };
        Ok((scene, self.report))
    }

    fn add_emitters(&mut self, emitters: &[Emitter], bounds: Bounds) -> Result<DistantEmitters> {
        // A scene without extent needs a positive radius for infinite emitters.
        let radius = bounds.radius().max(f32::MIN_POSITIVE.sqrt());
        let center = if bounds.radius() > 0.0 { bounds.center() } else { Vec3::ZERO };
        let scene = BoundingSphere { center, radius };
        let mut distant = DistantEmitters::default();
        for emitter in emitters {
            let id = EmitterId::from(self.lights.len());
            if emitter.is_environment() && distant.environment.replace(id).is_some() {
                return Err(Error::scene("expected at most one environment emitter, found two"));
            }
            if emitter.is_sun() && distant.sun.replace(id).is_some() {
                return Err(Error::scene("expected at most one sun, found two"));
            }
            let light = match emitter {
                Emitter::Point { position, intensity } => {
                    Light::Point(PointEmitter { position: *position, intensity: *intensity })
                }
                Emitter::Spot { to_world, intensity, texture, cutoff_angle, beam_width } => {
                    let texture = texture.map(|id| self.texture(id)).transpose()?;
                    Light::Spot(SpotEmitter::new(to_world, *intensity, texture, *cutoff_angle, *beam_width))
                }
                Emitter::Directional { direction, irradiance } => Light::Directional(DirectionalEmitter {
                    direction: *direction,
                    irradiance: *irradiance,
                    scene,
                }),
                Emitter::Constant { radiance } => Light::Environment(Environment::constant(*radiance, scene)),
                Emitter::EnvironmentMap(map) => Light::Environment(Environment::map(map.clone(), scene)),
                Emitter::Sky(sky) => Light::Environment(Environment::sky(sky.clone(), scene)),
                Emitter::Sun { direction, half_angle, up, radiance } => {
                    Light::Sun(SunEmitter::new(*direction, *half_angle, *up, *radiance, scene))
                }
                Emitter::Projector { to_world, irradiance, scale, half_extents } => {
                    let irradiance = self.texture(*irradiance)?;
                    Light::Projector(ProjectorEmitter::new(to_world, irradiance, *scale, *half_extents))
                }
            };
            self.lights.push(light);
        }
        Ok(distant)
    }
}

/// The emitters that rays hit when they leave the scene.
#[derive(Default)]
struct DistantEmitters {
    environment: Option<EmitterId>,
    sun: Option<EmitterId>,
}

/// Returns the distribution for choosing an emitter, in proportion to power. Every emitter with power has a positive
/// probability.
fn choice_among(lights: &[Light]) -> Result<Distribution1D> {
    // A power beyond the range of `f32` is replaced by its largest number.
    let power = |light: &Light| f64::from(light.power().luminance().min(f32::MAX));
    let powers: Vec<f64> = lights.iter().map(power).collect();
    let (count, most) = (Distribution1D::count(&powers), Distribution1D::MAX_ENTRIES);
    if count > most {
        return Err(Error::scene(format!("expected at most {most} emitters, found {count}")));
    }
    Ok(Distribution1D::new(&powers))
}

/// Adds the shape's name and location to an error.
fn locate(error: Error, name: &str, place: Option<&Place>) -> Error {
    match place {
        Some(place) => error.at(place.clone()),
        None if name.is_empty() => error,
        None => error.about(format!("shape \"{name}\"")),
    }
}

fn check_finite(transforms: &[DAffine3]) -> Result<()> {
    match transforms.iter().all(DAffine3::is_finite) {
        true => Ok(()),
        false => Err(Error::scene("expected a finite to_world transform")),
    }
}

fn find_needs(shapes: &[SceneShape], materials: &Materials, lights: &[Light], can_sample: bool) -> Needs {
    let used: Vec<_> = shapes.iter().map(|s| (materials.get(s.material), s.emitter.is_some())).collect();
    let lobes: Vec<Lobes> = used.iter().map(|(material, emits)| material.lobes_of(*emits)).collect();
    let finite_lobes = lobes.iter().any(|lobes| lobes.finite);
    let distant = lights.iter().any(|l| matches!(l, Light::Environment(_) | Light::Sun(_)));
    let area_lights = lights.iter().any(|l| matches!(l, Light::Area(_)));
    Needs {
        emitter_sampling: can_sample && finite_lobes,
        hit_emitters: area_lights || distant,
        delta_emitters: lights.iter().any(Light::is_delta),
        environment: distant,
        finite_lobes,
        specular_lobes: lobes.iter().any(|lobes| lobes.deltas > 0 && !lobes.finite),
        deltas: lobes.iter().map(|lobes| lobes.deltas).max().unwrap_or(0),
        lobe_choice: used.iter().any(|(material, emits)| material.chooses_lobe(*emits)),
        gloss: lights.len() > 1 && used.iter().any(|(material, _)| material.may_be_glossy()),
        tangents: used.iter().any(|(material, _)| material.tangents),
        varying_materials: used.iter().any(|(material, _)| material.constant.is_none()),
        ..Needs::default()
    }
}

/// Returns the cost of an occlusion query, and that of a camera path without its rays, relative to a nearest-hit query
/// and the shading after it. The more primitives there are, the more a ray costs, but not what is computed besides. The
/// first is a fit to ten scenes of 10 to 10⁶ primitives, the second to twelve.
fn costs(shapes: &[SceneShape]) -> [f64; 2] {
    let primitives: usize = shapes.iter().map(|shape| shape.world.geometry().len()).sum();
    let levels = (primitives.max(1) as f64).log2();
    [0.3 + 0.0125 * levels, (0.7 - 0.05 * levels).max(0.0)]
}

/// Returns a bucket for each shape, such that the shapes of a bucket are shaded by the same code; nothing if all are.
fn shading_buckets(shapes: &[SceneShape], materials: &Materials) -> Vec<u8> {
    let key = |shape: &SceneShape| {
        let material = materials.get(shape.material);
        let mesh = matches!(shape.world, WorldShape::Mesh(_) | WorldShape::Rectangle { .. });
        // Diffuse surfaces of any colour are shaded together.
        let own = !matches!(material.constant, Some(Bsdf::Diffuse(_)));
        (material.kind, own.then_some(shape.material), mesh)
    };
    let mut keys: Vec<_> = shapes.iter().map(key).collect();
    keys.sort_unstable();
    keys.dedup();
    if keys.len() < 2 {
        return Vec::new();
    }
    let bucket = |shape| {
        let rank = keys.partition_point(|other| *other < key(shape));
        (rank * 256 / keys.len().max(256)) as u8
    };
    shapes.iter().map(bucket).collect()
}
