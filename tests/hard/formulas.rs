//! The expected values of `scenes/hard`, computed again in `f64` from their formulas.

use super::root;
use buffon::math::DVec3;
use buffon::regress::{Claim, Expectations};
use std::f64::consts::{PI, TAU};

/// Returns the expected value of each channel for a case of a scene.
fn expected(scene: &str, case: &str) -> f64 {
    let cases =
        Expectations::read(&root().join(scene)).expect("the cases can be read").expect("there are cases");
    let found =
        cases.cases.iter().find(|c| c.name == case).unwrap_or_else(|| panic!("{scene} has no \"{case}\""));
    match found.claim {
        Claim::Value { expected: [r, g, b], .. } if r == g && g == b => r,
        ref other => panic!("{scene}, {case}: {other:?}"),
    }
}

#[track_caller]
fn assert_expected(scene: &str, case: &str, exact: f64) {
    let found = expected(scene, case);
    assert!((found - exact).abs() <= 1e-5 * exact.abs(), "{scene}, {case}: {found}, computed {exact}");
}

/// Returns the integral by the midpoint rule.
fn integral(from: f64, to: f64, n: u32, f: impl Fn(f64) -> f64) -> f64 {
    let step = (to - from) / f64::from(n);
    (0..n).map(|i| f(from + (f64::from(i) + 0.5) * step)).sum::<f64>() * step
}

/// Returns the form factor from the origin with the normal +z to a polygon above it. [Lambert 1760; Arvo 1995]
fn form_factor(corners: &[DVec3]) -> f64 {
    let edges = corners.iter().zip(corners.iter().cycle().skip(1));
    let sum: f64 = edges
        .map(|(a, b)| {
            let across = a.cross(*b);
            across.length().atan2(a.dot(*b)) * across.z / across.length()
        })
        .sum();
    sum.abs() / TAU
}

/// Returns the corners of `scenes/hard/lights/rectangle.xml`: a square of half-width 1, rotated about y, at (x, 0, z).
fn square(x: f64, z: f64, degrees: f64) -> [DVec3; 4] {
    let (sin, cos) = degrees.to_radians().sin_cos();
    [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
        .map(|(u, v): (f64, f64)| DVec3::new(cos * u + x, v, z - sin * u))
}

#[test]
fn squares_have_their_form_factors() {
    let scene = "lights/rectangle.xml";
    for (case, x, z, degrees) in
        [("above", 0.0, 1.0, 180.0), ("aside", 2.0, 1.0, 180.0), ("askew", 2.0, 3.0, 207.0)]
    {
        assert_expected(scene, case, 0.5 * form_factor(&square(x, z, degrees)));
    }
    for (case, distance) in [("1e-2", 1e-2), ("1e-3", 1e-3), ("1e-4", 1e-4), ("1e-6", 1e-6)] {
        let case = case.replace("1e-2", "0.01");
        let seen = 0.5 * form_factor(&square(-distance, 2.0, 90.0)) / distance;
        assert_expected(scene, &format!("edge-on, {case} before its plane"), seen);
    }
}

/// The sky is interpolated bilinearly between the centres of 32×16 texels. The first row is the zenith.
#[test]
fn skies_are_bilinear_between_texels() {
    let step = PI / 15.0;
    // The integral of a footprint over longitude is 2π/32; over the angle θ from the zenith ∫ hat cosθ sinθ dθ is:
    let hat = |row: f64| {
        integral((row - 1.0) * step, (row + 1.0) * step, 20_000, |t| {
            (1.0 - (t / step - row).abs()) * 0.5 * (2.0 * t).sin()
        })
    };
    let sun = 1.0 + (1e8 - 1.0) * (TAU / 32.0) * hat(3.0) / PI;
    assert_expected("lights/sky.xml", "one texel of 1e8", 0.5 * sun);
    let row = |i: usize| if [1, 2, 5].contains(&i) { 0.0 } else { 1.0 };
    let irradiance = integral(0.0, 0.5 * PI, 300_000, |t| {
        let at = t / step;
        let (i, share) = (at as usize, at.fract());
        (row(i) * (1.0 - share) + row(i + 1) * share) * 0.5 * (2.0 * t).sin()
    });
    // One of the 32 columns is black.
    assert_expected("lights/sky.xml", "black rows and columns", 0.5 / PI * TAU * irradiance * 31.0 / 32.0);
}

/// Returns Fresnel's reflectance for unpolarised light from index `n1` to `n2`.
fn fresnel(n1: f64, n2: f64, cos: f64) -> f64 {
    let sin2 = (n1 / n2).powi(2) * (1.0 - cos * cos);
    if sin2 >= 1.0 {
        return 1.0;
    }
    let refracted = (1.0 - sin2).sqrt();
    let s = (n1 * cos - n2 * refracted) / (n1 * cos + n2 * refracted);
    let p = (n2 * cos - n1 * refracted) / (n2 * cos + n1 * refracted);
    0.5 * (s * s + p * p)
}

#[test]
fn interfaces_follow_fresnel() {
    for (case, tan) in
        [("0.0 degrees", 0.0), ("38.7 degrees", 0.8), ("41.7 degrees", 0.89), ("41.8 degrees", 0.894)]
    {
        let cos = 1.0 / f64::hypot(1.0, tan);
        assert_expected("materials/critical-angle.xml", case, 2.25 * (1.0 - fresnel(1.5, 1.0, cos)));
    }
    for (case, cos) in [
        ("k = 0, n = 1.5", 1.0),
        ("k = 0, n = 1.5, 60 degrees", 0.5),
        ("k = 0, n = 1.5, cosine 0.01", 0.01),
        ("k = 0, n = 1.5, cosine 1e-6", 1e-6),
    ] {
        assert_expected("materials/conductor.xml", case, fresnel(1.0, 1.5, cos));
    }
    let (n, k) = (0.2f64, 3.9);
    let normal = ((n - 1.0).powi(2) + k * k) / ((n + 1.0).powi(2) + k * k);
    assert_expected("materials/conductor.xml", "n = 0.2, k = 3.9", normal);
}

/// Returns the directional albedo of a lossless GGX mirror with Smith's separable masking: ∫ D G₁(i) G₁(o)
/// (i·m)/(cosθᵢ) dm over the half vectors m; u is the distribution function of their angle. [Walter 2007]
fn ggx_albedo(alpha: f64, cos: f64) -> f64 {
    let i = DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
    let masking = |c: f64| 2.0 / (1.0 + (1.0 + alpha * alpha * (1.0 - c * c) / (c * c)).sqrt());
    integral(0.0, 1.0, 2000, |u| {
        let cos_m = 1.0 / (1.0 + alpha * alpha * u / (1.0 - u)).sqrt();
        let sin_m = (1.0 - cos_m * cos_m).sqrt();
        integral(0.0, 1.0, 500, |turn| {
            let m = DVec3::new(sin_m * (TAU * turn).cos(), sin_m * (TAU * turn).sin(), cos_m);
            let im = i.dot(m);
            let o = 2.0 * im * m - i;
            if im > 0.0 && o.z > 0.0 { masking(cos) * masking(o.z) * im / (cos * cos_m) } else { 0.0 }
        })
    })
}

#[test]
fn rough_mirrors_have_their_albedos() {
    let close = |case: &str, exact: f64| {
        let found = expected("materials/rough.xml", case);
        assert!((found - exact).abs() < 2e-4, "{case}: {found}, computed {exact}");
    };
    close("GGX, alpha 1", ggx_albedo(1.0, 1.0));
    close("GGX, alpha 1", 1.0 - 2f64.ln());
    close("GGX, alpha 1, 60 degrees", ggx_albedo(1.0, 0.5));
    close("alpha 1e-4, cosine 0.1", ggx_albedo(1e-4, 0.1));
}

#[test]
fn discs_have_their_share_of_the_image() {
    for (case, fov, radius) in [("fov 90", 90.0f64, 0.5), ("fov 0.01", 0.01, 5e-5), ("fov 179", 179.0, 100.0)]
    {
        let width = 2.0 * (0.5 * fov).to_radians().tan();
        assert_expected("cameras/disc.xml", case, PI * radius * radius / (width * width));
    }
    assert_expected("energy/corridor.xml", "200 reflections", 0.99f64.powi(200));
}

#[test]
fn media_absorb_and_scatter_by_their_optical_depth() {
    for (scene, case, depth) in [
        ("media/slab.xml", "optical depth 1e-6", 1e-6f64),
        ("media/slab.xml", "optical depth 80", 80.0),
        ("media/slab.xml", "optical depth 1e4", 1e4),
        ("media/boundary.xml", "camera on the boundary", 1.0),
        ("media/boundary.xml", "camera in the middle", 0.5),
        ("media/grid.xml", "density equal to its bound", 1.0),
        ("media/grid.xml", "density far below its bound, optical depth 1e-4", 1e-4),
    ] {
        assert_expected(scene, case, (-depth).exp());
    }
    // Light of intensity 1 at the distance h from the middle of a ray's part of length 1, scattered once.
    for (sigma, h, name) in [
        (1e-6f64, 1e-2f64, "optical depth 1e-6, emitter 0.01"),
        (1e-6, 0.3, "optical depth 1e-6, emitter 0.3"),
        (1e-6, 1e-4, "optical depth 1e-6, emitter 0.0001"),
        (1e-3, 1e-2, "optical depth 1e-3, emitter 0.01"),
    ] {
        let scattered = sigma / (4.0 * PI * h) * 2.0 * (0.5 / h).atan();
        assert_expected("media/thin.xml", &format!("{name} beside the ray"), scattered);
    }
}
