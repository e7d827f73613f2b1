//! Notes about light paths that have left no photons.

use crate::integrator::Statistic;

/// The names of the numbers of light paths and of photons, and the note for light paths without photons.
const MAPS: [[&str; 3]; 3] = [
    [
        "global_light_paths",
        "global_photons",
        "the global photon map is empty: the image has no light scattered more than once",
    ],
    ["caustic_light_paths", "caustic_photons", "the caustic photon map is empty: the image has no caustics"],
    [
        "light_paths_of_a_pass",
        "photons_of_the_last_pass",
        "the last pass deposited no scattered photons: it has direct light only",
    ],
];

/// Returns a sentence for each kind of photon with light paths but without photons.
pub fn photon_notes(facts: &[Statistic]) -> Vec<&'static str> {
    let fact = |name: &str| facts.iter().find(|fact| fact.name == name).map(|fact| fact.value);
    let missing = |[paths, photons, _]: &&[&str; 3]| {
        fact(paths).is_some_and(|paths| paths > 0.0) && fact(photons) == Some(0.0)
    };
    MAPS.iter().filter(missing).map(|[.., note]| *note).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn photons_are_missed_where_paths_were_traced_for_them() {
        let notes = |paths: f64, photons: f64| {
            let fact = |name, value| Statistic { name, value };
            photon_notes(&[fact("caustic_light_paths", paths), fact("caustic_photons", photons)])
        };
        assert!(notes(0.0, 0.0).is_empty() && notes(9.0, 1.0).is_empty() && photon_notes(&[]).is_empty());
        let missing = notes(9.0, 0.0);
        assert!(missing.len() == 1 && missing[0].ends_with("the image has no caustics"));
    }
}
