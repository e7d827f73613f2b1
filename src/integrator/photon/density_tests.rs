use super::density::*;
use super::kdtree::NeighbourBuffer;
use super::{IrradianceMap, Kernel, Photon, PhotonMap};
use crate::color::Rgb;
use crate::math::Vec3;
use crate::sampling::hash::{combine, to_unit};
use std::f32::consts::{FRAC_1_PI, TAU};

/// Random numbers in [0, 1).
struct Random(u32);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(1);
        to_unit(combine(0x5eed, self.0))
    }
}

/// Returns `n` photons at random points `p(u, v)` with the normal `n` and the total power `power` for one light path.
fn patch(
    random: &mut Random,
    n: usize,
    power: f32,
    normal: Vec3,
    p: impl Fn(f32, f32) -> Vec3,
) -> Vec<Photon> {
    (0..n)
        .map(|_| {
            let power = Rgb::new(1.0, 0.5, 0.25) * (power / n as f32);
            Photon::new(p(random.next(), random.next()), power, normal, normal).unwrap()
        })
        .collect()
}

fn floor(u: f32, v: f32) -> Vec3 {
    Vec3::new(u, v, 0.0)
}

fn estimator(kernel: Kernel, lookup_size: usize, lookup_radius: f32) -> DensityEstimator {
    DensityEstimator { kernel, lookup_size, lookup_radius }
}

fn red(estimator: &DensityEstimator, map: &PhotonMap, at: LookupPoint) -> f64 {
    f64::from(estimator.irradiance(map, at, &mut NeighbourBuffer::default()).value.r)
}

/// Returns the mean and standard error of independent values.
fn mean(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0);
    (mean, (variance / n).sqrt())
}

/// The tolerance of four standard errors has a probability of 6·10⁻⁵ in each of the twelve cases.
#[test]
fn a_uniform_plane_has_its_irradiance_under_every_kernel() {
    let mut random = Random(1);
    for kernel in Kernel::ALL {
        // The disc is limited by the number of photons, by the radius, by either, and by two photons.
        for (size, radius) in [(50, f32::INFINITY), (1000, 0.06), (40, 0.05), (2, 0.2)] {
            let estimator = estimator(kernel, size, radius);
            let maps: Vec<f64> = (0..60)
                .map(|_| {
                    // Photons extend beyond the unit square, because this test is not about borders.
                    let photons =
                        patch(&mut random, 8000, 2.0 * 3.0, Vec3::Z, |u, v| Vec3::new(2.0 * u - 0.5, v, 0.0));
                    let map = PhotonMap::new(photons, 1);
                    let places = (0..30)
                        .map(|i| Vec3::new(0.25 + 0.1 * (i % 6) as f32, 0.3 + 0.1 * (i / 6) as f32, 0.0));
                    places.map(|p| red(&estimator, &map, LookupPoint { p, n: Vec3::Z })).sum::<f64>() / 30.0
                })
                .collect();
            let (mean, error) = mean(&maps);
            println!("{kernel}, {size}, {radius}: {mean} ± {error}");
            assert!((mean - 3.0).abs() < 4.0 * error, "{kernel}, {size}, {radius}: {mean} ± {error}");
            assert!(error < if size == 2 { 0.2 } else { 0.02 }, "{error}");
        }
    }
}

#[test]
fn powers_are_divided_by_the_light_paths_and_channels_stay_apart() {
    let photons = patch(&mut Random(2), 5000, 8.0, Vec3::Z, floor);
    let at = LookupPoint { p: Vec3::new(0.5, 0.5, 0.0), n: Vec3::Z };
    let value = |paths: u64| {
        let map = PhotonMap::new(photons.clone(), paths);
        assert!((map.power().r * paths as f32 - 8.0).abs() < 1e-3);
        estimator(Kernel::Cone, 100, 1.0).irradiance(&map, at, &mut NeighbourBuffer::default())
    };
    let (one, four) = (value(1), value(4));
    assert!((one.value.r / four.value.r - 4.0).abs() < 1e-5);
    assert!((one.value.r / one.value.g - 2.0).abs() < 1e-4 && (one.value.r / one.value.b - 4.0).abs() < 1e-4);
    assert_eq!(one.photons, 99);
}

#[test]
fn light_stays_on_its_surface() {
    let mut random = Random(3);
    let dark = 1.0;
    let mut photons = patch(&mut random, 4000, dark, Vec3::Z, floor);
    // A wall at x = 0, a surface facing downwards directly below, and a shelf with the same normal above.
    photons.extend(patch(&mut random, 40_000, 1000.0, Vec3::X, |u, v| Vec3::new(0.0, u, v)));
    photons.extend(patch(&mut random, 40_000, 1000.0, Vec3::NEG_Z, |u, v| Vec3::new(u, v, -1e-6)));
    photons.extend(patch(&mut random, 40_000, 1000.0, Vec3::Z, |u, v| Vec3::new(u, v, 0.04)));
    let map = PhotonMap::new(photons, 1);
    for kernel in Kernel::ALL {
        let estimator = estimator(kernel, 400, 0.1);
        for (x, expected) in [(0.5, 1.0), (0.05, 1.0), (0.0, 0.5)] {
            let values: Vec<f64> = (0..8)
                .map(|i| Vec3::new(x, 0.2 + 0.08 * i as f32, 0.0))
                .map(|p| red(&estimator, &map, LookupPoint { p, n: Vec3::Z }))
                .collect();
            let (mean, error) = mean(&values);
            assert!((mean - expected).abs() < 5.0 * error.max(0.02), "{kernel} at {x}: {mean} ± {error}");
        }
    }
    let empty = estimator(Kernel::Constant, 50, 0.01);
    let elsewhere = LookupPoint { p: Vec3::new(0.5, 0.5, 5.0), n: Vec3::Z };
    assert_eq!(red(&empty, &map, elsewhere), 0.0);
    assert_eq!(red(&empty, &PhotonMap::new(Vec::new(), 0), elsewhere), 0.0);
}

/// Tests the bias on a sphere stated in the module documentation.
#[test]
fn a_sphere_is_too_dark_by_twice_the_squared_ratio_of_radii() {
    let mut random = Random(4);
    let photons: Vec<Photon> = (0..400_000)
        .map(|_| {
            let z = 2.0 * random.next() - 1.0;
            let (sin, cos) = (TAU * random.next()).sin_cos();
            let n = (Vec3::new(cos, sin, 0.0) * (1.0 - z * z).sqrt()).with_z(z).normalize();
            Photon::new(n, Rgb::splat(TAU * 2.0 / 400_000.0), n, n).unwrap()
        })
        .collect();
    let map = PhotonMap::new(photons.clone(), 1);
    let ratio = 0.2;
    let estimator = estimator(Kernel::Constant, 1_000_000, ratio);
    let values: Vec<f64> = photons[..400]
        .iter()
        .map(|photon| red(&estimator, &map, LookupPoint { p: photon.position(), n: photon.position() }))
        .collect();
    let (mean, error) = mean(&values);
    // The ellipsoid contains a cap of squared chords up to u, where u + 2u² is the squared radius.
    let squared = f64::from(ratio * ratio);
    let expected = ((1.0 + 8.0 * squared).sqrt() - 1.0) / (4.0 * squared);
    assert!((expected - (1.0 - 2.0 * squared)).abs() < 0.02);
    assert!((mean - expected).abs() < 4.0 * error && error < 0.002, "{mean} ± {error}, not {expected}");
}

#[test]
fn reflected_radiance_is_that_of_the_irradiance_for_a_diffuse_surface() {
    let mut random = Random(5);
    let mut photons = patch(&mut random, 3000, 2.0, Vec3::Z, floor);
    photons.extend(patch(&mut random, 3000, 6.0, Vec3::NEG_Z, floor));
    let map = PhotonMap::new(photons, 1);
    let (at, mut buffer) =
        (LookupPoint { p: Vec3::new(0.5, 0.5, 0.0), n: Vec3::Z }, NeighbourBuffer::default());
    let estimator = estimator(Kernel::Epanechnikov, 200, 0.2);
    let irradiance = estimator.irradiance(&map, at, &mut buffer).value;
    let f = |wi: Vec3| if wi.z > 0.0 { Rgb::splat(0.5 * FRAC_1_PI) } else { Rgb::BLACK };
    let front = estimator.reflected(&map, at, Sides::Front, &mut buffer, f);
    for c in 0..3 {
        assert!((front[c] / (irradiance[c] * 0.5 * FRAC_1_PI) - 1.0).abs() < 1e-4);
    }
    // Both sides use the same search and therefore the same disc.
    let both = estimator.reflected(&map, at, Sides::Both, &mut buffer, |_| Rgb::splat(FRAC_1_PI));
    assert!((both.r - 8.0 * FRAC_1_PI).abs() < 1.0, "{both:?}");
}

#[test]
fn photons_at_one_point_have_no_density() {
    let photon = Photon::new(Vec3::ONE, Rgb::WHITE, Vec3::Z, Vec3::Z).unwrap();
    let map = PhotonMap::new(vec![photon; 60], 1);
    let at = LookupPoint { p: Vec3::ONE, n: Vec3::Z };
    assert_eq!(red(&estimator(Kernel::Constant, 50, 1.0), &map, at), 0.0);
    let more = red(&estimator(Kernel::Constant, 100, 1.0), &map, at);
    assert!((more - 60.0 * f64::from(FRAC_1_PI)).abs() < 1e-4);
}

#[test]
fn irradiance_from_beforehand_is_that_of_a_photon_nearby() {
    let mut random = Random(6);
    let mut photons = patch(&mut random, 20_000, 2.0, Vec3::Z, floor);
    photons.extend(patch(&mut random, 20_000, 6.0, Vec3::NEG_Z, floor));
    photons.extend(patch(&mut random, 20_000, 600.0, Vec3::X, |u, v| Vec3::new(0.0, u, v)));
    let map = PhotonMap::new(photons, 1);
    let estimator = estimator(Kernel::Epanechnikov, 200, 0.2);
    let irradiances = IrradianceMap::new(&map, &map, &estimator, 4, None);
    assert_eq!(irradiances.len(), 15_000);
    assert!((irradiances.memory_bytes() as f64) < 24.6 * 15_000.0);
    let (mut front, mut back) = (Vec::new(), Vec::new());
    for i in 0..200 {
        let p = Vec3::new(0.15 + 0.7 * random.next(), 0.15 + 0.7 * random.next(), 0.0);
        let value = |n: Vec3| f64::from(irradiances.nearest(LookupPoint { p, n }).unwrap().value.r);
        front.push(value(Vec3::Z));
        back.push(value(Vec3::NEG_Z));
        let nowhere = LookupPoint { p: p + Vec3::Z * (1.0 + i as f32), n: Vec3::Z };
        assert_eq!(irradiances.nearest(nowhere), None);
        assert_eq!(irradiances.nearest(LookupPoint { p, n: Vec3::NEG_X }), None);
    }
    let ((front, e), (back, f)) = (mean(&front), mean(&back));
    assert!((front - 2.0).abs() < 0.05 && (back - 6.0).abs() < 0.15, "{front} ± {e}, {back} ± {f}");
}
