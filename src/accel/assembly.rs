//! What an accelerator is built from: geometries, groups of them, instances of the groups, and a filter of hits.

use super::instance::{Instance, check_reach};
use super::{COORDINATE_LIMIT, Geometry, Hit, geometry};
use crate::error::{Error, Result};
use crate::math::{Bounds, Ray};
use std::sync::Arc;

/// What an accelerator is built from.
#[derive(Clone, Default)]
pub struct Assembly {
    /// Geometries; the index is [`Hit::geometry`].
    pub geometry: Vec<Geometry>,
    /// Groups of geometries (by index) that stand in the world only where an instance puts them. A geometry is in at
    /// most one group; those in none stand in the world themselves.
    pub groups: Vec<Vec<u32>>,
    /// The instances; the index is [`Hit::instance`].
    pub instances: Vec<Instance>,
    /// Decides which hits count, for the geometries marked in it.
    pub filter: Option<Filtered>,
}

impl From<Vec<Geometry>> for Assembly {
    /// All geometries in the world, and all hits count.
    fn from(geometry: Vec<Geometry>) -> Self {
        Assembly { geometry, ..Assembly::default() }
    }
}

/// Decides which hits count: a surface with holes, or one that is there by chance.
pub trait HitFilter: Send + Sync {
    /// Whether a hit counts.
    ///
    /// `id` is the ray's [`ray_id`], so that a decision by chance is the same however often and in whatever order it
    /// is asked. `ray` is the ray in the coordinates of the geometry's group (of the world, if it is in none), with
    /// the hit's distance as its `t_max`. The answer may depend on nothing else.
    ///
    /// A panic reaches the caller of the query.
    fn accepts(&self, id: u32, ray: &Ray, hit: &Hit) -> bool;
}

/// A filter, and the geometries whose hits it is asked about.
#[derive(Clone)]
pub struct Filtered {
    /// The filter.
    pub filter: Arc<dyn HitFilter>,
    /// By geometry: whether its hits are subject to the filter. As long as the list of geometries.
    pub geometry: Vec<bool>,
}

/// The number of a ray for [`HitFilter`]: a hash of the bits of its origin and direction in the world.
/// [Appleby 2011, "MurmurHash3", 32 bits]
#[inline]
pub fn ray_id(ray: &Ray) -> u32 {
    let words = [ray.o.x, ray.o.y, ray.o.z, ray.d.x, ray.d.y, ray.d.z];
    let mix = |h: u32, x: f32| {
        let k = x.to_bits().wrapping_mul(0xcc9e_2d51).rotate_left(15).wrapping_mul(0x1b87_3593);
        (h ^ k).rotate_left(13).wrapping_mul(5).wrapping_add(0xe654_6b64)
    };
    let mut h = words.into_iter().fold(0, mix) ^ 24;
    h = (h ^ (h >> 16)).wrapping_mul(0x85eb_ca6b);
    h = (h ^ (h >> 13)).wrapping_mul(0xc2b2_ae35);
    h ^ (h >> 16)
}

/// The question to the filter during one query of one ray.
#[derive(Clone, Copy)]
pub(super) struct Question<'a> {
    filter: Option<&'a Filtered>,
    id: u32,
}

impl<'a> Question<'a> {
    /// For a ray in the world; without a filter nothing is computed.
    #[inline]
    pub fn new(filter: Option<&'a Filtered>, ray: &Ray) -> Self {
        Question { filter, id: if filter.is_some() { ray_id(ray) } else { 0 } }
    }

    /// For a ray whose number is known.
    #[cfg(feature = "embree")]
    pub fn with_id(filter: Option<&'a Filtered>, id: u32) -> Self {
        Question { filter, id }
    }

    /// Whether the hit counts; `ray` is that in the group's coordinates.
    #[inline]
    pub fn accepts(&self, ray: &Ray, hit: &Hit) -> bool {
        match self.filter {
            Some(f) if f.geometry[hit.geometry as usize] => {
                f.filter.accepts(self.id, &Ray { t_max: hit.t, ..*ray }, hit)
            }
            _ => true,
        }
    }
}

/// What [`Assembly::check`] finds.
pub(super) struct Checked {
    /// Primitives that no back end will hit.
    pub dropped: usize,
    /// The box around all that stands in the world, at any time.
    pub bounds: Bounds,
    /// The geometries that are in no group.
    pub world: Vec<u32>,
    /// By instance: its box in the world over all times.
    pub instances: Vec<Bounds>,
    /// The greatest component of a valid ray in the world.
    pub ray_limit: f32,
}

impl Assembly {
    /// Checks everything and makes the geometries safe for every back end, as [`geometry::check`] does.
    ///
    /// # Errors
    /// If an index is out of range, a geometry is in two groups, the filter's marks are not one for each geometry, or
    /// an instance's transform is refused (see [`build`](super::build)).
    pub(super) fn check(&mut self) -> Result<Checked> {
        let internal = |message: String| Err(Error::internal(message));
        let count = self.geometry.len();
        let mut grouped = vec![false; count];
        for &member in self.groups.iter().flatten() {
            match grouped.get_mut(member as usize) {
                None => return internal(format!("expected a geometry below {count}, found {member}")),
                Some(true) => {
                    return internal(format!("expected geometry {member} in one group, found it in two"));
                }
                Some(unseen) => *unseen = true,
            }
        }
        if let Some(marks) = self.filter.as_ref().map(|f| f.geometry.len()).filter(|&n| n != count) {
            return internal(format!("expected a mark for each of {count} geometries, found {marks}"));
        }
        let mut checked = Checked {
            dropped: 0,
            bounds: Bounds::EMPTY,
            world: (0..).zip(&grouped).filter(|(_, grouped)| !**grouped).map(|(i, _)| i).collect(),
            instances: Vec::with_capacity(self.instances.len()),
            ray_limit: COORDINATE_LIMIT,
        };
        let each: Vec<_> = self.geometry.iter_mut().map(geometry::check).collect();
        let around =
            |list: &[u32]| list.iter().map(|&i| each[i as usize].bounds).fold(Bounds::EMPTY, Bounds::union);
        checked.dropped = each.iter().map(|c| c.dropped).sum();
        checked.bounds = around(&checked.world);
        let groups: Vec<Bounds> = self.groups.iter().map(|group| around(group)).collect();
        for (i, instance) in self.instances.iter().enumerate() {
            let Some(&group) = groups.get(instance.group as usize) else {
                return internal(format!(
                    "expected a group below {}, found {}",
                    groups.len(),
                    instance.group
                ));
            };
            let about = |e: Error| e.about(format!("instance {i}"));
            checked.ray_limit = checked.ray_limit.min(instance.check().map_err(about)?);
            let bounds = instance.bounds(group);
            check_reach(bounds).map_err(about)?;
            checked.bounds = checked.bounds.union(bounds);
            checked.instances.push(bounds);
        }
        Ok(checked)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::Primitive;
    use crate::math::{DAffine3, DVec3, Vec3};

    fn spheres(n: usize) -> Vec<Geometry> {
        vec![Geometry::Analytic(Primitive::Sphere { center: Vec3::ZERO, radius: 1.0 }); n]
    }

    #[test]
    fn what_stands_in_the_world_is_in_no_group_or_instanced() {
        let far = DAffine3::from_translation(DVec3::X * 100.0);
        let mut assembly = Assembly {
            geometry: spheres(4),
            groups: vec![vec![3, 1], vec![2]],
            instances: vec![Instance::new(0, &[far])],
            filter: None,
        };
        let checked = assembly.check().expect("fine");
        assert_eq!(checked.world, [0]);
        assert!(
            checked.bounds.max.x >= 101.0 && checked.bounds.min.x <= -1.0 && checked.bounds.max.y < 1.001
        );
        assembly.instances.clear();
        assert!(assembly.check().expect("fine").bounds.max.x < 1.001);
    }

    #[test]
    fn wild_indices_are_refused() {
        let refused = |groups: Vec<Vec<u32>>, instances: Vec<Instance>| {
            let mut assembly = Assembly { geometry: spheres(2), groups, instances, filter: None };
            assembly.check().err().expect("refused").to_string()
        };
        assert_eq!(refused(vec![vec![2]], vec![]), "expected a geometry below 2, found 2");
        assert_eq!(
            refused(vec![vec![1], vec![1]], vec![]),
            "expected geometry 1 in one group, found it in two"
        );
        let one = Instance::new(1, &[DAffine3::IDENTITY]);
        assert_eq!(refused(vec![vec![1]], vec![one]), "expected a group below 1, found 1");
        let flat = Instance::new(0, &[DAffine3::from_scale(DVec3::new(1.0, 1.0, 0.0))]);
        assert!(
            refused(vec![vec![1]], vec![flat]).starts_with("instance 0: expected a transform that scales")
        );
    }

    #[test]
    fn ids_of_neighbouring_rays_have_nothing_in_common() {
        let id = |i: u32| ray_id(&Ray::new(Vec3::splat(i as f32 * 1e-3), Vec3::Z));
        for bit in 0..32 {
            let set = (0..4000).filter(|&i| id(i) >> bit & 1 == 1).count();
            let flipped = (0..4000).filter(|&i| (id(i) ^ id(i + 1)) >> bit & 1 == 1).count();
            // Six standard deviations.
            assert!(set.abs_diff(2000) < 190 && flipped.abs_diff(2000) < 190, "bit {bit}: {set}, {flipped}");
        }
    }
}
