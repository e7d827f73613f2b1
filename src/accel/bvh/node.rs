//! The test of a ray against the eight boxes of a compressed node, rounded outwards.

use crate::math::{Ray, Vec3, robust::UNIT_ROUNDOFF};
use obvhs::cwbvh::node::CwBvhNode;

/// The smallest ratio of a direction component to the greatest one. Smaller components are raised to it, so that 1/d
/// is finite. The ray then deviates by this ratio times the distance, which is far below the error bound of a box.
const MIN_RATIO: f32 = 1e-25;

/// The bound on the error of a slab's parameter, in units of |b| + 255·|a| (see [`BoxTest::children`]): 3 roundings
/// in b, 2 in q·a, 1 in their sum and 1 in the quantisation of the box; times two.
const SLAB_ERROR: f32 = 14.0 * UNIT_ROUNDOFF;

/// A ray prepared for box tests.
pub(super) struct BoxTest {
    o: [f32; 3],
    inverse: [f32; 3],
    octant: u32,
}

impl BoxTest {
    /// Prepares a ray with a direction that is finite and not zero.
    #[inline]
    pub fn new(ray: &Ray) -> Self {
        let least = ray.d.abs().max_element() * MIN_RATIO;
        let raised = |d: f32| if d.abs() < least { least.copysign(d) } else { d };
        let inverse = [ray.d.x, ray.d.y, ray.d.z].map(|d| 1.0 / raised(d));
        let bit = |axis: usize, bits: u32| if inverse[axis] < 0.0 { 0 } else { bits };
        let octant = bit(0, 0x0404_0404) | bit(1, 0x0202_0202) | bit(2, 0x0101_0101);
        BoxTest { o: ray.o.to_array(), inverse, octant }
    }

    /// Returns the inverted octant of the direction in each byte, which defines the order in which children are
    /// visited.
    /// [Ylitie, Karras, Laine 2017, section 3.2]
    #[inline]
    pub fn octant(&self) -> u32 {
        self.octant
    }

    /// Returns the children whose box the ray may intersect for `0 ≤ t ≤ t_max`. The high byte has the inner nodes,
    /// in visiting order. The low 24 bits have the primitives of leaves, counted from the node's first.
    ///
    /// The planes of a box on one axis are at the parameters q·a + b, where q is the quantised coordinate. Near
    /// planes are moved nearer and far planes farther by the bound on the rounding error. The comparisons are such
    /// that a NaN (0·∞, for a ray in a plane of the box) never excludes a child.
    #[inline]
    pub fn children(&self, node: &CwBvhNode, t_max: f32) -> u32 {
        let extent = Vec3::from(node.compute_extent()).to_array();
        let p = node.p.to_array();
        let planes = [
            (&node.child_min_x, &node.child_max_x),
            (&node.child_min_y, &node.child_max_y),
            (&node.child_min_z, &node.child_max_z),
        ];
        let mut near = [0.0f32; 8];
        let mut far = [t_max; 8];
        for axis in 0..3 {
            let a = extent[axis] * self.inverse[axis];
            let b = (p[axis] - self.o[axis]) * self.inverse[axis];
            let error = (b.abs() + 255.0 * a.abs()) * SLAB_ERROR;
            let (first, last) = match self.inverse[axis] < 0.0 {
                true => (planes[axis].1, planes[axis].0),
                false => planes[axis],
            };
            let (b_near, b_far) = (b - error, b + error);
            for i in 0..8 {
                let t = f32::from(first[i]) * a + b_near;
                near[i] = if t > near[i] { t } else { near[i] };
            }
            for i in 0..8 {
                let t = f32::from(last[i]) * a + b_far;
                far[i] = if t < far[i] { t } else { far[i] };
            }
        }
        let (bits, index) = node.get_child_and_index_bits(self.octant);
        let mut hits = 0;
        for i in 0..8 {
            let hit = u32::from(near[i] <= far[i]);
            let (bits, index) = ((bits >> (8 * i)) as u32 & 0xff, (index >> (8 * i)) as u32 & 0xff);
            hits |= (bits * hit) << index;
        }
        hits
    }
}
