//! Error estimates: coverage of intervals, stop rules, adaptive sampling.

use crate::support::cli::Folder;
use crate::support::scenes;
use buffon::accel::AccelKind;
use buffon::image::{Value, read};
use buffon::integrator::settings::WhenPays;
use buffon::integrator::{Preparation, Settings};
use buffon::loader::{LoadOptions, load};
use buffon::memory::Budget;
use buffon::render::{Job, JobSettings, Progress, Rates, Rendered, StopRules, thread_pool};
use buffon::sampling::{Sampler, SamplerKind};
use buffon::scene::Scene;
use serde_json::Value as Json;
use statrs::distribution::{Binomial, DiscreteCDF};
use std::ops::Range;
use std::path::Path;

/// Returns a scene of `scenes/error` with `size` × `size` pixels.
fn scene(name: &str, size: u32) -> (Scene, Settings) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/error").join(name);
    let mut loaded = load(&file, &LoadOptions::default()).expect("the scene loads");
    let film = &mut loaded.description.sensors[0].film;
    (film.width, film.height) = (size, size);
    (scenes::compiled(loaded.description, AccelKind::default()), loaded.integrator)
}

fn render(
    (scene, settings): &(Scene, Settings),
    sampler: SamplerKind,
    stop: StopRules,
    seed: u64,
    adaptive: bool,
) -> Rendered {
    let integrator = settings.create();
    let sampler = Sampler::new(sampler, stop.samples);
    let job = JobSettings { sampler, seed, threads: 2, stop, layers: Vec::new(), squared_bias: None };
    let progress = Progress::new();
    let job = Job::new(scene, integrator.as_ref(), &scene.sensors[0], job, &progress);
    if !adaptive {
        return job.run().expect("the threads start");
    }
    let pool = thread_pool(2).expect("the threads start");
    let rates = Rates::measure(
        integrator.as_ref(),
        &Preparation {
            scene,
            camera: &scene.sensors[0],
            sampler,
            seed,
            pool: &pool,
            interrupt: progress.interrupt_flag(),
            cache: None,
            memory: &Budget::default(),
        },
        WhenPays::Always,
        stop.samples,
    );
    assert!(rates.is_some());
    job.with_rates(rates).run_with(pool)
}

fn samples(n: u64) -> StopRules {
    StopRules { samples: Some(n), ..StopRules::default() }
}

/// Returns the relMSE of each image against the mean of all others, corrected for the error of that mean.
fn errors(images: &[Vec<[f64; 3]>]) -> Vec<f64> {
    let n = images.len() as f64;
    let sum = |pixel: usize, c: usize| images.iter().map(|image| image[pixel][c]).sum::<f64>();
    let sums: Vec<[f64; 3]> = (0..images[0].len()).map(|p| [0, 1, 2].map(|c| sum(p, c))).collect();
    let error = |image: &Vec<[f64; 3]>| {
        let pairs = image.iter().zip(&sums).flat_map(|(x, sum)| (0..3).map(move |c| (x[c], sum[c])));
        let terms = pairs.map(|(x, sum)| {
            let r = (sum - x) / (n - 1.0);
            (x - r) * (x - r) / (r * r + 0.01)
        });
        terms.sum::<f64>() / (3 * image.len()) as f64 * (n - 1.0) / n
    };
    images.iter().map(error).collect()
}

/// For 40 seeds of each case, the number of intervals that hold the true error is not significantly (one in a thousand)
/// below a coverage of 95 % (90 % with fireflies), and the estimates have the right mean.
#[test]
fn intervals_hold_the_true_error_as_often_as_they_claim() {
    const SEEDS: u64 = 40;
    let cases =
        [("smooth.xml", 0.95, 0.1, 1.4), ("noisy.xml", 0.95, 0.1, 1.6), ("fireflies.xml", 0.9, 0.8, 6.0)];
    for (name, coverage, largest_bias, widest) in cases {
        let scene = scene(name, 32);
        for sampler in [SamplerKind::Independent, SamplerKind::Sobol] {
            let renders: Vec<Rendered> =
                (0..SEEDS).map(|seed| render(&scene, sampler, samples(16), seed, false)).collect();
            let truths = errors(&renders.iter().map(scenes::pixels).collect::<Vec<_>>());
            let intervals: Vec<[f64; 2]> = renders.iter().filter_map(|r| r.relmse_interval).collect();
            assert_eq!(intervals.len(), truths.len());
            let held =
                intervals.iter().zip(&truths).filter(|([low, high], e)| (*low..=*high).contains(*e)).count();
            let chance = Binomial::new(coverage, SEEDS).expect("a distribution").cdf(held as u64);
            assert!(chance > 1e-3, "{name}, {sampler}: {held} of {SEEDS} intervals hold the error");
            let mean = renders.iter().filter_map(|r| r.relmse).sum::<f64>() / truths.iter().sum::<f64>();
            assert!(mean.ln().abs() < largest_bias, "{name}, {sampler}: estimates are {mean} of the error");
            let factors = renders.iter().zip(&intervals).filter_map(|(r, i)| Some(i[1] / r.relmse?));
            let factor = (factors.map(f64::ln).sum::<f64>() / SEEDS as f64).exp();
            assert!(factor > 1.05 && factor < widest, "{name}, {sampler}: up to {factor} times the estimate");
        }
    }
}

/// Adaptive sampling has the means of uniform sampling with other seeds, for the image and its quarters, within 4.5
/// standard errors (exceeded with a probability of 7 in a million for each of 40 comparisons). With path reuse, whole
/// cells get samples.
#[test]
fn adaptive_sampling_is_unbiased() {
    const SIZE: usize = 24;
    let means = |scene: &(Scene, Settings), sampler, seeds: Range<u64>, adaptive| -> [[f64; 2]; 5] {
        let of_seed = |seed: u64| {
            let mut sums = [0.0; 5];
            let image = scenes::pixels(&render(scene, sampler, samples(32), seed, adaptive));
            for (i, pixel) in image.iter().enumerate() {
                let quarter = i % SIZE / (SIZE / 2) + 2 * (i / SIZE / (SIZE / 2));
                let value = pixel.iter().sum::<f64>();
                sums[quarter] += value;
                sums[4] += value;
            }
            sums
        };
        let n = (seeds.end - seeds.start) as f64;
        let sums: Vec<[f64; 5]> = seeds.map(of_seed).collect();
        std::array::from_fn(|part| {
            let mean = sums.iter().map(|v| v[part]).sum::<f64>() / n;
            let variance = sums.iter().map(|v| (v[part] - mean).powi(2)).sum::<f64>() / (n - 1.0);
            [mean, variance / n]
        })
    };
    for name in ["noisy.xml", "fireflies.xml"] {
        let mut scene = scene(name, SIZE as u32);
        let uniform = means(&scene, SamplerKind::Sobol, 0..48, false);
        for (sampler, reuse) in [
            (SamplerKind::Independent, WhenPays::Never),
            (SamplerKind::Sobol, WhenPays::Never),
            (SamplerKind::Independent, WhenPays::Always),
            (SamplerKind::Sobol, WhenPays::Always),
        ] {
            scene.1.path_mut().expect("path tracing").reuse = reuse;
            let adaptive = means(&scene, sampler, 1000..1048, true);
            for (part, ([a, var_a], [b, var_b])) in adaptive.into_iter().zip(uniform).enumerate() {
                let z = (a - b) / (var_a + var_b).sqrt();
                let case = format!("{name}, {sampler}, reuse {reuse:?}, part {part}");
                assert!(z.abs() < 4.5, "{case}: {a} instead of {b}, z = {z}");
            }
        }
    }
}

#[test]
fn a_target_is_reached_with_few_samples_too_many() {
    let scene = scene("smooth.xml", 48);
    for (sampler, target) in [(SamplerKind::Independent, 0.003), (SamplerKind::Sobol, 0.0005)] {
        let rules = StopRules { error: Some(target), ..StopRules::default() };
        let mut ratios = 0.0;
        for seed in 0..8 {
            let rendered = render(&scene, sampler, rules, seed, false);
            let [_, high] = rendered.relmse_interval.expect("an interval");
            assert!(high <= target, "{sampler}, seed {seed}: {high}");
            assert!(rendered.samples_per_pixel.is_multiple_of(2));
            ratios += high / target / 8.0;
        }
        assert!(ratios > 0.85, "{sampler}: {ratios}");
    }
}

#[test]
fn adaptive_renders_keep_budget_and_numbers_on_any_threads() {
    let folder = Folder::new();
    let options = "s.xml -q --spp 32 --adaptive --aov samples,variance,standard_error";
    for threads in [1, 2, 5] {
        folder.render(&format!("{options} -t {threads} -o {threads}.exr --stats {threads}.json"));
    }
    let first = read(&folder.path("1.exr")).expect("the image");
    for threads in [2, 5] {
        let other = read(&folder.path(&format!("{threads}.exr"))).expect("the image");
        let bits = |image: &buffon::image::Image| image.data.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&first), bits(&other), "{threads} threads");
    }
    let channel = |name: &str| first.channel(name).expect("the layer is there");
    let (n, variance, error) = (channel("samples.N"), channel("variance.G"), channel("standard_error.G"));
    let pixels: Vec<&[f32]> = first.data.chunks_exact(first.data.len() / (40 * 30)).collect();
    let counts: Vec<u64> = pixels.iter().map(|p| p[n] as u64).collect();
    let mean = counts.iter().sum::<u64>() as f64 / counts.len() as f64;
    assert!(mean <= 32.0 && mean > 29.0, "{mean}");
    assert!(counts.iter().all(|n| n % 2 == 0 && *n >= 8) && counts.iter().any(|n| *n > 40));
    assert!(pixels.iter().all(|p| (p[error] * p[error] - p[variance]).abs() <= 1e-5 * p[variance]));
    let stats: Json = serde_json::from_slice(&folder.read("1.json")).expect("JSON");
    assert_eq!(stats["adaptive"], Json::from(true));
    // The order of the sum differs, so the last digit may.
    assert!((stats["samples"]["mean"].as_f64().expect("a number") - mean).abs() < 1e-9);
    assert_eq!(stats["spp"], Json::from(mean.round() as u64));
    for (i, key) in ["buffon:relmse_low", "buffon:relmse_high"].into_iter().enumerate() {
        let Some(Value::Float(value)) = first.metadata.get(key) else { panic!("{key} is missing") };
        let in_stats = stats["relmse_interval"][i].as_f64().expect("a number");
        assert!((f64::from(*value) / in_stats - 1.0).abs() < 1e-6, "{key}");
    }
}

/// `auto` has rates on glossy boards under lamps, and none on spheres or where they are of no use. A short range tells
/// of pixels without samples.
#[test]
fn auto_has_rates_where_they_pay() {
    let [boards, spheres] =
        [("speed", "boards.xml"), ("spheres", "spheres.xml")].map(|(t, n)| Folder::of_scene(t, n));
    let render = |folder: &Folder, options: &str| {
        let run =
            folder.render(&format!("s.xml --size 200x150 --progress none -o r.exr --stats s.json {options}"));
        let stats: Json = serde_json::from_slice(&folder.read("s.json")).expect("JSON");
        (stats["adaptive"].as_bool().expect("a truth value"), run.stderr)
    };
    for (folder, options, adaptive) in [
        (&boards, "--spp 9", true),
        (&boards, "--spp 8", false),
        (&boards, "--spp 17 --adaptive=never", false),
        (&boards, "--spp 25 --sampler multijitter", false),
        (&boards, "--spp 17 --integrator whitted", false),
        (&spheres, "--spp 17", false),
        (&spheres, "--spp 17 --adaptive", true),
    ] {
        assert_eq!(render(folder, options).0, adaptive, "{options}");
    }
    for (range, empty) in [("16..20", true), ("16..24", false)] {
        let (_, printed) = render(&boards, &format!("--spp 32 --sample-range {range}"));
        assert_eq!(printed.contains("some pixels have no sample in this range"), empty, "{printed}");
    }
}

#[test]
fn adaptive_sampling_works_with_every_rule_and_is_refused_where_it_cannot() {
    let folder = Folder::new();
    for (rules, reason) in [
        ("--time 0.5s", "time is up"),
        ("--target-error 0.3", "error reached"),
        ("--spp 5", "all samples taken"),
    ] {
        let run = folder.render(&format!("s.xml --adaptive --progress none {rules}"));
        assert!(run.stderr.trim_end().ends_with(reason), "{rules}: {}", run.stderr);
    }
    let run = folder.run("render s.xml --adaptive --integrator ptracer");
    assert_eq!(run.code, 2);
    let expected = "--adaptive: ptracer traces paths from the emitters and cannot choose the pixels that they contribute to";
    assert!(run.stderr.contains(expected), "{}", run.stderr);
    for sampler in ["zsobol", "fixed"] {
        let run = folder.run(&format!("render s.xml --adaptive --sampler {sampler}"));
        assert_eq!(run.code, 2);
        let expected = format!(
            "--adaptive: with the sampler {sampler}, the samples of neighbouring pixels are correlated"
        );
        assert!(run.stderr.contains(&expected), "{}", run.stderr);
    }
}
