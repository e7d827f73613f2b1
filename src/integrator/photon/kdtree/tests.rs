use super::*;
use crate::sampling::hash::{combine, to_unit};
use proptest::prelude::*;

/// Returns a number in [0, 1) that is a hash of the arguments.
fn unit(seed: u32, i: usize, c: u32) -> f32 {
    to_unit(combine(combine(seed, i as u32), c))
}

fn random(seed: u32, i: usize) -> Vec3 {
    Vec3::new(unit(seed, i, 0), unit(seed, i, 1), unit(seed, i, 2)) * 2.0 - 1.0
}

/// Returns clouds of `n` points with a description.
fn clouds(n: usize) -> Vec<(&'static str, Vec<Vec3>)> {
    let cloud = |f: &dyn Fn(usize) -> Vec3| (0..n).map(f).collect();
    vec![
        ("random", cloud(&|i| random(1, i))),
        ("duplicated", cloud(&|i| random(2, i % (n / 20 + 1)))),
        ("one point", cloud(&|_| Vec3::new(0.1, 0.2, 0.3))),
        ("collinear", cloud(&|i| Vec3::new(0.3, 0.5, -0.7) * unit(3, i, 0))),
        ("collinear along an axis", cloud(&|i| Vec3::new(0.25, unit(4, i, 0), -1.0))),
        ("coplanar", cloud(&|i| random(5, i).with_z(0.5))),
        ("a grid", cloud(&|i| Vec3::new((i % 7) as f32, (i / 7 % 7) as f32, (i / 49) as f32) * 0.1)),
        ("far from the origin", cloud(&|i| random(6, i) + Vec3::splat(1e6))),
        ("of all sizes", cloud(&|i| random(7, i) * 2f32.powi((i % 60) as i32 - 30))),
    ]
}

fn distances_squared(metric: impl Metric, center: Vec3, points: &[Vec3]) -> Vec<f32> {
    let distance = |p: &Vec3| metric.distances_squared(center, Vec3x16::splat(*p)).as_array()[0];
    points.iter().map(distance).collect()
}

/// Compares the result of the tree with that of an exhaustive search.
fn check(points: &[Vec3], center: Vec3, k: usize, bound: f32, metric: impl Metric, every: usize) {
    let BuiltTree { tree, order } = KdTree::build(points.len(), |i| points[i]);
    let all = distances_squared(metric, center, points);
    let accepted = |index: usize| index.is_multiple_of(every);
    let mut expected: Vec<f32> =
        (0..points.len()).filter(|&i| accepted(i) && all[i] < bound).map(|i| all[i]).collect();
    expected.sort_by(f32::total_cmp);
    let mut buffer = NeighbourBuffer::default();
    let found = tree
        .nearest(center, k, bound, metric, each(|slot| accepted(order[slot] as usize)), &mut buffer)
        .to_vec();
    let mut distances: Vec<f32> = found.iter().map(|n| n.distance_squared()).collect();
    distances.sort_by(f32::total_cmp);
    assert_eq!(distances, expected[..k.min(expected.len())], "{k} nearest of {}", points.len());
    for n in &found {
        assert_eq!(n.distance_squared(), all[order[n.slot()] as usize]);
        assert!(accepted(order[n.slot()] as usize));
    }
    let mut slots: Vec<usize> = found.iter().map(|n| n.slot()).collect();
    slots.sort();
    slots.dedup();
    assert_eq!(slots.len(), found.len(), "no point is found twice");
    let one = tree.nearest_one(center, bound, metric, |slot| accepted(order[slot] as usize));
    assert_eq!(one.map(Neighbour::distance_squared), expected.first().copied());
}

#[test]
fn the_nearest_are_those_that_a_search_of_all_finds() {
    for n in [0, 1, 2, 15, 16, 17, 31, 33, 48, 49, 100, 1000, 20_000] {
        for (name, points) in clouds(n) {
            for q in 0..4 {
                let center = match q {
                    0 if n > 0 => points[n / 2],
                    _ => random(40 + q, n) * 1.5,
                };
                for (k, bound) in [(1, f32::INFINITY), (3, 0.25), (50, f32::INFINITY), (200, 1.0)] {
                    println!("{n} points, {name}, k = {k}, from {center}");
                    check(&points, center, k, bound, Euclidean, 1);
                    let disc = EllipsoidMetric { normal: Vec3::new(0.6, 0.0, 0.8), flatness: 3.0 };
                    check(&points, center, k, bound, disc, 3);
                }
            }
        }
    }
}

#[test]
fn the_points_within_a_distance_are_those_that_a_search_of_all_finds() {
    for n in [0, 1, 17, 5000] {
        for (name, points) in clouds(n) {
            let BuiltTree { tree, order } = KdTree::build(n, |i| points[i]);
            for (q, bound) in [(50, 0.04), (51, 1.0), (52, f32::INFINITY)] {
                let center = random(q, n);
                let all = distances_squared(Euclidean, center, &points);
                let mut found = Vec::new();
                tree.for_each_within(center, bound, |slot, d| {
                    assert_eq!(d, all[order[slot] as usize]);
                    found.push(order[slot] as usize);
                });
                found.sort();
                let expected: Vec<usize> = (0..n).filter(|&i| all[i] < bound).collect();
                assert_eq!(found, expected, "{n} points, {name}");
            }
        }
    }
}

#[test]
fn every_point_has_one_slot_and_the_tree_is_the_same_for_any_number_of_threads() {
    for (name, points) in clouds(50_000) {
        let build = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| KdTree::build(points.len(), |i| points[i]))
        };
        let BuiltTree { tree, order } = build(1);
        let mut indices = order.clone();
        indices.sort();
        assert!(indices.iter().zip(0..).all(|(&i, j)| i == j), "{name}");
        assert!((0..points.len()).all(|slot| tree.point(slot) == points[order[slot] as usize]));
        for threads in [2, 7] {
            let other = build(threads);
            assert_eq!(other.order, order, "{name}");
            assert!(other.tree.splits == tree.splits && other.tree.leaves == tree.leaves, "{name}");
        }
        assert!(tree.memory_bytes() as f64 / (points.len() as f64) < 12.6);
    }
}

#[test]
#[should_panic(expected = "a kd-tree holds finite points only, not [0, NaN, 0]")]
fn a_point_that_is_none_is_refused() {
    KdTree::build(2, |i| Vec3::new(0.0, if i == 1 { f32::NAN } else { 0.0 }, 0.0));
}

#[test]
fn extents_beyond_the_range_of_numbers_do_no_harm() {
    let points: Vec<Vec3> = (0..100).map(|i| random(9, i) * f32::MAX).collect();
    let BuiltTree { tree, .. } = KdTree::build(points.len(), |i| points[i]);
    let found = tree.nearest_one(Vec3::ZERO, f32::INFINITY, Euclidean, |_| true);
    assert_eq!(found, None, "all squared distances are infinite, and none is below the bound");
}

proptest! {
    #[test]
    fn points_of_a_coarse_grid(
        points in prop::collection::vec(prop::array::uniform3(-3i8..4), 0..300),
        center in prop::array::uniform3(-4i8..5),
        k in 0usize..60,
        bound in prop::option::of(0u8..40),
    ) {
        let vector = |p: [i8; 3]| Vec3::from_array(p.map(|c| f32::from(c) * 0.1));
        let points: Vec<Vec3> = points.into_iter().map(vector).collect();
        let bound = bound.map_or(f32::INFINITY, |b| f32::from(b) * 0.01);
        check(&points, vector(center), k, bound, Euclidean, 1);
    }
}
