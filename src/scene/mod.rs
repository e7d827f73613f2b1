//! The scene: a description as plain data, compiled to arrays and ids.

mod casters;
pub mod compile;
pub mod description;
mod holes;
pub mod interaction;
pub mod media;
mod meter;
pub mod names;
pub mod needs;

pub use compile::{CompileOptions, CompileReport, compile, compile_within};
pub use description::Description;
pub use interaction::{Facet, SurfaceInteraction, SurfaceInteractionX16};
pub use media::SceneMedia;
pub use names::SceneNames;
pub use needs::Needs;

use crate::accel::{Accel, Hit, Instance, NO_INSTANCE};
use crate::bsdf::{Bsdf, Mask};
use crate::color::Rgb;
use crate::emitter::lanes::LightLanes;
use crate::emitter::{
    BoundingSphere, ChoiceX16, EmitterHit, EmitterSample, EmitterSampleX16, Light, LightRay, LightSelection,
    Receiver, ReceiverX16, ShadowTarget,
};
use crate::ids::{EmitterId, MaterialId};
use crate::material::{MaterialPoint, Materials, Scattering, SceneMaterial};
use crate::math::lanes::{bits, mask_from_bits};
use crate::math::ray::{offset_origin, offset_origin_x16};
use crate::math::{Bounds, Frame, FrameX16, LANES, Ray, RayX16, Vec2, Vec3, Vec3x16, f32x16};
use crate::sampling::Distribution1D;
use crate::sensor::Camera;
use crate::shape::{Placement, WorldShape};
use bumpalo::Bump;
use interaction::{CornersX16, SpheresX16, SurfaceX16};
use std::sync::Arc;

/// A shape of the compiled scene.
pub struct SceneShape {
    /// The geometry in world space or group space.
    pub world: WorldShape,
    /// The material.
    pub material: MaterialId,
    /// The material in the description, which is another one for a pane that rays pass.
    pub described: MaterialId,
    /// The emitter, if the front side emits.
    pub emitter: Option<EmitterId>,
}

/// A compiled scene: arrays, ids and an accelerator. It is `Sync` and immutable.
pub struct Scene {
    /// The accelerator of ray queries.
    pub accel: Box<dyn Accel>,
    /// The shapes. The geometry index of a hit is a shape's id.
    pub shapes: Vec<SceneShape>,
    /// For each shape, the bucket into which a wave is sorted before its hits are shaded; empty if there is only one.
    pub shading_buckets: Vec<u8>,
    /// The instances of groups of shapes, indexed by a hit's instance.
    pub instances: Vec<Instance>,
    /// The materials.
    pub materials: Arc<Materials>,
    /// The names of shapes, instances and materials.
    pub names: SceneNames,
    /// The emitters.
    pub lights: Vec<Light>,
    /// The emitters, prepared for sampling sixteen at a time.
    pub light_lanes: LightLanes,
    /// The distribution for choosing the emitter of a light path, in proportion to power.
    pub light_choice: Distribution1D,
    /// The choice of an emitter for a surface point.
    pub light_selection: LightSelection,
    /// The choice for a surface point at which the BSDF is sampled too, if it is another one.
    pub compensated_selection: Option<LightSelection>,
    /// The emitter around the scene, which rays that leave the scene hit.
    pub environment: Option<EmitterId>,
    /// The sun's disc, which rays that leave the scene hit in addition.
    pub sun: Option<EmitterId>,
    /// The sensors.
    pub sensors: Vec<Camera>,
    /// The bounding box of all shapes.
    pub bounds: Bounds,
    /// Spheres around the surfaces with Dirac deltas, over all times, if there are emitters that scattered rays can
    /// hit.
    pub casters: Vec<BoundingSphere>,
    /// The features that the scene uses.
    pub needs: Needs,
    /// The cost of an occlusion query relative to that of a nearest-hit query and the shading after it.
    pub occlusion_cost: f64,
    /// The cost of a camera path without its rays, in nearest-hit queries.
    pub camera_path_cost: f64,
    /// The participating media, if there are any. Integrators other than `volpath` and `bdpt` ignore
    /// them.
    pub media: Option<Box<SceneMedia>>,
}

impl Scene {
    /// Returns whether the surface of a hit may scatter by Dirac deltas.
    pub fn has_deltas(&self, hit: &Hit) -> bool {
        let shape = &self.shapes[hit.geometry as usize];
        self.materials.get(shape.material).lobes_of(shape.emitter.is_some()).deltas > 0
    }

    /// Computes the surface interaction of a hit of `ray`. The frame of a two-sided material is flipped to the ray's
    /// side.
    pub fn interaction(&self, ray: &Ray, hit: &Hit) -> SurfaceInteraction {
        self.interactions(&RayX16::splat(ray), &[*hit; LANES]).lane(0)
    }

    /// Computes [`interaction`](Self::interaction) for sixteen rays.
    #[inline]
    pub fn interactions(&self, rays: &RayX16, hits: &[Hit; LANES]) -> SurfaceInteractionX16 {
        let (mut corners, mut spheres) = (CornersX16::new(), SpheresX16::default());
        let (mut u, mut v) = ([0.0; LANES], [0.0; LANES]);
        let (mut in_spheres, mut analytic, mut two_sided, mut emitters, mut tangents, mut placed) =
            (0, 0, 0, 0, 0, 0);
        let mut material = [MaterialId(0); LANES];
        for (i, hit) in hits.iter().enumerate() {
            let shape = &self.shapes[hit.geometry as usize];
            match &shape.world {
                WorldShape::Mesh(mesh) | WorldShape::Rectangle { mesh, .. } => {
                    corners.set_lane(i, mesh, hit.primitive);
                }
                WorldShape::Sphere { center, radius, inward, .. } => {
                    spheres.set_lane(i, *center, *radius, *inward);
                    in_spheres |= 1 << i;
                }
                _ => analytic |= 1 << i,
            }
            (u[i], v[i]) = (hit.u, hit.v);
            material[i] = shape.material;
            let surface = self.materials.get(shape.material);
            two_sided |= u32::from(surface.two_sided) << i;
            emitters |= u32::from(shape.emitter.is_some()) << i;
            tangents |= u32::from(surface.tangents) << i;
            placed |= u32::from(hit.instance != NO_INSTANCE) << i;
        }
        let mut surface = corners.surface(f32x16::new(u), f32x16::new(v));
        let mut near = Vec3x16::default();
        if in_spheres | analytic != 0 {
            near = rays.o + rays.d * f32x16::new(hits.map(|hit| hit.t));
            for i in bits((in_spheres | analytic) & placed) {
                near.set_lane(i, self.local_point(&hits[i], rays.time.as_array()[i], near.lane(i)));
            }
        }
        if in_spheres != 0 {
            surface.set_lanes(in_spheres, &spheres.surface(near));
        }
        let SurfaceX16 { mut p, mut error, mut ng, mut ns } = surface;
        for i in bits(analytic) {
            let surface = self.analytic_surface(&hits[i], near.lane(i));
            p.set_lane(i, surface.p);
            error.as_mut_array()[i] = surface.error;
            ng.set_lane(i, surface.ng);
            ns.set_lane(i, surface.ns);
        }
        for i in bits(placed) {
            let (instance, time) = (&self.instances[hits[i].instance as usize], rays.time.as_array()[i]);
            let placement = Placement::new(instance, time);
            let at = placement.surface(instance, time, p.lane(i), error.as_array()[i], ng.lane(i));
            p.set_lane(i, at.p);
            error.as_mut_array()[i] = at.error;
            ng.set_lane(i, at.n);
            ns.set_lane(i, placement.normal(ns.lane(i)));
        }
        let front = ns.dot(rays.d).simd_lt(f32x16::ZERO).to_bitmask();
        // Light leaves the geometric front side, as in emitter sampling.
        let emitting = emitters & ng.dot(rays.d).simd_lt(f32x16::ZERO).to_bitmask();
        let mut frame = FrameX16::from_normal(ns);
        for i in bits(tangents) {
            let [tangent, _] = self.partials(&hits[i], rays.time.as_array()[i], p.lane(i));
            frame.set_lane(i, Frame::from_normal_tangent(ns.lane(i), tangent));
        }
        // On the back of a two-sided material, the frame is mirrored at the surface.
        let flip = two_sided & !front;
        if flip != 0 {
            let flip = mask_from_bits(flip);
            frame.n = Vec3x16::select(flip, -ns, ns);
            ng = Vec3x16::select(flip, -ng, ng);
        }
        SurfaceInteractionX16 { p, error, ng, frame, emitting, hit: *hits, time: rays.time, material }
    }

    /// Returns the point of an analytic surface that is no sphere; `p` is the ray's point at the hit, in the space of
    /// the shape.
    fn analytic_surface(&self, hit: &Hit, p: Vec3) -> interaction::AnalyticPoint {
        match &self.shapes[hit.geometry as usize].world {
            WorldShape::Disk { center, du, dv, normal } => {
                interaction::disk_point(*center, *du, *dv, *normal, hit.u, hit.v)
            }
            WorldShape::Cylinder { p0, p1, side, inward } => {
                interaction::cylinder_point([*p0, *p1], *side, *inward, p)
            }
            WorldShape::Curves(curves) => interaction::curve_point(curves, hit, p),
            WorldShape::SdfGrid(grid) => interaction::sdf_point(grid, hit, p),
            WorldShape::Mesh(_) | WorldShape::Rectangle { .. } | WorldShape::Sphere { .. } => {
                unreachable!("computed in lanes")
            }
        }
    }

    /// Transforms a hit point from world space to the shape's space.
    fn local_point(&self, hit: &Hit, time: f32, p: Vec3) -> Vec3 {
        match self.instances.get(hit.instance as usize) {
            Some(instance) => Placement::new(instance, time).local_point(p),
            None => p,
        }
    }

    /// Returns the derivatives of the world-space position with respect to the texture coordinates at a hit.
    fn partials(&self, hit: &Hit, time: f32, p: Vec3) -> [Vec3; 2] {
        let shape = &self.shapes[hit.geometry as usize].world;
        match self.instances.get(hit.instance as usize) {
            Some(instance) => {
                let placement = Placement::new(instance, time);
                shape.partials(hit, placement.local_point(p)).map(|d| placement.vector(d))
            }
            None => shape.partials(hit, p),
        }
    }

    /// Returns whether rays pass thin panes as they pass holes.
    pub fn passes_panes(&self) -> bool {
        self.materials.iter().any(SceneMaterial::is_pane)
    }

    /// Returns the BSDF at a surface point for the direction `wo` to the viewer, in the point's frame; without `wo`,
    /// for light scattered towards unknown viewers (see [`Bsdf::sample_adjoint`]). A BSDF that varies over the
    /// surface is allocated in the arena.
    #[inline]
    pub fn bsdf<'a>(&'a self, at: &SurfaceInteraction, wo: Option<Vec3>, arena: &'a Bump) -> &'a Bsdf<'a> {
        let material = self.materials.get(at.material);
        match &material.constant {
            Some(bsdf) => bsdf,
            None => arena
                .alloc(self.materials.uniform(material).unwrap_or_else(|| self.varying_bsdf(at, wo, arena))),
        }
    }

    /// Returns the BSDFs at sixteen surface points, as [`bsdf`](Self::bsdf) does for one.
    #[inline]
    pub fn bsdfs<'a>(
        &'a self,
        at: &SurfaceInteractionX16,
        wo: Option<&Vec3x16>,
        arena: &'a Bump,
    ) -> [&'a Bsdf<'a>; LANES] {
        let mut last: &'a Bsdf<'a> = &Bsdf::Null;
        let mut bsdfs = [last; LANES];
        for (i, bsdf) in bsdfs.iter_mut().enumerate() {
            let material = self.materials.get(at.material[i]);
            *bsdf = match &material.constant {
                Some(constant) => constant,
                // Neighbours often have the same material.
                None if i > 0 && material.uniform && at.material[i] == at.material[i - 1] => last,
                None => self.varying_bsdf_in_lane(material, at, i, wo, arena),
            };
            last = bsdf;
        }
        bsdfs
    }

    /// Returns the BSDF of a varying material in one lane.
    #[inline]
    fn varying_bsdf_in_lane<'a>(
        &'a self,
        material: &'a SceneMaterial,
        at: &SurfaceInteractionX16,
        i: usize,
        wo: Option<&Vec3x16>,
        arena: &'a Bump,
    ) -> &'a Bsdf<'a> {
        if material.plain && !material.uniform && (wo.is_some() || !material.two_sided) {
            let (hit, world) = (&at.hit[i], &self.shapes[at.hit[i].geometry as usize].world);
            let p = self.local_point(hit, at.time.as_array()[i], at.p.lane(i));
            if let Some(bsdf) = self.materials.textured(material, &world.texture_point(hit, p)) {
                return arena.alloc(bsdf);
            }
        }
        self.bsdf(&at.lane(i), wo.map(|wo| wo.lane(i)), arena)
    }

    /// Returns the BSDF of a material that is constant over the surface.
    ///
    /// # Panics
    /// If it varies.
    #[inline]
    pub fn constant_bsdf(&self, material: MaterialId) -> &Bsdf<'_> {
        self.materials.get(material).constant.as_ref().expect("the material is the same everywhere")
    }

    /// Returns the BSDF of a varying material at a point.
    fn varying_bsdf<'a>(&'a self, at: &SurfaceInteraction, wo: Option<Vec3>, arena: &'a Bump) -> Bsdf<'a> {
        let shape = &self.shapes[at.shape().index()];
        let point = MaterialPoint {
            texture: shape.world.texture_point(&at.hit, self.local_point(&at.hit, at.time, at.p)),
            frame: at.frame,
            ng: at.ng,
            dp_duv: match self.materials.get(at.material).tangents {
                true => self.partials(&at.hit, at.time, at.p),
                false => [Vec3::ZERO; 2],
            },
            wo,
        };
        let Scattering { bsdf, opacity } = match wo {
            Some(_) => self.materials.scattering(at.material, &point, arena),
            // The frame is flipped to the light's side. The viewer may be on the other side, so the BSDF covers both.
            None => self.materials.inner(at.material, &point, arena),
        };
        // On surfaces that do not emit, rays hit only where the surface exists. Emitting surfaces are hit everywhere,
        // because they emit everywhere.
        if opacity < 1.0 && shape.emitter.is_some() {
            return Bsdf::Mask(Mask { opacity, inner: arena.alloc(bsdf) });
        }
        bsdf
    }

    /// Returns the probability, in [0, 1], that a ray through a surface point hits the surface: the opacity, or 1 if
    /// the surface emits.
    pub fn hit_probability(&self, at: &SurfaceInteraction) -> f32 {
        let shape = &self.shapes[at.shape().index()];
        if !self.materials.get(at.material).holes || shape.emitter.is_some() {
            return 1.0;
        }
        let point = shape.world.texture_point(&at.hit, self.local_point(&at.hit, at.time, at.p));
        // Nothing is stored on a pane, which scatters by Dirac deltas only.
        self.materials.opacity(at.material, &point, 1.0)
    }

    /// Returns the texture coordinates of a surface point.
    pub fn uv(&self, at: &SurfaceInteraction) -> Vec2 {
        let p = self.local_point(&at.hit, at.time, at.p);
        self.shapes[at.shape().index()].world.uv(&at.hit, p)
    }

    /// Returns the emitter of the surface, if it emits towards the ray's origin.
    #[inline]
    pub fn emitter_at(&self, at: &SurfaceInteraction) -> Option<EmitterId> {
        self.shapes[at.shape().index()].emitter.filter(|_| at.emitting)
    }

    /// Returns the radiance of the area emitter at a point of its surface.
    #[inline]
    pub fn emitted(&self, emitter: EmitterId, at: &SurfaceInteraction) -> Rgb {
        match &self.lights[emitter.index()] {
            Light::Area(area) => area.radiance(&at.hit, self.local_point(&at.hit, at.time, at.p)),
            _ => Rgb::BLACK,
        }
    }

    /// Returns the density per unit solid angle with which [`sample_emitter`](Self::sample_emitter) samples the
    /// surface point `at` from `from`. `origin` is where the ray to `at` starts, beside `from`: far from the world's
    /// origin, the direction between `from` and `at` is not that of the ray.
    #[inline]
    pub fn emitter_pdf(
        &self,
        selection: &LightSelection,
        emitter: EmitterId,
        from: impl Into<Receiver>,
        origin: Vec3,
        at: &SurfaceInteraction,
    ) -> f32 {
        match &self.lights[emitter.index()] {
            Light::Area(area) => {
                let local = self.local_point(&at.hit, at.time, at.p);
                let place = EmitterHit { p: at.p, n: at.ng, hit: at.hit, local, time: at.time };
                selection.pmf(emitter.index(), from) * area.pdf(origin, &place)
            }
            _ => 0.0,
        }
    }

    /// Returns the emitters that a ray hits when it leaves the scene: the environment and the sun. The radiance of the
    /// ray is the sum of theirs.
    #[inline]
    pub fn distant_emitters(&self) -> impl Iterator<Item = EmitterId> {
        self.environment.into_iter().chain(self.sun)
    }

    /// Returns the radiance of a distant emitter in the unit direction `d`.
    #[inline]
    pub fn distant_radiance(&self, emitter: EmitterId, d: Vec3) -> Rgb {
        self.lights[emitter.index()].distant_radiance(d)
    }

    /// Returns the probability with which a selection chooses a distant emitter, for the first `count` of sixteen
    /// points.
    pub fn distant_pmf_x16(
        &self,
        selection: &LightSelection,
        emitter: EmitterId,
        from: &ReceiverX16,
        count: usize,
    ) -> f32x16 {
        selection.pmf_x16(emitter.index(), from, count)
    }

    /// Returns the radiance of a distant emitter in sixteen unit directions, and their densities per unit solid angle
    /// if a selection has chosen the emitter.
    #[inline]
    pub fn distant_x16(
        &self,
        selection: &LightSelection,
        emitter: EmitterId,
        d: &Vec3x16,
    ) -> ([f32x16; 3], f32x16) {
        self.lights[emitter.index()].distant_x16(d, selection.is_compensated())
    }

    /// Returns the density per unit solid angle of the direction `d` if a selection has chosen a distant emitter.
    #[inline]
    pub fn distant_density(&self, selection: &LightSelection, emitter: EmitterId, d: Vec3) -> f32 {
        self.lights[emitter.index()].distant_pdf(d, selection.is_compensated())
    }

    /// Samples an emitter and a direction to it as seen from `from`. The leading digits of `u.x` choose the emitter.
    /// Densities include the choice.
    #[inline]
    pub fn sample_emitter(
        &self,
        selection: &LightSelection,
        from: Vec3,
        u: Vec2,
        time: f32,
    ) -> Option<EmitterSample> {
        let choice = selection.sample(from, u.x)?;
        let u = Vec2::new(choice.u, u.y);
        let sample = self.sample_chosen(selection, choice.emitter, from, u, time)?;
        Some(EmitterSample { pdf: sample.pdf * choice.pmf, ..sample })
    }

    /// Samples a direction to an emitter that a selection has chosen.
    #[inline]
    pub fn sample_chosen(
        &self,
        selection: &LightSelection,
        emitter: usize,
        from: Vec3,
        u: Vec2,
        time: f32,
    ) -> Option<EmitterSample> {
        match selection.is_compensated() {
            true => self.lights[emitter].sample_compensated(from, u, time),
            false => self.lights[emitter].sample(from, u, time),
        }
    }

    /// Computes [`sample_emitter`](Self::sample_emitter) for sixteen points, for the lanes in the mask `active`.
    #[inline]
    pub fn sample_emitters(
        &self,
        selection: &LightSelection,
        from: &ReceiverX16,
        u: [f32x16; 2],
        time: f32x16,
        active: u32,
    ) -> EmitterSampleX16 {
        self.sample_emitters_choice(selection, from, u, time, active)
            .map_or(EmitterSampleX16::NONE, |(_, samples)| samples)
    }

    /// Computes [`sample_emitters`](Self::sample_emitters). Returns the choices beside the samples; `None` if there is
    /// no emitter to choose.
    #[inline]
    pub fn sample_emitters_choice(
        &self,
        selection: &LightSelection,
        from: &ReceiverX16,
        u: [f32x16; 2],
        time: f32x16,
        active: u32,
    ) -> Option<(ChoiceX16, EmitterSampleX16)> {
        let choice = selection.sample_x16(from, u[0], active)?;
        let ChoiceX16 { emitters, pmf, u: rest } = choice;
        let mut samples = self.sample_chosen_x16(selection, &emitters, from.p, [rest, u[1]], time, active);
        samples.pdf *= pmf;
        Some((choice, samples))
    }

    /// Computes [`sample_chosen`](Self::sample_chosen) for sixteen points, for the lanes in the mask `active`.
    #[inline]
    pub fn sample_chosen_x16(
        &self,
        selection: &LightSelection,
        emitters: &[usize; LANES],
        from: Vec3x16,
        u: [f32x16; 2],
        time: f32x16,
        active: u32,
    ) -> EmitterSampleX16 {
        let one =
            |i: usize, u| self.sample_chosen(selection, emitters[i], from.lane(i), u, time.as_array()[i]);
        self.light_lanes.sample(emitters, selection.is_compensated(), from, u, active, one)
    }

    /// Returns shadow rays from surface points to emitters. They end short of the emitter by at most the rounding
    /// error.
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

    /// Computes [`shadow_ray_to`](Self::shadow_ray_to) for sixteen points.
    #[inline]
    pub fn shadow_rays_to(
        &self,
        at: &SurfaceInteractionX16,
        target: Vec3x16,
        wi: Vec3x16,
        time: f32x16,
    ) -> RayX16 {
        let o = offset_origin_x16(at.p, at.error, at.ng, wi);
        RayX16 { o, t_max: f32x16::ONE, d: target - o, time }
    }

    /// Returns the shadow ray from a surface point to a sampled emitter.
    pub fn shadow_ray(&self, at: &SurfaceInteraction, sample: &EmitterSample) -> Ray {
        match sample.target {
            ShadowTarget::Point(target) => self.shadow_ray_to(at, target, sample.wi),
            ShadowTarget::Infinity => self.spawn_ray(at, sample.wi, at.time),
        }
    }

    /// Returns the rays from surface points in the world-space directions `wi`.
    #[inline]
    pub fn spawn_rays(&self, at: &SurfaceInteractionX16, wi: Vec3x16, time: f32x16) -> RayX16 {
        let o = offset_origin_x16(at.p, at.error, at.ng, wi);
        RayX16 { o, t_max: f32x16::splat(f32::INFINITY), d: wi, time }
    }

    /// Returns the ray from a surface point in the world-space direction `wi`.
    #[inline]
    pub fn spawn_ray(&self, at: &SurfaceInteraction, wi: Vec3, time: f32) -> Ray {
        Ray { o: offset_origin(at.p, at.error, at.ng, wi), t_max: f32::INFINITY, d: wi, time }
    }

    /// Samples a light ray. Its power is divided by the probability of choosing the emitter, which is returned beside
    /// it.
    pub fn sample_light_start(
        &self,
        u_choice: f32,
        [point, direction]: [Vec2; 2],
        time: f32,
    ) -> Option<(EmitterId, LightRay)> {
        let choice = self.light_choice.sample(u_choice)?;
        let light = self.lights[choice.index].sample_ray(point, direction, time)?;
        Some((EmitterId::from(choice.index), LightRay { power: light.power / choice.pmf, ..light }))
    }

    /// Returns the shadow ray from a surface point to another point, which is in the direction `wi`.
    pub fn shadow_ray_to(&self, at: &SurfaceInteraction, target: Vec3, wi: Vec3) -> Ray {
        let o = offset_origin(at.p, at.error, at.ng, wi);
        Ray { o, t_max: 1.0, d: target - o, time: at.time }
    }

    /// Returns the number of triangles in all shapes.
    pub fn triangle_count(&self) -> usize {
        self.shapes.iter().map(|s| s.world.triangle_count()).sum()
    }

    /// Returns the bytes of the shapes' arrays.
    pub fn mesh_bytes(&self) -> usize {
        self.shapes.iter().map(|s| s.world.memory_bytes()).sum()
    }
}
