//! Hard cases of emitters, as numbers: tiny, huge, edge-on and touching emitters against quadrature in `f64`; emitters
//! without area or power; many emitters of very different power; and the sky beside a small sun.

use crate::support::quadrature::over_square;
use crate::support::scenes;
use buffon::accel::AccelKind;
use buffon::color::Rgb;
use buffon::emitter::{AreaEmitter, Emission, Emitter, EmitterHit, EnvMap, Light, lanes::LightLanes};
use buffon::ids::EmitterId;
use buffon::image::TextureImage;
use buffon::math::{DAffine3, DQuat, DVec3, LANES, Ray, Vec2, Vec3, Vec3x16, f32x16};
use buffon::scene::{CompileOptions, Description, Scene, compile};
use buffon::shape::{Mesh, Shape, WorldShape};
use std::f64::consts::{PI, TAU};

/// Number of random numbers along each side of the square.
const SIDE: usize = 512;

/// Returns a white emitter in world space.
fn lamp(shape: Shape, to_world: &DAffine3) -> (Light, WorldShape) {
    let world = WorldShape::new(shape, to_world, false).expect("a shape");
    let area = AreaEmitter::new(&world, Emission::Constant(Rgb::WHITE), None).expect("it has an area");
    (Light::Area(Box::new(area)), world)
}

/// Estimates from samples of an emitter: the irradiance of a receiver and the solid angle.
#[derive(Debug)]
struct Seen {
    irradiance: f64,
    solid_angle: f64,
}

/// Returns means over a regular grid of random numbers. As in the integrators, sixteen are sampled at a time.
fn seen_by_samples(light: &Light, from: Vec3, n: Vec3) -> Seen {
    let lights = std::slice::from_ref(light);
    let lanes = LightLanes::new(lights);
    let mut seen = Seen { irradiance: 0.0, solid_angle: 0.0 };
    let u = |i: usize| (i as f32 + 0.5) / SIDE as f32;
    for first in (0..SIDE * SIDE).step_by(LANES) {
        let pair: [[f32; LANES]; 2] =
            [std::array::from_fn(|k| u((first + k) % SIDE)), std::array::from_fn(|k| u((first + k) / SIDE))];
        let all = lanes.sample(
            &[0; LANES],
            false,
            Vec3x16::splat(from),
            pair.map(f32x16::new),
            u32::from(u16::MAX),
            |_, u| lights[0].sample(from, u, 0.0),
        );
        let (valid, pdf) = (all.valid.to_bitmask(), all.pdf.to_array());
        for k in (0..LANES).filter(|k| valid >> k & 1 == 1) {
            let (wi, pdf) = (all.wi.lane(k), f64::from(pdf[k]));
            assert!((wi.length() - 1.0).abs() < 1e-5 && pdf > 0.0, "{from}: {wi} {pdf}");
            seen.solid_angle += 1.0 / pdf;
            seen.irradiance += f64::from(wi.dot(n).max(0.0)) / pdf;
        }
    }
    let samples = (SIDE * SIDE) as f64;
    Seen { irradiance: seen.irradiance / samples, solid_angle: seen.solid_angle / samples }
}

/// Returns the same by quadrature over the unit square, which `point` maps to the surface. The second result of `point`
/// is the vector area per unit of the square.
fn seen_exactly(point: impl Fn([f64; 2]) -> (DVec3, DVec3), from: Vec3, n: Vec3) -> Seen {
    let (from, n) = (from.as_dvec3(), n.as_dvec3());
    let integral = |cosine: bool| {
        over_square(|square| {
            let (p, area) = point(square);
            let to = p - from;
            let solid_angle = -area.dot(to) / to.length().powi(3);
            solid_angle.max(0.0) * if cosine { (n.dot(to) / to.length()).max(0.0) } else { 1.0 }
        })
    };
    Seen { irradiance: integral(true), solid_angle: integral(false) }
}

/// Returns the map of the rectangle with its corners as rounded to `f32`.
fn rectangle(world: &WorldShape) -> impl Fn([f64; 2]) -> (DVec3, DVec3) {
    let WorldShape::Rectangle { corner, edge_x, edge_y, normal, .. } = world else { panic!("a rectangle") };
    let (corner, x, y) = (corner.as_dvec3(), edge_x.as_dvec3(), edge_y.as_dvec3());
    let area = x.cross(y);
    let area = if area.dot(normal.as_dvec3()) < 0.0 { -area } else { area };
    move |[s, t]| (corner + x * s + y * t, area)
}

fn check(name: &str, light: &Light, from: Vec3, n: Vec3, exact: &Seen, tolerance: f64) {
    let found = seen_by_samples(light, from, n);
    let off = |found: f64, exact: f64| if exact == 0.0 { found.abs() } else { (found / exact - 1.0).abs() };
    let (e, w) = (off(found.irradiance, exact.irradiance), off(found.solid_angle, exact.solid_angle));
    println!(
        "{name}: irradiance {:.6e}, off by {e:.1e}; solid angle {:.6e}, off by {w:.1e}",
        exact.irradiance, exact.solid_angle
    );
    assert!(e < tolerance && w < tolerance, "{name}: {found:?} instead of {exact:?}");
}

/// Angular radii from a millionth of a radian to almost π/2.
#[test]
fn spheres_of_every_angular_radius_have_their_light() {
    for distance in [1e6f32, 1e3, 2.0, 1.01, 1.000_1, 1.000_01, 1.000_001] {
        for turn in [DQuat::IDENTITY, DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 2.0)] {
            let axis = (turn * DVec3::Z).as_vec3();
            let (light, world) =
                lamp(scenes::sphere(1.0), &DAffine3::from_translation((axis * distance).as_dvec3()));
            let WorldShape::Sphere { center, radius, .. } = world else { panic!("a sphere") };
            let sin2 = f64::from(radius).powi(2) / center.as_dvec3().length_squared();
            let exact = Seen {
                irradiance: PI * sin2 * axis.dot(center.normalize()) as f64,
                solid_angle: TAU * sin2 / (1.0 + (1.0 - sin2).sqrt()),
            };
            let degrees = sin2.sqrt().asin().to_degrees();
            check(&format!("sphere of {degrees:.5}°, at {distance}"), &light, Vec3::ZERO, axis, &exact, 1e-4);
        }
    }
}

#[test]
fn rectangles_edge_on_and_from_nearby_have_their_light() {
    let turned = DAffine3::from_axis_angle(DVec3::new(1.0, -2.0, 3.0).normalize(), 2.0);
    for (place, to_world) in [("", DAffine3::IDENTITY), (", askew", turned)] {
        let (light, world) = lamp(Shape::Rectangle, &to_world);
        let quadrature = rectangle(&world);
        let point = |p: [f64; 3]| to_world.transform_point3(DVec3::from(p)).as_vec3();
        let n = |n: [f64; 3]| to_world.transform_vector3(DVec3::from(n).normalize()).as_vec3();
        // For a rotated plane, the rounding of its points limits the precision of a small height.
        let coarse = if place.is_empty() { 1e-4 } else { 1e-3 };
        for (name, p, normal, tolerance) in [
            ("from above", [0.1, 0.2, 1.5], [0.0, 0.0, -1.0], 1e-4),
            ("from 1e-3 away", [0.3, -0.2, 1e-3], [0.0, 0.0, -1.0], 1e-4),
            ("from 1e-6 away", [0.3, -0.2, 1e-6], [0.0, 0.0, -1.0], 1e-4),
            ("from 1e-6 away, askew", [0.3, -0.2, 1e-6], [0.6, 0.0, -0.8], 1e-4),
            ("from 1e-3 away of a corner", [0.9995, 0.9995, 1e-3], [0.0, 0.0, -1.0], 1e-4),
            ("from 1e-2 above its plane", [2.0, 0.1, 1e-2], [-1.0, 0.0, 0.0], coarse),
            ("from 1e-3 above its plane", [2.0, 0.1, 1e-3], [-1.0, 0.0, 0.0], coarse),
            ("from afar", [300.0, 200.0, 900.0], [-0.3, -0.2, -0.9], 1e-4),
        ] {
            let (from, n) = (point(p), n(normal));
            let exact = seen_exactly(&quadrature, from, n);
            check(&format!("rectangle {name}{place}"), &light, from, n, &exact, tolerance);
        }
    }
}

/// In the plane z = 0 heights have no rounding error. A rectangle is visible from any height above it, and invisible
/// from its plane.
#[test]
fn a_rectangle_shines_down_to_its_plane_and_not_within() {
    let (light, world) = lamp(Shape::Rectangle, &DAffine3::IDENTITY);
    let quadrature = rectangle(&world);
    for height in [1e-4f32, 1e-6, 1e-12, 1e-30] {
        let from = Vec3::new(2.0, 0.1, height);
        let exact = seen_exactly(&quadrature, from, -Vec3::X);
        check(&format!("rectangle edge-on, {height:e} above"), &light, from, -Vec3::X, &exact, 1e-4);
    }
    for from in [[2.0, 0.1, 0.0], [1.0, 0.5, 0.0], [1.0, 1.0, 0.0], [0.2, 0.3, 0.0], [-1.0, 0.0, 0.0]] {
        let seen = seen_by_samples(&light, from.into(), -Vec3::X);
        assert_eq!((seen.irradiance, seen.solid_angle), (0.0, 0.0), "{from:?}");
        for u in [Vec2::ZERO, Vec2::splat(0.5), Vec2::splat(1f32.next_down())] {
            assert_eq!(light.sample(from.into(), u, 0.0), None, "{from:?}");
        }
    }
}

fn triangle() -> Mesh {
    Mesh {
        positions: [[-1.0, -1.0, 0.0], [1.5, -0.5, 0.0], [-0.5, 1.0, 0.0]].map(Vec3::from).to_vec(),
        indices: vec![[0, 1, 2]],
        ..Mesh::default()
    }
}

/// Returns the map from the square to a triangle with its corners as rounded to `f32`. [Duffy 1982]
fn triangle_chart(corners: [Vec3; 3]) -> impl Fn([f64; 2]) -> (DVec3, DVec3) {
    let [a, b, c] = corners.map(|p| p.as_dvec3());
    let n = (b - a).cross(c - a);
    move |[s, t]| (a + (b - a) * (s * (1.0 - t)) + (c - a) * (s * t), n * s)
}

#[test]
fn triangles_have_their_light() {
    let (light, world) = lamp(Shape::Mesh(triangle()), &DAffine3::IDENTITY);
    let WorldShape::Mesh(mesh) = &world else { panic!("a mesh") };
    let quadrature = triangle_chart(mesh.triangle(0));
    for (name, from, n) in [
        ("from above", [0.0, 0.0, 0.8], [0.0, 0.0, -1.0]),
        ("from afar", [100.0, 200.0, 900.0], [-0.1, -0.2, -0.97]),
        ("edge-on, 1e-6 above", [3.0, 0.1, 1e-6], [-1.0, 0.0, 0.0]),
        ("edge-on, 1e-20 above", [3.0, 0.1, 1e-20], [-1.0, 0.0, 0.0]),
    ] {
        let (from, n) = (Vec3::from(from), Vec3::from(n).normalize());
        let exact = seen_exactly(&quadrature, from, n);
        check(&format!("triangle {name}"), &light, from, n, &exact, 1e-4);
    }
    assert_eq!(light.sample(Vec3::new(0.1, 0.1, 0.0), Vec2::splat(0.4), 0.0), None);
    assert_eq!(light.sample(Vec3::new(3.0, 0.1, 0.0), Vec2::splat(0.4), 0.0), None);
}

/// Returns a scene with one emitter.
fn alone(shape: Shape, to_world: DAffine3, accel: AccelKind) -> Scene {
    let mut description = Description::default();
    let id = scenes::add(&mut description, shape, to_world, scenes::diffuse(0.5));
    description.shapes[id].emission = Some(Rgb::WHITE.into());
    scenes::compiled(description, accel)
}

/// Rays to sampled points hit the emitter, except at its outline, and the density at the hit is that of the sample.
#[test]
fn rays_find_extreme_lamps_with_the_density_of_their_samples() {
    let sphere = |distance: f64| (scenes::sphere(1.0), DAffine3::from_translation(DVec3::Z * distance));
    let plane = || (Shape::Rectangle, DAffine3::IDENTITY);
    for &kind in AccelKind::ALL {
        for (name, (shape, place), from, most_misses) in [
            ("tiny sphere", sphere(1e6), Vec3::ZERO, 0.1),
            ("sphere", sphere(2.0), Vec3::ZERO, 0.002),
            ("huge sphere", sphere(1.000_01), Vec3::ZERO, 0.002),
            ("near rectangle", plane(), Vec3::new(0.3, -0.2, 1e-6), 0.002),
            ("rectangle edge-on", plane(), Vec3::new(2.0, 0.1, 1e-6), 0.002),
            ("rectangle beside", plane(), Vec3::new(1.0, 0.1, 1e-3), 0.01),
            ("triangle", (Shape::Mesh(triangle()), DAffine3::IDENTITY), Vec3::new(0.2, 0.1, 1e-6), 0.002),
        ] {
            let scene = alone(shape, place, kind);
            let (mut samples, mut misses, mut furthest) = (0, 0, 0.0f64);
            for i in 0..64 * 64 {
                let u = Vec2::new(i as f32 % 64.0 + 0.5, (i / 64) as f32 + 0.5) / 64.0;
                let Some(s) = scene.sample_emitter(&scene.light_selection, from, u, 0.0) else { continue };
                samples += 1;
                let ray = Ray::new(from, s.wi);
                let Some(hit) = scene.accel.intersect(&ray) else {
                    misses += 1;
                    continue;
                };
                let at = scene.interaction(&ray, &hit);
                let pdf = scene.emitter_pdf(&scene.light_selection, EmitterId(0), from, from, &at);
                furthest = furthest.max(f64::from(pdf / s.pdf - 1.0).abs());
            }
            let share = f64::from(misses) / f64::from(samples.max(1));
            println!("{kind}, {name}: {samples} samples, {share:.4} missed, densities off by {furthest:.1e}");
            assert!(samples > 2000 && share <= most_misses, "{kind}, {name}: {misses} of {samples} miss");
            assert!(furthest < 5e-3, "{kind}, {name}: {furthest}");
        }
    }
}

/// Emitters without area or power are reported, are never sampled and do not change the sampling of others.
#[test]
fn lamps_without_area_or_power_are_never_drawn() {
    for &accel in AccelKind::ALL {
        let mut description = Description::default();
        let mut shine = |shape: Shape, to_world: DAffine3, radiance: f32| {
            let id = scenes::add(&mut description, shape, to_world, scenes::diffuse(0.5));
            description.shapes[id].emission = Some(Rgb::splat(radiance).into());
        };
        let away = DAffine3::from_translation(DVec3::new(5.0, 0.0, 0.0));
        let line = Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::X * 2.0],
            indices: vec![[0, 1, 2]],
            ..Mesh::default()
        };
        shine(Shape::Mesh(line), away, 3.0);
        shine(Shape::Mesh(Mesh::default()), away, 3.0);
        shine(Shape::Rectangle, DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0)), 3.0);
        shine(scenes::sphere(0.5), away, 0.0);
        let partly = Mesh { indices: vec![[0, 0, 1], [0, 1, 2], [2, 2, 2]], ..triangle() };
        shine(Shape::Mesh(partly), DAffine3::IDENTITY, 2.0);
        let dark = [Vec3::Y, -Vec3::Z].map(|position| Emitter::Point { position, intensity: Rgb::BLACK });
        description.emitters.extend(dark);
        let (scene, report) =
            compile(description, CompileOptions { accel, threads: 1, sensor: 0, passes_panes: false })
                .expect("it compiles");
        let warnings: Vec<String> = report.warnings.iter().map(|w| w.to_string()).collect();
        assert_eq!(warnings, ["the emitter has no area and emits no light"; 3], "{accel}");
        assert_eq!(scene.lights.len(), 3, "the triangles and the dark points");
        assert_eq!([0, 1, 2].map(|i| scene.light_choice.pmf(i)), [1.0, 0.0, 0.0]);
        let (mut mean, n) = (0.0, 300);
        for i in 0..n * n {
            let u = Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / n as f32;
            let s = scene
                .sample_emitter(&scene.light_selection, Vec3::Z, u, 0.0)
                .expect("the triangle is before it");
            assert!(s.radiance == Rgb::splat(2.0) && !s.delta);
            mean += f64::from(-s.wi.z / s.pdf) / f64::from(n as u32).powi(2);
        }
        let exact =
            seen_exactly(triangle_chart([0, 1, 2].map(|i| triangle().positions[i])), Vec3::Z, -Vec3::Z);
        assert!((mean / exact.irradiance - 1.0).abs() < 1e-4, "{accel}: {mean} instead of {exact:?}");
    }
}

/// Returns a hundred thousand point emitters with powers that decrease geometrically to 10⁻⁹ of the largest. One in a
/// hundred is black.
fn many_points() -> Vec<Emitter> {
    const COUNT: usize = 100_000;
    let power = |i: usize| match i % 100 {
        57 => 0.0,
        _ => 10f64.powf(-9.0 * (i * 61_803 % COUNT) as f64 / COUNT as f64),
    };
    let position = |i: usize| {
        let (turn, height) = (i as f32 * 0.618_034, 1.0 + (i % 1000) as f32 * 1e-3);
        Vec3::new(turn.cos() * 2.0, turn.sin() * 2.0, height)
    };
    (0..COUNT)
        .map(|i| Emitter::Point { position: position(i), intensity: Rgb::splat(power(i) as f32) })
        .collect()
}

/// Over all possible random numbers, every emitter with power is chosen with exactly its probability, so the mean is
/// the light of all emitters.
#[test]
fn a_hundred_thousand_lamps_of_power_ratio_a_billion_are_all_drawn() {
    let mut description = Description::default();
    scenes::add(&mut description, Shape::Rectangle, DAffine3::IDENTITY, scenes::diffuse(0.5));
    description.emitters = many_points();
    let scene = scenes::compiled(description, AccelKind::default());
    let irradiance = |i: usize| {
        let sample = scene.lights[i].sample(Vec3::ZERO, Vec2::ZERO, 0.0)?;
        Some(f64::from(sample.radiance.g * sample.wi.z))
    };
    let each: Vec<f64> = (0..scene.lights.len()).map(|i| irradiance(i).unwrap_or(0.0)).collect();
    let exact: f64 = each.iter().sum();
    const NUMBERS: u32 = 1 << 24;
    let mut drawn = vec![0u32; each.len()];
    for k in 0..NUMBERS {
        let choice = scene.light_choice.sample(k as f32 / NUMBERS as f32).expect("a lamp");
        drawn[choice.index] += 1;
    }
    let mut mean = 0.0;
    for (i, (&n, e)) in drawn.iter().zip(&each).enumerate() {
        let pmf = scene.light_choice.pmf(i);
        assert_eq!(n as f32, pmf * NUMBERS as f32, "lamp {i}");
        assert_eq!(n > 0, *e > 0.0, "lamp {i} of irradiance {e}");
        if n > 0 {
            mean += f64::from(n) / f64::from(NUMBERS) * e / f64::from(pmf);
        }
    }
    println!("{} lamps drawn; irradiance {mean:.9} of {exact:.9}", drawn.iter().filter(|n| **n > 0).count());
    assert!((mean / exact - 1.0).abs() < 1e-9, "{mean} instead of {exact}");
    // Bright emitters keep their probability.
    let powers: Vec<f64> = scene.lights.iter().map(|l| f64::from(l.power().luminance())).collect();
    let total: f64 = powers.iter().sum();
    for (i, power) in powers.iter().enumerate().filter(|(_, power)| **power > 1e-4 * total) {
        assert!((f64::from(scene.light_choice.pmf(i)) * total / power - 1.0).abs() < 7e-3, "lamp {i}");
    }
}

const WIDTH: usize = 64;
const HEIGHT: usize = 33;
/// Column and row of the sun.
const SUN: [usize; 2] = [20, 10];

/// Returns a sky of 1 with a sun of 10⁸ in one texel and black rows from 24 on.
fn sky() -> EnvMap {
    let mut values = vec![1.0f32; 3 * WIDTH * HEIGHT];
    values[3 * (SUN[1] * WIDTH + SUN[0])..][..3].fill(1e8);
    values[3 * WIDTH * 24..].fill(0.0);
    let image = TextureImage::from_floats(WIDTH, HEIGHT, 3, values).expect("a picture");
    EnvMap::new(image, 1.0, &DAffine3::IDENTITY).expect("a map")
}

/// The mean radiance of the sky, and that of its upper half without the texels of the sun, from samples and exactly.
#[test]
fn the_sky_beside_a_sun_of_a_hundred_million_is_found() {
    let map = sky();
    // Outside the footprint of the sun the sky is 1, down to the row above the black ones.
    let beside = |w: Vec3| {
        let turns = f64::from(w.x).atan2(-f64::from(w.z)) / TAU;
        let column = (turns - turns.floor()) * WIDTH as f64 - 0.5;
        let row = f64::from(w.y).clamp(-1.0, 1.0).acos() / PI * (HEIGHT - 1) as f64;
        w.y > 0.0 && ((column - SUN[0] as f64).abs() > 1.0 || (row - SUN[1] as f64).abs() > 1.0)
    };
    let exact = {
        let angle = |row: f64| (PI * row / (HEIGHT - 1) as f64).cos();
        let row = SUN[1] as f64;
        0.5 * (1.0 - (angle(row - 1.0) - angle(row + 1.0)) * 2.0 / WIDTH as f64)
    };
    let n = 2048;
    let (mut all, mut sum, mut squares, mut found) = (0.0, 0.0, 0.0, 0);
    for i in 0..n * n {
        // A lattice that also projects evenly to each of its axes. [Korobov 1959]
        let (k, points) = (i as u64, (n * n) as u64);
        let u = [k, k * 1_588_635 % points].map(|k| (k as f64 + 0.5) / points as f64);
        let Some(s) = map.sample(Vec2::new(u[0] as f32, u[1] as f32)) else { continue };
        assert!(s.pdf > 0.0 && s.pdf.is_finite() && s.radiance.is_valid());
        if i % 64 == 0 || s.radiance.g < 2.0 {
            let at = map.pdf(s.wi);
            assert!((at / s.pdf - 1.0).abs() < 2e-2, "{} and {at} towards {}", s.pdf, s.wi);
        }
        let estimate = f64::from(s.radiance.g / s.pdf) / (4.0 * PI);
        all += estimate;
        if beside(s.wi) {
            (sum, squares, found) = (sum + estimate, squares + estimate * estimate, found + 1);
        }
    }
    let points = (n * n) as f64;
    let mean = f64::from(map.mean_radiance().g);
    assert!((all / points / mean - 1.0).abs() < 1e-4, "{} instead of {mean}", all / points);
    let (sum, error) = (sum / points, (squares / points / points).sqrt());
    println!("the sky beside the sun: {sum:.4} ± {error:.4} from {found} samples, exactly {exact:.4}");
    assert!(found > 10 && (sum - exact).abs() < 4.0 * error, "{sum} ± {error} instead of {exact}");
}

/// Along lines through the sun, the sky behind it has the right fraction of all random numbers, within a few of 2^24.
#[test]
fn nothing_is_lost_behind_a_sun_in_its_row() {
    let map = sky();
    let turns = |w: Vec3| {
        let turns = f64::from(w.x).atan2(-f64::from(w.z)) / TAU - 0.5 / WIDTH as f64;
        turns - turns.floor()
    };
    const NUMBERS: u32 = 1 << 24;
    const LAST: u32 = 256;
    let behind = (SUN[0] + 1) as f64 / WIDTH as f64;
    let sun = map.pdf(direction(SUN[0] as f64, SUN[1] as f64));
    let (mut furthest, mut lines) = (0.0f64, 0);
    for y in (0..1 << 11).map(|k| (k as f32 + 0.5) / 2048.0) {
        let Some(middle) = map.sample(Vec2::new(0.5, y)).filter(|s| s.pdf > 0.1 * sun) else { continue };
        let row = f64::from(middle.wi.y).acos() * (HEIGHT - 1) as f64 / PI;
        // The density is piecewise linear, so the trapezoidal rule is exact.
        let pdf = |column: usize| f64::from(map.pdf(direction(column as f64, row)));
        let all: f64 = (0..WIDTH).map(pdf).sum();
        let part = (SUN[0] + 2..WIDTH).map(pdf).sum::<f64>() + 0.5 * (pdf(SUN[0] + 1) + pdf(0));
        let expected = part / all * f64::from(NUMBERS);
        let leads_behind = |k: &u32| {
            let s = map.sample(Vec2::new((NUMBERS - k) as f32 / NUMBERS as f32, y));
            s.is_some_and(|s| turns(s.wi) > behind)
        };
        assert!(!leads_behind(&LAST), "more random numbers lead behind the sun");
        let found = (1..LAST).filter(leads_behind).count() as f64;
        (furthest, lines) = (furthest.max((found - expected).abs()), lines + 1);
    }
    println!("behind the sun: off by at most {furthest:.2} random numbers in {lines} lines");
    assert!(lines > 1000 && furthest < 6.0, "{furthest}");
}

/// Returns the direction of a column and row.
fn direction(column: f64, row: f64) -> Vec3 {
    let (sin_phi, cos_phi) = (TAU * (column + 0.5) / WIDTH as f64).sin_cos();
    let (sin, cos) = (PI * row / (HEIGHT - 1) as f64).sin_cos();
    DVec3::new(sin_phi * sin, cos, -cos_phi * sin).as_vec3()
}

#[test]
fn black_rows_are_not_drawn_and_texels_that_are_no_numbers_are_refused() {
    let map = sky();
    for i in 0..1 << 16 {
        let u = Vec2::new((i % 256) as f32 / 256.0, (i / 256) as f32 / 256.0);
        if let Some(s) = map.sample(u) {
            assert!(s.wi.y > direction(0.0, 24.0).y - 1e-6, "{}", s.wi);
        }
    }
    assert_eq!(map.pdf(-Vec3::Y), 0.0);
    assert_eq!(map.eval(-Vec3::Y), Rgb::BLACK);
    for (bad, found) in [(f32::NAN, "NaN"), (f32::INFINITY, "inf"), (f32::NEG_INFINITY, "-inf")] {
        let mut values = vec![1.0; 12];
        values[4] = bad;
        let image = TextureImage::from_floats(2, 2, 3, values).expect("a picture");
        let error = EnvMap::new(image, 1.0, &DAffine3::IDENTITY).expect_err("it is refused");
        let sentence = format!("expected finite radiance, found 1 {found} 1 in column 1 of row 0");
        assert_eq!(error.to_string(), sentence);
    }
}

/// A receiver so close to an emitter that few emitter samples matter. BSDF samples hit the emitter, and both techniques
/// together give its irradiance.
#[test]
fn a_triangle_from_a_millionth_away_has_its_light_by_both_techniques() {
    for &kind in AccelKind::ALL {
        let scene = alone(Shape::Mesh(triangle()), DAffine3::IDENTITY, kind);
        let Light::Area(area) = &scene.lights[0] else { panic!("a triangle") };
        let from = Vec3::new(0.2, 0.1, 1e-6);
        let bsdf_pdf = |wi: Vec3| (-wi.z).max(0.0) / std::f32::consts::PI;
        let balance = |a: f32, b: f32| f64::from(a / (a + b));
        let n = 512;
        let mut sum = 0.0;
        for i in 0..n * n {
            let u = Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / n as f32;
            if let Some(s) = area.sample(from, u, 0.0) {
                sum += f64::from((-s.wi.z).max(0.0) / s.pdf) * balance(s.pdf, bsdf_pdf(s.wi));
            }
            let w = buffon::sampling::warp::square_to_cosine_hemisphere(u) * Vec3::new(1.0, 1.0, -1.0);
            let ray = Ray::new(from, w);
            if let Some(hit) = scene.accel.intersect(&ray) {
                let at = scene.interaction(&ray, &hit);
                let place = EmitterHit { p: at.p, n: at.ng, hit, local: at.p, time: 0.0 };
                sum += PI * balance(bsdf_pdf(w), area.pdf(from, &place));
            }
        }
        let found = sum / f64::from(n * n);
        println!("{kind}: {found} of {PI}");
        assert!((found / PI - 1.0).abs() < 1e-3, "{kind}: {found}");
    }
}
