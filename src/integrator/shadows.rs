//! Shadow rays of a wave, which wait for their occlusion.

use super::flight::{Departure, Journey, follow};
use crate::color::Rgb;
use crate::math::lanes::bits;
use crate::math::{Ray, RayX16, f32x16};
use crate::scene::Scene;

/// Shadow rays with their contributions if unoccluded.
#[derive(Default)]
pub struct ShadowQueue {
    pub(super) rays: Vec<Ray>,
    pending: Vec<(u32, Rgb)>,
    pub(super) occluded: Vec<bool>,
    /// Where rays start in media, beside their indices.
    departures: Vec<(usize, Departure)>,
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

    /// Calls `add` for each entry whose ray is unoccluded, in the order of the queue, and empties the queue.
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
            let mut departures = self.departures.iter().peekable();
            let mut journeys = Vec::new();
            for (i, ((slot, value), _)) in unoccluded {
                while departures.next_if(|(ray, _)| *ray < i).is_some() {}
                match departures.next_if(|(ray, _)| *ray == i) {
                    None => add(*slot as usize, *value),
                    Some((_, departure)) => journeys.push((i, *departure)),
                }
            }
            self.finish_in_media(scene, journeys, add);
        }
        self.rays.clear();
        self.pending.clear();
        self.departures.clear();
    }

    /// Adds the values of rays, given by their indices, times the transmittances of the media through which they go.
    fn finish_in_media(
        &self,
        scene: &Scene,
        mut journeys: Vec<(usize, Departure)>,
        mut add: impl FnMut(usize, Rgb),
    ) {
        let Some(media) = &scene.media else { return };
        let rays: Vec<Ray> = journeys.iter().map(|(i, _)| self.rays[*i]).collect();
        let mut boundaries = media.passed(&rays);
        // Rays that meet no medium need no journey.
        let mut count = 0;
        for k in 0..journeys.len() {
            let (i, departure) = journeys[k];
            if departure.medium.is_none() && boundaries[k].is_none() {
                let (slot, value) = self.pending[i];
                add(slot as usize, value);
            } else {
                (journeys[count], boundaries[count]) = (journeys[k], boundaries[k]);
                count += 1;
            }
        }
        journeys.truncate(count);
        boundaries.truncate(count);
        let start = |(i, departure): &(usize, Departure)| departure.unscattered(self.rays[*i]);
        let mut flights: Vec<Journey> = journeys.iter().map(start).collect();
        follow(scene, media, &mut flights, Some(&boundaries), |_| None, |_, _, _| {});
        for ((i, _), journey) in journeys.iter().zip(&flights) {
            let (slot, value) = self.pending[*i];
            add(slot as usize, value * journey.flight.passed());
        }
    }
}
