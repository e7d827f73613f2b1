//! The state of the paths of a wave.

use super::volpath::scattering::Scattered;
use crate::accel::Hit;
use crate::color::Rgb;
use crate::emitter::{Gloss, GlossX16, Receiver};
use crate::ids::MediumId;
use crate::math::lanes::bits;
use crate::math::{Ray, RayX16, Vec3, Vec3x16, f32x16};
use crate::sampling::SampleKey;
use std::ops::Range;

/// The state of a wave of paths, as a structure of arrays of equal length.
#[derive(Default)]
pub struct PathWave {
    /// The next ray.
    pub rays: Vec<Ray>,
    /// The sample's key.
    pub keys: Vec<SampleKey>,
    /// The entry of the output to which the path contributes.
    pub slots: Vec<u32>,
    /// Throughput by channel: the product of the weights so far.
    pub beta: [Vec<f32>; 3],
    /// The surface point at which the ray's direction was sampled. The ray starts beside it, by the rounding error.
    pub from: Vec<Vec3>,
    /// The glossy lobe there for which emitters were chosen. Empty if unused.
    pub gloss: Vec<Gloss>,
    /// Density per unit solid angle of the ray's direction; infinite after the camera or a specular lobe.
    pub pdf: Vec<f32>,
    /// Product of the relative indices of refraction along the path.
    pub eta: Vec<f32>,
    /// Where the path is in media. Empty if unused.
    pub in_media: Vec<InMedia>,
}

/// Where a path is in media.
#[derive(Clone, Copy, Debug)]
pub struct InMedia {
    /// The medium in which the path's ray starts.
    pub medium: Option<MediumId>,
    /// The number of times that bodies have scattered the path.
    pub events: u32,
    /// The index of the point at which a medium scattered the path last, if points near emitters were sampled on that
    /// ray.
    pub on_leg: Option<u32>,
    /// The probability with which an emitter was sampled at the last event; 1 at a surface.
    pub emitter_share: f32,
}

impl InMedia {
    /// Returns the state of a path that no medium has scattered last.
    pub fn in_medium(medium: Option<MediumId>) -> Self {
        InMedia { medium, events: 0, on_leg: None, emitter_share: 1.0 }
    }
}

/// Memory for sorting a wave.
#[derive(Default)]
pub struct SortBuffers {
    order: Vec<u32>,
    paths: PathWave,
    hits: Vec<Option<Hit>>,
}

/// Calls a function with every list of a wave, with the same list of another wave if there is one, and with more
/// arguments.
macro_rules! each_list {
    ($call:path, $wave:expr $(, $other:expr)?; $($more:expr)?) => {
        $call(&mut $wave.rays $(, &$other.rays)? $(, $more)?);
        $call(&mut $wave.keys $(, &$other.keys)? $(, $more)?);
        $call(&mut $wave.slots $(, &$other.slots)? $(, $more)?);
        for c in 0..3 {
            $call(&mut $wave.beta[c] $(, &$other.beta[c])? $(, $more)?);
        }
        $call(&mut $wave.from $(, &$other.from)? $(, $more)?);
        $call(&mut $wave.gloss $(, &$other.gloss)? $(, $more)?);
        $call(&mut $wave.pdf $(, &$other.pdf)? $(, $more)?);
        $call(&mut $wave.eta $(, &$other.eta)? $(, $more)?);
        $call(&mut $wave.in_media $(, &$other.in_media)? $(, $more)?);
    };
}

/// Replaces the contents of `to` by the elements of `from` in the given order. An unused list is empty.
fn take<T: Copy>(to: &mut Vec<T>, from: &[T], order: &[u32]) {
    to.clear();
    if !from.is_empty() {
        to.extend(order.iter().map(|&i| from[i as usize]));
    }
}

/// Makes a used list `n` elements long. The values of the new ones do not matter.
fn grow<T: Copy>(list: &mut Vec<T>, n: usize) {
    if let Some(&last) = list.last() {
        list.resize(n, last);
    }
}

/// Removes a range of a used list. The last elements take their places.
fn close_gap<T: Copy>(list: &mut Vec<T>, gap: &Range<usize>) {
    if list.is_empty() {
        return;
    }
    let last = gap.end.max(list.len() - gap.len());
    list.copy_within(last.., gap.start);
    list.truncate(list.len() - gap.len());
}

impl PathWave {
    /// Starts a path on every ray.
    pub fn begin(&mut self, rays: &[Ray], keys: &[SampleKey]) {
        assert_eq!(rays.len(), keys.len());
        let n = rays.len();
        self.rays.clear();
        self.rays.extend_from_slice(rays);
        self.keys.clear();
        self.keys.extend_from_slice(keys);
        self.slots.clear();
        self.slots.extend(0..n as u32);
        self.from.clear();
        self.from.extend(rays.iter().map(|ray| ray.o));
        self.gloss.clear();
        self.in_media.clear();
        let [r, g, b] = &mut self.beta;
        let ones = [r, g, b, &mut self.eta].map(|values| (values, 1.0));
        for (values, v) in ones.into_iter().chain([(&mut self.pdf, f32::INFINITY)]) {
            values.clear();
            values.resize(n, v);
        }
    }

    /// Adds a path whose last ray was sampled from a Dirac delta.
    pub fn push(&mut self, ray: Ray, key: SampleKey, slot: u32, beta: Rgb, eta: f32) {
        self.rays.push(ray);
        self.keys.push(key);
        self.slots.push(slot);
        for (channel, value) in self.beta.iter_mut().zip(beta.to_array()) {
            channel.push(value);
        }
        self.from.push(ray.o);
        if !self.gloss.is_empty() {
            self.gloss.push(Gloss::NONE);
        }
        self.pdf.push(f32::INFINITY);
        self.eta.push(eta);
    }

    /// Adds paths that media have scattered.
    pub fn push_scattered(&mut self, scattered: &[Scattered]) {
        self.rays.extend(scattered.iter().map(Scattered::ray));
        self.keys.extend(scattered.iter().map(|path| path.key));
        self.slots.extend(scattered.iter().map(|path| path.slot));
        for (c, channel) in self.beta.iter_mut().enumerate() {
            channel.extend(scattered.iter().map(|path| path.beta[c]));
        }
        self.from.extend(scattered.iter().map(|path| path.p));
        if !self.gloss.is_empty() {
            self.gloss.resize(self.rays.len(), Gloss::NONE);
        }
        self.pdf.extend(scattered.iter().map(|path| path.pdf));
        self.eta.extend(scattered.iter().map(|path| path.eta));
        self.in_media.extend(scattered.iter().map(Scattered::in_media));
    }

    /// Keeps the paths that have hit something, sorted by the bucket of the shape. Paths of a bucket keep their order.
    /// Without buckets, all do.
    pub fn keep_sorted(&mut self, hits: &mut Vec<Option<Hit>>, bucket_of: &[u8], buffers: &mut SortBuffers) {
        let bucket =
            |hit: &Hit| bucket_of.get(hit.geometry as usize).map_or(0, |bucket| usize::from(*bucket));
        let mut starts = [0; 256];
        hits.iter().flatten().for_each(|hit| starts[bucket(hit)] += 1);
        if starts.contains(&hits.len()) {
            return;
        }
        let mut sum = 0;
        for start in &mut starts {
            (*start, sum) = (sum, sum + *start);
        }
        let SortBuffers { order, paths, hits: sorted } = buffers;
        order.resize(sum, 0);
        for (i, hit) in hits.iter().enumerate() {
            if let Some(hit) = hit {
                let to = &mut starts[bucket(hit)];
                order[*to] = i as u32;
                *to += 1;
            }
        }
        take(sorted, hits, order);
        each_list!(take, paths, self; order);
        std::mem::swap(self, paths);
        std::mem::swap(hits, sorted);
    }

    /// Sets the throughput of path `i`.
    #[inline]
    pub fn set_beta(&mut self, i: usize, beta: Rgb) {
        for (channel, value) in self.beta.iter_mut().zip(beta.to_array()) {
            channel[i] = value;
        }
    }

    /// Returns the throughput of path `i`.
    #[inline]
    pub fn beta(&self, i: usize) -> Rgb {
        Rgb::new(self.beta[0][i], self.beta[1][i], self.beta[2][i])
    }

    /// Returns the point at which the direction of path `i` was sampled, as emitters were chosen for it.
    #[inline]
    pub fn receiver(&self, i: usize) -> Receiver {
        Receiver { p: self.from[i], gloss: self.gloss.get(i).copied().unwrap_or(Gloss::NONE) }
    }

    /// Writes the continuations of paths `first..first + 16`, for the lanes in the mask `lanes`, to the indices from
    /// `to` on. Returns the index after the last. The paths up to `first + 16` must have been read before.
    #[inline(always)]
    pub fn compact(&mut self, first: usize, mut to: usize, next: &Continuation, lanes: u32) -> usize {
        let rays = next.rays.to_rays();
        let [r, g, b] = next.beta.map(f32x16::to_array);
        let (pdf, eta) = (next.pdf.to_array(), next.eta.to_array());
        if next.gloss.is_some() {
            self.gloss.resize(self.rays.len(), Gloss::NONE);
        }
        if !self.in_media.is_empty() {
            for (to, i) in (to..).zip(bits(lanes)) {
                self.in_media[to] = self.in_media[first + i];
            }
        }
        for i in bits(lanes) {
            if let Some(gloss) = self.gloss.get_mut(to) {
                *gloss = next.gloss.as_ref().map_or(Gloss::NONE, |gloss| gloss.lane(i));
            }
            self.rays[to] = rays[i];
            self.keys[to] = self.keys[first + i];
            self.slots[to] = self.slots[first + i];
            (self.beta[0][to], self.beta[1][to], self.beta[2][to]) = (r[i], g[i], b[i]);
            self.from[to] = next.from.lane(i);
            self.pdf[to] = pdf[i];
            self.eta[to] = eta[i];
            to += 1;
        }
        to
    }

    /// Removes the paths that hit nothing, and their entries in `hits`.
    pub fn keep_hits(&mut self, hits: &mut Vec<Option<Hit>>) {
        self.keep_sorted(hits, &[], &mut SortBuffers::default());
    }

    /// Copies another wave.
    pub fn copy_from(&mut self, other: &PathWave) {
        each_list!(Vec::clone_from, self, other;);
    }

    /// Keeps the first `n` paths.
    pub fn truncate(&mut self, n: usize) {
        each_list!(Vec::truncate, self; n);
    }

    /// Makes room for more paths behind the others, up to `n`.
    pub fn make_room(&mut self, n: usize) {
        each_list!(grow, self; n);
    }

    /// Removes a range of paths. The last ones take their places.
    pub fn remove(&mut self, range: Range<usize>) {
        each_list!(close_gap, self; &range);
    }
}

/// The continuations of sixteen paths.
pub struct Continuation {
    /// The next rays.
    pub rays: RayX16,
    /// The surface points at which the directions were sampled.
    pub from: Vec3x16,
    /// The glossy lobes there for which emitters were chosen.
    pub gloss: Option<GlossX16>,
    /// The throughputs by channel.
    pub beta: [f32x16; 3],
    /// The densities of the directions.
    pub pdf: f32x16,
    /// The products of the relative indices of refraction.
    pub eta: f32x16,
}
