//! Scenes: a builder that `commit` consumes, and the immutable scene that answers queries.

use super::device::{Device, DeviceHandle};
use super::filter::{FilterState, TriangleFilter, on_filter};
use super::packet::{COMPONENT_LIMIT, Mask16, RayHit1, RayHits16, Rays16, WIDTH};
use super::user::{QueryContext, UserPrimitives, UserState, on_bounds, on_intersect, on_occluded};
use crate::error::{Error, Result};
use buffon_embree_sys as sys;
use std::sync::Arc;

/// The greatest number of motion steps of an instance.
const MAX_STEPS: usize = sys::RTC_MAX_TIME_STEP_COUNT as usize;

/// The options of a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneOptions {
    /// Whether edges are watertight, at some cost (`RTC_SCENE_FLAG_ROBUST`). False only for measuring that cost.
    pub robust: bool,
    /// The greatest absolute value of a component of a valid ray, at most [`COMPONENT_LIMIT`]. It is lower where the
    /// inverse of an instance's transform would take a ray beyond that.
    pub ray_limit: f32,
}

impl Default for SceneOptions {
    fn default() -> Self {
        SceneOptions { robust: true, ray_limit: COMPONENT_LIMIT }
    }
}

/// The coherence of the rays of successive queries, as known by the caller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coherence {
    /// Neighbouring rays have nearly the same origin and direction.
    Coherent,
    /// Neighbouring rays are unrelated.
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

/// The single owner of a scene's C handle.
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

/// The data that Embree reads while the scene lives.
#[derive(Default)]
struct EmbreeData {
    vertices: Vec<Arc<Vec<[f32; 3]>>>,
    indices: Vec<Arc<Vec<[u32; 3]>>>,
    // Boxed because Embree holds the address.
    #[expect(clippy::vec_box)]
    users: Vec<Box<UserState>>,
    // As above.
    #[expect(clippy::vec_box)]
    filters: Vec<Box<FilterState>>,
    scenes: Vec<Arc<CommittedScene>>,
}

/// The single owner of a geometry's C handle until it is attached.
struct GeometryHandle(sys::RTCGeometry);

impl Drop for GeometryHandle {
    fn drop(&mut self) {
        // SAFETY: the handle is live and owned by `self`; an attached geometry is retained by its scene.
        unsafe { sys::rtcReleaseGeometry(self.0) };
    }
}

/// A scene under construction.
pub struct SceneBuilder {
    // Declared first so that it is dropped before the data that it reads.
    scene: SceneHandle,
    data: EmbreeData,
    ray_limit: f32,
}

impl SceneBuilder {
    /// Creates an empty scene.
    ///
    /// # Errors
    /// If Embree has no memory for it.
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
        Ok(SceneBuilder {
            scene,
            data: EmbreeData::default(),
            ray_limit: options.ray_limit.min(COMPONENT_LIMIT),
        })
    }

    /// Adds a triangle mesh as geometry `id`. The arrays are shared with Embree, not copied.
    ///
    /// The first `count` elements of `vertices` are the vertices. At least one more element must follow them, because
    /// Embree reads 16 bytes at the last vertex, of which only 12 belong to it. The filter, if any, accepts or
    /// rejects the hits.
    ///
    /// # Errors
    /// If the padding is missing, an index is out of range, or Embree reports an error (an id used twice).
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
        // SAFETY: the geometry is live. Both arrays lie behind an `Arc<Vec>` that `data` holds until after the
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
        self.data.vertices.push(vertices);
        self.data.indices.push(indices);
        if let Some(filter) = filter {
            let state = Box::new(FilterState(filter));
            let pointer: *const FilterState = &*state;
            // SAFETY: the geometry is live; `state` is boxed and held by `data` until after the scene is released; the
            // callback reads it only, and has the signature that Embree calls.
            unsafe {
                sys::rtcSetGeometryUserData(geometry.0, pointer.cast_mut().cast());
                sys::rtcSetGeometryIntersectFilterFunction(geometry.0, Some(on_filter));
                sys::rtcSetGeometryOccludedFilterFunction(geometry.0, Some(on_filter));
            }
            self.data.filters.push(state);
        }
        self.attach(&geometry, id)
    }

    /// Adds user primitives as geometry `id`.
    ///
    /// # Errors
    /// If Embree reports an error (an id used twice).
    pub fn add_user(&mut self, id: u32, primitives: Arc<dyn UserPrimitives>) -> Result<()> {
        let state = Box::new(UserState::new(primitives));
        let geometry = self.new_geometry(sys::RTCGeometryType::RTC_GEOMETRY_TYPE_USER)?;
        let pointer: *const UserState = &*state;
        // SAFETY: the geometry is live; `state` is boxed and held by `data` until after the scene is released; the
        // callbacks read it only, and have the signatures that Embree calls.
        unsafe {
            sys::rtcSetGeometryUserPrimitiveCount(geometry.0, state.count());
            sys::rtcSetGeometryUserData(geometry.0, pointer.cast_mut().cast());
            sys::rtcSetGeometryBoundsFunction(geometry.0, Some(on_bounds), std::ptr::null_mut());
            sys::rtcSetGeometryIntersectFunction(geometry.0, Some(on_intersect));
            sys::rtcSetGeometryOccludedFunction(geometry.0, Some(on_occluded));
        }
        self.data.users.push(state);
        self.attach(&geometry, id)
    }

    /// Adds an instance of a scene as geometry `id`; hits report it as their instance. Instances inside the instanced
    /// scene are not traversed.
    ///
    /// `steps` are the transforms from the space of the instanced scene to that of this scene, at equally spaced
    /// times over [0, 1], each as three axes and the translation. They are interpolated linearly. They must be
    /// invertible at all times. The scene's [`ray_limit`](SceneOptions::ray_limit) must be such that no inverse takes
    /// a ray beyond [`COMPONENT_LIMIT`]; otherwise a build of Embree with assertions aborts the process.
    ///
    /// # Errors
    /// If the scene belongs to another device, there are no steps or more than 129, a step is not finite, or Embree
    /// reports an error (an id used twice).
    pub fn add_instance(&mut self, id: u32, scene: Arc<CommittedScene>, steps: &[[f32; 12]]) -> Result<()> {
        if !Arc::ptr_eq(&scene.scene.device, &self.scene.device) {
            return Err(Error::internal("expected a scene of the same device").about("Embree"));
        }
        // With a number of steps out of range, Embree reads beyond its arrays.
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
        // SAFETY: the geometry and the instanced scene are live and of one device; the scene is committed and `data`
        // holds it until after this one is released. Embree copies the 12 floats of each step.
        unsafe {
            sys::rtcSetGeometryInstancedScene(geometry.0, scene.scene.raw);
            sys::rtcSetGeometryTimeStepCount(geometry.0, steps.len() as u32);
            for (i, step) in (0..).zip(steps) {
                let format = sys::RTCFormat::RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR;
                sys::rtcSetGeometryTransform(geometry.0, i, format, step.as_ptr().cast());
            }
        }
        self.data.scenes.push(scene);
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
        let honours_masks = self.scene.device.has_native_packets16();
        Ok(CommittedScene { scene: self.scene, data: self.data, ray_limit: self.ray_limit, honours_masks })
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

/// A built, immutable scene. It can be queried from any number of threads.
///
/// A ray is invalid if a component of its origin or direction is NaN or exceeds [`SceneOptions::ray_limit`], its
/// direction is zero, `0 ≤ t_near < t_far` is false, or its time is outside [0, 1]. An invalid ray hits nothing and
/// is not changed. Embree itself does not check this; a build with assertions, such as Debian's, aborts the process.
pub struct CommittedScene {
    // Declared first so that it is dropped before the data that it reads.
    scene: SceneHandle,
    data: EmbreeData,
    ray_limit: f32,
    /// Whether Embree honours the mask of a packet. A device without native packets of sixteen does not: it splits
    /// them and traces every ray with `t_near` ≤ `t_far`.
    honours_masks: bool,
}

impl CommittedScene {
    /// Returns the bounding box of the scene (least corner, greatest corner); least > greatest if the scene is empty.
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

    /// Returns the bytes that Embree holds for the scene's device, which are the scene's own if the device has no
    /// other scene.
    pub fn memory_bytes(&self) -> usize {
        self.scene.device.memory_bytes()
    }

    /// Finds the nearest hit. A miss leaves the ray unchanged.
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

    /// Returns whether the ray hits anything.
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

    /// Finds the nearest hits of the active rays of a packet. A miss leaves a ray unchanged. Returns a mask of the
    /// rays that were traced: the active ones that are valid.
    #[inline]
    pub fn intersect16(&self, active: &Mask16, rays: &mut RayHits16, coherence: Coherence) -> Mask16 {
        let valid = rays.rays.valid(active, self.ray_limit);
        let t_near_before = self.deactivate(&valid, &mut rays.rays);
        let mut context = coherence.context();
        let (context_ptr, packet) = (context.as_mut_ptr(), &raw mut *rays);
        // SAFETY: the scene is committed; `RayHits16` is `RTCRayHit16` in size, alignment and layout, and the mask
        // is aligned alike.
        unsafe { sys::rtcIntersect16(valid.as_ptr(), self.scene.raw, context_ptr, packet.cast()) };
        if let Some(t_near) = t_near_before {
            rays.rays.t_near = t_near;
        }
        context.finish();
        valid
    }

    /// Finds whether the active rays of a packet hit anything; `t_far` of such a ray becomes -∞. Returns a mask of
    /// the rays that were traced: the active ones that are valid.
    #[inline]
    pub fn occluded16(&self, active: &Mask16, rays: &mut Rays16, coherence: Coherence) -> Mask16 {
        let valid = rays.valid(active, self.ray_limit);
        // Embree 3.13.5 does not return from a coherent `rtcOccluded16` that enters an instance.
        let coherence = if self.data.scenes.is_empty() { coherence } else { Coherence::Incoherent };
        let t_near_before = self.deactivate(&valid, rays);
        let mut context = coherence.context();
        let (context_ptr, packet) = (context.as_mut_ptr(), &raw mut *rays);
        // SAFETY: the scene is committed; `Rays16` is `RTCRay16` in size, alignment and layout, and the mask is
        // aligned alike.
        unsafe { sys::rtcOccluded16(valid.as_ptr(), self.scene.raw, context_ptr, packet.cast()) };
        if let Some(t_near) = t_near_before {
            rays.t_near = t_near;
        }
        context.finish();
        valid
    }

    /// Sets `t_near` of the inactive rays to NaN, so that Embree does not trace them even if it ignores the mask.
    /// Returns the previous values of `t_near`.
    #[inline]
    fn deactivate(&self, valid: &Mask16, rays: &mut Rays16) -> Option<[f32; WIDTH]> {
        if self.honours_masks || *valid == Mask16::ALL {
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
