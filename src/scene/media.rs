//! The participating media of a scene, and the surfaces that bound them.

use super::{CompileOptions, Scene, SurfaceInteraction};
use crate::accel::{self, Accel, Assembly, Coherence, Geometry, Hit};
use crate::emitter::{BoundingSphere, Emitter, Light, LitRegion};
use crate::error::{Error, Result};
use crate::ids::{MediumId, ShapeId};
use crate::math::{Bounds, Ray, Vec3};
use crate::medium::{Medium, MediumBoundary, Phase};
use crate::memory::Budget;
use std::collections::BTreeMap;

/// The media of a scene.
pub struct SceneMedia {
    list: Vec<Medium>,
    /// For each medium, whether it is [sealed](Self::is_sealed).
    sealed: Vec<bool>,
    /// What each shape bounds.
    boundaries: Vec<MediumBoundary>,
    /// Whether all media [fill bodies](Self::fill_bodies).
    fill_bodies: bool,
    /// The boundaries of media that rays may pass without being scattered: `null`, and masks with holes. Rays of
    /// [`Scene::accel`](super::Scene::accel) do not hit `null`, nor the holes of a mask.
    passed: Option<Box<dyn Accel>>,
    bounds: Bounds,
    /// The medium around the sensor to render.
    pub sensor: Option<MediumId>,
}

impl Scene {
    /// Returns whether there is a medium around the sensor or at a shape.
    pub fn uses_media(&self) -> bool {
        self.media
            .as_ref()
            .is_some_and(|media| media.sensor.is_some() || media.boundaries.iter().any(|b| !b.is_none()))
    }

    /// Checks that all media can be rendered.
    ///
    /// # Errors
    /// If one cannot, with the reason.
    pub fn check_media(&self) -> Result<()> {
        match self.media.as_ref().and_then(|media| media.unsupported()) {
            Some(reason) => Err(Error::scene(reason)),
            None => Ok(()),
        }
    }
}

impl SceneMedia {
    /// Returns a medium; `None` for vacuum.
    #[inline]
    pub fn get(&self, id: Option<MediumId>) -> Option<&Medium> {
        Some(&self.list[id?.index()])
    }

    /// Returns the phase function of a medium.
    #[inline]
    pub fn phase(&self, id: MediumId) -> &Phase {
        self.list[id.index()].phase()
    }

    /// Returns the reason why the media cannot be rendered, if there is one.
    fn unsupported(&self) -> Option<&str> {
        self.list.iter().find_map(|medium| match medium {
            Medium::Homogeneous(_) | Medium::Heterogeneous(_) => None,
            Medium::Unsupported(reason) => Some(reason.as_str()),
        })
    }

    /// Returns whether a medium is the interior of all its boundaries, none of which rays pass without being scattered,
    /// and which do not emit. It is not around the sensor, and no emitter of the scene is at a point. If the boundaries
    /// enclose it, light cannot reach it from an emitter on a straight line, unless the emitter is inside.
    #[inline]
    pub fn is_sealed(&self, id: MediumId) -> bool {
        self.sealed[id.index()]
    }

    /// Returns whether light gets into all media by being scattered at their boundaries only, unless these have a hole
    /// that a ray can pass, too: the media are [sealed](Self::is_sealed), there are no emitters in the boxes around
    /// them, and scattered rays can hit every emitter. The media are homogeneous, with the phase functions of
    /// [`Homogeneous::asymmetry`](crate::medium::Homogeneous::asymmetry); no shape is an instance.
    #[inline]
    pub fn fill_bodies(&self) -> bool {
        self.fill_bodies
    }

    /// Returns whether some medium scatters light.
    pub fn scatters(&self) -> bool {
        self.list.iter().any(Medium::scatters)
    }

    /// Returns bounds of the boundaries that rays may pass without being scattered, and of grids that no boundary
    /// encloses.
    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// Returns whether there are boundaries that rays may pass without being scattered.
    pub fn has_passed(&self) -> bool {
        self.passed.is_some()
    }

    /// Returns the nearest boundaries that rays may pass without being scattered. Hits are in the terms of
    /// [`Scene::accel`](super::Scene::accel).
    pub fn passed(&self, rays: &[Ray]) -> Vec<Option<Hit>> {
        let mut hits = vec![None; rays.len()];
        if let Some(passed) = &self.passed {
            passed.intersect_wave(rays, &mut hits, Coherence::Incoherent);
        }
        hits
    }

    /// Returns whether a shape is a boundary of media.
    pub fn is_boundary(&self, shape: ShapeId) -> bool {
        !self.boundary(shape).is_none()
    }

    /// Returns what a shape bounds.
    #[inline]
    fn boundary(&self, shape: ShapeId) -> MediumBoundary {
        self.boundaries[shape.index()]
    }

    /// Returns the medium on the geometric front side of a shape, if the description tells.
    pub fn exterior(&self, shape: ShapeId) -> Option<MediumId> {
        self.boundary(shape).exterior
    }

    /// Returns the medium on the side of a surface towards which the direction `w` points: `current` if the surface is
    /// not a boundary of media.
    pub fn beside(&self, at: &SurfaceInteraction, w: Vec3, current: Option<MediumId>) -> Option<MediumId> {
        self.on_side(at.shape(), w.dot(at.ng) > 0.0, current)
    }

    /// Returns the medium on the geometric front or back side of a shape: `current` if it is not a boundary of media.
    pub fn on_side(&self, shape: ShapeId, front: bool, current: Option<MediumId>) -> Option<MediumId> {
        match self.boundary(shape) {
            boundary if boundary.is_none() => current,
            boundary if front => boundary.exterior,
            boundary => boundary.interior,
        }
    }
}

/// The media of a scene under construction.
#[derive(Default)]
pub(super) struct MediaCompiler {
    boundaries: BTreeMap<ShapeId, MediumBoundary>,
    /// The media that light may reach on a straight line from outside.
    open: Vec<MediumId>,
    /// The geometry of the boundaries that rays may pass.
    passed: Vec<(ShapeId, Geometry)>,
}

impl MediaCompiler {
    /// Adds a boundary, with its geometry if rays may pass it without being scattered.
    pub fn add(&mut self, shape: ShapeId, boundary: MediumBoundary, emits: bool, passed: Option<Geometry>) {
        self.boundaries.insert(shape, boundary);
        self.open.extend(boundary.exterior);
        self.open.extend(boundary.interior.filter(|_| emits || passed.is_some()));
        self.passed.extend(passed.map(|geometry| (shape, geometry)));
    }

    /// Returns the media of the scene; `None` if there are none. `assembly` is that of the scene's shapes, `sensor` the
    /// medium around the sensor, and `lights` are the emitting shapes.
    ///
    /// # Errors
    /// If an index is out of range, and the errors of [`build_within`](accel::build_within).
    pub fn finish(
        &mut self,
        list: Vec<Medium>,
        sensor: Option<MediumId>,
        (lights, emitters): (&[Light], &[Emitter]),
        assembly: &Assembly,
        options: CompileOptions,
        memory: &Budget,
    ) -> Result<Option<Box<SceneMedia>>> {
        let boundaries = std::mem::take(&mut self.boundaries);
        let sides = boundaries.values().flat_map(|boundary| [boundary.interior, boundary.exterior]);
        if let Some(id) = sides.chain([sensor]).flatten().find(|id| id.index() >= list.len()) {
            return Err(Error::internal(format!("there is no medium {}", id.0)));
        }
        if list.is_empty() {
            return Ok(None);
        }
        // A lamp without size that is inside a body could be found by emitter samples only.
        let mut sealed = vec![!emitters.iter().any(Emitter::is_at_a_point); list.len()];
        for id in std::mem::take(&mut self.open).into_iter().chain(sensor) {
            sealed[id.index()] = false;
        }
        let mut boxes = vec![Bounds::EMPTY; list.len()];
        for (shape, boundary) in &boundaries {
            for id in [boundary.interior, boundary.exterior].into_iter().flatten() {
                boxes[id.index()] = boxes[id.index()].union(assembly.geometry[shape.index()].bounds());
            }
        }
        let lamps: Vec<Bounds> = lights.iter().filter_map(Light::lit_region).map(around).collect();
        let fills_bodies = |(medium, (sealed, inside)): (&Medium, (&bool, &Bounds))| {
            let simple = matches!(medium, Medium::Homogeneous(medium) if medium.asymmetry().is_some());
            inside.is_empty() || (simple && *sealed && !lamps.iter().any(|lamp| lamp.touches(inside)))
        };
        let fill_bodies = self.passed.is_empty()
            && sensor.is_none()
            && assembly.instances.is_empty()
            && !emitters.iter().any(Emitter::is_delta)
            && list.iter().zip(sealed.iter().zip(&boxes)).all(fills_bodies);
        let mut passed = None;
        if !self.passed.is_empty() {
            let mut geometry: Vec<Geometry> = assembly.geometry.iter().map(|_| Geometry::nothing()).collect();
            for (shape, of_shape) in self.passed.drain(..) {
                geometry[shape.index()] = of_shape;
            }
            let (groups, instances) = (assembly.groups.clone(), assembly.instances.clone());
            let assembly = Assembly { geometry, groups, instances, filter: None };
            passed = Some(accel::build_within(options.accel, assembly, options.threads, true, memory)?.accel);
        }
        let open = boundaries.values().filter_map(|boundary| boundary.exterior).chain(sensor);
        let grids = open.filter_map(|id| match &list[id.index()] {
            Medium::Heterogeneous(medium) => Some(medium.world_box()),
            Medium::Homogeneous(_) | Medium::Unsupported(_) => None,
        });
        let of_passed = passed.as_ref().map_or(Bounds::EMPTY, |passed| passed.bounds());
        let bounds = grids.fold(of_passed, Bounds::union);
        let of_shape = |shape| boundaries.get(&ShapeId::from(shape)).copied().unwrap_or_default();
        let boundaries = (0..assembly.geometry.len()).map(of_shape).collect();
        Ok(Some(Box::new(SceneMedia { list, sealed, boundaries, fill_bodies, passed, bounds, sensor })))
    }
}

/// Returns the box around an emitter.
fn around(region: LitRegion) -> Bounds {
    let BoundingSphere { center, radius } = region.sphere;
    Bounds { min: center - radius, max: center + radius }
}
