//! The scene: described as plain data, compiled to arrays and ids.

pub mod compile;
pub mod description;
pub mod interaction;
pub mod needs;

pub use compile::{CompileOptions, CompileReport, compile};
pub use description::Description;
pub use interaction::SurfaceInteraction;
pub use needs::Needs;

use crate::accel::{Accel, Hit};
use crate::bsdf::Bsdf;
use crate::color::Rgb;
use crate::emitter::{EmitterSample, Light, Target};
use crate::ids::{EmitterId, MaterialId, ShapeId};
use crate::math::ray::{offset_origin, plane_error};
use crate::math::{Bounds, Frame, Ray, Vec2, Vec3};
use crate::sampling::Distribution1D;
use crate::sensor::Perspective;
use crate::shape::WorldShape;

/// A shape of the compiled scene.
pub struct SceneShape {
    /// Its geometry.
    pub world: WorldShape,
    /// Its material.
    pub material: MaterialId,
    /// Its emitter, if its front emits.
    pub emitter: Option<EmitterId>,
}

/// A material of the compiled scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneMaterial {
    /// Scattering on the front.
    pub bsdf: Bsdf,
    /// Whether the back scatters as the front does.
    pub two_sided: bool,
}

/// A compiled scene: arrays, ids and an accelerator. It is `Sync` and never changes.
pub struct Scene {
    /// Answers ray queries.
    pub accel: Box<dyn Accel>,
    /// The shapes; a hit's geometry index is a shape's id.
    pub shapes: Vec<SceneShape>,
    /// The materials.
    pub materials: Vec<SceneMaterial>,
    /// The emitters.
    pub lights: Vec<Light>,
    /// Which emitter to sample, in proportion to power.
    pub light_choice: Distribution1D,
    /// The emitter that rays find when they leave the scene.
    pub environment: Option<EmitterId>,
    /// The sensors.
    pub sensors: Vec<Perspective>,
    /// The box around all shapes.
    pub bounds: Bounds,
    /// What the scene uses.
    pub needs: Needs,
}

impl Scene {
    /// The surface point of a hit of `ray`. The frame of a two-sided material looks to the ray's side.
    #[inline]
    pub fn interaction(&self, ray: &Ray, hit: &Hit) -> SurfaceInteraction {
        let shape = &self.shapes[hit.geometry as usize];
        let surface = match &shape.world {
            WorldShape::Mesh(mesh) | WorldShape::Rectangle { mesh, .. } => {
                interaction::mesh_point(mesh, hit.primitive, hit.u, hit.v)
            }
            WorldShape::Sphere { center, radius, inward } => {
                interaction::sphere_point(*center, *radius, *inward, ray.at(hit.t))
            }
            WorldShape::Disk { center, du, dv, normal } => {
                interaction::disk_point(*center, *du, *dv, *normal, hit.u, hit.v)
            }
        };
        let material = &self.materials[shape.material.index()];
        let front = surface.ns.dot(ray.d) < 0.0;
        let flip = material.two_sided && !front;
        let n = if flip { -surface.ns } else { surface.ns };
        let frame = if self.needs.tangents && material.bsdf.is_anisotropic() {
            let tangent = interaction::tangent(&shape.world, hit.primitive, hit.u, hit.v, surface.p);
            Frame::from_normal_tangent(n, tangent)
        } else {
            Frame::from_normal(n)
        };
        SurfaceInteraction {
            p: surface.p,
            error: plane_error(surface.p_error, surface.ng),
            ng: if flip { -surface.ng } else { surface.ng },
            frame,
            front,
            shape: ShapeId(hit.geometry),
            material: shape.material,
        }
    }

    /// The BSDF at a surface point.
    #[inline]
    pub fn bsdf(&self, at: &SurfaceInteraction) -> &Bsdf {
        &self.materials[at.material.index()].bsdf
    }

    /// Texture coordinates of a hit.
    pub fn uv(&self, at: &SurfaceInteraction, hit: &Hit) -> Vec2 {
        interaction::uv(&self.shapes[hit.geometry as usize].world, hit.primitive, hit.u, hit.v, at.p)
    }

    /// The emitter of the surface, if it emits on the side that the ray came from.
    #[inline]
    pub fn emitter_at(&self, at: &SurfaceInteraction) -> Option<EmitterId> {
        self.shapes[at.shape.index()].emitter.filter(|_| at.front)
    }

    /// Radiance of an area or environment emitter.
    #[inline]
    pub fn emitted(&self, emitter: EmitterId) -> Rgb {
        match &self.lights[emitter.index()] {
            Light::Area(area) => area.radiance(),
            Light::Constant { radiance, .. } => *radiance,
            Light::Point { .. } => Rgb::BLACK,
        }
    }

    /// The density per unit solid angle with which [`sample_emitter`](Self::sample_emitter) finds the surface
    /// point `at` from `from`.
    #[inline]
    pub fn emitter_pdf(&self, emitter: EmitterId, from: Vec3, at: &SurfaceInteraction) -> f32 {
        match &self.lights[emitter.index()] {
            Light::Area(area) => self.light_choice.pmf(emitter.index()) * area.pdf(from, at.p, at.ng),
            Light::Point { .. } | Light::Constant { .. } => 0.0,
        }
    }

    /// The density per unit solid angle with which [`sample_emitter`](Self::sample_emitter) draws a direction
    /// of the environment.
    #[inline]
    pub fn environment_pdf(&self, emitter: EmitterId) -> f32 {
        self.light_choice.pmf(emitter.index()) * self.lights[emitter.index()].pdf_environment()
    }

    /// Draws an emitter and a direction to it as seen from `from`; densities include the choice.
    #[inline]
    pub fn sample_emitter(&self, from: Vec3, u_choice: f32, u: Vec2) -> Option<EmitterSample> {
        let choice = self.light_choice.sample(u_choice)?;
        let mut sample = self.lights[choice.index].sample(from, u)?;
        sample.pdf *= choice.pmf;
        Some(sample)
    }

    /// A shadow ray from a surface point to an emitter. It ends short of the emitter by no more than rounding.
    #[inline]
    pub fn shadow_ray(&self, at: &SurfaceInteraction, sample: &EmitterSample, time: f32) -> Ray {
        let o = offset_origin(at.p, at.error, at.ng, sample.wi);
        match sample.target {
            Target::Point(target) => Ray { o, t_max: 1.0, d: target - o, time },
            Target::Infinity => Ray { o, t_max: f32::INFINITY, d: sample.wi, time },
        }
    }

    /// The ray that leaves a surface point in the world direction `wi`.
    #[inline]
    pub fn spawn_ray(&self, at: &SurfaceInteraction, wi: Vec3, time: f32) -> Ray {
        Ray { o: offset_origin(at.p, at.error, at.ng, wi), t_max: f32::INFINITY, d: wi, time }
    }

    /// Triangles of all shapes.
    pub fn triangle_count(&self) -> usize {
        self.shapes.iter().map(|s| s.world.triangle_count()).sum()
    }

    /// Bytes of the shapes' arrays.
    pub fn mesh_bytes(&self) -> usize {
        self.shapes.iter().map(|s| s.world.memory_bytes()).sum()
    }
}
