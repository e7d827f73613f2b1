//! The scene: described as plain data, compiled to arrays and ids.

pub mod compile;
pub mod description;
pub mod interaction;
pub mod needs;

pub use compile::{CompileOptions, CompileReport, compile};
pub use description::Description;
pub use interaction::{SurfaceInteraction, SurfaceInteractionX16};
pub use needs::Needs;

use crate::accel::{Accel, Hit};
use crate::bsdf::Bsdf;
use crate::color::Rgb;
use crate::emitter::{self, EmitterSample, EmitterSampleX16, Light};
use crate::ids::{EmitterId, MaterialId, ShapeId};
use crate::math::lanes::{bits, mask_from_bits};
use crate::math::ray::{offset_origin, offset_origin_x16};
use crate::math::{Bounds, Frame, FrameX16, LANES, Ray, RayX16, Vec2, Vec3, Vec3x16, f32x16};
use crate::sampling::Distribution1D;
use crate::sensor::Perspective;
use crate::shape::WorldShape;
use interaction::{CornersX16, SurfaceX16};

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
    pub bsdf: Bsdf<'static>,
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
    pub fn interaction(&self, ray: &Ray, hit: &Hit) -> SurfaceInteraction {
        self.interactions(&RayX16::splat(ray), &[*hit; LANES]).lane(0)
    }

    /// As [`interaction`](Self::interaction), for sixteen rays.
    #[inline]
    pub fn interactions(&self, rays: &RayX16, hits: &[Hit; LANES]) -> SurfaceInteractionX16 {
        let mut corners = CornersX16::new();
        let (mut u, mut v) = ([0.0; LANES], [0.0; LANES]);
        let (mut analytic, mut two_sided, mut emitters, mut anisotropic) = (0, 0, 0, 0);
        let mut material = [MaterialId(0); LANES];
        for (i, hit) in hits.iter().enumerate() {
            let shape = &self.shapes[hit.geometry as usize];
            match &shape.world {
                WorldShape::Mesh(mesh) | WorldShape::Rectangle { mesh, .. } => {
                    corners.set_lane(i, mesh, hit.primitive);
                }
                WorldShape::Sphere { .. } | WorldShape::Disk { .. } => analytic |= 1 << i,
            }
            (u[i], v[i]) = (hit.u, hit.v);
            material[i] = shape.material;
            let SceneMaterial { bsdf, two_sided: both } = &self.materials[shape.material.index()];
            two_sided |= u32::from(*both) << i;
            emitters |= u32::from(shape.emitter.is_some()) << i;
            anisotropic |= u32::from(self.needs.tangents && bsdf.is_anisotropic()) << i;
        }
        let SurfaceX16 { mut p, mut error, mut ng, mut ns } = corners.surface(f32x16::new(u), f32x16::new(v));
        for i in bits(analytic) {
            let surface = self.analytic_surface(&hits[i], &|| rays.o.lane(i) + rays.d.lane(i) * hits[i].t);
            p.set_lane(i, surface.p);
            error.as_mut_array()[i] = surface.error;
            ng.set_lane(i, surface.n);
            ns.set_lane(i, surface.n);
        }
        let front = ns.dot(rays.d).simd_lt(f32x16::ZERO).to_bitmask();
        let flip = two_sided & !front;
        if flip != 0 {
            let flip = mask_from_bits(flip);
            ns = Vec3x16::select(flip, -ns, ns);
            ng = Vec3x16::select(flip, -ng, ng);
        }
        let mut frame = FrameX16::from_normal(ns);
        for i in bits(anisotropic) {
            let Hit { geometry, primitive, u, v, .. } = hits[i];
            let shape = &self.shapes[geometry as usize].world;
            let tangent = interaction::tangent(shape, primitive, u, v, p.lane(i));
            frame.set_lane(i, Frame::from_normal_tangent(ns.lane(i), tangent));
        }
        let shape = hits.map(|hit| ShapeId(hit.geometry));
        SurfaceInteractionX16 { p, error, ng, frame, front, emitting: emitters & front, shape, material }
    }

    /// The point of a sphere or disk; `at` is the ray's point at the hit.
    fn analytic_surface(&self, hit: &Hit, at: &dyn Fn() -> Vec3) -> interaction::Surface {
        match &self.shapes[hit.geometry as usize].world {
            WorldShape::Sphere { center, radius, inward } => {
                interaction::sphere_point(*center, *radius, *inward, at())
            }
            WorldShape::Disk { center, du, dv, normal } => {
                interaction::disk_point(*center, *du, *dv, *normal, hit.u, hit.v)
            }
            WorldShape::Mesh(_) | WorldShape::Rectangle { .. } => unreachable!("a mesh is not analytic"),
        }
    }

    /// The BSDF at a surface point.
    #[inline]
    pub fn bsdf(&self, at: &SurfaceInteraction) -> &Bsdf<'_> {
        &self.materials[at.material.index()].bsdf
    }

    /// The BSDF of a material.
    #[inline]
    pub fn bsdf_of(&self, material: MaterialId) -> &Bsdf<'_> {
        &self.materials[material.index()].bsdf
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

    /// As [`sample_emitter`](Self::sample_emitter), from sixteen points, for the lanes in the bits of `active`.
    #[inline]
    pub fn sample_emitters(
        &self,
        from: Vec3x16,
        u_choice: f32x16,
        u: [f32x16; 2],
        active: u32,
    ) -> EmitterSampleX16 {
        if let [light] = self.lights.as_slice() {
            return emitter::lanes::sample_x16([light; LANES], from, u, active);
        }
        let Some(first) = self.lights.first() else {
            return EmitterSampleX16::NONE;
        };
        let mut lights = [first; LANES];
        let mut pmf = [0.0; LANES];
        let mut chosen = 0;
        for i in bits(active) {
            if let Some(choice) = self.light_choice.sample(u_choice.as_array()[i]) {
                lights[i] = &self.lights[choice.index];
                pmf[i] = choice.pmf;
                chosen |= 1 << i;
            }
        }
        let mut samples = emitter::lanes::sample_x16(lights, from, u, chosen);
        samples.pdf *= f32x16::new(pmf);
        samples.valid &= mask_from_bits(chosen);
        samples
    }

    /// Shadow rays from surface points to emitters. They end short of the emitter by no more than rounding.
    #[inline]
    pub fn shadow_rays(&self, at: &SurfaceInteractionX16, sample: &EmitterSampleX16, time: f32x16) -> RayX16 {
        let o = offset_origin_x16(at.p, at.error, at.ng, sample.wi);
        RayX16 {
            o,
            t_max: sample.at_infinity.select(f32x16::splat(f32::INFINITY), f32x16::ONE),
            d: Vec3x16::select(sample.at_infinity, sample.wi, sample.target - o),
            time,
        }
    }

    /// The rays that leave surface points in the world directions `wi`.
    #[inline]
    pub fn spawn_rays(&self, at: &SurfaceInteractionX16, wi: Vec3x16, time: f32x16) -> RayX16 {
        let o = offset_origin_x16(at.p, at.error, at.ng, wi);
        RayX16 { o, t_max: f32x16::splat(f32::INFINITY), d: wi, time }
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
