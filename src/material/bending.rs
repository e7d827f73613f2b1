//! Perturbed normals: the common part of `bumpmap` and `normalmap`.

use super::{Context, MaterialPoint, Sampling, Scattering, Source};
use crate::bsdf::{Bsdf, Tilted};
use crate::error::Result;
use crate::ids::MaterialId;
use crate::math::{Frame, Vec3};

/// Options for perturbed normals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Bending {
    /// Whether a normal that points away from the viewer is mirrored to point to the viewer. [Schüßler 2017]
    pub flip_invalid: bool,
    /// Whether the shadow terminator is softened. [Estevez 2019]
    pub soften: bool,
}

impl Bending {
    pub(super) fn read(source: &mut dyn Source) -> Result<Self> {
        Ok(Bending {
            flip_invalid: source.boolean("flip_invalid_normals", true)?,
            soften: source.boolean("use_shadowing_function", true)?,
        })
    }

    /// Returns the sampling around `inner`. Light paths choose between the normal and its mirror image.
    pub(super) fn sampling(&self, inner: Sampling) -> Sampling {
        Sampling { chooses_lobe: inner.chooses_lobe || self.flip_invalid, ..inner }
    }

    /// Returns the inner material in the frame of the local normal `n`, which need not have unit length.
    pub(super) fn tilted<'a>(&self, context: &Context<'a>, n: Vec3, inner: MaterialId) -> Scattering<'a> {
        let Context { at, arena, .. } = *context;
        let mirrored = Vec3::new(-n.x, -n.y, n.z);
        let tilt = |n: Vec3, turned: Option<&'a Tilted<'a>>| {
            let frame = Frame::from_normal_tangent(n.try_normalize().unwrap_or(Vec3::Z), Vec3::X);
            let world = Frame {
                s: at.frame.to_world(frame.s),
                t: at.frame.to_world(frame.t),
                n: at.frame.to_world(frame.n),
            };
            let wo = at.wo.map(|wo| frame.to_local(wo));
            let at = MaterialPoint { frame: world, wo, ..at };
            let Scattering { bsdf, opacity } = Context { at, ..*context }.inner(inner);
            (Tilted { frame, soften: self.soften, inner: arena.alloc(bsdf), turned }, opacity)
        };
        let (tilted, opacity) = match at.wo {
            _ if !self.flip_invalid => tilt(n, None),
            Some(wo) if wo.z * wo.dot(n) <= 0.0 => tilt(mirrored, None),
            Some(_) => tilt(n, None),
            None => {
                let (turned, _) = tilt(mirrored, None);
                tilt(n, Some(arena.alloc(turned)))
            }
        };
        Scattering { bsdf: Bsdf::Tilted(tilted), opacity }
    }
}
