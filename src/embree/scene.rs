//! Scenes: a builder that is consumed, and the immutable scene that answers queries.

use super::device::{Device, DeviceHandle};
use super::filter::{FilterState, TriangleFilter, on_filter};
use super::packet::{COMPONENT_LIMIT, Mask16, RayHit1, RayHits16, Rays16, WIDTH};
use super::user::{QueryContext, UserPrimitives, UserState, on_bounds, on_intersect, on_occluded};
use crate::error::{Error, Result};
use buffon_embree_sys as sys;
use std::sync::Arc;

/// The most steps of an instance's motion.
const MAX_STEPS: usize = sys::RTC_MAX_TIME_STEP_COUNT as usize;

/// How a scene is built.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneOptions {
    /// Watertight along edges, at some cost (`RTC_SCENE_FLAG_ROBUST`). Off only to measure that cost.
    pub robust: bool,
    /// The greatest absolute value of a valid ray's components, up to [`COMPONENT_LIMIT`]: less where the inverse of
    /// an instance's transform would take a ray beyond that.
    pub ray_limit: f32,
}

impl Default for SceneOptions {
    fn default() -> Self {
        SceneOptions { robust: true, ray_limit: COMPONENT_LIMIT }
    }
}

/// What the caller knows about the rays of successive queries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coherence {
    /// Neighbours start at about one point and point in about one direction.
    Coherent,
    /// Neighbours have nothing in common.
    Incoherent,
}

impl Coherence {
    #[inline]
    fn context(self) -> QueryContext {
        QueryContext::new(match self {
            Coherence::Coherent => sys::RTCIntersectContextFlags::RTC_INTERSECT_CONTEXT_FLAG_COHERENT,
            Coherence::Incoherent => sys::RTCIntersectContextFlags::RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT,
        })
    }
}

/// The one owner of a scene's C handle.
struct SceneHandle {
    raw: sys::RTCScene,
    device: Arc<DeviceHandle>,
}

// SAFETY: Embree's scenes may be used from any thread; changes happen only through `SceneBuilder` (owned, `&mut`),
// and the queries of a committed scene are thread-safe.
unsafe impl Send for SceneHandle {}
// SAFETY: as above.
unsafe impl Sync for SceneHandle {}

impl Drop for SceneHandle {
    fn drop(&mut self) {
        // SAFETY: the handle is live and owned by `self` alone; the device is a field and is dropped after this.
        unsafe { sys::rtcReleaseScene(self.raw) };
    }
}

/// What Embree reads for as long as the scene lives.
#[derive(Default)]
struct Kept {
    vertices: Vec<Arc<Vec<[f32; 3]>>>,
    indices: Vec<Arc<Vec<[u32; 3]>>>,
    // Boxed: Embree holds the address.
    #[expect(clippy::vec_box)]
    users: Vec<Box<UserState>>,
    // As above.
    #[expect(clippy::vec_box)]
    filters: Vec<Box<FilterState>>,
    scenes: Vec<Arc<CommittedScene>>,
}

/// The one owner of a geometry's C handle until it is attached.
struct GeometryHandle(sys::RTCGeometry);

impl Drop for GeometryHandle {
    fn drop(&mut self) {
        // SAFETY: the handle is live and owned by `self`; an attached geometry is retained by its scene.
        unsafe { sys::rtcReleaseGeometry(self.0) };
    }
}

/// A scene to which geometries are added.
pub struct SceneBuilder {
    // Declared first, so dropped before what it reads.
    scene: SceneHandle,
    kept: Kept,
    ray_limit: f32,
}

impl SceneBuilder {
    /// An empty scene.
    ///
    /// # Errors
    /// If Embree cannot make one (no memory).
    pub fn new(device: &Device, options: SceneOptions) -> Result<Self> {
        let device = Arc::clone(device.handle());
        // SAFETY: the device is live.
        let raw = unsafe { sys::rtcNewScene(device.raw()) };
        if raw.is_null() {
            device.check("making a scene")?;
            return Err(Error::internal("making a scene: no scene and no error").about("Embree"));
        }
        let scene = SceneHandle { raw, device };
        let flags = match options.robust {
            true => sys::RTCSceneFlags::RTC_SCENE_FLAG_ROBUST,
            false => sys::RTCSceneFlags::RTC_SCENE_FLAG_NONE,
        };
        // SAFETY: the scene is live and not committed.
        unsafe { sys::rtcSetSceneFlags(scene.raw, flags) };
        scene.device.check("setting the scene's flags")?;
        Ok(SceneBuilder { scene, kept: Kept::default(), ray_limit: options.ray_limit.min(COMPONENT_LIMIT) })
    }

    /// Adds a triangle mesh as geometry `id`. The arrays are shared with Embree, not copied.
    ///
    /// The first `count` elements of `vertices` are the vertices. At least one more element must follow them:
    /// Embree reads 16 bytes at the last vertex, of which 12 are its own. A filter decides which hits count.
    ///
    /// # Errors
    /// If the padding is missing, an index is out of range, or Embree refuses (an id used twice).
    pub fn add_triangles(
        &mut self,
        id: u32,
        vertices: Arc<Vec<[f32; 3]>>,
        count: usize,
        indices: Arc<Vec<[u32; 3]>>,
        filter: Option<Arc<dyn TriangleFilter>>,
    ) -> Result<()> {
        if vertices.len() <= count {
            let message =
                format!("expected padding after {count} vertices, found {} elements", vertices.len());
            return Err(Error::internal(message).about("Embree"));
        }
        let greatest = indices.iter().flatten().fold(0, |a, &b| a.max(b));
        if !indices.is_empty() && greatest as usize >= count {
            let message = format!("expected indices below {count}, found {greatest}");
            return Err(Error::internal(message).about("Embree"));
        }
        let geometry = self.new_geometry(sys::RTCGeometryType::RTC_GEOMETRY_TYPE_TRIANGLE)?;
        // SAFETY: the geometry is live. Both arrays lie behind an `Arc<Vec>` that `kept` holds until after the
        // scene is released; nobody can change or move a `Vec` behind a shared `Arc`. All indices are below
        // `count` and an element follows the last vertex, so what Embree reads lies inside.
        unsafe {
            sys::rtcSetSharedGeometryBuffer(
                geometry.0,
                sys::RTCBufferType::RTC_BUFFER_TYPE_VERTEX,
                0,
                sys::RTCFormat::RTC_FORMAT_FLOAT3,
                vertices.as_ptr().cast(),
                0,
                size_of::<[f32; 3]>(),
                count,
            );
            sys::rtcSetSharedGeometryBuffer(
                geometry.0,
                sys::RTCBufferType::RTC_BUFFER_TYPE_INDEX,
                0,
                sys::RTCFormat::RTC_FORMAT_UINT3,
                indices.as_ptr().cast(),
                0,
                size_of::<[u32; 3]>(),
                indices.len(),
            );
        }
        self.kept.vertices.push(vertices);
        self.kept.indices.push(indices);
        if let Some(filter) = filter {
            let state = Box::new(FilterState(filter));
            let pointer: *const FilterState = &*state;
            // SAFETY: the geometry is live; `state` is boxed and held by `kept` until after the scene is released; the
            // callback reads it only, and has the signature that Embree calls.
            unsafe {
                sys::rtcSetGeometryUserData(geometry.0, pointer.cast_mut().cast());
                sys::rtcSetGeometryIntersectFilterFunction(geometry.0, Some(on_filter));
                sys::rtcSetGeometryOccludedFilterFunction(geometry.0, Some(on_filter));
            }
            self.kept.filters.push(state);
        }
        self.attach(&geometry, id)
    }

    /// Adds user primitives as geometry `id`.
    ///
    /// # Errors
    /// If Embree refuses (an id used twice).
    pub fn add_user(&mut self, id: u32, primitives: Arc<dyn UserPrimitives>) -> Result<()> {
        let state = Box::new(UserState::new(primitives));
        let geometry = self.new_geometry(sys::RTCGeometryType::RTC_GEOMETRY_TYPE_USER)?;
        let pointer: *const UserState = &*state;
        // SAFETY: the geometry is live; `state` is boxed and held by `kept` until after the scene is released; the
        // callbacks read it only, and have the signatures that Embree calls.
        unsafe {
            sys::rtcSetGeometryUserPrimitiveCount(geometry.0, state.count());
            sys::rtcSetGeometryUserData(geometry.0, pointer.cast_mut().cast());
            sys::rtcSetGeometryBoundsFunction(geometry.0, Some(on_bounds), std::ptr::null_mut());
            sys::rtcSetGeometryIntersectFunction(geometry.0, Some(on_intersect));
            sys::rtcSetGeometryOccludedFunction(geometry.0, Some(on_occluded));
        }
        self.kept.users.push(state);
        self.attach(&geometry, id)
    }

    /// Adds an instance of a scene as geometry `id`; hits report it as their instance. A scene that holds instances
    /// itself is not traversed to the second level.
    ///
    /// `steps` are the transforms of the scene's coordinates into this one's at equally spaced times over [0, 1]:
    /// three axes and the translation each, linear in between. They must be invertible at all times, and the scene's
    /// [`ray_limit`](SceneOptions::ray_limit) such that no inverse leads beyond [`COMPONENT_LIMIT`]: a build of Embree
    /// with assertions aborts the process otherwise.
    ///
    /// # Errors
    /// If the scene is another device's, there are no steps or more than 129, one is not finite, or Embree refuses
    /// (an id used twice).
    pub fn add_instance(&mut self, id: u32, scene: Arc<CommittedScene>, steps: &[[f32; 12]]) -> Result<()> {
        if !Arc::ptr_eq(&scene.scene.device, &self.scene.device) {
            return Err(Error::internal("expected a scene of the same device").about("Embree"));
        }
        // Embree reads what is not there if the number of steps is out of range.
        if !(1..=MAX_STEPS).contains(&steps.len()) {
            let message = format!("expected 1 to {MAX_STEPS} transforms, found {}", steps.len());
            return Err(Error::internal(message).about("Embree"));
        }
        if let Some(step) = steps.iter().find(|step| !step.iter().all(|x| x.is_finite())) {
            return Err(
                Error::internal(format!("expected a finite transform, found {step:?}")).about("Embree")
            );
        }
        let geometry = self.new_geometry(sys::RTCGeometryType::RTC_GEOMETRY_TYPE_INSTANCE)?;
        // SAFETY: the geometry and the instanced scene are live and of one device; the scene is committed and `kept`
        // holds it until after this one is released. Embree copies the 12 floats of each step.
        unsafe {
            sys::rtcSetGeometryInstancedScene(geometry.0, scene.scene.raw);
            sys::rtcSetGeometryTimeStepCount(geometry.0, steps.len() as u32);
            for (i, step) in (0..).zip(steps) {
                let format = sys::RTCFormat::RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR;
                sys::rtcSetGeometryTransform(geometry.0, i, format, step.as_ptr().cast());
            }
        }
        self.kept.scenes.push(scene);
        self.attach(&geometry, id)
    }

    /// Builds the acceleration structure with the device's threads.
    ///
    /// # Errors
    /// If Embree fails, e.g. for lack of memory.
    pub fn commit(self) -> Result<CommittedScene> {
        // SAFETY: the scene is live, and `self` is owned: no query runs.
        unsafe { sys::rtcCommitScene(self.scene.raw) };
        self.scene.device.check("building the scene")?;
        let sees_masks = self.scene.device.has_native_packets16();
        Ok(CommittedScene { scene: self.scene, kept: self.kept, ray_limit: self.ray_limit, sees_masks })
    }

    fn new_geometry(&self, kind: sys::RTCGeometryType) -> Result<GeometryHandle> {
        // SAFETY: the device is live.
        let raw = unsafe { sys::rtcNewGeometry(self.scene.device.raw(), kind) };
        if raw.is_null() {
            self.scene.device.check("making a geometry")?;
            return Err(Error::internal("making a geometry: no geometry and no error").about("Embree"));
        }
        Ok(GeometryHandle(raw))
    }

    fn attach(&mut self, geometry: &GeometryHandle, id: u32) -> Result<()> {
        self.scene.device.check("describing a geometry")?;
        // SAFETY: geometry and scene are live.
        unsafe {
            sys::rtcCommitGeometry(geometry.0);
            sys::rtcAttachGeometryByID(self.scene.raw, geometry.0, id);
        }
        self.scene.device.check("adding a geometry")
    }
}

/// A scene that is built. It does not change any more; queries may come from any number of threads.
///
/// An invalid ray hits nothing and is left as it was: one with a component of origin or direction that is NaN or
/// beyond [`SceneOptions::ray_limit`], with a zero direction, without `0 ≤ t_near < t_far` or a time in [0, 1].
/// Embree itself does not look: a build with assertions, such as Debian's, aborts the process.
pub struct CommittedScene {
    // Declared first, so dropped before what it reads.
    scene: SceneHandle,
    kept: Kept,
    ray_limit: f32,
    /// Whether Embree looks at the mask of a packet. Where it has no packets of sixteen it does not: it takes them apart, and
    /// traces every ray whose `t_near` is not above its `t_far`.
    sees_masks: bool,
}

impl CommittedScene {
    /// The box (least corner, greatest corner) around everything; least > greatest when the scene is empty.
    pub fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        let mut b = sys::RTCBounds {
            lower_x: f32::INFINITY,
            lower_y: f32::INFINITY,
            lower_z: f32::INFINITY,
            align0: 0.0,
            upper_x: f32::NEG_INFINITY,
            upper_y: f32::NEG_INFINITY,
            upper_z: f32::NEG_INFINITY,
            align1: 0.0,
        };
        // SAFETY: the scene is committed; `b` is a box to write.
        unsafe { sys::rtcGetSceneBounds(self.scene.raw, &mut b) };
        ([b.lower_x, b.lower_y, b.lower_z], [b.upper_x, b.upper_y, b.upper_z])
    }

    /// Bytes that Embree holds for the scene's device; the scene's alone when it is the device's only one.
    pub fn memory_bytes(&self) -> usize {
        self.scene.device.memory_bytes()
    }

    /// Finds the nearest hit. A miss leaves the ray as it was.
    #[inline]
    pub fn intersect1(&self, ray: &mut RayHit1, coherence: Coherence) {
        if !ray.is_valid(self.ray_limit) {
            return;
        }
        let mut context = coherence.context();
        // SAFETY: the scene is committed; `RayHit1` is `RTCRayHit` in size, alignment and layout.
        unsafe { sys::rtcIntersect1(self.scene.raw, context.as_mut_ptr(), (&raw mut *ray).cast()) };
        context.finish();
    }

    /// Whether anything is hit.
    #[inline]
    pub fn occluded1(&self, ray: &mut RayHit1, coherence: Coherence) -> bool {
        if !ray.is_valid(self.ray_limit) {
            return false;
        }
        let mut context = coherence.context();
        // SAFETY: the scene is committed; `RayHit1` begins with `RTCRay`.
        unsafe { sys::rtcOccluded1(self.scene.raw, context.as_mut_ptr(), (&raw mut *ray).cast()) };
        context.finish();
        ray.t_far == f32::NEG_INFINITY
    }

    /// Finds the nearest hits of the wanted rays of a packet. A miss leaves a ray as it was.
    /// Returns which rays were traced: the wanted ones that are valid.
    #[inline]
    pub fn intersect16(&self, wanted: &Mask16, rays: &mut RayHits16, coherence: Coherence) -> Mask16 {
        let valid = rays.rays.valid(wanted, self.ray_limit);
        let held_back = self.hold_back(&valid, &mut rays.rays);
        let mut context = coherence.context();
        let (context_ptr, packet) = (context.as_mut_ptr(), &raw mut *rays);
        // SAFETY: the scene is committed; `RayHits16` is `RTCRayHit16` in size, alignment and layout, and the mask
        // is aligned alike.
        unsafe { sys::rtcIntersect16(valid.as_ptr(), self.scene.raw, context_ptr, packet.cast()) };
        if let Some(t_near) = held_back {
            rays.rays.t_near = t_near;
        }
        context.finish();
        valid
    }

    /// Finds whether the wanted rays of a packet hit anything: then `t_far` becomes -∞.
    /// Returns which rays were traced: the wanted ones that are valid.
    #[inline]
    pub fn occluded16(&self, wanted: &Mask16, rays: &mut Rays16, coherence: Coherence) -> Mask16 {
        let valid = rays.valid(wanted, self.ray_limit);
        // Embree 3.13.5 does not return from a coherent `rtcOccluded16` that enters an instance.
        let coherence = if self.kept.scenes.is_empty() { coherence } else { Coherence::Incoherent };
        let held_back = self.hold_back(&valid, rays);
        let mut context = coherence.context();
        let (context_ptr, packet) = (context.as_mut_ptr(), &raw mut *rays);
        // SAFETY: the scene is committed; `Rays16` is `RTCRay16` in size, alignment and layout, and the mask is
        // aligned alike.
        unsafe { sys::rtcOccluded16(valid.as_ptr(), self.scene.raw, context_ptr, packet.cast()) };
        if let Some(t_near) = held_back {
            rays.t_near = t_near;
        }
        context.finish();
        valid
    }

    /// Makes rays that are not to be traced such as Embree does not trace, mask or no mask; gives the `t_near` that they
    /// had.
    #[inline]
    fn hold_back(&self, valid: &Mask16, rays: &mut Rays16) -> Option<[f32; WIDTH]> {
        if self.sees_masks || *valid == Mask16::ALL {
            return None;
        }
        let before = rays.t_near;
        for (i, t_near) in rays.t_near.iter_mut().enumerate() {
            if !valid.get(i) {
                *t_near = f32::NAN;
            }
        }
        Some(before)
    }
}
