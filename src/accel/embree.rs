//! The back end on Embree 3: single rays, and waves in packets of sixteen.

use super::{Accel, Coherence, Geometry, Hit, NO_INSTANCE, Primitive};
use crate::embree::{
    self, CommittedScene, Device, DeviceOptions, INVALID_ID, Mask16, RayHit1, RayHits16, Rays16,
    SceneBuilder, SceneOptions, UserHit, UserPrimitives, UserRay, WIDTH,
};
use crate::error::{Error, Result};
use crate::math::{Bounds, Ray, Vec3};
use std::sync::Arc;

/// Embree over a list of geometries. Vertex and index arrays are shared with it.
///
/// A mesh keeps its place in the list as its Embree id. The analytic surfaces together are one user geometry,
/// whose id is the length of the list.
pub struct EmbreeAccel {
    scene: CommittedScene,
    bounds: Bounds,
    /// The least id that is not a mesh's.
    analytic_id: u32,
    /// Place in the list of each analytic surface.
    analytic: Vec<u32>,
}

impl EmbreeAccel {
    /// Builds the scene with `threads` threads (0 for all cores). The geometry must be checked.
    ///
    /// # Errors
    /// If Embree cannot be started or runs out of memory.
    pub(super) fn new(geometry: Vec<Geometry>, bounds: Bounds, threads: usize, robust: bool) -> Result<Self> {
        let device = Device::new(DeviceOptions { threads })?;
        let mut builder = SceneBuilder::new(&device, SceneOptions { robust })?;
        let analytic_id =
            u32::try_from(geometry.len()).ok().filter(|&n| n < INVALID_ID).ok_or_else(|| {
                Error::scene(format!("{} shapes are more than Embree can number", geometry.len()))
            })?;
        let mut analytic = Vec::new();
        let mut surfaces = Vec::new();
        for (id, entry) in (0..).zip(geometry) {
            match entry {
                Geometry::Triangles { indices, .. } if indices.is_empty() => {}
                Geometry::Triangles { positions, indices } => {
                    builder.add_triangles(id, Arc::clone(positions.padded()), positions.len(), indices)?;
                }
                Geometry::Analytic(surface) if surface.is_valid() => {
                    analytic.push(id);
                    surfaces.push(surface);
                }
                Geometry::Analytic(_) => {}
            }
        }
        if !surfaces.is_empty() {
            builder.add_user(analytic_id, Arc::new(Surfaces(surfaces)))?;
        }
        Ok(EmbreeAccel { scene: builder.commit()?, bounds, analytic_id, analytic })
    }

    /// The geometry and the primitive that Embree's ids stand for.
    #[inline]
    fn place(&self, geometry: u32, primitive: u32) -> (u32, u32) {
        if geometry < self.analytic_id {
            (geometry, primitive)
        } else {
            (self.analytic[primitive as usize], 0)
        }
    }

    #[inline]
    fn hit16(&self, packet: &RayHits16, i: usize) -> Option<Hit> {
        if packet.geometry[i] == INVALID_ID {
            return None;
        }
        let (geometry, primitive) = self.place(packet.geometry[i], packet.primitive[i]);
        let (t, u, v) = (packet.rays.t_far[i], packet.u[i], packet.v[i]);
        Some(Hit { t, u, v, geometry, primitive, instance: NO_INSTANCE })
    }
}

impl Accel for EmbreeAccel {
    fn name(&self) -> &'static str {
        "embree"
    }

    fn bounds(&self) -> Bounds {
        self.bounds
    }

    fn memory_bytes(&self) -> usize {
        self.scene.memory_bytes()
    }

    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        let mut query = RayHit1::new(bytemuck::cast_ref(ray));
        self.scene.intersect1(&mut query, embree::Coherence::Incoherent);
        if query.geometry == INVALID_ID {
            return None;
        }
        let (geometry, primitive) = self.place(query.geometry, query.primitive);
        Some(Hit { t: query.t_far, u: query.u, v: query.v, geometry, primitive, instance: NO_INSTANCE })
    }

    fn occluded(&self, ray: &Ray) -> bool {
        self.scene.occluded1(&mut RayHit1::new(bytemuck::cast_ref(ray)), embree::Coherence::Incoherent)
    }

    fn intersect_wave(&self, rays: &[Ray], hits: &mut [Option<Hit>], coherence: Coherence) {
        assert_eq!(rays.len(), hits.len(), "one hit for each ray");
        let coherence = coherence.into();
        let mut packet = RayHits16::default();
        let trace = |packet: &mut RayHits16, hits: &mut [Option<Hit>]| {
            packet.clear_hits();
            self.scene.intersect16(&Mask16::ALL, packet, coherence);
            for (i, hit) in hits.iter_mut().enumerate() {
                *hit = self.hit16(packet, i);
            }
        };
        let (rays, rays_tail) = bytemuck::cast_slice::<Ray, [f32; 8]>(rays).as_chunks::<WIDTH>();
        let (hits, hits_tail) = hits.as_chunks_mut::<WIDTH>();
        for (rays, hits) in rays.iter().zip(hits) {
            packet.rays.load(rays);
            trace(&mut packet, hits);
        }
        if !rays_tail.is_empty() {
            packet.rays.load_tail(rays_tail);
            trace(&mut packet, hits_tail);
        }
    }

    fn occluded_wave(&self, rays: &[Ray], occluded: &mut [bool], coherence: Coherence) {
        assert_eq!(rays.len(), occluded.len(), "one answer for each ray");
        let coherence = coherence.into();
        let mut packet = Rays16::default();
        let trace = |packet: &mut Rays16, occluded: &mut [bool]| {
            let traced = self.scene.occluded16(&Mask16::ALL, packet, coherence);
            for (i, occluded) in occluded.iter_mut().enumerate() {
                *occluded = traced.get(i) & (packet.t_far[i] == f32::NEG_INFINITY);
            }
        };
        let (rays, rays_tail) = bytemuck::cast_slice::<Ray, [f32; 8]>(rays).as_chunks::<WIDTH>();
        let (occluded, occluded_tail) = occluded.as_chunks_mut::<WIDTH>();
        for (rays, occluded) in rays.iter().zip(occluded) {
            packet.load(rays);
            trace(&mut packet, occluded);
        }
        if !rays_tail.is_empty() {
            packet.load_tail(rays_tail);
            trace(&mut packet, occluded_tail);
        }
    }
}

impl From<Coherence> for embree::Coherence {
    fn from(coherence: Coherence) -> Self {
        match coherence {
            Coherence::Coherent => embree::Coherence::Coherent,
            Coherence::Incoherent => embree::Coherence::Incoherent,
        }
    }
}

/// The analytic surfaces as Embree's user geometry.
struct Surfaces(Vec<Primitive>);

impl UserPrimitives for Surfaces {
    fn count(&self) -> u32 {
        self.0.len() as u32
    }

    fn bounds(&self, i: u32) -> ([f32; 3], [f32; 3]) {
        let b = self.0[i as usize].bounds();
        (b.min.to_array(), b.max.to_array())
    }

    fn intersect(&self, i: u32, ray: &UserRay) -> Option<UserHit> {
        let (o, d) = (Vec3::from(ray.origin), Vec3::from(ray.direction));
        let hit = self.0[i as usize].intersect(&Ray { o, t_max: ray.t_far, d, time: ray.time })?;
        Some(UserHit { t: hit.t, u: hit.u, v: hit.v })
    }
}
