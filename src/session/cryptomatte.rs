//! Cryptomatte: layers from which compositing programs cut the objects and materials of a scene out of its image.
//! [Friedman and Jones, Cryptomatte specification 1.2]

use super::{Plan, Session};
use crate::accel::{Coherence, Hit};
use crate::error::Result;
use crate::film::{Filter, FilterSampler, PixelRect};
use crate::image::{Image, Value};
use crate::integrator::pilot::PilotRays;
use crate::math::Vec2;
use crate::render::{Progress, thread_pool};
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use std::collections::BTreeMap;

/// The camera rays of a pixel, from which coverages are counted.
const SAMPLES: usize = 32;
/// The number of objects, and of materials, that a pixel can have. Those with the least coverage are left out.
const RANKS: usize = 6;
/// The names of the layers.
const LAYERS: [&str; 2] = ["crypto_object", "crypto_material"];
/// The channels of the layers: an id and a coverage for each rank.
const CHANNELS: usize = 2 * RANKS * LAYERS.len();
/// Makes the random numbers others than those of the image.
const STREAM: u64 = 0x6372_7970_746f_6d61;

/// Returns the id of a name: its hash as a 32-bit float that is neither infinite, nor NaN, nor denormal.
fn id(name: &str) -> u32 {
    let hash = murmur3::murmur3_32(&mut name.as_bytes(), 0).unwrap_or_default();
    match hash >> 23 & 0xff {
        0 | 0xff => hash ^ 1 << 23,
        _ => hash,
    }
}

impl Session {
    /// Checks that there is memory for the Cryptomatte layers beside a render.
    ///
    /// # Errors
    /// If there is not, as an error of writing output.
    pub fn check_cryptomatte(&self, plan: &Plan) -> Result<()> {
        let render = self.render_memory(plan).total();
        self.reserve_layers(plan, render, CHANNELS, "the Cryptomatte layers").map(drop)
    }

    /// Adds the Cryptomatte layers of objects and of materials to an image of a plan. An object is an instance that
    /// has a name, or a shape. Coverages are fractions of 32 camera rays, distributed like those of the image, or
    /// over the area of the pixel if the reconstruction filter has negative lobes. They do not depend on the samples
    /// of the image.
    ///
    /// Returns false, with the image unchanged, if the render is interrupted.
    ///
    /// # Errors
    /// As for [`check_cryptomatte`](Self::check_cryptomatte), and if threads cannot be started.
    pub fn add_cryptomatte(&self, plan: &Plan, progress: &Progress, image: &mut Image) -> Result<bool> {
        let _reserved = self.reserve_layers(plan, 0, CHANNELS, "the Cryptomatte layers")?;
        let names = &self.scene.names;
        let materials =
            self.scene.shapes.iter().map(|shape| names.materials[shape.material.index()].as_str());
        let ids = Ids {
            shapes: names.shapes.iter().map(|name| id(name)).collect(),
            instances: names.instances.iter().map(|name| (!name.is_empty()).then(|| id(name))).collect(),
            materials: materials.clone().map(id).collect(),
        };
        let rect = self.camera().film.rect();
        let row = |y: u32| {
            let row = PixelRect { y, height: 1, ..rect };
            (!progress.is_interrupted()).then(|| self.matte_row(plan, row, &ids))
        };
        let rows = (rect.y..rect.y + rect.height).into_par_iter().map(row);
        let rows: Option<Vec<Vec<f32>>> = thread_pool(self.threads)?.install(|| rows.collect());
        let Some(rows) = rows else { return Ok(false) };
        let channel = |layer: &str, i: usize| ["R", "G", "B", "A"].map(|c| format!("{layer}{i:02}.{c}"));
        let channels = LAYERS.iter().flat_map(|layer| (0..RANKS / 2).flat_map(|i| channel(layer, i)));
        image.append(channels.collect(), &rows.concat());
        let objects = names.shapes.iter().chain(names.instances.iter().filter(|name| !name.is_empty()));
        set_metadata(image, LAYERS[0], objects.map(String::as_str));
        set_metadata(image, LAYERS[1], materials);
        Ok(true)
    }

    /// Returns the values of a row of pixels, [`CHANNELS`] for each.
    fn matte_row(&self, plan: &Plan, row: PixelRect, ids: &Ids) -> Vec<f32> {
        let (camera, sampler, seed) = (self.camera(), plan.job.sampler, plan.job.seed ^ STREAM);
        let filter = match FilterSampler::new(camera.film.filter) {
            filter if filter.has_weights() => FilterSampler::new(Filter::Box { radius: 0.5 }),
            filter => filter,
        };
        let place = |u: Vec2| filter.sample(u).offset.as_dvec2() + 0.5;
        let pixels = (row.x..row.x + row.width).map(|x| (x, row.y));
        let PilotRays { rays, .. } =
            PilotRays::through(&self.scene, camera, sampler, seed, pixels, SAMPLES, place);
        let mut hits = vec![None; rays.len()];
        self.scene.accel.intersect_wave(&rays, &mut hits, Coherence::Coherent);
        let object = |hit: &Hit| {
            let instance = ids.instances.get(hit.instance as usize).copied().flatten();
            instance.unwrap_or(ids.shapes[hit.geometry as usize])
        };
        let mut values = Vec::with_capacity(row.width as usize * CHANNELS);
        for hits in hits.chunks_exact(SAMPLES) {
            values.extend(ranked(hits.iter().flatten().map(object)));
            values.extend(ranked(hits.iter().flatten().map(|hit| ids.materials[hit.geometry as usize])));
        }
        values
    }
}

/// The ids of everything that a ray can hit.
struct Ids {
    /// For each shape.
    shapes: Vec<u32>,
    /// For each instance that has a name.
    instances: Vec<Option<u32>>,
    /// For each shape, that of its material.
    materials: Vec<u32>,
}

/// Returns the ids of the hits of a pixel, each with its coverage, by decreasing coverage.
fn ranked(hits: impl Iterator<Item = u32>) -> [f32; 2 * RANKS] {
    let mut counts: Vec<(u32, u32)> = Vec::with_capacity(RANKS);
    for id in hits {
        match counts.iter_mut().find(|(known, _)| *known == id) {
            Some((_, count)) => *count += 1,
            None => counts.push((id, 1)),
        }
    }
    counts.sort_by_key(|&(id, count)| (std::cmp::Reverse(count), id));
    let mut values = [0.0; 2 * RANKS];
    for (pair, (id, count)) in values.chunks_exact_mut(2).zip(counts) {
        pair.copy_from_slice(&[f32::from_bits(id), count as f32 / SAMPLES as f32]);
    }
    values
}

/// Describes a layer: its name, and the id of each name as a hexadecimal number.
fn set_metadata<'a>(image: &mut Image, layer: &str, names: impl Iterator<Item = &'a str>) {
    let manifest: BTreeMap<&str, String> = names.map(|name| (name, format!("{:08x}", id(name)))).collect();
    let manifest = serde_json::to_string(&manifest).unwrap_or_default();
    let key = &format!("{:08x}", id(layer))[..7];
    for (name, text) in [
        ("name", layer),
        ("hash", "MurmurHash3_32"),
        ("conversion", "uint32_to_float32"),
        ("manifest", &manifest),
    ] {
        image.metadata.set(format!("cryptomatte/{key}/{name}"), Value::Text(text.to_owned()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_those_of_other_programs() {
        for (name, expected) in [
            ("hello", 6.070_563e-17),
            ("cube", -4.084_619e15),
            ("sphere", 2.790_186e15),
            ("plane", 3.665_576_2e-11),
        ] {
            let seen = f32::from_bits(id(name));
            assert!((seen / expected - 1.0).abs() < 1e-6f32, "{name} {seen:e} {expected:e}");
        }
    }

    #[test]
    fn ids_are_normal_numbers() {
        for i in 0..100_000 {
            assert!(f32::from_bits(id(&i.to_string())).is_normal(), "{i}");
        }
    }

    #[test]
    fn ranks_are_by_coverage() {
        let hits = [3u32, 5, 5, 7].into_iter().chain(std::iter::repeat_n(9, 28));
        let values = ranked(hits);
        let bits = [0, 2, 4, 6].map(|i| values[i].to_bits());
        assert_eq!(bits, [9, 5, 3, 7]);
        assert_eq!([values[1], values[3], values[5], values[7]], [28.0, 2.0, 1.0, 1.0].map(|v| v / 32.0));
        assert_eq!(values[8..], [0.0; 4]);
    }
}
