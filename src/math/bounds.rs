//! Axis-aligned bounding boxes.

use glam::Vec3;

/// An axis-aligned box; empty when `min > max` in any component.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// The corner with the least coordinates.
    pub min: Vec3,
    /// The corner with the greatest coordinates.
    pub max: Vec3,
}

impl Bounds {
    /// The empty box.
    pub const EMPTY: Bounds = Bounds { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    /// Returns the smallest box that contains the points.
    pub fn of(points: impl IntoIterator<Item = Vec3>) -> Self {
        points.into_iter().fold(Bounds::EMPTY, Bounds::with)
    }

    /// Returns the smallest box that contains the box and `p`.
    pub fn with(self, p: Vec3) -> Self {
        Bounds { min: self.min.min(p), max: self.max.max(p) }
    }

    /// Returns the smallest box that contains both.
    pub fn union(self, other: Bounds) -> Self {
        Bounds { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Returns whether the box is empty.
    pub fn is_empty(&self) -> bool {
        !(self.min.x <= self.max.x && self.min.y <= self.max.y && self.min.z <= self.max.z)
    }

    /// Returns whether the point is in the box or on its border.
    pub fn contains(&self, p: Vec3) -> bool {
        (self.min.cmple(p) & p.cmple(self.max)).all()
    }

    /// Returns whether the boxes have a point in common, or touch.
    pub fn touches(&self, other: &Bounds) -> bool {
        (self.min.cmple(other.max) & other.min.cmple(self.max)).all()
    }

    /// Returns the centre; zero for the empty box.
    pub fn center(&self) -> Vec3 {
        if self.is_empty() { Vec3::ZERO } else { self.min * 0.5 + self.max * 0.5 }
    }

    /// Returns half the diagonal, which is the radius of the bounding sphere around [`center`](Self::center).
    pub fn radius(&self) -> f32 {
        if self.is_empty() { 0.0 } else { (self.max * 0.5 - self.min * 0.5).length() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn empty_box_has_no_radius_and_union_grows() {
        assert!(Bounds::EMPTY.is_empty());
        assert_eq!(Bounds::EMPTY.radius(), 0.0);
        let b = Bounds::of([Vec3::ZERO, Vec3::new(2.0, 0.0, 0.0)]);
        assert_eq!(b.center(), Vec3::X);
        assert_eq!(b.radius(), 1.0);
        assert_eq!(b.union(Bounds::EMPTY), b);
    }
}
