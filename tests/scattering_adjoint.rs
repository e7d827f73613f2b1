//! The adjoint BSDF of light paths, compared with that of camera paths.

use crate::support::bsdfs::{DIFFUSE, plain_models, transmittances, wrapped};
use buffon::bsdf::{Blend, Bsdf, Lobe, Mask, Tilted, TwoSided};
use buffon::math::{DVec3, Frame, Vec2, Vec3};
use buffon::sampling::{Dimension, SampleKey, Sampler, SamplerKind, warp};

/// Number of pairs of directions.
const SAMPLES: usize = 1 << 15;
/// Maximum difference of the two estimates in standard errors. Correct pairs exceed it with a probability of 3·10⁻⁷.
const DEVIATIONS: f64 = 5.1;

/// Evaluates an asymmetric function of viewer and light.
fn weight(viewer: Vec3, light: Vec3) -> f64 {
    let (v, l) = (viewer.as_dvec3(), light.as_dvec3());
    (1.0 + 0.6 * v.dot(DVec3::new(0.5, 0.3, 0.81)) + 0.3 * v.x * l.y)
        * (1.0 + 0.5 * l.dot(DVec3::new(-0.7, 0.1, 0.7)))
}

/// Returns the mean of `f` over random directions, lobes and points of the square, and its standard error.
fn mean(f: impl Fn(Vec3, f32, Vec2) -> f64) -> (f64, f64) {
    let keys: Vec<_> = (0..SAMPLES as u32).map(|i| SampleKey::new(3, i, 0, 0)).collect();
    let draw = |d: u64| {
        let (mut x, mut y) = (vec![0.0; SAMPLES], vec![0.0; SAMPLES]);
        Sampler::new(SamplerKind::Independent, None).fill_2d(Dimension(d), &keys, &mut x, &mut y);
        (x, y)
    };
    let [(ax, ay), (lobe, _), (x, y)] = [0, 1, 2].map(draw);
    let values = (0..SAMPLES).map(|i| {
        let direction = warp::square_to_sphere(Vec2::new(ax[i], ay[i]));
        f(direction, lobe[i], Vec2::new(x[i], y[i]))
    });
    let (sum, squares) = values.fold((0.0, 0.0), |(s, q), v| (s + v, q + v * v));
    let n = SAMPLES as f64;
    let mean = sum / n;
    (mean, ((squares / n - mean * mean) / n).sqrt())
}

/// Compares two estimates of ∫∫ f(v, l)·|cos v|·|cos l|·w(v, l) over viewers and lights: by viewers and sampled lights,
/// and by lights and sampled viewers.
fn check(name: &str, bsdf: &Bsdf<'_>) {
    let by_viewers = mean(|v, u_lobe, u| {
        let sample = bsdf.sample(v, u_lobe, u);
        sample.map_or(0.0, |s| f64::from(s.weight.g * v.z.abs()) * weight(v, s.wi))
    });
    let by_lights = mean(|l, u_lobe, u| {
        let sample = bsdf.sample_adjoint(l, u_lobe, u);
        sample.map_or(0.0, |s| {
            if s.lobe != Lobe::Specular {
                let pdf = bsdf.pdf_adjoint(l, s.wi);
                assert!((pdf / s.pdf - 1.0).abs() < 1e-3, "{name}: densities {pdf} and {}", s.pdf);
            }
            f64::from(s.weight.g * l.z.abs()) * weight(s.wi, l)
        })
    });
    let error = by_viewers.1.hypot(by_lights.1);
    let difference = (by_viewers.0 - by_lights.0).abs();
    assert!(
        difference <= DEVIATIONS * error && error <= 0.1 * by_viewers.0 + 1e-9,
        "{name}: {:.5} by viewers, {:.5} by lights, ± {error:.5}",
        by_viewers.0,
        by_lights.0
    );
}

#[test]
fn every_bsdf_scatters_light_as_it_gathers_radiance() {
    let transmittance = transmittances();
    let frame = Frame::from_normal(Vec3::new(0.4, -0.3, 1.0).normalize());
    let turned = Frame::from_normal(Vec3::new(-0.4, 0.3, 1.0).normalize());
    for inner in &plain_models(&transmittance) {
        let name = format!("{inner:?}");
        check(&name, inner);
        let tilt = |frame, soften, turned| Tilted { frame, soften, inner, turned };
        let other = tilt(turned, true, None);
        let flipping = Bsdf::Tilted(tilt(frame, true, Some(&other)));
        check(&format!("tilted {name}"), &Bsdf::Tilted(tilt(frame, false, None)));
        check(&format!("tilted to the viewer {name}"), &flipping);
        check(
            &format!("in parts tilted {name}"),
            &Bsdf::Blend(Blend { weight: 0.3, bsdfs: [&flipping, &DIFFUSE] }),
        );
        check(&format!("with holes, tilted {name}"), &Bsdf::Mask(Mask { opacity: 0.6, inner: &flipping }));
        if !inner.transmits() {
            let tilted = Bsdf::Tilted(tilt(frame, false, None));
            let sides = [&tilted, &tilted];
            check(&format!("of both sides, never turned, {name}"), &Bsdf::TwoSided(TwoSided { sides }));
            check(
                &format!("of both sides, tilted {name}"),
                &Bsdf::TwoSided(TwoSided { sides: [&DIFFUSE, &flipping] }),
            );
        }
    }
}

/// Every sample belongs to a kind of lobe that the BSDF declares.
#[test]
fn lobes_are_those_that_samples_are_of() {
    let transmittance = transmittances();
    let plain = plain_models(&transmittance);
    for bsdf in &wrapped(&plain) {
        let lobes = bsdf.lobes();
        assert_eq!(bsdf.is_specular(), !lobes.finite, "{bsdf:?}");
        for z in [1.0f32, 0.3, -0.6, -1.0] {
            let wo = Vec3::new((1.0 - z * z).sqrt(), 0.0, z);
            let mut deltas = 0;
            bsdf.specular_lobes(wo, &mut |_| deltas += 1);
            assert!(deltas <= lobes.deltas, "{bsdf:?}: {deltas} deltas of {}", lobes.deltas);
            for i in 0..256 {
                let u = |k: u32| ((i * (2 * k + 3) + k) % 256) as f32 / 256.0;
                let Some(sample) = bsdf.sample(wo, u(0), Vec2::new(u(1), u(2))) else { continue };
                let known = if sample.lobe == Lobe::Specular { lobes.deltas > 0 } else { lobes.finite };
                assert!(known, "{bsdf:?}: a sample of {:?}, which is none of {lobes:?}", sample.lobe);
            }
        }
    }
}
