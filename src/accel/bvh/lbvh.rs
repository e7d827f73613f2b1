//! Trees for very many boxes that overlap each other almost completely.
//!
//! The builder of obvhs merges pairs of boxes that are mutually nearest. Where neighbours lie side by side, this
//! takes a few rounds. Of nested or nearly identical boxes, the nearest neighbour of each is the next smaller one; a
//! round then merges a single pair, and construction takes quadratic time. Such boxes get a separate tree, built by
//! halving their order along a Z-curve. [Lauterbach et al. 2009]

use crate::sampling::hash::combine;
use obvhs::aabb::Aabb;
use obvhs::bvh2::{Bvh2, node::Bvh2Node};
use obvhs::cwbvh::{CwBvh, bvh2_to_cwbvh::bvh2_to_cwbvh};
use rayon::prelude::*;

/// The least length of a run of overlapping boxes along the Z-curve that gets a separate tree.
const MIN_RUN: usize = 256;
/// The greatest ratio between the area of the union of two boxes and the area of the larger one, for them to overlap.
const MAX_GROWTH: f32 = 1.05;

/// Returns the boxes that get a separate tree, in Z-curve order; almost always empty.
pub fn find_overlapping(boxes: &[Aabb]) -> Vec<u32> {
    if boxes.len() < MIN_RUN {
        return Vec::new();
    }
    let order = z_order(boxes);
    let at = |i: usize| &boxes[order[i] as usize];
    let overlaps_next = |i: usize| {
        let [a, b] = [at(i), at(i + 1)];
        a.union(b).half_area() <= MAX_GROWTH * a.half_area().max(b.half_area())
    };
    let mut overlapping = Vec::new();
    let mut first = 0;
    for i in 0..order.len() {
        if i + 1 == order.len() || !overlaps_next(i) {
            if i + 1 - first >= MIN_RUN {
                overlapping.extend(&order[first..=i]);
            }
            first = i + 1;
        }
    }
    overlapping
}

/// Returns the boxes' indices in the order of their centres along a Z-curve, equal boxes next to each other.
fn z_order(boxes: &[Aabb]) -> Vec<u32> {
    let all = boxes.iter().fold(Aabb::empty(), |all, b| all.union(b));
    let (low, extent) = (all.min, all.diagonal());
    let code = |b: &Aabb| {
        let place = (b.center() - low) / extent;
        // An axis of extent 0 gives NaN, which is cast to 0.
        [place.x, place.y, place.z]
            .iter()
            .fold(0, |code, &x| code << 1 | insert_two_zero_bits((x * 2_097_151.0) as u64))
    };
    let hash = |b: &Aabb| {
        let numbers = [b.min, b.max].map(|p| [p.x, p.y, p.z]);
        numbers.as_flattened().iter().fold(0, |h, x| combine(h, x.to_bits()))
    };
    let key = |i: usize| (code(&boxes[i]), hash(&boxes[i]), i as u32);
    let mut order: Vec<(u64, u32, u32)> = (0..boxes.len()).into_par_iter().map(key).collect();
    order.par_sort_unstable();
    order.into_iter().map(|(_, _, i)| i).collect()
}

/// Inserts two zero bits between the lowest 21 bits.
fn insert_two_zero_bits(v: u64) -> u64 {
    let v = (v | v << 32) & 0x001f_0000_0000_ffff;
    let v = (v | v << 16) & 0x001f_0000_ff00_00ff;
    let v = (v | v << 8) & 0x100f_00f0_0f00_f00f;
    let v = (v | v << 4) & 0x10c3_0c30_c30c_30c3;
    (v | v << 2) & 0x1249_2492_4924_9249
}

/// Builds the balanced tree over boxes in the given order.
pub fn tree(boxes: &[Aabb], order: Vec<u32>) -> CwBvh {
    let mut nodes = vec![Bvh2Node::default()];
    fill(&mut nodes, 0, boxes, &order, 0);
    let binary = Bvh2 { nodes, primitive_indices: order, ..Bvh2::default() };
    bvh2_to_cwbvh(&binary, 3, true, false)
}

/// Fills a node with the boxes of `order`, which is not empty and starts at index `first` of the whole order.
fn fill(nodes: &mut Vec<Bvh2Node>, node: usize, boxes: &[Aabb], order: &[u32], first: usize) {
    if let [one] = order {
        nodes[node] = Bvh2Node::new(boxes[*one as usize], 1, first as u32);
        return;
    }
    let children = nodes.len();
    nodes.extend([Bvh2Node::default(); 2]);
    let (left, right) = order.split_at(order.len() / 2);
    fill(nodes, children, boxes, left, first);
    fill(nodes, children + 1, boxes, right, first + left.len());
    let whole = nodes[children].aabb().union(nodes[children + 1].aabb());
    nodes[node] = Bvh2Node::new(whole, 0, children as u32);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;

    fn aabb(min: Vec3, max: Vec3) -> Aabb {
        Aabb::new(min.into(), max.into())
    }

    #[test]
    fn boxes_beside_each_other_are_no_crowd_and_boxes_in_each_other_are() {
        let beside = |i: u32| {
            let p = Vec3::new((i % 32) as f32, (i / 32) as f32, 0.0);
            aabb(p, p + Vec3::new(1.0, 1.0, 0.1))
        };
        let mut boxes: Vec<Aabb> = (0..1024).map(beside).collect();
        // The two triangles of a rectangle have the same box.
        boxes.extend_from_within(..);
        assert!(find_overlapping(&boxes).is_empty());
        let nested = |i: u32| aabb(Vec3::splat(40.0), Vec3::splat(40.0 + 1e-3 * i as f32));
        boxes.extend((1..=1000).map(nested));
        let mut overlapping = find_overlapping(&boxes);
        overlapping.sort_unstable();
        // A few boxes at either end of the run may sort among their neighbours.
        assert!(overlapping.len() > 900 && overlapping.iter().all(|&i| i >= 2048), "{}", overlapping.len());
    }

    #[test]
    fn a_tree_holds_every_box_of_its_order_once() {
        let boxes: Vec<Aabb> = (0..100).map(|i| aabb(Vec3::ZERO, Vec3::splat(1.0 + i as f32))).collect();
        for count in [4, 50, 100] {
            let order: Vec<u32> = (0..count).map(|i| (i * 37) % 100).collect();
            let tree = tree(&boxes, order.clone());
            let sorted = |mut v: Vec<u32>| {
                v.sort_unstable();
                v
            };
            assert_eq!(sorted(tree.primitive_indices), sorted(order));
        }
    }

    #[test]
    fn bits_are_spread() {
        assert_eq!(insert_two_zero_bits(0b1011), 0b1_000_001_001);
        assert_eq!(insert_two_zero_bits(0x1f_ffff).count_ones(), 21);
        assert_eq!(insert_two_zero_bits(0x1f_ffff), 0x1249_2492_4924_9249);
    }
}
