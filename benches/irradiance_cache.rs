//! Lookup of irradiance: `cargo bench --bench irradiance_cache [-- LARGEST]`, with up to LARGEST records (default one
//! million), on one thread.
//!
//! Records cover the five walls of an open box evenly. The number of records around a point does not depend on their
//! total and is that of a render. There are two rows of queries: neighbours in order, as in the pixels of a tile, and
//! random ones, for which no cache of the processor helps.

use buffon::integrator::irrcache::interpolation::Interpolation;
use buffon::integrator::irrcache::record::Record;
use buffon::math::{Bounds, Vec3};
use buffon::sampling::hash::{pcg3d, to_unit};
use std::hint::black_box;
use std::time::Instant;

const QUERIES: u32 = 400_000;
const ROUNDS: u32 = 5;

/// Returns point `i` of the walls with its normal; `spread` is the fraction of the walls that is used.
fn on_walls(i: u32, seed: u32, spread: f32) -> (Vec3, Vec3) {
    let [wall, u, v] = pcg3d(i, seed, 7).map(to_unit);
    let [u, v] = [u, v].map(|u| 2.0 * u * spread - 1.0);
    match (5.0 * wall * spread) as u32 {
        0 => (Vec3::new(u, v, -1.0), Vec3::Z),
        1 => (Vec3::new(u, -1.0, v), Vec3::Y),
        2 => (Vec3::new(u, 1.0, v), -Vec3::Y),
        3 => (Vec3::new(-1.0, u, v), Vec3::X),
        _ => (Vec3::new(1.0, u, v), -Vec3::X),
    }
}

/// Returns the shortest of several rounds in nanoseconds per query, and the fraction of queries with a result.
fn measure(cache: &Interpolation, queries: &[(Vec3, Vec3)]) -> (f64, f64) {
    let (mut best, mut found) = (f64::INFINITY, 0);
    for _ in 0..ROUNDS {
        let started = Instant::now();
        found = queries.iter().filter(|(p, n)| black_box(cache.irradiance(*p, *n, *n)).is_some()).count();
        best = best.min(started.elapsed().as_secs_f64());
    }
    (best * 1e9 / queries.len() as f64, found as f64 / queries.len() as f64)
}

fn main() {
    let largest: u32 = std::env::args().skip(1).find_map(|a| a.parse().ok()).unwrap_or(1_000_000);
    println!("  records  build s  MB     bytes/record  ns neighbours  ns random  found");
    for count in [1_000, 10_000, 100_000, 1_000_000].into_iter().filter(|&n| n <= largest) {
        // About ten records reach a point: an area of 20 contains `count` disks.
        let radius = (10.0 * 20.0 / (std::f32::consts::PI * count as f32)).sqrt();
        let records: Vec<Record> = (0..count)
            .map(|i| {
                let (p, n) = on_walls(i, 1, 1.0);
                Record { p, n, radius, ..Record::default() }
            })
            .collect();
        let bounds = Bounds { min: Vec3::NEG_ONE, max: Vec3::ONE };
        let started = Instant::now();
        let cache = Interpolation::new(&records, bounds);
        let built = started.elapsed().as_secs_f64();
        let random: Vec<_> = (0..QUERIES).map(|i| on_walls(i, 2, 1.0)).collect();
        // Points of one tile on a part of one wall, row by row.
        let side = (QUERIES as f32).sqrt();
        let near: Vec<_> = (0..QUERIES)
            .map(|i| {
                let (x, y) = ((i as f32 / side).floor() / side, (i as f32 % side) / side);
                (Vec3::new(0.1 * x, 0.1 * y, -1.0), Vec3::Z)
            })
            .collect();
        let (ns_near, _) = measure(&cache, &near);
        let (ns_random, found) = measure(&cache, &random);
        let bytes = cache.memory_bytes() as f64;
        println!(
            "{count:>9}  {built:>7.3}  {:>5.1}  {:>12.0}  {ns_near:>13.1}  {ns_random:>9.1}  {found:.4}",
            bytes / (1024.0 * 1024.0),
            bytes / f64::from(count)
        );
    }
}
