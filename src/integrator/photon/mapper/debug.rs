//! Debug images of the photons.

use super::{LookupPoint, Photonmapper, lookup_point};
use crate::color::Rgb;
use crate::integrator::block::ShadingBlock;
use crate::integrator::photon::density::FLATNESS;
use crate::integrator::photon::kdtree::{EllipsoidMetric, NeighbourBuffer};
use crate::integrator::photon::{PhotonMap, Sides};
use crate::integrator::settings::PhotonDebug;
use crate::integrator::{Radiance, Wave, Worker};
use crate::math::lanes::{LANES, bits};
use crate::scene::Scene;

/// Shows the global map at the first surface along each ray.
pub fn li(
    mapper: &Photonmapper,
    scene: &Scene,
    show: PhotonDebug,
    wave: Wave<'_>,
    worker: &mut Worker,
    out: &mut [Radiance],
) {
    out.fill(Radiance::NONE);
    worker.paths.begin(wave.rays, wave.keys);
    worker.intersect(scene, wave.rays, wave.coherence);
    let Worker { paths, hits, arena, .. } = worker;
    for (out, hit) in out.iter_mut().zip(&*hits) {
        out.distance = hit.map_or(f32::INFINITY, |hit| hit.t);
    }
    paths.keep_hits(hits);
    let mut buffer = NeighbourBuffer::default();
    for first in (0..hits.len()).step_by(LANES) {
        arena.reset();
        let block = ShadingBlock::new(scene, arena, &paths.rays, hits, first);
        for i in bits(block.finite) {
            let slot = paths.slots[first + i] as usize;
            let maps = &mapper.maps[wave.keys[slot].replicate as usize % mapper.maps.len()];
            let Some(map) = &maps.global else { continue };
            let at = lookup_point(&block, i);
            out[slot].value = match show {
                PhotonDebug::Photons => nearest_photon(map, at, maps.point),
                _ => {
                    let (wo, frame) = (block.wo.lane(i), block.at.frame.lane(i));
                    mapper.global.reflected(map, at, Sides::Both, &mut buffer, |wi| {
                        block.bsdfs[i].eval(wo, frame.to_local(wi)).f
                    })
                }
            };
        }
    }
}

/// Returns the colour of the nearest photon, or black if none is near.
fn nearest_photon(map: &PhotonMap, at: LookupPoint, radius: f32) -> Rgb {
    let metric = EllipsoidMetric { normal: at.n, flatness: FLATNESS };
    match map.tree().nearest_one(at.p, radius * radius, metric, |_| true) {
        Some(nearest) => {
            let power = map.photon(nearest.slot()).power();
            power / power.max_component()
        }
        None => Rgb::BLACK,
    }
}
