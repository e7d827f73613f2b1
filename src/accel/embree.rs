//! The back end on Embree 3. Waves are traced in packets of sixteen, or among analytic surfaces one ray at a time.

use super::assembly::{Assembly, CheckedAssembly, FilterQuery, GeometryFilter, HitFilter, ray_id};
use super::{Accel, Coherence, Geometry, Hit, NO_INSTANCE, Primitive, PrimitiveHit};
use crate::embree::{
    self, CandidateHit, CommittedScene, Device, DeviceOptions, INVALID_ID, Mask16, RayHit1, RayHits16,
    Rays16, SceneBuilder, SceneOptions, TriangleFilter, UserHit, UserPrimitives, UserRay, WIDTH,
};
use crate::error::{Error, Result};
use crate::math::{Bounds, Ray, Vec3};
use crate::memory::Budget;
use std::sync::Arc;

/// An Embree scene over an assembly. It shares the vertex and index arrays.
///
/// In the scene of world space, the Embree id of a mesh is its index in the list of geometries; in the scene of a
/// group it is its index in the group. (Embree keeps an array over all ids for each scene.) The same is true of curves,
/// which are user geometries. All other analytic surfaces of a scene are one user geometry, whose id follows those of
/// the meshes; its hits report the surface's index in the list as their primitive. The ids of instances follow.
pub struct EmbreeAccel {
    scene: CommittedScene,
    bounds: Bounds,
    /// Whether hits are filtered, which needs [`ray_id`] for each ray.
    filtered: bool,
    /// Whether the rays of waves are traced one at a time, which is faster if most primitives are analytic surfaces.
    one_at_a_time: bool,
    /// The Embree id of the analytic surfaces in world space.
    surfaces_id: u32,
    /// The members of all groups, concatenated; [`INVALID_ID`] for the analytic surfaces ends each group.
    members: Vec<u32>,
    /// For each instance, the index in `members` of the first member of its group.
    first_members: Vec<u32>,
}

impl EmbreeAccel {
    /// Builds the scenes with `threads` threads (0: all cores). The assembly must have been checked.
    ///
    /// # Errors
    /// If Embree cannot be started or memory runs out.
    pub(super) fn new(
        assembly: Assembly,
        checked: &CheckedAssembly,
        threads: usize,
        robust: bool,
        memory: &Budget,
    ) -> Result<Self> {
        let Assembly { geometry, groups, instances, filter } = assembly;
        let numbered = u32::try_from(geometry.len() + instances.len()).ok().filter(|&n| n < INVALID_ID - 1);
        if numbered.is_none() {
            let (shapes, instances) = (geometry.len(), instances.len());
            let message =
                format!("expected fewer than 2^32 shapes and instances, found {shapes} and {instances}");
            return Err(Error::scene(message));
        }
        // The surfaces live as long as Embree's scenes, which call back to intersect them.
        let surfaces =
            geometry.iter().map(|g| if let Geometry::Surfaces(many) = g { many.count() } else { 0 });
        let bytes = surfaces.sum::<usize>() as u64 * size_of::<UserSurface>() as u64;
        let (meshes, analytic): (Vec<_>, Vec<_>) =
            geometry.iter().partition(|g| matches!(g, Geometry::Triangles { .. }));
        let [triangles, surfaces] =
            [meshes, analytic].map(|of| of.into_iter().map(Geometry::len).sum::<usize>());
        let one_at_a_time = surfaces > triangles;
        let planned = memory.reserve(bytes).map_err(|refusal| {
            let message = refusal.sentence("the surfaces", "use fewer segments of curves or cells of grids");
            Error::scene(message)
        })?;
        planned.keep(bytes);
        let device = Device::within(DeviceOptions { threads, ..DeviceOptions::default() }, memory.clone())?;
        let surfaces_id = geometry.len() as u32;
        let parts = SceneParts { geometry, filter: filter.map(Arc::new), first_instance: surfaces_id + 1 };
        let mut members = Vec::new();
        let mut scenes = Vec::with_capacity(groups.len());
        for group in &groups {
            let options = SceneOptions { robust, ..SceneOptions::default() };
            let mut builder = SceneBuilder::new(&device, options)?;
            parts.add((0..).zip(group.iter().copied()), group.len() as u32, &mut builder)?;
            scenes.push((Arc::new(builder.commit()?), members.len() as u32));
            members.extend(group.iter().chain(&[INVALID_ID]));
        }
        let mut builder = SceneBuilder::new(&device, SceneOptions { robust, ray_limit: checked.ray_limit })?;
        parts.add(checked.world.iter().map(|&i| (i, i)), surfaces_id, &mut builder)?;
        let mut first_members = Vec::with_capacity(instances.len());
        for (id, (instance, bounds)) in (parts.first_instance..).zip(instances.iter().zip(&checked.instances))
        {
            let (scene, first) = &scenes[instance.group as usize];
            first_members.push(*first);
            if !bounds.is_empty() {
                builder.add_instance(id, Arc::clone(scene), instance.steps())?;
            }
        }
        Ok(EmbreeAccel {
            scene: builder.commit()?,
            bounds: checked.bounds,
            filtered: parts.filter.is_some(),
            one_at_a_time,
            surfaces_id,
            members,
            first_members,
        })
    }

    /// Converts Embree's ids to a hit.
    #[inline]
    fn hit(&self, (t, u, v): (f32, f32, f32), [geometry, primitive, instance]: [u32; 3]) -> Hit {
        let (mesh, instance) = match instance {
            INVALID_ID => (if geometry < self.surfaces_id { geometry } else { INVALID_ID }, NO_INSTANCE),
            id => {
                let instance = id - self.surfaces_id - 1;
                let first = self.first_members[instance as usize];
                (self.members[(first + geometry) as usize], instance)
            }
        };
        let (geometry, primitive) = if mesh == INVALID_ID { (primitive, 0) } else { (mesh, primitive) };
        Hit { t, u, v, geometry, primitive, instance }
    }

    #[inline]
    fn hit16(&self, packet: &RayHits16, i: usize) -> Option<Hit> {
        if packet.geometry[i] == INVALID_ID {
            return None;
        }
        let ids = [packet.geometry[i], packet.primitive[i], packet.instance[i]];
        Some(self.hit((packet.rays.t_far[i], packet.u[i], packet.v[i]), ids))
    }

    /// Prepares the query of a single ray, with its identifier if hits are filtered.
    #[inline]
    fn single(&self, ray: &Ray) -> RayHit1 {
        let mut query = RayHit1::new(bytemuck::cast_ref(ray));
        if self.filtered {
            query.id = ray_id(ray);
        }
        query
    }

    /// Sets the identifiers of the rays in a packet if hits are filtered.
    #[inline]
    fn set_ids(&self, rays: &[[f32; 8]], packet: &mut Rays16) {
        if self.filtered {
            for (id, ray) in packet.id.iter_mut().zip(rays) {
                *id = ray_id(bytemuck::cast_ref(ray));
            }
        }
    }
}

/// The data from which scenes are assembled.
struct SceneParts {
    geometry: Vec<Geometry>,
    filter: Option<Arc<GeometryFilter>>,
    /// The Embree id of the first instance.
    first_instance: u32,
}

impl SceneParts {
    /// Adds geometries, given as (Embree id, index in the list), and their analytic surfaces under the id
    /// `surfaces_id`.
    fn add(
        &self,
        members: impl Iterator<Item = (u32, u32)>,
        surfaces_id: u32,
        builder: &mut SceneBuilder,
    ) -> Result<()> {
        let mut single = Vec::new();
        let add_surfaces = |id, surfaces: Vec<UserSurface>, builder: &mut SceneBuilder| {
            let (filter, first_instance) = (self.filter.clone(), self.first_instance);
            match surfaces.is_empty() {
                true => Ok(()),
                false => {
                    builder.add_user(id, Arc::new(AnalyticSurfaces { surfaces, filter, first_instance }))
                }
            }
        };
        for (id, geometry) in members {
            match &self.geometry[geometry as usize] {
                Geometry::Triangles { indices, .. } if indices.is_empty() => {}
                Geometry::Triangles { positions, indices } => {
                    let (vertices, indices) = (Arc::clone(positions.padded()), Arc::clone(indices));
                    builder.add_triangles(
                        id,
                        vertices,
                        positions.len(),
                        indices,
                        self.mesh_filter(geometry),
                    )?;
                }
                Geometry::Analytic(surface) if surface.is_valid() => {
                    single.push(UserSurface {
                        surface: *surface,
                        geometry,
                        primitive: 0,
                        reported: geometry,
                    });
                }
                Geometry::Analytic(_) => {}
                Geometry::Surfaces(surfaces) => {
                    let mut valid = Vec::with_capacity(surfaces.count());
                    valid.extend(surfaces.valid().map(|(primitive, surface)| UserSurface {
                        surface,
                        geometry,
                        primitive,
                        reported: primitive,
                    }));
                    add_surfaces(id, valid, builder)?;
                }
            }
        }
        add_surfaces(surfaces_id, single, builder)
    }

    fn mesh_filter(&self, geometry: u32) -> Option<Arc<dyn TriangleFilter>> {
        let filtered = self.filter.as_ref().filter(|f| f.geometry[geometry as usize])?;
        let (filter, first_instance) = (Arc::clone(&filtered.filter), self.first_instance);
        Some(Arc::new(MeshFilter { filter, geometry, first_instance }))
    }
}

/// The filter of one mesh.
struct MeshFilter {
    filter: Arc<dyn HitFilter>,
    geometry: u32,
    first_instance: u32,
}

impl TriangleFilter for MeshFilter {
    fn accepts(&self, ray: &UserRay, hit: &CandidateHit) -> bool {
        let CandidateHit { t, u, v, primitive } = *hit;
        let instance = instance_of(ray, self.first_instance);
        self.filter.accepts(
            ray.id,
            &Ray { t_max: t, ..to_ray(ray) },
            &Hit { t, u, v, geometry: self.geometry, primitive, instance },
        )
    }
}

fn to_ray(ray: &UserRay) -> Ray {
    Ray { o: Vec3::from(ray.origin), t_max: ray.t_far, d: Vec3::from(ray.direction), time: ray.time }
}

/// Returns the index of the instance in whose space the ray is.
fn instance_of(ray: &UserRay, first_instance: u32) -> u32 {
    if ray.instance == INVALID_ID { NO_INSTANCE } else { ray.instance - first_instance }
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
        let mut query = self.single(ray);
        self.scene.intersect1(&mut query, embree::Coherence::Incoherent);
        if query.geometry == INVALID_ID {
            return None;
        }
        let ids = [query.geometry, query.primitive, query.instance];
        Some(self.hit((query.t_far, query.u, query.v), ids))
    }

    fn occluded(&self, ray: &Ray) -> bool {
        self.scene.occluded1(&mut self.single(ray), embree::Coherence::Incoherent)
    }

    fn intersect_wave(&self, rays: &[Ray], hits: &mut [Option<Hit>], coherence: Coherence) {
        assert_eq!(rays.len(), hits.len(), "one hit for each ray");
        if self.one_at_a_time {
            rays.iter().zip(hits).for_each(|(ray, hit)| *hit = self.intersect(ray));
            return;
        }
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
            self.set_ids(rays, &mut packet.rays);
            trace(&mut packet, hits);
        }
        if !rays_tail.is_empty() {
            packet.rays.load_tail(rays_tail);
            self.set_ids(rays_tail, &mut packet.rays);
            trace(&mut packet, hits_tail);
        }
    }

    fn occluded_wave(&self, rays: &[Ray], occluded: &mut [bool], coherence: Coherence) {
        assert_eq!(rays.len(), occluded.len(), "one answer for each ray");
        if self.one_at_a_time {
            rays.iter().zip(occluded).for_each(|(ray, occluded)| *occluded = self.occluded(ray));
            return;
        }
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
            self.set_ids(rays, &mut packet);
            trace(&mut packet, occluded);
        }
        if !rays_tail.is_empty() {
            packet.load_tail(rays_tail);
            self.set_ids(rays_tail, &mut packet);
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

/// An analytic surface, its geometry, its index in the geometry, and the primitive that Embree reports for it.
#[derive(Clone, Copy)]
struct UserSurface {
    surface: Primitive,
    geometry: u32,
    primitive: u32,
    reported: u32,
}

/// Analytic surfaces of one scene as an Embree user geometry.
struct AnalyticSurfaces {
    surfaces: Vec<UserSurface>,
    filter: Option<Arc<GeometryFilter>>,
    first_instance: u32,
}

impl UserPrimitives for AnalyticSurfaces {
    fn count(&self) -> u32 {
        self.surfaces.len() as u32
    }

    fn bounds(&self, i: u32) -> ([f32; 3], [f32; 3]) {
        let b = self.surfaces[i as usize].surface.bounds();
        (b.min.to_array(), b.max.to_array())
    }

    fn intersect(&self, i: u32, user_ray: &UserRay) -> Option<UserHit> {
        let &UserSurface { ref surface, geometry, primitive, reported } = &self.surfaces[i as usize];
        let ray = to_ray(user_ray);
        let query = FilterQuery::with_id(self.filter.as_deref(), user_ray.id);
        let instance = instance_of(user_ray, self.first_instance);
        let hit = surface.intersect_where(&ray, |&PrimitiveHit { t, u, v }| {
            query.accepts(&ray, &Hit { t, u, v, geometry, primitive, instance })
        })?;
        Some(UserHit { t: hit.t, u: hit.u, v: hit.v, primitive: reported })
    }
}
