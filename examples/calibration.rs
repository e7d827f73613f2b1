use buffon::accel::AccelKind;
use buffon::integrator;
use buffon::loader::{LoadOptions, load};
use buffon::render::{Job, JobSettings, Progress, Rendered, StopRules};
use buffon::sampling::{Sampler, SamplerKind};
use buffon::scene::{CompileOptions, compile};
#[path = "../src/estimate/metrics.rs"]
mod metrics;
#[path = "../src/estimate/replicates.rs"]
mod replicates;
use replicates::*;

fn main() {
    let a: Vec<String> = std::env::args().collect();
    let seeds: u64 = a[1].parse().unwrap();
    let size: u32 = a[2].parse().unwrap();
    for file in &a[3..] {
        let file = file.as_str();
        let mut l = load(file.as_ref(), &LoadOptions::default()).unwrap();
        let f = &mut l.description.sensors[0].film;
        f.width = size; f.height = size; f.crop = None;
        let scene = compile(l.description, CompileOptions { accel: AccelKind::default(), threads: 2, sensor: 0 }).unwrap().0;
        let int = integrator::create(&l.integrator);
        for kind in [SamplerKind::Independent, SamplerKind::Sobol] {
            let spps = [4u64, 16, 64];
            let mut best_ref: Option<Vec<f64>> = None;
            for &spp in spps.iter().rev() {
                let mut renders: Vec<Rendered> = Vec::new();
                for seed in 0..seeds {
                    let p = Progress::new();
                    let job = JobSettings { sampler: Sampler::new(kind, Some(spp)), seed, threads: 2, stop: StopRules { samples: Some(spp), ..Default::default() }, layers: vec![] };
                    renders.push(Job::new(&scene, int.as_ref(), &scene.sensors[0], job, &p).run().unwrap());
                }
                let get = |r: &Rendered| -> Vec<f64> { r.tiles.iter().flat_map(|t| (0..t.pixel_count()).flat_map(move |i| (0..3).map(move |c| t.estimate(i, c).mean))).collect() };
                let imgs: Vec<Vec<f64>> = renders.iter().map(get).collect();
                let n = imgs[0].len();
                let loo = best_ref.is_none();
                if loo {
                    best_ref = Some((0..n).map(|k| imgs.iter().map(|m| m[k]).sum::<f64>() / seeds as f64).collect());
                }
                let mean = best_ref.as_ref().unwrap();
                let s = seeds as f64;
                let truth: Vec<f64> = imgs.iter().map(|m| (0..n).map(|k| {
                    let r = if loo { (mean[k] * s - m[k]) / (s - 1.0) } else { mean[k] };
                    (m[k] - r).powi(2) / (r * r + 0.01)
                }).sum::<f64>() / n as f64 * if loo { (s - 1.0) / s } else { 1.0 }).collect();
                let mt = truth.iter().sum::<f64>() / s;
                println!("{file} {kind} {spp}: true {mt:.4e}");
                let mut cover = [0.0; 2];
                let (mut width, mut est, mut own) = (0.0, 0.0, 0.0);
                let mut ratio: Vec<f64> = vec![];
                let t0 = std::time::Instant::now();
                for (r, e) in renders.iter().zip(&truth) {
                    let mut sums = ErrorSums::default();
                    for t in &r.tiles {
                        let (w, h) = (t.rect.width as usize, t.rect.height as usize);
                        let mut b = Block::new(w, h);
                        for i in 0..t.pixel_count() { for c in 0..3 { b.set(i % w, i / w, c, t.replicates(i, c)); } }
                        sums.merge(&b.sums());
                    }
                    let ee = sums.estimate().unwrap();
                    est += ee.relmse / s; own += r.relmse.unwrap() / s;
                    let [lo, hi] = ee.interval;
                    cover[0] += f64::from(lo <= *e && *e <= hi) / s;
                    cover[1] += f64::from(*e <= hi) / s;
                    width += (hi / lo).sqrt().ln() / s;
                    ratio.push((e / ee.relmse).ln());
                }
                let ns = t0.elapsed().as_nanos() as f64 / s / (n as f64 / 3.0);
                ratio.sort_by(f64::total_cmp);
                println!("   bias {:.4} own {:.4}; cover {:.3} upper {:.3}; width x{:.3}; ratio quantiles {:.3} {:.3} {:.3}; {ns:.0} ns/px", est / mt, own / mt, cover[0], cover[1], width.exp(),
                   ratio[ratio.len()/40].exp(), ratio[ratio.len()/2].exp(), ratio[ratio.len() - 1 - ratio.len()/40].exp());
            }
        }
    }
}
