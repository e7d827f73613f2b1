//! From a description to a scene: transforms applied, emitters made samplable, the accelerator built.

use super::description::{Description, PlacedShape};
use super::{Needs, Scene, SceneMaterial, SceneShape};
use crate::accel::{self, AccelKind};
use crate::bsdf::fresnel::ConductorFresnel;
use crate::bsdf::microfacet::Microfacets;
use crate::bsdf::{Bsdf, Conductor, Dielectric, Diffuse, RoughConductor};
use crate::emitter::{AreaEmitter, Emitter, Light};
use crate::error::{Error, Result};
use crate::ids::{EmitterId, MaterialId};
use crate::material::Material;
use crate::math::Bounds;
use crate::sampling::Distribution1D;
use crate::sensor::Perspective;
use crate::shape::WorldShape;
use std::time::Instant;

/// How to compile.
#[derive(Clone, Copy, Debug)]
pub struct CompileOptions {
    /// The accelerator.
    pub accel: AccelKind,
    /// Threads for building it.
    pub threads: usize,
}

/// What happened on the way.
#[derive(Clone, Debug, Default)]
pub struct CompileReport {
    /// Invalid primitives (not finite, out of range) that no ray can hit.
    pub dropped_primitives: usize,
    /// Emitters that cannot emit (no area, no power), with the reason.
    pub warnings: Vec<Error>,
    /// Seconds spent building the accelerator.
    pub build_seconds: f64,
}

/// Compiles a description.
///
/// # Errors
/// If a transform is not finite, a sphere is squeezed, a sensor is singular, or the accelerator cannot be built.
pub fn compile(description: Description, options: CompileOptions) -> Result<(Scene, CompileReport)> {
    let mut report = CompileReport::default();
    let materials: Vec<SceneMaterial> = (0..description.materials.len())
        .map(|i| scene_material(&description.materials, i))
        .collect::<Result<_>>()?;
    let mut lights = Vec::new();
    let mut shapes = Vec::with_capacity(description.shapes.len());
    for placed in description.shapes {
        shapes.push(place_shape(placed, &materials, &mut lights, &mut report)?);
    }
    let started = Instant::now();
    let geometry: Vec<_> = shapes.iter().map(|s| s.world.geometry()).collect();
    let built = accel::build(options.accel, geometry, options.threads, true)?;
    report.build_seconds = started.elapsed().as_secs_f64();
    report.dropped_primitives = built.dropped;
    let bounds = built.accel.bounds();
    let environment = add_emitters(&description.emitters, bounds, &mut lights)?;
    let powers: Vec<f64> = lights.iter().map(|l| f64::from(l.power().luminance())).collect();
    let light_choice = Distribution1D::new(&powers);
    let sensors = description.sensors.iter().map(Perspective::new).collect::<Result<_>>()?;
    let needs = find_needs(&shapes, &materials, &lights, !light_choice.is_empty(), environment);
    let scene = Scene {
        accel: built.accel,
        shapes,
        materials,
        lights,
        light_choice,
        environment,
        sensors,
        bounds,
        needs,
    };
    Ok((scene, report))
}

fn place_shape(
    placed: PlacedShape,
    materials: &[SceneMaterial],
    lights: &mut Vec<Light>,
    report: &mut CompileReport,
) -> Result<SceneShape> {
    let PlacedShape { name, place, shape, to_world, flip_normals, material, emission } = placed;
    let locate = |e: Error| match &place {
        Some(place) => e.at(place.clone()),
        None if name.is_empty() => e,
        None => e.about(format!("shape \"{name}\"")),
    };
    if !to_world.is_finite() {
        return Err(locate(Error::scene("expected a finite to_world transform")));
    }
    if material.index() >= materials.len() {
        return Err(locate(Error::internal(format!("there is no material {}", material.0))));
    }
    let world = WorldShape::new(shape, &to_world, flip_normals).map_err(locate)?;
    let mut emitter = None;
    if let Some(radiance) = emission.filter(|r| !r.is_black()) {
        match AreaEmitter::new(&world, radiance) {
            Some(area) => {
                emitter = Some(EmitterId::from(lights.len()));
                lights.push(Light::Area(area));
            }
            None => report.warnings.push(locate(Error::scene("an emitter without area sends no light"))),
        }
    }
    Ok(SceneShape { world, material, emitter })
}

fn add_emitters(emitters: &[Emitter], bounds: Bounds, lights: &mut Vec<Light>) -> Result<Option<EmitterId>> {
    let mut environment = None;
    for emitter in emitters {
        match emitter {
            Emitter::Point { position, intensity } => {
                lights.push(Light::Point { position: *position, intensity: *intensity });
            }
            Emitter::Constant { radiance } => {
                if environment.replace(EmitterId::from(lights.len())).is_some() {
                    return Err(Error::scene("expected at most one environment emitter, found two"));
                }
                // A scene without extent still has light around it.
                let scene_radius = bounds.radius().max(f32::MIN_POSITIVE.sqrt());
                lights.push(Light::Constant { radiance: *radiance, scene_radius });
            }
        }
    }
    Ok(environment)
}

fn scene_material(materials: &[Material], index: usize) -> Result<SceneMaterial> {
    let one_sided = |bsdf| SceneMaterial { bsdf, two_sided: false };
    Ok(match &materials[index] {
        Material::Diffuse { reflectance } => one_sided(Bsdf::Diffuse(Diffuse { reflectance: *reflectance })),
        Material::Conductor { eta, k, specular_reflectance } => one_sided(Bsdf::Conductor(Conductor {
            fresnel: ConductorFresnel { eta: *eta, k: *k },
            specular_reflectance: *specular_reflectance,
        })),
        Material::RoughConductor { distribution, alpha, sample_visible, eta, k, specular_reflectance } => {
            one_sided(Bsdf::RoughConductor(RoughConductor {
                microfacets: Microfacets {
                    distribution: *distribution,
                    // Below this, squares of the roughness leave the range of f32.
                    alpha_x: alpha[0].max(1e-4),
                    alpha_y: alpha[1].max(1e-4),
                    sample_visible: *sample_visible,
                },
                fresnel: ConductorFresnel { eta: *eta, k: *k },
                specular_reflectance: *specular_reflectance,
            }))
        }
        Material::Dielectric { int_ior, ext_ior, specular_reflectance, specular_transmittance } => {
            one_sided(Bsdf::Dielectric(Dielectric {
                eta: int_ior / ext_ior,
                specular_reflectance: *specular_reflectance,
                specular_transmittance: *specular_transmittance,
            }))
        }
        Material::TwoSided(MaterialId(inner)) => {
            let inner = *inner as usize;
            match materials.get(inner) {
                Some(Material::TwoSided(_)) | None => {
                    return Err(Error::scene("expected a one-sided material inside a twosided one"));
                }
                Some(Material::Dielectric { .. }) => {
                    return Err(Error::scene("a material that transmits light cannot be made twosided"));
                }
                Some(_) => SceneMaterial { two_sided: true, ..scene_material(materials, inner)? },
            }
        }
    })
}

fn find_needs(
    shapes: &[SceneShape],
    materials: &[SceneMaterial],
    lights: &[Light],
    can_sample: bool,
    environment: Option<EmitterId>,
) -> Needs {
    let used: Vec<&Bsdf<'_>> = shapes.iter().map(|s| &materials[s.material.index()].bsdf).collect();
    let finite_lobes = used.iter().any(|b| !b.is_specular());
    let area_lights = lights.iter().any(|l| matches!(l, Light::Area(_)));
    Needs {
        emitter_sampling: can_sample && finite_lobes,
        hit_emitters: area_lights || environment.is_some(),
        environment: environment.is_some(),
        finite_lobes,
        specular_lobes: used.iter().any(|b| b.is_specular()),
        lobe_choice: used.iter().any(|b| matches!(b, Bsdf::Dielectric(_))),
        tangents: used.iter().any(|b| b.is_anisotropic()),
    }
}
