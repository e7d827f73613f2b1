//! Connections of the vertices of camera paths with emitters and with the vertices of light paths.

use super::camera_paths::{CameraPaths, CameraVertices, Subpath};
use super::light_paths::{StoredVertex, typical_start_density};
use super::technique::Techniques;
use super::vertex::{IN_MEDIUM, Vertex};
use super::weights::{self, End, Start};
use crate::bsdf::lanes::{eval_x16, pdf_adjoint_x16};
use crate::color::Rgb;
use crate::integrator::flight::{Departure, medium_after, stream};
use crate::integrator::light_path::LightVertex;
use crate::integrator::shadows::ShadowQueue;
use crate::math::lanes::{LANES, bits, each_lane, f32x16};
use crate::math::{Ray, RayX16, Vec3, Vec3x16};
use crate::sampling::SampleKey;
use std::f32::consts::FRAC_1_PI;

/// The least cosine in the estimate of a contribution: shading normals and lobes may be anywhere.
const LEAST_COSINE: f32 = 0.05;
/// The least weight in the estimate of a contribution: that of glossy surfaces is another one.
const LEAST_WEIGHT: f32 = 1e-4;

impl CameraPaths<'_> {
    /// Samples an emitter at each vertex with a finite lobe. Queues shadow rays with the weighted contributions.
    pub(super) fn sample_emitters(
        &self,
        vertices: &CameraVertices<'_>,
        u: [f32x16; 2],
        shadows: &mut ShadowQueue,
    ) {
        let (scene, CameraVertices { block, partials, depth, .. }) = (self.scene, vertices);
        let (at, selection) = (&block.at, &scene.light_selection);
        let chosen = scene.sample_emitters_choice(selection, &at.p.into(), u, block.rays.time, block.finite);
        let Some((choice, sample)) = chosen else { return };
        let wi = at.frame.to_local(sample.wi);
        let scattered = eval_x16(&block.bsdfs, &block.wo, &wi, block.finite);
        let mut value = std::array::from_fn(|c| scattered.f[c] * sample.radiance[c]);
        let lanes =
            some(&value) & (sample.valid & !sample.pdf.simd_le(f32x16::ZERO)).to_bitmask() & block.finite;
        if lanes == 0 {
            return;
        }
        let reverse = pdf_adjoint_x16(&block.bsdfs, &wi, &block.wo, lanes).to_array();
        let rays = scene.shadow_rays(at, &sample, block.rays.time);
        let distance2 = rays.d.length_squared().to_array();
        let cosines = sample.wi.dot(at.ng).abs().to_array();
        let (directions, emitted) = (-sample.wi, sample.cosine.to_array());
        let (pmf, pdf) = (choice.pmf.to_array(), scattered.pdf.to_array());
        let weights = each_active(lanes, |i| {
            let light = &scene.lights[choice.emitters[i]];
            let started = typical_start_density(scene, self.guide, choice.emitters[i]);
            let start = Start::new(light, directions.lane(i), emitted[i], pmf[i], started);
            let (distance2, cos) = (f64::from(distance2[i]), f64::from(cosines[i]));
            let weight =
                partials[i].of_emitter_sample(start, distance2, cos, pdf[i].into(), reverse[i].into());
            self.techniques.weight(1, depth + 2, weight) as f32
        });
        let factor = wi.z.abs() / sample.pdf * weights;
        value = value.map(|channel| channel * factor);
        self.push(shadows, vertices, lanes, (&rays, |key| key, 1), value);
    }

    /// Connects each vertex with a finite lobe to one vertex of each of its light paths. Queues shadow rays with the
    /// weighted contributions. The vertices are chosen with probabilities that are nearly in proportion to their
    /// contributions, by the number of the lane in `u`.
    pub(super) fn connect(&self, vertices: &CameraVertices<'_>, u: &[f32], shadows: &mut ShadowQueue) {
        let CameraVertices { block, paths, partials, .. } = vertices;
        let densities = (block.wo.z.abs() * f32x16::splat(FRAC_1_PI)).to_array();
        let mut ratios = [0.0; LANES];
        for i in bits(block.finite) {
            ratios[i] = partials[i].ratios(densities[i].into()) as f32;
        }
        let most = bits(block.finite).map(|i| self.connections(&paths[i])).max().unwrap_or(0);
        for k in 0..most {
            self.connect_to(k, vertices, &ratios, u, shadows);
        }
    }

    /// Returns the number of light paths to which the next vertex of a path is connected: several at the first one with
    /// a finite lobe, which has most of the noise of connections. Merging has less noise there.
    pub(super) fn connections(&self, path: &Subpath) -> u32 {
        if path.finite || self.merging.is_some() { 1 } else { self.shared.connected() }
    }

    /// Connects the vertices to light path `k` of each.
    fn connect_to(
        &self,
        k: u32,
        vertices: &CameraVertices<'_>,
        ratios: &[f32; LANES],
        u: &[f32],
        shadows: &mut ShadowQueue,
    ) {
        let CameraVertices { block, partials, depth, .. } = vertices;
        let at = &block.at;
        let mut chosen = [None; LANES];
        for i in bits(block.finite).filter(|i| k < self.connections(&vertices.paths[*i])) {
            let (path, p, ng) = (&vertices.paths[i], at.p.lane(i), at.ng.lane(i));
            let end = CameraEnd { path, depth: *depth, p, ratio: ratios[i] };
            chosen[i] = self.choose(&end, |wi| wi.dot(ng).abs().max(LEAST_COSINE), (k, u[i]));
            if let Some(connection @ (StoredVertex { vertex: Vertex::Medium(_), .. }, _)) = chosen[i] {
                let vertex = Vertex::Surface(LightVertex::new(block, i));
                self.connect_one(path, &vertex, (partials[i], *depth), connection, k, shadows);
                chosen[i] = None;
            }
        }
        let lanes =
            chosen.iter().enumerate().fold(0, |lanes, (i, choice)| lanes | u32::from(choice.is_some()) << i);
        let Some((any, _)) = chosen.iter().flatten().next().copied() else { return };
        // The lanes without a connection have any vertex, and are not used.
        let lights: [&StoredVertex<'_>; LANES] = each_lane(|i| chosen[i].map_or(any, |(light, _)| light));
        let of_choice = f32x16::new(each_lane(|i| chosen[i].map_or(0.0, |(_, factor)| factor)));
        let vectors = |vector: &dyn Fn(&StoredVertex<'_>) -> Vec3| {
            let mut all = Vec3x16::default();
            lights.iter().enumerate().for_each(|(i, light)| all.set_lane(i, vector(light)));
            all
        };
        let way = vectors(&|light| light.vertex.surface().at.p) - at.p;
        let distance2 = way.length_squared();
        let wi = way * (f32x16::ONE / distance2.sqrt());
        let local = at.frame.to_local(wi);
        let scattered = eval_x16(&block.bsdfs, &block.wo, &local, lanes);
        let lanes = lanes & some(&scattered.f);
        if lanes == 0 {
            return;
        }
        // At the light path's end.
        let bsdfs = lights.map(|light| light.vertex.surface().bsdf);
        let (wo, ng) =
            (vectors(&|light| light.vertex.surface().wo), vectors(&|light| light.vertex.surface().at.ng));
        let mut to_viewer = Vec3x16::default();
        for i in bits(lanes) {
            to_viewer.set_lane(i, lights[i].vertex.surface().at.frame.to_local(-wi.lane(i)));
        }
        let emerging = eval_x16(&bsdfs, &to_viewer, &wo, lanes);
        let lanes = lanes & some(&emerging.f);
        if lanes == 0 {
            return;
        }
        let wo_ng = f32x16::new(each_lane(|i| lights[i].vertex.surface().wo_ng));
        let corrected = (wi.dot(ng) * wo.z / wo_ng).abs();
        let forward_of_light = pdf_adjoint_x16(&bsdfs, &wo, &to_viewer, lanes).to_array();
        let reverse_of_camera = pdf_adjoint_x16(&block.bsdfs, &local, &block.wo, lanes).to_array();
        let (forward, reverse_of_light) = (scattered.pdf.to_array(), emerging.pdf.to_array());
        let cosines = [at.ng, ng].map(|n| wi.dot(n).abs().to_array());
        let squares = distance2.to_array();
        let per_area =
            |pdf: f32, cosine: f32, i: usize| f64::from(pdf) * f64::from(cosine) / f64::from(squares[i]);
        let weights = each_active(lanes, |i| {
            let weight = weights::of_connection(
                &End {
                    partial: partials[i],
                    to_other: per_area(forward[i], cosines[1][i], i),
                    reverse: reverse_of_camera[i].into(),
                },
                &End {
                    partial: lights[i].partial,
                    to_other: per_area(forward_of_light[i], cosines[0][i], i),
                    reverse: reverse_of_light[i].into(),
                },
            );
            self.techniques.weight(lights[i].edges + 1, depth + 2, weight) as f32
        });
        let factor = local.z.abs() * corrected / distance2 * weights * of_choice;
        let powers = [0, 1, 2].map(|c| f32x16::new(each_lane(|i| lights[i].power.to_array()[c])));
        let value = std::array::from_fn(|c| scattered.f[c] * emerging.f[c] * powers[c] * factor);
        let mut targets = Vec3x16::default();
        for i in bits(lanes) {
            targets.set_lane(i, lights[i].vertex.target(way.lane(i)));
        }
        let rays = self.scene.shadow_rays_to(at, targets, wi, block.rays.time);
        self.push(shadows, vertices, lanes, (&rays, |key| of_connection(key, k), 2), value);
    }

    /// Chooses the vertex of light path `k` of a camera path to which that is connected. `scatters` estimates how much
    /// light the end scatters from a direction, relative to a diffuse surface. Returns the vertex with the factor of
    /// the contribution: the reciprocal of its probability and of the number of light paths.
    pub(super) fn choose(
        &self,
        end: &CameraEnd<'_>,
        scatters: impl Fn(Vec3) -> f32,
        (k, u): (u32, f32),
    ) -> Option<(&StoredVertex<'_>, f32)> {
        let (mut sum, mut chosen) = (0.0f32, None);
        let count = self.connections(end.path) as f32;
        let is_weighted = !matches!(self.techniques, Techniques::Alone(_));
        let mut u = (u + k as f32 / count).fract();
        for light in self.light.of(self.shared.of(end.path.slot, k)) {
            let edges = end.depth + light.edges + 2;
            if !self.limits.allows(edges) || !self.query.wants(edges) {
                continue;
            }
            let importance = importance(end, &scatters, light, is_weighted);
            if importance == 0.0 {
                continue;
            }
            sum += importance;
            let share = importance / sum;
            if u < share || chosen.is_none() {
                u = (u / share).min(1f32.next_down());
                chosen = Some((light, importance));
            } else {
                u = (u - share) / (1.0 - share);
            }
        }
        chosen.map(|(light, importance)| (light, sum / (importance * count)))
    }

    /// Queues the shadow rays of the lanes in a mask. Their contributions are the values times the weights of the
    /// paths. `key` maps the key of a path to that of the random numbers for the transmittance of its ray, which have
    /// the given purpose.
    fn push(
        &self,
        shadows: &mut ShadowQueue,
        vertices: &CameraVertices<'_>,
        lanes: u32,
        (rays, key, purpose): (&RayX16, impl Fn(SampleKey) -> SampleKey, u32),
        value: [f32x16; 3],
    ) {
        let CameraVertices { block, paths, depth, .. } = vertices;
        let rays: [Ray; LANES] = rays.to_rays();
        let [r, g, b] = value.map(f32x16::to_array);
        for i in bits(lanes) {
            let (path, ray) = (&paths[i], rays[i]);
            let value = path.beta * Rgb::new(r[i], g[i], b[i]);
            if value.is_black() {
                continue;
            }
            let Some(media) = self.media else {
                shadows.push_one(ray, path.slot, value);
                continue;
            };
            let directions = (block.rays.d.lane(i), ray.d);
            let medium = medium_after(self.scene, media, block.at.facet(i), directions, path.medium);
            let random = stream(key(path.key), *depth, purpose);
            shadows.push_through_media(ray, path.slot, value, Departure { medium, random });
        }
    }
}

/// Returns the key of the random numbers for the transmittance to light path `k`.
pub(super) fn of_connection(key: SampleKey, k: u32) -> SampleKey {
    SampleKey { scramble: key.scramble ^ k.wrapping_mul(0x9e37_79b9), ..key }
}

/// The end of a camera path, for the choice of a connection.
pub(super) struct CameraEnd<'a> {
    pub path: &'a Subpath,
    /// The number of scatterings before.
    pub depth: u32,
    pub p: Vec3,
    /// An estimate of the ratios of the other techniques.
    pub ratio: f32,
}

/// Returns an estimate of the contribution of a connection, which is positive if the contribution is: that of diffuse
/// surfaces and isotropic media without absorption. If `is_weighted`, it is that with the weight of the technique.
fn importance(
    end: &CameraEnd<'_>,
    scatters: impl Fn(Vec3) -> f32,
    light: &StoredVertex<'_>,
    is_weighted: bool,
) -> f32 {
    let way = light.vertex.p() - end.p;
    let distance2 = way.length_squared();
    if distance2 == 0.0 {
        return 0.0;
    }
    let wi = way / distance2.sqrt();
    let emerging = match &light.vertex {
        Vertex::Surface(surface) => wi.dot(surface.at.ng).abs().max(LEAST_COSINE),
        Vertex::Medium(_) => IN_MEDIUM,
    };
    let geometry = scatters(wi) * emerging / distance2;
    let contribution = light.power.max_component() * geometry;
    if !is_weighted {
        return contribution;
    }
    // About the density with which either path would continue to the other.
    let density = geometry * FRAC_1_PI;
    let weight = 1.0 / (1.0 + density * density * (end.ratio + light.ratio));
    contribution * weight.max(LEAST_WEIGHT)
}

/// Returns a mask of the lanes in which a colour is not black.
fn some(color: &[f32x16; 3]) -> u32 {
    let [r, g, b] = color.map(|channel| channel.simd_ne(f32x16::ZERO));
    (r | g | b).to_bitmask()
}

/// Returns a number for each lane in a mask, and 0 for the others.
fn each_active(lanes: u32, number: impl Fn(usize) -> f32) -> f32x16 {
    let mut numbers = [0.0; LANES];
    for i in bits(lanes) {
        numbers[i] = number(i);
    }
    f32x16::new(numbers)
}
