//! Nearest photons: `cargo bench --bench caches [-- LARGEST]`, with up to LARGEST points (default 10 million).
//!
//! Compares our kd-tree with kiddo's `ImmutableKdTree` on one thread. Each figure is the shortest of several rounds,
//! which excludes other activity of the machine.
//!
//! Handicaps:
//! * kiddo's leaves hold 32, 64 or 128 points; the best of the three is shown for every k. Queries request unsorted
//!   results if possible (`nearest_n_within`, without a bound), and use `nearest_one` for the nearest point.
//! * kiddo allocates the results of every query; ours are in a buffer that is reused.
//! * kiddo is built on one thread; ours also on all threads (the second figure).
//! * Neither tree specifies which of several equally distant points it returns.
//! * Bytes are the growth of the process while the tree is built, from a million points on.

use buffon::integrator::photon::kdtree::{BuiltTree, Euclidean, KdTree, NeighbourBuffer};
use buffon::math::Vec3;
use kiddo::SquaredEuclidean;
use kiddo::immutable::float::kdtree::ImmutableKdTree;
use std::num::NonZero;
use std::time::Instant;

type Kiddo<const LEAF: usize> = ImmutableKdTree<f32, u32, 3, LEAF>;

const SIZES: [usize; 5] = [1_000, 10_000, 100_000, 1_000_000, 10_000_000];
const QUERIES: usize = 20_000;
const ROUNDS: usize = 5;
const K: [usize; 3] = [1, 50, 200];

/// A SplitMix64 generator of floats in [0, 1).
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / (1u64 << 24) as f32
    }

    /// Returns a point on one of the five walls of an open box.
    fn on_walls(&mut self) -> Vec3 {
        let wall = (5.0 * self.unit()) as u32;
        let (u, v) = (2.0 * self.unit() - 1.0, 2.0 * self.unit() - 1.0);
        match wall {
            0 => Vec3::new(u, v, -1.0),
            1 => Vec3::new(u, -1.0, v),
            2 => Vec3::new(u, 1.0, v),
            3 => Vec3::new(-1.0, u, v),
            _ => Vec3::new(1.0, u, v),
        }
    }

    /// Returns a point of a bright ring on the floor, as in a caustic.
    fn on_ring(&mut self) -> Vec3 {
        let (sin, cos) = (std::f32::consts::TAU * self.unit()).sin_cos();
        let r = 0.3 + 0.02 * (self.unit() + self.unit() - 1.0);
        Vec3::new(r * cos, -1.0, r * sin)
    }
}

/// Returns the resident memory of the process in bytes; 0 if the system does not report it.
fn resident() -> f64 {
    let statm = std::fs::read_to_string("/proc/self/statm").unwrap_or_default();
    statm.split(' ').nth(1).and_then(|pages| pages.parse::<f64>().ok()).unwrap_or(0.0) * 4096.0
}

/// Returns the result of `build`, and the seconds and bytes that it takes.
fn built<T>(build: impl FnOnce() -> T) -> (T, f64, f64) {
    let (before, start) = (resident(), Instant::now());
    let made = build();
    (made, start.elapsed().as_secs_f64(), resident() - before)
}

/// Returns the shortest time of a query in ns, and the sum of the results of the queries.
fn ns_per_query(queries: &[Vec3], mut query: impl FnMut(Vec3) -> f32) -> (f64, f64) {
    let (mut shortest, mut sum) = (f64::INFINITY, 0.0);
    for _ in 0..ROUNDS {
        let start = Instant::now();
        sum = queries.iter().map(|q| f64::from(query(*q))).sum();
        shortest = shortest.min(start.elapsed().as_secs_f64());
    }
    (shortest * 1e9 / queries.len() as f64, sum)
}

/// Returns the build time and bytes, and for each k the ns per query and the sum of the largest squared distances.
fn kiddo_row<const LEAF: usize>(points: &[[f32; 3]], queries: &[Vec3]) -> (f64, f64, Vec<(f64, f64)>) {
    let (tree, seconds, bytes) = built(|| Kiddo::<LEAF>::new_from_slice(points));
    let row = K.map(|k| {
        let k = NonZero::new(k).expect("not zero");
        ns_per_query(&queries[..QUERIES / k.get().min(10)], |q| {
            let q = q.to_array();
            match k.get() {
                1 => tree.nearest_one::<SquaredEuclidean>(&q).distance,
                _ => tree
                    .nearest_n_within::<SquaredEuclidean>(&q, f32::INFINITY, k, false)
                    .iter()
                    .fold(0.0, |far, n| n.distance.max(far)),
            }
        })
    });
    (seconds, bytes, row.to_vec())
}

fn our_row(points: &[Vec3], queries: &[Vec3]) -> (f64, f64, Vec<(f64, f64)>) {
    let (BuiltTree { tree, .. }, seconds, _) = built(|| KdTree::build(points.len(), |i| points[i]));
    let mut buffer = NeighbourBuffer::default();
    let row = K.map(|k| {
        ns_per_query(&queries[..QUERIES / k.min(10)], |q| match k {
            1 => {
                tree.nearest_one(q, f32::INFINITY, Euclidean, |_| true).map_or(0.0, |n| n.distance_squared())
            }
            _ => tree
                .nearest(q, k, f32::INFINITY, Euclidean, |_, all| all, &mut buffer)
                .iter()
                .fold(0.0, |far, n| n.distance_squared().max(far)),
        })
    });
    (seconds, tree.memory_bytes() as f64, row.to_vec())
}

/// Compares the distance of the k-th nearest point with a search of all points, for a few queries.
fn check(points: &[Vec3], queries: &[Vec3]) {
    let BuiltTree { tree, .. } = KdTree::build(points.len(), |i| points[i]);
    let mut buffer = NeighbourBuffer::default();
    for q in &queries[..5] {
        let mut all: Vec<f32> = points.iter().map(|p| (*p - *q).length_squared()).collect();
        for k in K {
            let found = tree.nearest(*q, k, f32::INFINITY, Euclidean, |_, all| all, &mut buffer);
            let farthest = found.iter().fold(0.0f32, |far, n| n.distance_squared().max(far));
            let (_, expected, _) = all.select_nth_unstable_by(k - 1, f32::total_cmp);
            assert_eq!(farthest, *expected, "the {k} nearest of {}", points.len());
        }
    }
}

fn compare(name: &str, points: &[Vec3], queries: &[Vec3]) {
    let n = points.len() as f64;
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    let (_, single, _) = built(|| one_thread.install(|| KdTree::build(points.len(), |i| points[i])));
    let (all, bytes, ours) = our_row(points, queries);
    let raw: Vec<[f32; 3]> = points.iter().map(|p| p.to_array()).collect();
    let theirs =
        [kiddo_row::<32>(&raw, queries), kiddo_row::<64>(&raw, queries), kiddo_row::<128>(&raw, queries)];
    println!(
        "\n{} points, {name}; ns per query, and all by itself {} threads",
        points.len(),
        rayon::current_num_threads()
    );
    println!("  {:<8} {:>8} {:>8} {:>8}   build", "", "k = 1", "50", "200");
    let print =
        |row: &dyn Fn(usize) -> f64| (0..K.len()).map(|i| format!(" {:>8.0}", row(i))).collect::<String>();
    let bytes_per =
        |bytes: f64| if n >= 1e6 { format!(", {:.1} bytes a point", bytes / n) } else { String::new() };
    println!("  {:<8}{}   {single:.3} s, {all:.3} s{}", "ours", print(&|i| ours[i].0), bytes_per(bytes));
    let best = |i: usize| theirs.iter().map(|(.., row)| row[i].0).fold(f64::INFINITY, f64::min);
    let seconds = theirs.iter().map(|t| t.0).fold(f64::INFINITY, f64::min);
    let least = theirs.iter().map(|t| t.1).fold(f64::INFINITY, f64::min);
    println!("  {:<8}{}   {seconds:.3} s{}", "kiddo", print(&best), bytes_per(least));
    for (i, k) in K.into_iter().enumerate() {
        for (.., row) in &theirs {
            let (ours, theirs) = (ours[i].1, row[i].1);
            assert!(
                (ours / theirs - 1.0).abs() < 1e-6,
                "k = {k}: {ours} and {theirs} are not the same photons"
            );
        }
    }
}

fn main() {
    let numbers = std::env::args().skip(1).filter_map(|a| a.parse::<usize>().ok());
    let largest = numbers.max().unwrap_or(SIZES[SIZES.len() - 1]);
    println!("Buffon's code: {}", if cfg!(target_feature = "avx2") { "x86-64-v3" } else { "baseline" });
    for n in SIZES.into_iter().filter(|&n| n <= largest) {
        for (name, place) in [
            ("walls of a room", Random::on_walls as fn(&mut Random) -> Vec3),
            ("a caustic's ring", Random::on_ring),
        ] {
            let mut random = Random(n as u64);
            let points: Vec<Vec3> = (0..n).map(|_| place(&mut random)).collect();
            let queries: Vec<Vec3> = (0..QUERIES).map(|_| place(&mut random)).collect();
            check(&points, &queries);
            compare(name, &points, &queries);
        }
    }
}
