//! The densities of directions over the surfaces of a scene: a binary tree over positions and normals.

use super::directions::{Arrival, Directions};
use crate::math::Vec3;
use std::f32::consts::PI;
use std::ops::Range;

/// A cell with more photons than this is divided.
const MOST_PHOTONS: usize = 1024;
/// A cell with fewer photons than this has no density.
const LEAST_PHOTONS: usize = 32;
/// A cell in which a coordinate of the normals varies by more than this is divided by the normals.
const NORMALS: f32 = 0.8;
/// A cell has a density if the estimator with cosine-distributed directions would have at least this relative second
/// moment. For light from a cone around the normal it is 1 over the squared sine of the half angle.
const LEAST_MOMENT: f32 = 12.0;
/// The least cosine between an incident direction and the normal in the estimate of that moment.
const LEAST_COSINE: f32 = 0.01;

/// A photon of which the field learns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LearnedPhoton {
    /// Where it arrived.
    pub place: Place,
    /// The unit direction towards the incident light.
    pub wi: Vec3,
    /// The flux, in any unit.
    pub flux: f32,
}

/// A point of a surface: three coordinates of the position and three of the unit normal on the side of the light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place([f32; 6]);

impl Place {
    /// The place at a position, with the geometric normal that is turned to the side of `w`.
    #[inline]
    pub fn new(p: Vec3, ng: Vec3, w: Vec3) -> Self {
        let n = if ng.dot(w) < 0.0 { -ng } else { ng };
        Place([p.x, p.y, p.z, n.x, n.y, n.z])
    }

    fn normal(&self) -> Vec3 {
        Vec3::new(self.0[3], self.0[4], self.0[5])
    }
}

/// A cell of the tree.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Cell {
    /// Places with a coordinate less than `middle` are in the next cell, others in the cell `upper`.
    Divided { axis: u8, middle: f32, upper: u32 },
    /// The index of the density; `None` if directions are sampled as well without it.
    Whole(Option<u32>),
}

/// Densities of directions over the surfaces of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GuidingField {
    cells: Vec<Cell>,
    densities: Vec<Directions>,
}

impl GuidingField {
    /// Builds the field from photons, which are reordered.
    pub fn new(photons: &mut [LearnedPhoton]) -> Self {
        let mut field = GuidingField::default();
        field.add_cell(photons);
        field
    }

    fn add_cell(&mut self, photons: &mut [LearnedPhoton]) {
        let index = self.cells.len();
        let Some((axis, middle)) = division(photons) else {
            let density = density(photons);
            self.cells.push(Cell::Whole(density.is_some().then_some(self.densities.len() as u32)));
            self.densities.extend(density);
            return;
        };
        photons.sort_by_key(|photon| photon.place.0[axis] >= middle);
        let (lower, upper) = photons.split_at_mut(photons.partition_point(|p| p.place.0[axis] < middle));
        self.cells.push(Cell::Whole(None));
        self.add_cell(lower);
        let next = self.cells.len();
        self.add_cell(upper);
        if [index + 1, next].iter().all(|&part| self.cells[part] == Cell::Whole(None)) {
            self.cells.truncate(index + 1);
        } else {
            self.cells[index] = Cell::Divided { axis: axis as u8, middle, upper: next as u32 };
        }
    }

    /// Returns the density at a place; `None` if directions are sampled as well without it.
    #[inline]
    pub fn directions(&self, place: &Place) -> Option<&Directions> {
        let mut index = 0;
        loop {
            match *self.cells.get(index)? {
                Cell::Divided { axis, middle, upper } => {
                    index = if place.0[usize::from(axis)] < middle { index + 1 } else { upper as usize };
                }
                Cell::Whole(density) => return density.map(|i| &self.densities[i as usize]),
            }
        }
    }

    /// Returns the number of densities.
    pub fn len(&self) -> usize {
        self.densities.len()
    }

    /// Returns whether there is no density.
    pub fn is_empty(&self) -> bool {
        self.densities.is_empty()
    }
}

/// Returns the axis along which a cell is divided, and the least coordinate of its upper part. No part is empty.
fn division(photons: &mut [LearnedPhoton]) -> Option<(usize, f32)> {
    let mut extents = [[f32::INFINITY, f32::NEG_INFINITY]; 6];
    for photon in &*photons {
        for ([least, most], x) in extents.iter_mut().zip(photon.place.0) {
            (*least, *most) = (least.min(x), most.max(x));
        }
    }
    let width = |axis: &usize| extents[*axis][1] - extents[*axis][0];
    let widest = |axes: Range<usize>| axes.max_by(|a, b| width(a).total_cmp(&width(b)));
    if let Some(axis) = widest(3..6).filter(|axis| width(axis) > NORMALS) {
        return Some((axis, 0.5 * (extents[axis][0] + extents[axis][1])));
    }
    let axis = widest(0..3).filter(|_| photons.len() > MOST_PHOTONS)?;
    let half = photons.len() / 2;
    photons.select_nth_unstable_by(half, |a, b| a.place.0[axis].total_cmp(&b.place.0[axis]));
    let middle = photons[half].place.0[axis];
    (extents[axis][0] < middle).then_some((axis, middle))
}

/// Returns the density of the light of a cell, if it is better than a cosine.
fn density(photons: &[LearnedPhoton]) -> Option<Directions> {
    let mut arrivals: Vec<_> = photons.iter().map(|photon| Arrival::new(photon.wi, photon.flux)).collect();
    let directions = Directions::new(&mut arrivals).filter(|_| arrivals.len() >= LEAST_PHOTONS)?;
    let flux: f32 = photons.iter().map(|photon| photon.flux).sum();
    // ∫ p²/q dω for the density p of light and the density q of a cosine, by the photons, which are samples of p.
    let ratio = |photon: &LearnedPhoton| {
        directions.pdf(photon.wi) * PI / photon.place.normal().dot(photon.wi).max(LEAST_COSINE)
    };
    let moment = photons.iter().map(|photon| photon.flux * ratio(photon)).sum::<f32>() / flux;
    (moment >= LEAST_MOMENT).then_some(directions)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec2;
    use crate::sampling::hash::{combine, to_unit};
    use crate::sampling::warp;

    /// Photons on both sides of the unit square in the plane z = 0. From above they come from a narrow cone where
    /// x < 0.5 and from everywhere else; from below, all come from the direction (0, 0, -1).
    fn photons() -> Vec<LearnedPhoton> {
        let random = |i: u32, k: u32| to_unit(combine(k, i));
        let photon = |i: u32| {
            let p = Vec3::new(random(i, 1), random(i, 2), 0.0);
            let u = Vec2::new(random(i, 3), random(i, 4));
            let wi = match (i.is_multiple_of(2), p.x < 0.5) {
                (true, _) => -Vec3::Z,
                (false, true) => warp::square_to_cone(u, 0.005),
                (false, false) => warp::square_to_cosine_hemisphere(u),
            };
            LearnedPhoton { place: Place::new(p, Vec3::Z, wi), wi, flux: 1.0 }
        };
        (0..1 << 16).map(photon).collect()
    }

    #[test]
    fn places_have_densities_where_light_is_narrow() {
        let field = GuidingField::new(&mut photons());
        let at = |x, w| Place::new(Vec3::new(x, 0.4, 0.0), Vec3::Z, w);
        let narrow = at(0.2, Vec3::Z);
        // More than ten times the density of a cosine. Cells at the poles of the sphere are long and narrow.
        assert!(field.directions(&narrow).expect("a density").pdf(Vec3::Z) > 10.0 / PI);
        assert_eq!(field.directions(&at(0.8, Vec3::Z)), None);
        let below = field.directions(&at(0.8, -Vec3::Z)).expect("a density");
        assert!(below.pdf(-Vec3::Z) > 1e4 && below.pdf(Vec3::Z) == 0.0);
    }

    #[test]
    fn photons_at_one_point_are_one_cell() {
        let place = Place::new(Vec3::ONE, Vec3::Z, Vec3::Z);
        let photon = LearnedPhoton { place, wi: Vec3::Z, flux: 1.0 };
        let field = GuidingField::new(&mut vec![photon; 3 * MOST_PHOTONS]);
        assert_eq!(field.len(), 1);
        assert!(GuidingField::new(&mut vec![photon; LEAST_PHOTONS - 1]).is_empty());
        assert!(GuidingField::new(&mut []).is_empty());
    }
}
