//! Which share of a disc around a surface point the surface fills.
//!
//! Density estimation takes a disc for full. At the edge of a surface half of it is empty, so that the estimate is
//! half of what it should be. Rays that go down to the disc along the normal say how much is there, whatever light
//! falls on it, so that the border of a shadow is not taken for the border of a surface. What stands on a
//! surface which goes on below is not seen so: there the estimate stays too dark.

use super::density::{COMPATIBLE, FLATNESS, Irradiance, Place};
use super::kernel::Kernel;
use crate::accel::{Coherence, Hit};
use crate::integrator::worker::{Counters, intersect};
use crate::math::{Frame, Ray, Vec3};
use crate::sampling::hash::{mix, to_unit};
use crate::scene::Scene;
use std::sync::{Mutex, PoisonError};

/// Rays for a disc.
const RAYS: usize = 32;

/// Corrects irradiance at the boundaries of surfaces.
pub struct Boundary<'a> {
    scene: &'a Scene,
    counters: Mutex<Counters>,
}

impl<'a> Boundary<'a> {
    /// For the surfaces of a scene.
    pub fn new(scene: &'a Scene) -> Self {
        Boundary { scene, counters: Mutex::default() }
    }

    /// Divides each estimate by the share of its disc, weighted by the kernel, that the surface fills; by 1/8 where it is less.
    pub fn correct(&self, places: &[Place], kernel: Kernel, estimates: &mut [Irradiance]) {
        let mut rays = Vec::with_capacity(RAYS * places.len());
        for (i, (at, estimate)) in places.iter().zip(&*estimates).enumerate() {
            rays.extend((0..RAYS).map(|k| ray_to_disc(at, estimate.radius, kernel, i as u32, k)));
        }
        let (mut hits, mut counters) = (Vec::new(), Counters::default());
        intersect(self.scene, &rays, Coherence::Incoherent, &mut hits, &mut counters);
        for (i, (at, estimate)) in places.iter().zip(estimates).enumerate() {
            let own = RAYS * i..RAYS * (i + 1);
            let filled =
                rays[own.clone()].iter().zip(&hits[own]).filter(|(ray, hit)| self.meets(at, ray, hit));
            let share = (filled.count() as f32 / RAYS as f32).max(0.125);
            estimate.value = estimate.value / share;
        }
        self.counters.lock().unwrap_or_else(PoisonError::into_inner).merge(&counters);
    }

    /// Whether a ray has met the surface that the place belongs to.
    fn meets(&self, at: &Place, ray: &Ray, hit: &Option<Hit>) -> bool {
        hit.is_some_and(|hit| {
            let cosine = self.scene.interaction(ray, &hit).ng.dot(at.n);
            cosine * cosine > COMPATIBLE
        })
    }

    /// The rays that were traced.
    pub fn counters(self) -> Counters {
        self.counters.into_inner().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The `k`-th ray along the normal through the flat ellipsoid of a disc; its points are spread as the kernel's weight is.
fn ray_to_disc(at: &Place, radius: f32, kernel: Kernel, disc: u32, k: usize) -> Ray {
    let u = (k as f32 + 0.5) / RAYS as f32;
    // A sunflower's spiral, turned for each disc.
    let turn = k as f32 * 0.618_034 + to_unit(mix(disc));
    let (sin, cos) = (std::f32::consts::TAU * turn.fract()).sin_cos();
    let d = kernel.quantile(u);
    let height = radius / FLATNESS * (1.0 - d * d).max(0.0).sqrt();
    let beside = Frame::from_normal(at.n).to_world(Vec3::new(cos, sin, 0.0) * d * radius);
    Ray { o: at.p + beside + at.n * height, d: -at.n, t_max: 2.0 * height, time: 0.0 }
}
