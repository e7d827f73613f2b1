//! The vertices of subpaths: surface points, and points in media.

use crate::color::Rgb;
use crate::ids::MediumId;
use crate::integrator::flight::medium_after;
use crate::integrator::light_path::LightVertex;
use crate::math::ray::{end_error, offset_origin};
use crate::math::{Ray, Vec3};
use crate::medium::Phase;
use crate::scene::{Scene, SceneMedia};
use std::f32::consts::FRAC_1_PI;

/// What stands for the cosine at a point in a medium: the isotropic phase function relative to a diffuse BSDF.
pub const IN_MEDIUM: f32 = 0.25;

/// A vertex of a subpath.
pub enum Vertex<'a> {
    /// A surface point.
    Surface(LightVertex<'a>),
    /// A point in a medium.
    Medium(MediumPoint<'a>),
}

/// A point in a medium at which a subpath is scattered.
#[derive(Clone, Copy)]
pub struct MediumPoint<'a> {
    pub p: Vec3,
    /// The unit direction in which the subpath arrives.
    pub d: Vec3,
    pub time: f32,
    pub phase: &'a Phase,
}

/// What a vertex does to light that goes from the other end of a connection to the subpath's start, or the reverse.
pub struct Scattering {
    /// The BSDF times the cosine, or the phase function.
    pub value: Rgb,
    /// The density per unit solid angle with which the subpath would have sampled the direction to the other end.
    pub forward: f32,
    /// The density per unit solid angle of the reversed path.
    pub reverse: f32,
}

impl MediumPoint<'_> {
    /// Returns the phase function for the world-space direction `w`, which is also the density of `w` and of the
    /// reversed path.
    pub fn density(&self, w: Vec3) -> f32 {
        self.phase.eval(self.d.dot(w))
    }

    fn scattering(&self, w: Vec3) -> Scattering {
        let density = self.density(w);
        Scattering { value: Rgb::splat(density), forward: density, reverse: density }
    }
}

impl<'a> Vertex<'a> {
    /// Returns the position.
    pub fn p(&self) -> Vec3 {
        match self {
            Vertex::Surface(surface) => surface.at.p,
            Vertex::Medium(point) => point.p,
        }
    }

    /// Returns an estimate of the density per unit solid angle with which the reversed path goes on: that of a diffuse
    /// surface or an isotropic medium.
    pub fn usual_density(&self) -> f64 {
        let relative = match self {
            Vertex::Surface(surface) => surface.wo.z.abs(),
            Vertex::Medium(_) => IN_MEDIUM,
        };
        f64::from(relative * FRAC_1_PI)
    }

    /// Returns the time, in [0, 1] over the shutter interval.
    pub fn time(&self) -> f32 {
        match self {
            Vertex::Surface(surface) => surface.at.time,
            Vertex::Medium(point) => point.time,
        }
    }

    /// Returns the surface point, where no vertex is in a medium.
    ///
    /// # Panics
    /// If it is a point in a medium.
    pub fn surface(&self) -> &LightVertex<'a> {
        match self {
            Vertex::Surface(surface) => surface,
            Vertex::Medium(_) => panic!("expected a surface point"),
        }
    }

    /// Returns the cosine of a world-space direction with the geometric normal. Every technique samples a point in a
    /// medium, with the density of the free flight there as the factor in place of a cosine. So it is 1.
    pub fn cosine(&self, w: Vec3) -> f32 {
        match self {
            Vertex::Surface(surface) => w.dot(surface.at.ng).abs(),
            Vertex::Medium(_) => 1.0,
        }
    }

    /// Returns the value and the reverse density of [`emerging`](Self::emerging).
    pub fn emerging_with_reverse(&self, w: Vec3) -> (Rgb, f32) {
        match self {
            Vertex::Surface(surface) => surface.eval_with_density(w),
            Vertex::Medium(point) => (Rgb::splat(point.density(w)), point.density(w)),
        }
    }

    /// Returns the scattering at the end of a light path into the world-space direction `w` towards the viewer.
    pub fn emerging(&self, w: Vec3) -> Scattering {
        match self {
            Vertex::Surface(surface) => {
                let (value, reverse) = self.emerging_with_reverse(w);
                let to_viewer = surface.at.frame.to_local(w);
                let forward = surface.bsdf.pdf_adjoint(surface.wo, to_viewer);
                Scattering { value, forward, reverse }
            }
            Vertex::Medium(point) => point.scattering(w),
        }
    }

    /// Returns the scattering at the end of a camera path from the world-space direction `w` towards the light.
    pub fn incident(&self, w: Vec3) -> Scattering {
        match self {
            Vertex::Surface(surface) => {
                let wi = surface.at.frame.to_local(w);
                let eval = surface.bsdf.eval(surface.wo, wi);
                let reverse = surface.bsdf.pdf_adjoint(wi, surface.wo);
                Scattering { value: eval.f * wi.z.abs(), forward: eval.pdf, reverse }
            }
            Vertex::Medium(point) => point.scattering(w),
        }
    }

    /// Returns the ray to the point `target` in the world-space direction `w`, with the parameter 1 at its end.
    pub fn ray_to(&self, scene: &Scene, target: Vec3, w: Vec3) -> Ray {
        match self {
            Vertex::Surface(surface) => scene.shadow_ray_to(&surface.at, target, w),
            Vertex::Medium(point) => Ray { o: point.p, d: target - point.p, t_max: 1.0, time: point.time },
        }
    }

    /// Returns the end of a ray to the vertex. `way` is the vector to it.
    pub fn target(&self, way: Vec3) -> Vec3 {
        match self {
            Vertex::Surface(LightVertex { at, .. }) => {
                offset_origin(at.p, at.error + end_error(way), at.ng, -way)
            }
            Vertex::Medium(point) => point.p,
        }
    }

    /// Returns the medium in which light starts in the direction `w`, if the subpath arrives in `medium`.
    pub fn medium_towards(
        &self,
        scene: &Scene,
        media: &SceneMedia,
        w: Vec3,
        medium: Option<MediumId>,
    ) -> Option<MediumId> {
        match self {
            Vertex::Surface(LightVertex { at, wo, .. }) => {
                medium_after(scene, media, at.facet(), (-at.frame.to_world(*wo), w), medium)
            }
            Vertex::Medium(_) => medium,
        }
    }
}
