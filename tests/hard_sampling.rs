//! Hard cases of sampling: very large dimensions and sample numbers, random numbers at the ends of their range, and the
//! poles and seams of every parametrisation.

use crate::support::scenes;
use buffon::accel::AccelKind;
use buffon::emitter::EnvMap;
use buffon::image::TextureImage;
use buffon::math::{DAffine3, Ray, Vec2, Vec3};
use buffon::sampling::{Dimension, SampleKey, Sampler, SamplerKind, warp};
use buffon::scene::Description;
use buffon::shape::Shape;
use std::collections::HashSet;
use std::f32::consts::{PI, TAU};

/// The largest number that a sampler returns.
pub const LAST: f32 = 1.0 - f32::EPSILON / 2.0;
/// The ends of the range, and some values between them.
const ENDS: [f32; 7] = [0.0, f32::EPSILON / 2.0, 1e-4, 0.5, 0.75, 1.0 - 1e-4, LAST];

/// Returns all pairs of these numbers.
pub fn squares() -> impl Iterator<Item = Vec2> {
    ENDS.into_iter().flat_map(|x| ENDS.into_iter().map(move |y| Vec2::new(x, y)))
}

/// Returns the deviation of the chi² statistic of equally likely cells in standard deviations.
fn chi2_excess(cells: usize, indices: impl Iterator<Item = usize>) -> f64 {
    let mut counts = vec![0u32; cells];
    indices.for_each(|i| counts[i] += 1);
    let expected = f64::from(counts.iter().sum::<u32>()) / cells as f64;
    let chi2: f64 = counts.iter().map(|&c| (f64::from(c) - expected).powi(2) / expected).sum();
    let freedom = cells as f64 - 1.0;
    (chi2 - freedom) / (2.0 * freedom).sqrt()
}

fn pairs(sampler: Sampler, dimension: Dimension, keys: &[SampleKey]) -> Vec<[f32; 2]> {
    let (mut x, mut y) = (vec![0.0; keys.len()], vec![0.0; keys.len()]);
    sampler.fill_2d(dimension, keys, &mut x, &mut y);
    x.into_iter().zip(y).map(|(x, y)| [x, y]).collect()
}

fn numbers(sampler: Sampler, dimension: Dimension, keys: &[SampleKey]) -> Vec<f32> {
    let mut out = vec![0.0; keys.len()];
    sampler.fill_1d(dimension, keys, &mut out);
    out
}

/// First samples: 0, and past 2^16, 2^31, 2^32 and 2^33, where 32-bit indices of one or both halves end.
const STARTS: [u64; 6] = [0, 1 << 17, 1 << 31, 1 << 32, 1 << 33, 1 << 50];
/// Number of samples in a window: 6^5 in each half, which are whole blocks of strata in bases 2 and 3.
const WINDOW: u64 = 2 * 7776;
/// Maximum deviation in standard deviations of a chi² with 255 degrees of freedom. A correct sampler exceeds it with a
/// probability of 10^−5.
const SIGMAS: f64 = 5.0;

/// In every window of samples and in every dimension, up to the thousandth and beyond, numbers are in [0, 1), at most
/// as uneven as random ones, and not repeated.
#[test]
fn samples_far_out_are_uniform_and_do_not_repeat() {
    let dimensions = [
        Dimension::emitter_point(0),
        Dimension(1000),
        Dimension::bsdf_direction(1000),
        Dimension::bsdf_direction(u32::MAX),
        Dimension::emitter_point(3).repeat((1 << 28) - 1),
    ];
    for kind in SamplerKind::ALL {
        for spp in [Some(64), None] {
            let sampler = Sampler::new(kind, spp);
            for dimension in dimensions {
                let mut seen: HashSet<[u32; 2]> = HashSet::new();
                for (window, start) in STARTS.into_iter().enumerate() {
                    let keys: Vec<_> = (start..start + WINDOW).map(|i| sampler.key(9, 5, 7, i)).collect();
                    let points = pairs(sampler, dimension, &keys);
                    let singles = numbers(sampler, dimension, &keys);
                    let what = format!("{kind} {spp:?}, {dimension}, from sample {start}");
                    let inside = |u: &f32| (0.0..1.0).contains(u);
                    assert!(points.iter().flatten().chain(&singles).all(inside), "{what}");
                    let cell = |u: f32, n: usize| (u * n as f32) as usize;
                    let excess =
                        chi2_excess(256, points.iter().map(|[x, y]| cell(*y, 16) * 16 + cell(*x, 16)));
                    assert!(excess < SIGMAS, "{what}: pairs are off by {excess} sigmas");
                    let excess = chi2_excess(256, singles.iter().map(|u| cell(*u, 256)));
                    assert!(excess < SIGMAS, "{what}: numbers are off by {excess} sigmas");
                    seen.extend(points.iter().map(|p| p.map(f32::to_bits)));
                    let repeated = (window + 1) * WINDOW as usize - seen.len();
                    // About 10^-5 of these pairs of 24 bits are expected to be equal by chance.
                    assert!(repeated <= 1, "{what}: {repeated} pairs have been there before");
                }
            }
        }
    }
}

/// Checks a direction and its density, the results of `square_to_x` and `square_to_x_pdf`.
fn check_direction(what: &str, u: Vec2, w: Vec3, pdf: f32) {
    assert!(w.is_finite() && (w.length() - 1.0).abs() < 1e-6, "{what} at {u}: {w}");
    assert!(pdf > 0.0 && pdf.is_finite(), "{what} at {u}: density {pdf}");
}

#[test]
fn every_warp_is_finite_and_inside_at_the_ends_of_its_square() {
    for u in squares() {
        let back = |what: &str, v: Vec2, tolerance: f32| {
            let off = (v - u).abs();
            // At a singularity of the map the azimuth is arbitrary.
            let off = Vec2::new(off.x.min(1.0 - off.x), off.y);
            assert!(v.is_finite() && off.max_element() < tolerance, "{what} at {u}: back at {v}");
        };
        let disk = warp::square_to_disk(u);
        assert!(disk.length() <= 1.0 + 3e-7, "disk at {u}: {disk}");
        assert!(warp::square_to_disk_pdf(disk * (1.0 - 1e-6)) > 0.0, "disk at {u}");
        back("disk", warp::disk_to_square(disk), 1e-5);
        let w = warp::square_to_cosine_hemisphere(u);
        check_direction("cosine", u, w, warp::square_to_cosine_hemisphere_pdf(w));
        assert!(w.z > 0.0, "cosine at {u}: {w}");
        let w = warp::square_to_sphere(u);
        check_direction("sphere", u, w, warp::SQUARE_TO_SPHERE_PDF);
        if (1e-5..1.0 - 1e-5).contains(&u.y) {
            back("sphere", warp::sphere_to_square(w), 1e-4);
        }
        for cap in [1e-20f32, 1e-12, 1e-6, 0.3, 1.0, 1.999] {
            let w = warp::square_to_cone(u, cap);
            check_direction(&format!("cone of {cap:e}"), u, w, warp::square_to_cone_pdf(cap));
            assert!(1.0 - w.z <= cap + 2e-7, "cone of {cap:e} at {u}: {w}");
        }
        let b = warp::square_to_triangle(u);
        assert!(b.cmpge(Vec2::ZERO).all() && b.x + b.y <= 1.0, "triangle at {u}: {b}");
        assert_eq!(warp::square_to_triangle_pdf(b), 2.0);
        back("triangle", warp::triangle_to_square(b), 1e-6);
        let x = warp::interval_to_tent(u.x);
        assert!(x.abs() <= 1.0 && (warp::tent_to_interval(x) - u.x).abs() < 1e-6, "tent at {}: {x}", u.x);
        // The density is zero only at the very end.
        assert!(warp::interval_to_tent_pdf(x) > 0.0 || u.x == 0.0, "tent at {}: {x}", u.x);
    }
}

/// Rays hit a surface exactly at its poles and seams and within rounding of them. Texture coordinates are in the unit
/// square, frames have unit vectors, and both sides of a seam have coordinates at opposite ends.
#[test]
fn poles_and_seams_of_every_shape_have_coordinates() {
    let tube = Shape::Cylinder { p0: -Vec3::Z, p1: Vec3::Z, radius: 1.0 };
    let nudges = [0.0, f32::MIN_POSITIVE, 1e-30, 1e-10, 1e-7, 1e-3];
    let signed = || nudges.into_iter().flat_map(|n| [n, -n]);
    for &accel in AccelKind::ALL {
        for (name, shape) in
            [("sphere", scenes::sphere(1.0)), ("cylinder", tube.clone()), ("disk", Shape::Disk)]
        {
            let mut d = Description::default();
            scenes::add(&mut d, shape, DAffine3::IDENTITY, scenes::diffuse(0.5));
            let scene = scenes::compiled(d, accel);
            let mut hits = 0;
            for (x, y) in signed().flat_map(|x| signed().map(move |y| (x, y))) {
                let rays = [
                    // The poles and the centre of the disk, from both sides.
                    Ray::new(Vec3::new(x, y, 3.0), -Vec3::Z),
                    Ray::new(Vec3::new(x, y, -3.0), Vec3::Z),
                    // The seam, at which y changes its sign, and the opposite side.
                    Ray::new(Vec3::new(3.0, y, x), -Vec3::X),
                    Ray::new(Vec3::new(-3.0, y, x), Vec3::X),
                    // The ends of a cylinder.
                    Ray::new(Vec3::new(3.0, y, 1.0 - x.abs()), -Vec3::X),
                    Ray::new(Vec3::new(3.0, y, -1.0 + x.abs()), -Vec3::X),
                    // The edge and the seam of a disk.
                    Ray::new(Vec3::new(1.0 - x.abs(), y, 3.0), -Vec3::Z),
                    Ray::new(Vec3::new(0.5 + x, y, 3.0), -Vec3::Z),
                ];
                for ray in rays {
                    let Some(hit) = scene.accel.intersect(&ray) else { continue };
                    hits += 1;
                    let at = scene.interaction(&ray, &hit);
                    let uv = scene.uv(&at);
                    let what = format!("{accel}, {name} at {}: {uv}", at.p);
                    assert!(uv.cmpge(Vec2::ZERO).all() && uv.cmple(Vec2::splat(1.0 + 1e-6)).all(), "{what}");
                    assert!(at.p.is_finite() && (at.ng.length() - 1.0).abs() < 1e-5, "{what}");
                    for axis in [at.frame.s, at.frame.t, at.frame.n] {
                        assert!((axis.length() - 1.0).abs() < 1e-5, "{what}: {:?}", at.frame);
                    }
                    let world = &scene.shapes[0].world;
                    assert!(world.partials(&hit, at.p).iter().all(|d| d.is_finite()), "{what}");
                    // The azimuth in the texture coordinates is that of the point.
                    let turn = if name == "disk" { uv.y } else { uv.x };
                    let exact = f64::from(at.p.y).atan2(f64::from(at.p.x)).rem_euclid(std::f64::consts::TAU)
                        / std::f64::consts::TAU;
                    let off = (f64::from(turn) - exact).abs();
                    let radius = at.p.truncate().length();
                    assert!(radius < 1e-5 || off.min(1.0 - off) < 1e-5, "{what}: {exact}");
                }
            }
            println!("{accel}, {name}: {hits} hits");
            assert!(hits > 400, "{accel}, {name}: {hits}");
        }
    }
}

/// At the poles and the seam of an environment map, values are finite and continuous, and samples and directions have
/// the same density.
#[test]
fn poles_and_seam_of_an_environment_map_have_radiance() {
    let values: Vec<f32> = (0..3 * 8 * 5).map(|i| ((i * 37) % 23) as f32 / 16.0).collect();
    let image = TextureImage::from_floats(8, 5, 3, values).expect("a picture");
    let map = EnvMap::new(image, 1.0, &DAffine3::IDENTITY).expect("a map");
    for nudge in [0.0, f32::MIN_POSITIVE, 1e-20, 1e-10, 1e-7] {
        for (x, z) in [(nudge, nudge), (-nudge, nudge), (nudge, -nudge), (-nudge, -nudge)] {
            for y in [1.0, -1.0] {
                let w = Vec3::new(x, y, z);
                let (radiance, pdf) = (map.eval(w), map.pdf(w));
                assert!(radiance.is_valid() && pdf > 0.0 && pdf.is_finite(), "{w}: {radiance:?} {pdf}");
            }
            // The seam is half a column from −z.
            let seam = TAU * 0.5 / 8.0;
            let d = |turn: f32| Vec3::new((seam + turn).sin(), 0.0, -(seam + turn).cos());
            let (left, right) = (map.eval(d(-nudge)), map.eval(d(nudge)));
            assert!((left - right).map(f32::abs).max_component() < 1e-5, "{left:?} {right:?}");
            assert!((map.pdf(d(-nudge)) / map.pdf(d(nudge)) - 1.0).abs() < 1e-5);
        }
    }
    for u in squares() {
        let s = map.sample(u).expect("it shines everywhere");
        let (pdf, off) = (map.pdf(s.wi), (map.eval(s.wi) - s.radiance).map(f32::abs).max_component());
        assert!((s.wi.length() - 1.0).abs() < 1e-6 && s.radiance.is_valid(), "{u}: {s:?}");
        // At a pole the longitude is lost.
        let close = (pdf / s.pdf - 1.0).abs() < 1e-3 && off < 1e-3;
        assert!(close || s.wi.x.hypot(s.wi.z) < 1e-6, "{u}: {s:?}, {pdf}, {off}");
    }
    assert!((map.pdf(Vec3::Y) * 4.0 * PI).is_finite());
}
