//! The input of an accelerator: geometries, groups of geometries, instances of the groups, and a filter of hits.

use super::geometry::{self, CheckedGeometry};
use super::instance::{Instance, check_reach};
use super::{COORDINATE_LIMIT, Geometry, Hit};
use crate::error::{Error, Result};
use crate::math::{Bounds, Ray};
use std::sync::Arc;

/// The input from which an accelerator is built.
#[derive(Clone, Default)]
pub struct Assembly {
    /// Geometries; the index is [`Hit::geometry`].
    pub geometry: Vec<Geometry>,
    /// Groups of geometries, by index. An instance places a group in world space. A geometry belongs to at most one
    /// group; a geometry in no group is in world space itself.
    pub groups: Vec<Vec<u32>>,
    /// The instances; the index is [`Hit::instance`].
    pub instances: Vec<Instance>,
    /// Accepts or rejects the hits of the geometries marked in it. `None` accepts every hit.
    pub filter: Option<GeometryFilter>,
}

impl From<Vec<Geometry>> for Assembly {
    /// An assembly without groups, instances or a filter: all geometries are in world space and all hits are
    /// accepted.
    fn from(geometry: Vec<Geometry>) -> Self {
        Assembly { geometry, ..Assembly::default() }
    }
}

/// Accepts or rejects hits, for a surface with holes or with stochastic opacity.
pub trait HitFilter: Send + Sync {
    /// Returns whether a hit is accepted.
    ///
    /// `id` is the ray's [`ray_id`]. A stochastic decision made from it is the same in every query order and number
    /// of queries. `ray` is the ray in the space of the geometry's group (world space if it is in none); its `t_max`
    /// is the distance of the hit. The answer must depend on nothing else.
    ///
    /// A panic reaches the caller of the query.
    fn accepts(&self, id: u32, ray: &Ray, hit: &Hit) -> bool;
}

/// A filter and the geometries to which it applies.
#[derive(Clone)]
pub struct GeometryFilter {
    /// The filter.
    pub filter: Arc<dyn HitFilter>,
    /// For each geometry, whether its hits go through the filter. The length is that of the list of geometries.
    pub geometry: Vec<bool>,
}

/// Returns the ray's identifier for [`HitFilter`]: a hash of the bits of its origin and direction in world space and of
/// its time.
/// [Appleby 2011, "MurmurHash3", 32 bits]
#[inline]
pub fn ray_id(ray: &Ray) -> u32 {
    let words = [ray.o.x, ray.o.y, ray.o.z, ray.d.x, ray.d.y, ray.d.z];
    let mix = |h: u32, x: f32| {
        let k = x.to_bits().wrapping_mul(0xcc9e_2d51).rotate_left(15).wrapping_mul(0x1b87_3593);
        (h ^ k).rotate_left(13).wrapping_mul(5).wrapping_add(0xe654_6b64)
    };
    let mut h = words.into_iter().fold(0, mix) ^ 24 ^ ray.time.to_bits();
    h = (h ^ (h >> 16)).wrapping_mul(0x85eb_ca6b);
    h = (h ^ (h >> 13)).wrapping_mul(0xc2b2_ae35);
    h ^ (h >> 16)
}

/// The filter during one query of one ray.
#[derive(Clone, Copy)]
pub(super) struct FilterQuery<'a> {
    filter: Option<&'a GeometryFilter>,
    id: u32,
}

impl<'a> FilterQuery<'a> {
    /// Prepares the filter for a ray in world space. The identifier is computed only if there is a filter.
    #[inline]
    pub fn new(filter: Option<&'a GeometryFilter>, ray: &Ray) -> Self {
        FilterQuery { filter, id: if filter.is_some() { ray_id(ray) } else { 0 } }
    }

    /// Prepares the filter for a ray whose identifier is known.
    #[cfg(feature = "embree")]
    pub fn with_id(filter: Option<&'a GeometryFilter>, id: u32) -> Self {
        FilterQuery { filter, id }
    }

    /// Returns whether the hit is accepted; `ray` is in the space of the group.
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

/// The result of [`Assembly::check`].
pub(super) struct CheckedAssembly {
    /// The number of primitives that no back end can hit.
    pub dropped: usize,
    /// The bounding box of everything in world space, over all times.
    pub bounds: Bounds,
    /// For each geometry, the bounding box of its valid primitives.
    pub geometry: Vec<Bounds>,
    /// The indices of the geometries that are in no group.
    pub world: Vec<u32>,
    /// For each instance, its bounding box in world space over all times.
    pub instances: Vec<Bounds>,
    /// The greatest magnitude of a component of a valid ray in world space.
    pub ray_limit: f32,
}

impl Assembly {
    /// Checks the assembly and makes the geometries safe for every back end, as [`geometry::check`] does.
    ///
    /// # Errors
    /// If an index is out of range, a geometry is in two groups, the filter has not one mark for each geometry, or an
    /// instance's transform is rejected (see [`build`](super::build)).
    pub(super) fn check(&mut self) -> Result<CheckedAssembly> {
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
            return internal(format!("expected {count} marks, one for each geometry, found {marks}"));
        }
        let mut checked = CheckedAssembly {
            dropped: 0,
            bounds: Bounds::EMPTY,
            geometry: Vec::new(),
            world: (0..).zip(&grouped).filter(|(_, grouped)| !**grouped).map(|(i, _)| i).collect(),
            instances: Vec::with_capacity(self.instances.len()),
            ray_limit: COORDINATE_LIMIT,
        };
        for of_list in &mut self.geometry {
            let CheckedGeometry { dropped, bounds } = geometry::check(of_list);
            checked.dropped += dropped;
            checked.geometry.push(bounds);
        }
        let each = std::mem::take(&mut checked.geometry);
        let around = |list: &[u32]| list.iter().map(|&i| each[i as usize]).fold(Bounds::EMPTY, Bounds::union);
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
        checked.geometry = each;
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
