//! Shadow rays of a wave, which wait for their occlusion.

use super::flight::{Departure, Journeys};
use crate::color::Rgb;
use crate::math::lanes::{LANES, bits, each_lane};
use crate::math::{Ray, RayX16, f32x16};
use crate::medium::lanes::CoefficientsX16;
use crate::medium::{Homogeneous, Medium};
use crate::scene::Scene;

/// Shadow rays with their contributions if unoccluded.
#[derive(Default)]
pub struct ShadowQueue {
    pub(super) rays: Vec<Ray>,
    pending: Vec<(u32, Rgb)>,
    pub(super) occluded: Vec<bool>,
    /// Where rays start in media, beside their indices.
    departures: Vec<(usize, Departure)>,
    journeys: Journeys,
}

impl ShadowQueue {
    /// Returns whether rays go through media.
    pub(super) fn has_departures(&self) -> bool {
        !self.departures.is_empty()
    }

    /// Adds the rays of the lanes in the mask `lanes`. The value of lane `i`, by channel, is added to entry
    /// `slots[i]` if the ray is unoccluded.
    #[inline(always)]
    pub fn push(&mut self, rays: &RayX16, slots: &[u32], value: &[f32x16; 3], lanes: u32) {
        let rays = rays.to_rays();
        let [r, g, b] = value.map(f32x16::to_array);
        for i in bits(lanes) {
            self.rays.push(rays[i]);
            self.pending.push((slots[i], Rgb::new(r[i], g[i], b[i])));
        }
    }

    /// Adds one ray; its value is added to entry `slot` if the ray is unoccluded.
    pub fn push_one(&mut self, ray: Ray, slot: u32, value: Rgb) {
        self.rays.push(ray);
        self.pending.push((slot, value));
    }

    /// Adds one ray through media; its value times the transmittance is added to entry `slot` if the ray is unoccluded.
    pub fn push_through_media(&mut self, ray: Ray, slot: u32, value: Rgb, departure: Departure) {
        self.departures.push((self.rays.len(), departure));
        self.push_one(ray, slot, value);
    }

    /// Calls `add` for each entry whose ray is unoccluded, and empties the queue. Rays that meet no medium come first,
    /// then those that stay in one homogeneous medium, then the others, in the order of the queue each.
    pub(super) fn finish(
        &mut self,
        scene: &Scene,
        occluded: impl Iterator<Item = bool>,
        mut add: impl FnMut(usize, Rgb),
    ) {
        let unoccluded = self.pending.iter().zip(occluded).enumerate().filter(|(_, (_, occluded))| !occluded);
        if self.departures.is_empty() {
            unoccluded.for_each(|(_, ((slot, value), _))| add(*slot as usize, *value));
        } else {
            let all = std::mem::take(&mut self.departures);
            let mut departures = all.iter().peekable();
            let mut through_media = Vec::with_capacity(all.len());
            for (i, ((slot, value), _)) in unoccluded {
                while departures.next_if(|(ray, _)| *ray < i).is_some() {}
                match departures.next_if(|(ray, _)| *ray == i) {
                    None => add(*slot as usize, *value),
                    Some(departure) => through_media.push(*departure),
                }
            }
            self.finish_in_media(scene, &through_media, add);
            self.departures = all;
        }
        self.rays.clear();
        self.pending.clear();
        self.departures.clear();
    }

    /// Adds the values of rays, given by their indices, times the transmittances of the media through which they go.
    fn finish_in_media(
        &mut self,
        scene: &Scene,
        departures: &[(usize, Departure)],
        mut add: impl FnMut(usize, Rgb),
    ) {
        let Some(media) = &scene.media else { return };
        let ShadowQueue { rays, pending, journeys, .. } = self;
        let boundaries = media.has_passed().then(|| {
            let rays: Vec<Ray> = departures.iter().map(|(i, _)| rays[*i]).collect();
            media.passed(&rays)
        });
        journeys.clear();
        let (mut on_journeys, mut first) = (Vec::new(), Vec::new());
        // What is added to an entry is added in the same order, whatever else is in the queue.
        let mut simple = Vec::new();
        for (k, &(i, departure)) in departures.iter().enumerate() {
            let boundary = boundaries.as_ref().and_then(|boundaries| boundaries[k]);
            let (slot, value) = pending[i];
            match media.get(departure.medium) {
                None if boundary.is_none() => add(slot as usize, value),
                Some(Medium::Homogeneous(medium)) if boundary.is_none() => simple.push((i, medium)),
                _ => {
                    journeys.push(rays[i], departure, value);
                    first.push(boundary);
                    on_journeys.push(slot);
                }
            }
        }
        for block in simple.chunks(LANES) {
            add_in_one_medium(block, rays, pending, &mut add);
        }
        journeys.follow(scene, media, (0..on_journeys.len()).collect(), Some(&first), |_| None, None);
        for (k, slot) in on_journeys.into_iter().enumerate() {
            add(slot as usize, journeys.beta(k));
        }
    }
}

/// Adds the values of at most sixteen rays, given by their indices, times the transmittances of the media in which they
/// stay.
fn add_in_one_medium(
    block: &[(usize, &Homogeneous)],
    rays: &[Ray],
    pending: &[(u32, Rgb)],
    mut add: impl FnMut(usize, Rgb),
) {
    let of = each_lane(|k| block[k.min(block.len() - 1)]);
    let of_block = RayX16::load(&of.map(|(i, _)| rays[i]), 0);
    let lengths = of_block.t_max * of_block.d.length_squared().sqrt();
    let transmittance = CoefficientsX16::of(&of.map(|(_, medium)| Some(medium))).transmittance(lengths);
    for (k, (i, _)) in block.iter().enumerate() {
        let (slot, value) = pending[*i];
        add(slot as usize, value * Rgb::from(transmittance.map(|channel| channel.as_array()[k])));
    }
}
