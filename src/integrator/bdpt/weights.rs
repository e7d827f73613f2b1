//! Weights of the techniques that can sample a path.
//!
//! A path with n edges is sampled by n + 1 techniques at most: each joins a subpath from the camera and a subpath from
//! an emitter. The weights are those of the power heuristic with exponent 2 (Veach 1997, Eq. 9.13) over all of them.
//! The part of the sum that belongs to one subpath does not depend on the other, except for the densities of its last
//! edge. Two numbers per subpath, updated at each vertex, are therefore enough. [Georgiev 2012, "Implementing Vertex
//! Connection and Merging", Eqs. 31 to 41]
//!
//! With merging, a vertex with a finite lobe is one more technique: both subpaths end there, and any of the light
//! paths of a pass may be the one that does. Its density is that of both subpaths times an area and the number of light
//! paths. [Georgiev 2012, Eq. 9] Subpaths are merged where nothing else finds all light: at the first vertex with a
//! finite lobe from the camera, and behind a Dirac delta ([`Merged`]). Emitter samples find light that nothing has
//! scattered.

use crate::emitter::Light;
use crate::math::Vec3;

/// The square of a density, for the power heuristic.
#[inline]
fn mis(density: f64) -> f64 {
    density * density
}

/// The partial weight of a subpath. Densities are per unit area unless stated otherwise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Partial {
    /// The techniques that join the path at an earlier vertex.
    pub earlier: Earlier,
    /// The squared ratio of the density of merging at the vertex and that of a connection to it; 0 for light paths,
    /// which are merged where camera paths end.
    merged: f64,
    /// The value of `merged` at the next vertex, if a Dirac delta scatters at this one.
    merged_after_delta: f64,
    /// The value of `merged` behind a finite lobe and a Dirac delta: for camera paths, and for light paths.
    merged_later: [f64; 2],
    /// The part of [`Earlier::sum`] for merging at the previous vertex of a camera path. It exists unless this vertex
    /// is on the emitter of the path.
    before_surface: f64,
    /// The part of [`Earlier::sum`] for merging at the previous vertex of a light path. It exists only if a Dirac delta
    /// scatters at this one.
    before_delta: f64,
    /// Whether a light path has more than one edge, so that camera paths may be merged with it.
    is_scattered: bool,
}

/// The sum of the squared ratios of the densities of the techniques that join a path at an earlier vertex of a subpath,
/// and that of a connection to its last vertex.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Earlier {
    /// The ratio for the last vertex's predecessor: `dVCM` [Georgiev 2012, Eqs. 31, 33, 35].
    connected: f64,
    /// The sum for all vertices before, without the reverse density of the last edge: `dVC` [Georgiev 2012, Eqs. 32,
    /// 34, 36].
    sum: f64,
}

impl Earlier {
    /// Returns the sum. `reverse` is the density per unit solid angle with which the reversed path leaves the last
    /// vertex.
    fn ratios(&self, reverse: f64) -> f64 {
        if reverse > 0.0 { self.connected + self.sum * mis(reverse) } else { self.connected }
    }
}

/// The densities of merging relative to those of connecting: number of light paths × area; 0 without merging.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Merged {
    /// At the first vertex with a finite lobe from the camera: the area of the disk in which subpaths are merged.
    pub first: f64,
    /// At a later vertex, behind a Dirac delta. All subpaths in a disk are merged with the same camera path, which is
    /// random there. They count as one: with the area of the disk, the weights would take the noise of a single camera
    /// path for that of many. [Grittmann et al. 2021]
    pub later: f64,
}

/// The start of a light path: its densities with the probabilities of the choice of the emitter.
#[derive(Clone, Copy, Debug)]
pub struct Start {
    /// The density of the point or direction with which the first vertex samples the emitter.
    pub sampled: f64,
    /// The density of the first ray.
    pub ray: f64,
    /// Cosine at the emitting surface; 1 if there is none.
    pub cosine: f64,
    /// Whether no scattered ray can hit the emitter.
    pub delta: bool,
    /// Whether the emitter is at infinity.
    pub distant: bool,
}

impl Start {
    /// Creates the start of a ray that leaves an emitter in the world-space direction `d`, with the cosine `cosine` at
    /// its surface. A vertex chooses the emitter with the probability `sampled`. `started` is the density with which
    /// light paths start there: see [`typical_start_density`](super::light_paths::typical_start_density) and
    /// [`Targets::density`](super::targets::Targets::density).
    pub fn new(light: &Light, d: Vec3, cosine: f32, sampled: f32, started: f32) -> Self {
        let density = light.start_density(d, cosine);
        Start {
            sampled: density.point * f64::from(sampled),
            ray: density.ray * f64::from(started),
            cosine: cosine.into(),
            delta: light.is_delta(),
            distant: light.is_distant(),
        }
    }
}

impl Partial {
    /// Creates the partial weight of a camera path at its first vertex. `density` is that of camera rays per unit area
    /// of the surface, with one camera path and one light path per pixel.
    pub fn of_camera(density: f64, merged: Merged) -> Self {
        let first = mis(merged.first);
        Partial {
            earlier: Earlier { connected: mis(1.0 / density), sum: 0.0 },
            merged: first,
            merged_after_delta: first,
            merged_later: [mis(merged.later), 0.0],
            before_surface: 0.0,
            before_delta: 0.0,
            is_scattered: false,
        }
    }

    /// Creates the partial weight of a light path at its first vertex, at the squared distance `distance2` from the
    /// emitter, where `cos` is the cosine of the ray with the geometric normal.
    pub fn of_light(start: Start, distance2: f64, cos: f64, merged: Merged) -> Self {
        let per_area = if start.distant { 1.0 } else { distance2 };
        let sum = if start.delta { 0.0 } else { mis(start.cosine / (start.ray * cos)) };
        Partial {
            earlier: Earlier { connected: mis(start.sampled * per_area / (start.ray * cos)), sum },
            merged: 0.0,
            merged_after_delta: 0.0,
            merged_later: [0.0, mis(merged.later)],
            before_surface: 0.0,
            before_delta: 0.0,
            is_scattered: false,
        }
    }

    /// Returns the partial weight at the next vertex, at the squared distance `distance2`, where `cos` is the cosine of
    /// the ray with the geometric normal.
    #[must_use]
    pub fn at_next(self, distance2: f64, cos: f64) -> Self {
        let Earlier { connected, sum } = self.earlier;
        let earlier = Earlier { connected: connected * mis(distance2 / cos), sum: sum / mis(cos) };
        Partial {
            earlier,
            before_surface: self.before_surface / mis(cos),
            before_delta: self.before_delta / mis(cos),
            is_scattered: true,
            ..self
        }
    }

    /// Returns the partial weight after scattering by a finite lobe. `forward` and `reverse` are densities per unit
    /// solid angle: that of the sampled direction, and that of the reversed path. `cos` is the cosine of the sampled
    /// direction with the geometric normal.
    #[must_use]
    pub fn scattered(self, forward: f64, reverse: f64, cos: f64) -> Self {
        let scale = mis(cos / forward);
        let [of_camera, of_light] = self.merged_later;
        Partial {
            earlier: Earlier {
                connected: mis(1.0 / forward),
                sum: scale * self.all_earlier().ratios(reverse),
            },
            merged: 0.0,
            merged_after_delta: of_camera,
            before_surface: scale * self.merged,
            before_delta: if self.is_scattered { scale * of_light } else { 0.0 },
            ..self
        }
    }

    /// Returns the partial weight without the technique that joins the path at the vertex before.
    #[must_use]
    pub fn unconnected(self) -> Self {
        Partial { earlier: Earlier { connected: 0.0, ..self.earlier }, ..self }
    }

    /// Returns the partial weight after scattering by a Dirac delta, whose probabilities are equal in both directions.
    #[must_use]
    pub fn reflected(self, cos: f64) -> Self {
        let sum = (self.all_earlier().sum + self.before_delta) * mis(cos);
        Partial {
            earlier: Earlier { connected: 0.0, sum },
            merged: self.merged_after_delta,
            before_surface: 0.0,
            before_delta: 0.0,
            ..self
        }
    }

    /// Returns whether the path is merged with others at its last vertex, if that has a finite lobe.
    pub fn is_merged(&self) -> bool {
        self.merged > 0.0
    }

    /// Returns the sum of the squared ratios of the techniques that join the path at an earlier vertex or merge it at
    /// this one, relative to that which connects it to this vertex, without the reverse density of the joining edge.
    /// `reverse` is the density per unit solid angle with which the reversed path leaves the vertex.
    pub fn ratios(&self, reverse: f64) -> f64 {
        self.merged + self.all_earlier().ratios(reverse)
    }

    /// Returns the earlier techniques if the last vertex is not on the emitter of the path.
    fn all_earlier(&self) -> Earlier {
        Earlier { sum: self.earlier.sum + self.before_surface, ..self.earlier }
    }

    /// Returns the weight of merging a camera path and a light path that end at one point. The densities per unit solid
    /// angle are those with which the reversed paths leave the point. [Georgiev 2012, Eqs. 38, 39]
    pub fn of_merging(&self, reverse: f64, light: &Earlier, reverse_of_light: f64) -> f64 {
        self.merged / (self.ratios(reverse) + light.ratios(reverse_of_light))
    }

    /// Returns the weight of a camera path that hits an emitter, after at least one scattering. [Georgiev 2012, Eq. 38]
    pub fn of_hit(&self, start: Start) -> f64 {
        1.0 / (1.0 + mis(start.sampled) * self.earlier.connected + mis(start.ray) * self.earlier.sum)
    }

    /// Returns the weight of a camera path whose last vertex samples an emitter. `pdf` and `reverse` are the densities
    /// per unit solid angle with which the BSDF samples the direction to the emitter and the reversed path. `cos` is
    /// the cosine at the vertex. [Georgiev 2012, Eqs. 44, 45]
    pub fn of_emitter_sample(&self, start: Start, distance2: f64, cos: f64, pdf: f64, reverse: f64) -> f64 {
        // Per unit solid angle at the vertex, and per unit area of the vertex.
        let (sampled, arrival) = match start.distant {
            true => (start.sampled, cos * start.ray / start.sampled),
            false => {
                let per_angle = if start.delta { distance2 } else { distance2 / start.cosine };
                (start.sampled * per_angle, cos * start.ray / (start.sampled * distance2))
            }
        };
        let hit = if start.delta { 0.0 } else { mis(pdf / sampled) };
        1.0 / (1.0 + hit + mis(arrival) * self.all_earlier().ratios(reverse))
    }

    /// Returns the weight of a light path whose last vertex is connected to the camera. `density` is that of camera
    /// rays per unit area of the surface. [Georgiev 2012, Eq. 46]
    pub fn of_camera_connection(&self, density: f64, reverse: f64, merged: Merged) -> f64 {
        let merged = if self.is_scattered { mis(merged.first) } else { 0.0 };
        1.0 / (1.0 + mis(density) * (merged + self.ratios(reverse)))
    }
}

/// The densities at one end of a connection between two subpaths.
pub struct End {
    /// The partial weight of the subpath.
    pub partial: Partial,
    /// The density per unit area of the other end, with which this subpath would have continued to it.
    pub to_other: f64,
    /// The density per unit solid angle of the reversed path.
    pub reverse: f64,
}

/// Returns the weight of a connection. [Georgiev 2012, Eqs. 40, 41]
pub fn of_connection(camera: &End, light: &End) -> f64 {
    let ratio = |end: &End, other: &End| mis(other.to_other) * end.partial.ratios(end.reverse);
    1.0 / (1.0 + ratio(camera, light) + ratio(light, camera))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::hash::{pcg3d, to_unit};

    /// A path with random densities. Vertex 0 is on the emitter, the last one before the camera is `vertices - 1`.
    struct RandomPath {
        vertices: usize,
        start: Start,
        /// Density of camera rays per unit area of the last vertex.
        camera: f64,
        /// Squared lengths of the edges; edge `i` is between vertices `i` and `i + 1`.
        distance2: Vec<f64>,
        /// Cosines at each vertex, towards the emitter and towards the camera.
        cosines: Vec<[f64; 2]>,
        /// Densities per unit solid angle at each vertex, of the directions to the emitter and to the camera.
        pdfs: Vec<[f64; 2]>,
        merged: Merged,
        /// Whether a Dirac delta scatters at each vertex.
        delta: Vec<bool>,
    }

    impl RandomPath {
        fn new(seed: u32, vertices: usize) -> Self {
            let number = |i: usize, k: u32| 0.05 + f64::from(to_unit(pcg3d(i as u32, k, seed)[0]));
            let all = |k: u32| (0..vertices).map(move |i| [number(i, k), number(i, k + 1)]);
            let distant = seed.is_multiple_of(3);
            let delta = seed % 4 == 1;
            let cosine = if distant || delta { 1.0 } else { number(90, 0) };
            let start = Start { sampled: number(91, 0), ray: number(92, 0), cosine, delta, distant };
            let distance2 = (0..vertices).map(|i| 4.0 * number(i, 9)).collect();
            let (cosines, mut pdfs): (_, Vec<[f64; 2]>) = (all(1).collect(), all(3).collect());
            let merged = match seed % 2 {
                0 => Merged { first: number(94, 0), later: number(95, 0) },
                _ => Merged::default(),
            };
            let delta: Vec<bool> = (0..vertices).map(|i| i > 0 && number(i, 11) < 0.4).collect();
            // The probability of a Dirac delta is the same in both directions.
            pdfs.iter_mut().zip(&delta).filter(|(_, delta)| **delta).for_each(|(pdf, _)| *pdf = [1.0; 2]);
            RandomPath { vertices, start, camera: number(93, 0), distance2, cosines, pdfs, merged, delta }
        }

        /// Returns whether the path can be joined between vertices `s - 1` and `s`.
        fn is_joined(&self, s: usize) -> bool {
            let finite = |i: usize| i == 0 || i == self.vertices || !self.delta[i];
            match s {
                0 => !self.start.delta,
                _ => finite(s - 1) && finite(s),
            }
        }

        /// Returns the density of the path if the first `s` vertices belong to the light path. [Veach 1997, 10.2]
        fn density(&self, s: usize) -> f64 {
            let (n, start) = (self.vertices, &self.start);
            // Per unit area of vertex i, from the light and from the camera.
            let from_light = |i: usize| match i {
                0 => panic!("the start has a density of its own"),
                1 if start.distant => start.ray * self.cosines[1][0],
                1 => start.ray / start.cosine * self.cosines[1][0] / self.distance2[0] * start.cosine,
                _ => self.pdfs[i - 1][1] * self.cosines[i][0] / self.distance2[i - 1],
            };
            let from_camera = |i: usize| match i {
                _ if i + 1 == n => self.camera,
                0 if start.delta => 0.0,
                0 if start.distant => self.pdfs[1][0],
                0 => self.pdfs[1][0] * start.cosine / self.distance2[0],
                _ => self.pdfs[i + 1][0] * self.cosines[i][1] / self.distance2[i],
            };
            let light: f64 = match s {
                0 => 1.0,
                1 => start.sampled,
                // The density of the ray includes that of its start.
                _ => (1..s).map(from_light).product(),
            };
            light * (s..n).map(from_camera).product::<f64>()
        }

        /// Returns the density of the path if both subpaths end at vertex `i`; 0 if they are not merged there.
        fn density_of_merging(&self, i: usize) -> f64 {
            let merged = match () {
                () if self.delta[i] || i == 1 => 0.0,
                () if self.delta[i + 1..].iter().all(|delta| *delta) => self.merged.first,
                () if self.delta[i + 1] => self.merged.later,
                () => 0.0,
            };
            // A connection to vertex i, and the light path that would have gone on to it.
            let to_light = match i {
                1 if self.start.distant => self.start.ray / self.start.sampled * self.cosines[1][0],
                1 => self.start.ray / self.start.sampled * self.cosines[1][0] / self.distance2[0],
                _ => self.pdfs[i - 1][1] * self.cosines[i][0] / self.distance2[i - 1],
            };
            self.density(i) * to_light * merged
        }

        /// Returns the partial weights of both subpaths at each vertex: those of the light path from vertex 1 on.
        fn partials(&self) -> [Vec<Partial>; 2] {
            let n = self.vertices;
            let mut light = Vec::new();
            for i in 1..n {
                let (distance2, cos) = (self.distance2[i - 1], self.cosines[i][0]);
                light.push(match i {
                    1 => Partial::of_light(self.start, distance2, cos, self.merged),
                    _ => {
                        let last: Partial = light[i - 2];
                        let [reverse, forward] = self.pdfs[i - 1];
                        let cos_out = self.cosines[i - 1][1];
                        let on = match self.delta[i - 1] {
                            true => last.reflected(cos_out),
                            false => last.scattered(forward, reverse, cos_out),
                        };
                        on.at_next(distance2, cos)
                    }
                });
            }
            let mut camera = vec![Partial::of_camera(self.camera, self.merged); n];
            for i in (0..n - 1).rev() {
                let [forward, reverse] = self.pdfs[i + 1];
                let cos = self.cosines[i + 1][0];
                let on = match self.delta[i + 1] {
                    true => camera[i + 1].reflected(cos),
                    false => camera[i + 1].scattered(forward, reverse, cos),
                };
                camera[i] = match i {
                    0 if self.start.distant => on,
                    0 => on.at_next(self.distance2[0], self.start.cosine),
                    _ => on.at_next(self.distance2[i], self.cosines[i][1]),
                };
            }
            [light, camera]
        }

        /// Returns the weight of merging at vertex `i`.
        fn weight_of_merging(&self, i: usize) -> f64 {
            let [light, camera] = self.partials();
            let [to_light, to_camera] = self.pdfs[i];
            camera[i].of_merging(to_camera, &light[i - 1].earlier, to_light)
        }

        /// Returns the weight of the technique with `s` vertices in the light path, from the partial weights.
        fn weight(&self, s: usize) -> f64 {
            let n = self.vertices;
            let [light, camera] = self.partials();
            let end = |partial: Partial, i: usize, to: usize, edge: usize, side: usize| End {
                partial,
                to_other: self.pdfs[i][side] * self.cosines[to][1 - side] / self.distance2[edge],
                reverse: self.pdfs[i][1 - side],
            };
            match s {
                0 => camera[0].of_hit(self.start),
                1 => {
                    let [pdf, reverse] = self.pdfs[1];
                    camera[1].of_emitter_sample(
                        self.start,
                        self.distance2[0],
                        self.cosines[1][0],
                        pdf,
                        reverse,
                    )
                }
                _ if s == n => {
                    light[n - 2].of_camera_connection(self.camera, self.pdfs[n - 1][0], self.merged)
                }
                _ => {
                    of_connection(&end(camera[s], s, s - 1, s - 1, 0), &end(light[s - 2], s - 1, s, s - 1, 1))
                }
            }
        }
    }

    /// The weights are those of the power heuristic over the densities of all techniques.
    #[test]
    fn weights_are_those_of_the_power_heuristic() {
        for seed in 0..60 {
            for vertices in 2..7 {
                let path = RandomPath::new(seed, vertices);
                let density = |s| if path.is_joined(s) { path.density(s) } else { 0.0 };
                let densities: Vec<f64> = (0..=vertices).map(density).collect();
                let merging: Vec<f64> = (1..vertices).map(|i| path.density_of_merging(i)).collect();
                let sum: f64 = densities.iter().chain(&merging).map(|p| p * p).sum();
                let near = |weight: f64, exact: f64| (weight - exact).abs() < 1e-9 * (1.0 + exact);
                for (i, density) in (1..vertices).zip(&merging).filter(|(_, density)| **density > 0.0) {
                    let (weight, exact) = (path.weight_of_merging(i), density * density / sum);
                    let seen =
                        format!("seed {seed}, {vertices} vertices, merged at {i}: {weight}, not {exact}");
                    assert!(near(weight, exact), "{seen}");
                }
                for (s, density) in densities.iter().enumerate() {
                    if !path.is_joined(s) {
                        continue;
                    }
                    let (weight, exact) = (path.weight(s), density * density / sum);
                    assert!(
                        near(weight, exact),
                        "seed {seed}, {vertices} vertices, {s} from the light: {weight}, expected {exact}"
                    );
                }
            }
        }
    }
}
