//! Radiance and sampling of environment maps.

use crate::support::chi2::{check_directions, check_square};
use buffon::color::Rgb;
use buffon::emitter::EnvMap;
use buffon::image::TextureImage;
use buffon::math::{DAffine3, DVec3, Vec2, Vec3};
use glam::DQuat;
use std::f64::consts::{PI, TAU};

/// The number of comparisons by which the significance is divided.
const TESTS: usize = 14;

/// Returns a map of `values` of red, green and blue.
fn map(width: usize, height: usize, values: Vec<f32>) -> EnvMap {
    let image = TextureImage::from_floats(width, height, 3, values).unwrap();
    EnvMap::new(image, 1.0, &DAffine3::IDENTITY).unwrap()
}

/// Returns a black map with one texel of 100.
fn sun(width: usize, height: usize, x: usize, y: usize) -> EnvMap {
    let mut values = vec![0.0; 3 * width * height];
    values[3 * (y * width + x)..][..3].fill(100.0);
    map(width, height, values)
}

/// Returns values without any symmetry.
fn uneven(width: usize, height: usize) -> Vec<f32> {
    (0..3 * width * height).map(|i| ((i * 37) % 23) as f32 / 16.0).collect()
}

fn turned() -> DAffine3 {
    DAffine3::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 40f64.to_radians())
}

/// Returns the direction for a longitude in turns and an angle from +y.
fn direction(turns: f64, theta: f64) -> DVec3 {
    let (sin_phi, cos_phi) = (TAU * turns).sin_cos();
    let (sin, cos) = theta.sin_cos();
    DVec3::new(sin_phi * sin, cos, -cos_phi * sin)
}

/// The radiance is that of Mitsuba 3.9.1 for the same image: across the seam, near the poles, rotated and mirrored.
#[test]
fn radiance_agrees_with_the_scene_languages_map() {
    let directions = [
        [0.0, 0.0, -1.0],
        [1.0, 0.0, 0.0],
        [0.303046, 0.505076, -0.808122],
        [-0.001085, 0.21693, 0.976186],
        [0.001085, 0.21693, 0.976186],
        [0.001, 0.999998, 0.002],
        [0.001, -0.999998, 0.002],
        [-0.742781, 0.557086, -0.371391],
    ];
    let plain = [
        [0.75, 0.98438, 1.21875],
        [0.94922, 1.45312, 0.60938],
        [0.42044, 1.27302, 0.88919],
        [1.76906, 0.92531, 0.08347],
        [1.76917, 0.92598, 0.08223],
        [1.54521, 0.70146, 1.21549],
        [0.23442, 1.54401, 0.70026],
        [1.06232, 0.30431, 1.53107],
    ];
    let rotated = [
        [0.66217, 1.42828, 1.13092],
        [0.43472, 1.44911, 0.60536],
        [0.55247, 1.65288, 0.80913],
        [1.64727, 0.80352, 0.28442],
        [1.64819, 0.80444, 0.28184],
        [1.31544, 1.22621, 0.38246],
        [1.66358, 0.81983, 1.32018],
        [0.66062, 0.8801, 1.12937],
    ];
    let mirrored = [
        [0.75, 0.98438, 1.21875],
        [1.35938, 0.51562, 1.82812],
        [0.79516, 0.42342, 1.26391],
        [1.76917, 0.92598, 0.08223],
        [1.76906, 0.92531, 0.08347],
        [1.2685, 0.42475, 1.73431],
        [0.75329, 1.26728, 0.42525],
        [0.94191, 1.43279, 0.58904],
    ];
    let mirror = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    let cases = [(DAffine3::IDENTITY, plain), (turned(), rotated), (mirror, mirrored)];
    for (to_world, expected) in cases {
        let image = TextureImage::from_floats(5, 4, 3, uneven(5, 4)).unwrap();
        let map = EnvMap::new(image, 1.5, &to_world).unwrap();
        for (d, expected) in directions.into_iter().zip(expected) {
            let found = map.eval(Vec3::from(d).normalize()).to_array();
            let off = found.iter().zip(expected).map(|(a, b): (&f32, f32)| (a - b).abs()).fold(0.0, f32::max);
            assert!(off < 3e-4, "{d:?}: {found:?}, expected {expected:?}");
        }
    }
}

#[test]
fn samples_follow_their_density() {
    let image = TextureImage::from_floats(9, 6, 3, uneven(9, 6)).unwrap();
    let rotated = EnvMap::new(image, 1.5, &turned()).unwrap();
    for (name, map) in [
        ("uneven map", map(9, 6, uneven(9, 6))),
        ("rotated map", rotated),
        ("map of one texel", map(1, 1, vec![1.0, 2.0, 3.0])),
        ("map of one row", map(2, 1, vec![1.0, 1.0, 1.0, 4.0, 2.0, 9.0])),
        ("map of one column", map(1, 2, vec![1.0, 1.0, 1.0, 4.0, 2.0, 9.0])),
        ("map of four texels", map(2, 2, uneven(2, 2))),
        ("half a sphere", map(1, 3, vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])),
    ] {
        for compensated in [false, true] {
            let (mean, excess) = (map.mean_radiance().luminance(), map.mean_excess());
            assert!((0.0..=mean).contains(&excess), "{name}: {excess} of {mean}");
            if compensated && excess == 0.0 {
                continue;
            }
            let density = |d: Vec3| if compensated { map.pdf_compensated(d) } else { map.pdf(d) };
            let total = check_directions(
                name,
                2 * TESTS,
                |_, u| {
                    let s = if compensated { map.sample_compensated(u)? } else { map.sample(u)? };
                    let (pdf, radiance) = (density(s.wi), map.eval(s.wi));
                    assert!(
                        (pdf / s.pdf - 1.0).abs() < 1e-3,
                        "{name}: densities {} and {pdf} at {}",
                        s.pdf,
                        s.wi
                    );
                    let off = (radiance - s.radiance).map(f32::abs).max_component();
                    assert!(off < 1e-3, "{name}: {radiance:?} {:?} at {}", s.radiance, s.wi);
                    Some(s.wi)
                },
                density,
            );
            assert!((total - 1.0).abs() < 2e-3, "{name}: the density integrates to {total}");
        }
    }
}

/// A sun of one texel, at the poles and across the seam, in a chart of the columns and rows of its footprint.
#[test]
fn a_sun_of_one_texel_is_sampled() {
    let (width, height) = (64, 33);
    for (name, x, y) in [
        ("sun", 20, 10),
        ("sun on the seam", 63, 12),
        ("sun at the upper pole", 5, 0),
        ("sun by the upper pole", 40, 1),
        ("sun by the lower pole", 0, 31),
        ("sun at the lower pole", 30, 32),
    ] {
        let map = sun(width, height, x, y);
        let centre = (x as f64 + 0.5) / width as f64;
        let step = PI / (height - 1) as f64;
        let (low, high) = ((y as f64 - 1.0).max(0.0) * step, ((y + 1).min(height - 1)) as f64 * step);
        let total = check_square(
            name,
            TESTS,
            |_, u| {
                let s = map.sample(u)?;
                assert!(s.radiance.g > 0.0 || s.pdf < 1e-3, "{name}: black at {}", s.wi);
                let d = s.wi.as_dvec3();
                let turns = d.x.atan2(-d.z) / TAU - centre;
                let theta = d.x.hypot(d.z).atan2(d.y);
                Some([0.5 * ((turns - turns.round()) * width as f64 + 1.0), (theta - low) / (high - low)])
            },
            |[s, t]| {
                let theta = low + t * (high - low);
                let d = direction(centre + (2.0 * s - 1.0) / width as f64, theta);
                let area = 2.0 * TAU / width as f64 * (high - low) * theta.sin();
                f64::from(map.pdf(d.as_vec3())) * area
            },
        );
        assert!((total - 1.0).abs() < 5e-3, "{name}: the density integrates to {total}");
        assert_eq!(map.pdf(direction(centre + 0.5, 0.5 * PI).as_vec3()), 0.0);
    }
}

/// At the poles the density is finite and continuous.
#[test]
fn the_density_is_continuous_at_the_poles() {
    let map = map(8, 9, uneven(8, 9));
    for pole in [0.0, PI] {
        for turns in [0.1, 0.6, 0.85] {
            let near = map.pdf(direction(turns, (pole - 1e-5f64).abs()).as_vec3());
            let nearer = map.pdf(direction(turns, (pole - 1e-7f64).abs()).as_vec3());
            assert!(near > 0.0 && (near / nearer - 1.0).abs() < 1e-3, "{near} {nearer}");
        }
        let at = map.pdf(Vec3::new(0.0, pole.cos() as f32, 0.0));
        assert!(at.is_finite() && at > 0.0);
    }
}

/// The mean radiance is the same by the formula, by quadrature and by sampling.
#[test]
fn energies_agree() {
    let image = TextureImage::from_floats(7, 5, 3, uneven(7, 5)).unwrap();
    let uneven = EnvMap::new(image, 2.5, &turned()).unwrap();
    let row = map(2, 1, vec![1.0, 1.0, 1.0, 4.0, 2.0, 9.0]);
    for map in [uneven, sun(16, 9, 3, 0), sun(16, 9, 3, 7), row] {
        let (mut quadrature, mut samples, n) = ([0.0f64; 3], [0.0f64; 3], 500);
        let (mut squares, mut finite) = (0.0f64, true);
        for i in 0..n {
            for j in 0..n {
                let u = [i, j].map(|k| (f64::from(k) + 0.5) / f64::from(n));
                let w = direction(u[0], (1.0 - 2.0 * u[1]).acos()).as_vec3();
                let Some(s) = map.sample(Vec2::new(u[0] as f32, u[1] as f32)) else { continue };
                let estimate = s.radiance / (s.pdf * 4.0 * std::f32::consts::PI);
                finite &= estimate.is_valid();
                for (c, value) in map.eval(w).to_array().into_iter().enumerate() {
                    quadrature[c] += f64::from(value);
                    samples[c] += f64::from(estimate[c]);
                }
                squares += f64::from(estimate.luminance()).powi(2);
            }
        }
        assert!(finite);
        let points = f64::from(n * n);
        for (c, mean) in map.mean_radiance().to_array().map(f64::from).into_iter().enumerate() {
            assert!(
                (quadrature[c] / points / mean - 1.0).abs() < 5e-3,
                "{c}: {} {mean}",
                quadrature[c] / points
            );
            assert!((samples[c] / points / mean - 1.0).abs() < 2e-3, "{c}: {} {mean}", samples[c] / points);
        }
        // The density of samples is almost proportional to the luminance.
        let mean = f64::from(map.mean_radiance().luminance());
        let relative_variance = squares / points / (mean * mean) - 1.0;
        assert!(relative_variance < 0.03, "{relative_variance}");
    }
}

#[test]
fn a_map_of_one_colour_is_the_constant_environment() {
    let map = map(3, 4, vec![2.0; 36]);
    assert!((map.mean_radiance().r - 2.0).abs() < 1e-6);
    let expected = 2.0 * 4.0 * std::f32::consts::PI.powi(2) * 9.0;
    assert!((map.power(3.0).g / expected - 1.0).abs() < 1e-6);
    for u in [Vec2::ZERO, Vec2::splat(0.3), Vec2::splat(1f32.next_down())] {
        let s = map.sample(u).unwrap();
        assert!((s.pdf * 4.0 * std::f32::consts::PI - 1.0).abs() < 1e-6);
        assert_eq!(s.radiance, Rgb::splat(2.0));
    }
}

#[test]
fn a_black_map_is_not_sampled() {
    let dark =
        EnvMap::new(TextureImage::from_floats(2, 2, 3, uneven(2, 2)).unwrap(), 0.0, &turned()).unwrap();
    for map in [map(4, 3, vec![0.0; 36]), dark] {
        assert!(map.sample(Vec2::splat(0.5)).is_none());
        assert_eq!(map.pdf(Vec3::X), 0.0);
        assert_eq!((map.eval(Vec3::Y), map.mean_radiance()), (Rgb::BLACK, Rgb::BLACK));
    }
}

#[test]
fn what_is_no_map_is_refused() {
    let image = || TextureImage::from_floats(2, 2, 1, vec![1.0, f32::INFINITY, 1.0, 1.0]).unwrap();
    let error = EnvMap::new(image(), 1.0, &DAffine3::IDENTITY).unwrap_err();
    assert_eq!(error.to_string(), "expected finite radiance, found inf inf inf in column 1 of row 0");
    let error = EnvMap::new(image(), -1.0, &DAffine3::IDENTITY).unwrap_err();
    assert_eq!(error.to_string(), "expected a finite scale of at least 0, found -1");
    let scaled = DAffine3::from_scale(DVec3::new(1.0, 2.0, 1.0));
    let error = EnvMap::new(image(), 1.0, &scaled).unwrap_err();
    assert_eq!(error.to_string(), "expected a to_world transform that rotates, mirrors or scales evenly");
    // Uniform scale and translation have no effect.
    let image = || TextureImage::from_floats(3, 3, 3, uneven(3, 3)).unwrap();
    let rotation = DQuat::from_rotation_x(0.7);
    let plain = EnvMap::new(image(), 1.0, &DAffine3::from_quat(rotation)).unwrap();
    let moved = DAffine3::from_scale_rotation_translation(DVec3::splat(5.0), rotation, DVec3::ONE);
    let moved = EnvMap::new(image(), 1.0, &moved).unwrap();
    let w = Vec3::new(0.36, 0.48, -0.8);
    assert!((plain.eval(w) - moved.eval(w)).map(f32::abs).max_component() < 1e-5);
}
