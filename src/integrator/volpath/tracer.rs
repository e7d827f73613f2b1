//! What all paths share, and the light that they find between their events.

use super::Path;
use super::equiangular::LegPoint;
use crate::color::Rgb;
use crate::emitter::{LightSelection, LitRegion};
use crate::integrator::{PathLimits, RadianceQuery};
use crate::sampling::mis::{power_heuristic, power_heuristic_of_three};
use crate::scene::{Scene, SceneMedia, SurfaceInteraction};

/// What all paths share.
pub struct Tracer<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Its media.
    pub media: &'a SceneMedia,
    /// The limits of paths.
    pub limits: PathLimits,
    /// The light to find.
    pub query: RadianceQuery,
    /// The points that each emitter may light; `None` at infinity.
    pub regions: &'a [Option<LitRegion>],
    /// Whether there are emitters that are not at infinity.
    pub has_near: bool,
}

impl Tracer<'_> {
    /// Returns the weighted light at the surface that a path's ray meets, or from infinity.
    pub fn found(&self, path: &Path, at: Option<&SurfaceInteraction>, leg_points: &[LegPoint]) -> Rgb {
        match at {
            _ if !self.adds_emission(path) => Rgb::BLACK,
            Some(at) => self.emitted(path, at, leg_points),
            None => self.environment(path),
        }
    }

    /// Returns whether paths may be scattered once more after `depth` events.
    pub fn scatters(&self, depth: u32) -> bool {
        self.limits.allows(depth + 2) && (self.query.direct || self.query.indirect)
    }

    /// Returns whether emission found by the path's ray is added.
    fn adds_emission(&self, path: &Path) -> bool {
        self.query.wants(path.depth + 1) && !(path.depth == 0 && self.limits.hide_emitters)
    }

    /// Returns the choice among the emitters. A direction is sampled at every event, too, so emitter samples may omit
    /// light that those find well.
    pub fn selection(&self) -> &LightSelection {
        self.scene.compensated_selection.as_ref().unwrap_or(&self.scene.light_selection)
    }

    /// Returns the weighted radiance of the emitter at a surface; black if nothing is emitted towards the path.
    fn emitted(&self, path: &Path, at: &SurfaceInteraction, leg_points: &[LegPoint]) -> Rgb {
        let Some(emitter) = self.scene.emitter_at(at) else { return Rgb::BLACK };
        let radiance = self.scene.emitted(emitter, at);
        if path.pdf.is_infinite() {
            return radiance;
        }
        let other = self.scene.emitter_pdf(self.selection(), emitter, path.from, path.ray.o, at);
        let other = other * path.emitter_share;
        let factor = path.on_leg.map_or(0.0, |point| {
            let pmf = self.selection().pmf(emitter.index(), path.from);
            self.relative_density(&leg_points[point as usize], emitter.index(), pmf)
        });
        let near = if factor > 0.0 { other * factor } else { 0.0 };
        radiance * power_heuristic_of_three(path.pdf, [other, near])
    }

    /// Returns [`LegPoint::relative_density`] for an emitter; 0 if it is at infinity.
    pub fn relative_density(&self, point: &LegPoint, emitter: usize, pmf: f32) -> f32 {
        let region = self.regions.get(emitter).and_then(Option::as_ref);
        region.map_or(0.0, |region| point.relative_density(self.selection(), emitter, region, pmf))
    }

    /// Returns the weighted radiance of the environment and the sun.
    fn environment(&self, path: &Path) -> Rgb {
        let d = path.ray.d;
        let mut sum = Rgb::BLACK;
        // Each emitter is weighted against its own samples, as if it were alone.
        for emitter in self.scene.distant_emitters() {
            let mut radiance = self.scene.distant_radiance(emitter, d);
            if path.pdf.is_finite() {
                let pmf = self.selection().pmf(emitter.index(), path.from);
                let other = pmf * self.scene.distant_density(self.selection(), emitter, d);
                let other = other * path.emitter_share;
                radiance *= power_heuristic(path.pdf, other);
            }
            sum += radiance;
        }
        sum
    }
}
