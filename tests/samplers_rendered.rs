//! Samplers in a render: all have the same mean and a correct estimate of the error.

use crate::support::scenes::{add, camera, compiled, diffuse, render, sphere};
use buffon::accel::AccelKind;
use buffon::color::Rgb;
use buffon::integrator::Settings;
use buffon::integrator::settings::PathLimits;
use buffon::math::{DAffine3, DVec3};
use buffon::sampling::SamplerKind;
use buffon::scene::{Description, Scene};

/// Number of renders with different seeds.
const RUNS: u64 = 48;

/// The number of edges of the longest paths. Only the last edge may be ended by roulette.
const EDGES: u32 = 6;
/// The radiance of [`furnace`] by paths of so many edges.
const RADIANCE: f64 = 1.0 - 1.0 / (1 << EDGES) as f64;

/// Returns a sphere with albedo 1/2 and emission 1/2, seen from inside. The radiance is the same everywhere.
fn furnace() -> Scene {
    let mut scene = Description::default();
    let id = add(&mut scene, sphere(1.0), DAffine3::IDENTITY, diffuse(0.5));
    scene.shapes[id].emission = Some(Rgb::splat(0.5).into());
    scene.shapes[id].flip_normals = true;
    scene.sensors.push(camera(DVec3::new(0.2, 0.1, -0.3), DVec3::new(-0.3, 0.4, 0.5), 90.0, 8));
    compiled(scene, AccelKind::default())
}

/// Statistics of several renders of the furnace.
struct Figures {
    /// The error of the mean of all renders in standard errors, which come from the spread of the renders' means.
    t: f64,
    /// The mean estimate of a pixel's variance, divided by the mean square of its error.
    estimated: f64,
    /// The mean square of the error of an image's mean, divided by that of independent pixels.
    of_mean: f64,
}

fn figures(scene: &Scene, kind: SamplerKind) -> Figures {
    let settings = Settings::Path(
        PathLimits { max_depth: Some(EDGES), rr_depth: EDGES - 1, hide_emitters: false }.into(),
    );
    let (mut means, mut squares, mut estimates, mut pixels) = (Vec::new(), 0.0, 0.0, 0.0);
    for seed in 0..RUNS {
        let rendered = render(scene, &settings, kind, 16, seed);
        assert_eq!(rendered.invalid_count, 0, "{kind}");
        let (mut sum, mut count) = (0.0, 0.0);
        for tile in &rendered.tiles {
            for i in 0..tile.pixel_count() {
                let estimate = tile.estimate(i, 0);
                sum += estimate.mean;
                squares += (estimate.mean - RADIANCE).powi(2);
                estimates += estimate.variance.expect("both halves have samples");
                count += 1.0;
            }
        }
        means.push(sum / count);
        pixels = count;
    }
    let runs = RUNS as f64;
    let mean = means.iter().sum::<f64>() / runs;
    let variance = means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (runs - 1.0);
    let of_mean = means.iter().map(|m| (m - RADIANCE).powi(2)).sum::<f64>() / runs;
    Figures {
        t: (mean - RADIANCE) / (variance / runs).sqrt(),
        estimated: estimates / squares,
        of_mean: of_mean / (squares / (runs * pixels) / pixels),
    }
}

/// Student's t with 47 degrees of freedom exceeds 4.5 with a probability of 4.5·10^−5.
#[test]
fn every_sampler_has_the_same_mean_and_knows_its_error() {
    let scene = furnace();
    for kind in SamplerKind::ALL {
        let Figures { t, estimated, of_mean } = figures(&scene, kind);
        println!(
            "{kind}: off by {t:.2} standard errors; estimated over true variance of a pixel {estimated:.2}; variance of the \
             image's mean {of_mean:.2} times that of independent pixels"
        );
        assert!(t.abs() < 4.5, "{kind}: the mean is off by {t} standard errors");
        // If all pixels have the same error, 64 of them contain little more information than one.
        let (least, most) = if kind == SamplerKind::Fixed { (0.5, 2.0) } else { (0.85, 1.18) };
        assert!((least..most).contains(&estimated), "{kind}: {estimated}");
        let expected = match kind {
            SamplerKind::Fixed => 5.0..65.0,
            SamplerKind::Zsobol => 0.0..0.6,
            _ => 0.4..2.2,
        };
        assert!(expected.contains(&of_mean), "{kind}: {of_mean}");
    }
}
