//! Images do not depend on threads, crops, passes or the traversal.

use crate::support::cli::{Folder, SCENE};
use crate::support::scenes;
use buffon::accel::AccelKind;
use buffon::compare::{compare, z_test};
use buffon::film::{PixelRect, Tile};
use buffon::image::{Image, read};
use buffon::integrator::settings::{PathLimits, PathSettings, WhenPays};
use buffon::integrator::{self, Settings, Worker};
use buffon::loader::{LoadOptions, load};
use buffon::render::edges::EmitterEdges;
use buffon::render::tracing::CameraWorker;
use buffon::render::{Job, JobSettings, Progress, StopRules};
use buffon::sampling::{Sampler, SamplerKind};
use buffon::scene::Scene;
use std::path::Path;

/// Returns the bits of all values of an image.
fn bits(image: &Image) -> Vec<u32> {
    image.data.iter().map(|v| v.to_bits()).collect()
}

/// Renders the scene to `name`.exr and reads the image.
fn picture(folder: &Folder, name: &str, arguments: &str) -> Image {
    folder.render(&format!("s.xml -q -o {name}.exr {arguments}"));
    read(&folder.path(&format!("{name}.exr"))).expect("the image can be read")
}

/// Returns an image without its render time.
fn timeless(mut image: Image) -> Image {
    image.metadata.set("renderTimeSeconds", buffon::image::Value::Float(0.0));
    image
}

#[test]
fn threads_and_repetition_change_no_bit() {
    let folder = Folder::new();
    for sampler in SamplerKind::ALL {
        let options = format!("--sampler {sampler} --spp 21 --aov albedo,N,variance,samples");
        let once = picture(&folder, "once", &format!("{options} -t 1"));
        assert!(once.data.iter().any(|v| *v > 0.0));
        for threads in [1, 2, 5] {
            let again = picture(&folder, "again", &format!("{options} -t {threads}"));
            assert_eq!(bits(&again), bits(&once), "{sampler}, {threads} threads");
            assert_eq!(timeless(again), timeless(once.clone()));
        }
    }
    // A file format without times has identical bytes.
    for threads in [1, 2, 5] {
        folder.render(&format!("s.xml -q -o {threads}.pfm -t {threads}"));
        assert_eq!(folder.read(&format!("{threads}.pfm")), folder.read("1.pfm"));
    }
}

#[test]
fn a_crop_has_the_very_pixels_of_the_whole() {
    let folder = Folder::new();
    for options in ["--spp 6 --aov variance,Z", "--spp 24 --adaptive"] {
        a_crop_is_a_part(&folder, options);
    }
}

fn a_crop_is_a_part(folder: &Folder, options: &str) {
    let whole = picture(folder, "whole", options);
    for (x, y, width, height) in
        [(0, 0, 40, 30), (7, 5, 20, 19), (16, 16, 16, 14), (39, 29, 1, 1), (3, 0, 1, 30)]
    {
        let crop = picture(folder, "crop", &format!("{options} --crop {x},{y},{width},{height}"));
        let part = whole.crop(x, y, width, height).expect("the crop is inside");
        assert_eq!((crop.width, crop.height), (width, height));
        assert_eq!(bits(&crop), bits(&part), "{x},{y},{width},{height}");
    }
    // A crop in the scene file has the same pixels.
    let cropped = SCENE.replace(
        "<string name=\"component_format\"",
        "<integer name=\"crop_offset_x\" value=\"7\"/><integer name=\"crop_offset_y\" value=\"5\"/>\
         <integer name=\"crop_width\" value=\"20\"/><integer name=\"crop_height\" value=\"19\"/>\
         <string name=\"component_format\"",
    );
    let crop = picture(&Folder::with(&cropped), "crop", options);
    assert_eq!(bits(&crop), bits(&whole.crop(7, 5, 20, 19).expect("the crop is inside")));
}

/// Media of several kinds, some of which rays enter unscattered.
fn with_media(bodies_only: bool) -> String {
    let ball = |x: f32, bsdf: &str, medium: &str| {
        format!(
            "<shape type='sphere'><point name='center' x='{x}' y='0' z='0'/><float name='radius' value='0.5'/>\
             <bsdf type='{bsdf}'/><medium type='homogeneous' name='interior'>\
             <rgb name='sigma_t' value='2, 3, 2'/><float name='albedo' value='0.9'/>{medium}</medium></shape>"
        )
    };
    let hg = "<phase type='hg'><float name='g' value='0.5'/></phase>";
    let mut shapes = ball(-0.6, "dielectric", "") + &ball(0.6, "dielectric", hg);
    if !bodies_only {
        shapes += &ball(0.0, "null", "<phase type='rayleigh'/>");
        shapes += "<emitter type='point'><point name='position' x='1' y='2' z='1'/></emitter>";
    }
    format!(
        "<scene version='3.0.0'><integrator type='volpath'/><sensor type='perspective'>\
         <transform name='to_world'><lookat origin='0, 0, 4' target='0, 0, 0' up='0, 1, 0'/></transform>\
         <film type='hdrfilm'><integer name='width' value='40'/><integer name='height' value='30'/>\
         <rfilter type='box'/></film></sensor><emitter type='constant'/>{shapes}</scene>"
    )
}

/// A crop has other paths side by side in a block of sixteen lanes. That changes no bit.
#[test]
fn a_crop_has_the_very_pixels_of_media() {
    for bodies_only in [true, false] {
        let folder = Folder::with(&with_media(bodies_only));
        for integrator in ["volpath", "bdpt"] {
            let options = format!("--integrator {integrator} --spp 8");
            let whole = picture(&folder, "whole", &options);
            for (x, y, width, height) in [(7, 5, 20, 19), (20, 15, 3, 2)] {
                let crop = picture(&folder, "crop", &format!("{options} --crop {x},{y},{width},{height}"));
                let part = whole.crop(x, y, width, height).expect("the crop is inside");
                assert_eq!(bits(&crop), bits(&part), "{integrator}, {x},{y},{width},{height}");
            }
        }
    }
}

/// A crop has exactly the pixels of the whole image, also for samplers whose pixels depend on each other.
#[test]
fn a_crop_has_the_very_pixels_of_the_whole_with_every_sampler() {
    let folder = Folder::new();
    for sampler in SamplerKind::ALL {
        let options = format!("--spp 4 --sampler {sampler}");
        let whole = picture(&folder, "whole", &options);
        let crop = picture(&folder, "crop", &format!("{options} --crop 7,5,20,19"));
        assert_eq!(bits(&crop), bits(&whole.crop(7, 5, 20, 19).expect("the crop is inside")), "{sampler}");
    }
}

/// Caches, photons, light paths and chains are those of the whole image.
#[test]
fn a_crop_has_the_very_pixels_of_the_whole_with_every_integrator() {
    let path = r#"<integrator type="path"><integer name="max_depth" value="6"/></integrator>"#;
    for integrator in Settings::NAMES.iter().copied() {
        let settings = match integrator {
            "photonmapper" => {
                r#"<integer name="global_photons" value="4000"/><integer name="caustic_photons" value="2000"/>"#
            }
            "aov" => r#"<string name="aovs" value="depth:depth"/>"#,
            _ => "",
        };
        let chosen = format!(r#"<integrator type="{integrator}">{settings}</integrator>"#);
        let folder = Folder::with(&SCENE.replace(path, &chosen));
        let whole = picture(&folder, "whole", "--spp 2");
        let crop = picture(&folder, "crop", "--spp 2 --crop 7,5,20,19");
        assert_eq!(bits(&crop), bits(&whole.crop(7, 5, 20, 19).expect("the crop is inside")), "{integrator}");
    }
}

#[test]
fn seeds_and_samplers_differ_and_estimate_the_same_picture() {
    let folder = Folder::new();
    let options = "--spp 256 --aov variance";
    let first = picture(&folder, "first", options);
    let others = [
        "--seed 1",
        "--seed 4294967296",
        "--sampler stratified",
        "--sampler independent",
        "--sampler zsobol",
    ];
    for other in others {
        let image = picture(&folder, "other", &format!("{options} {other}"));
        assert_ne!(bits(&image), bits(&first), "{other}");
        let noisy = first.channel("variance.R").expect("the layer is there");
        let pixels = image.data.chunks(6).zip(first.data.chunks(6)).filter(|(_, b)| b[noisy] > 0.0);
        let (same, all) =
            pixels.fold((0, 0), |(same, all), (a, b)| (same + u32::from(a[0] == b[0]), all + 1));
        assert!(all > 500 && same < all / 20, "{other}: {same} of {all} noisy pixels are the same");
        let relmse = picture_error(&image, &first);
        assert!(relmse < 0.02, "{other}: {relmse}");
    }
}

/// Returns the relMSE between two images.
fn picture_error(a: &Image, b: &Image) -> f64 {
    compare(a, b).expect("images of one size").layers[0].relmse
}

#[test]
fn every_traversal_gives_the_same_picture() {
    let folder = Folder::new();
    let images: Vec<Image> = AccelKind::CHOICES
        .iter()
        .map(|kind| picture(&folder, &kind.to_string(), &format!("--accel {kind} --spp 64 --aov variance,Z")))
        .collect();
    for image in &images[1..] {
        let comparison = compare(image, &images[0]).expect("images of one size");
        assert_eq!(comparison.layers.len(), 2);
        // The paths are the same except for rounding at edges, so the difference is far below the noise.
        let (picture, noise) = (&comparison.layers[0], 1e-3);
        assert!(picture.relmse < noise, "relMSE {}", picture.relmse);
        assert!((picture.mean_ratio - 1.0).abs() < 1e-3, "ratio {}", picture.mean_ratio);
        let z = z_test(image, &images[0], None, 0.01).expect("variances are there");
        assert!(z.passes() && z.rms < 0.5, "{z:?}");
    }
}

/// Sorting a wave by what its rays hit changes the order of the work, but no path.
#[test]
fn sorted_waves_have_the_pixels_of_unsorted_ones() {
    for reuse in [WhenPays::Never, WhenPays::Always] {
        for file in ["interior/interior.xml", "spheres/spheres.xml"] {
            let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(file);
            let mut loaded = load(&file, &LoadOptions::default()).expect("the scene loads");
            let film = &mut loaded.description.sensors[0].film;
            (film.width, film.height, film.crop) = (48, 48, None);
            let mut scene = scenes::compiled(loaded.description, AccelKind::default());
            assert!(!scene.shading_buckets.is_empty());
            let settings =
                Settings::Path(PathSettings { reuse, ..PathSettings::independent(PathLimits::default()) });
            let image = |scene: &Scene| {
                let rendered = scenes::render(scene, &settings, SamplerKind::Sobol, 8, 1);
                scenes::pixels(&rendered).into_iter().map(|rgb| rgb.map(f64::to_bits)).collect::<Vec<_>>()
            };
            let sorted = image(&scene);
            scene.shading_buckets.clear();
            assert!(image(&scene) == sorted, "{}, {reuse:?}", file.display());
        }
    }
}

/// Returns the sums of a 16×16 tile after the given passes.
fn sums(job: &Job<'_>, passes: &[u64]) -> Vec<(u64, u64)> {
    let mut tile = Tile::new(PixelRect { x: 16, y: 3, width: 16, height: 16 }, 3, 2);
    let mut worker = CameraWorker::new(Worker::new(job.settings.sampler));
    let edges = EmitterEdges::new(job, 1, &mut worker);
    let edges = edges.as_ref().map(|edges| edges.of_tile(job, 0, tile.rect(), &mut worker));
    let edges = edges.unwrap_or_default();
    let mut done = 0;
    for pass in passes {
        worker.render_tile(job, &mut tile, edges, done..done + pass);
        done += pass;
    }
    let values = (0..tile.pixel_count()).flat_map(|i| (0..3).map(move |c| (i, c)));
    values.map(|(i, c)| (tile.estimate(i, c).mean.to_bits(), tile.count(i))).collect()
}

#[test]
fn passes_change_no_bit() {
    let folder = Folder::new();
    let loaded = load(&folder.path("s.xml"), &LoadOptions::default()).expect("the scene loads");
    let scene = scenes::compiled(loaded.description, AccelKind::default());
    let direct = Settings::Direct(integrator::settings::DirectSettings {
        emitter_samples: 2,
        bsdf_samples: 3,
        hide_emitters: false,
    });
    for settings in [loaded.integrator, direct] {
        for kind in SamplerKind::ALL {
            let integrator = settings.create();
            let progress = Progress::new();
            let stop = StopRules { samples: Some(64), ..StopRules::default() };
            let sampler = Sampler::new(kind, Some(64));
            let settings =
                JobSettings { sampler, seed: 5, threads: 1, stop, layers: Vec::new(), squared_bias: None };
            let job = Job::new(&scene, integrator.as_ref(), &scene.sensors[0], settings, &progress);
            let at_once = sums(&job, &[64]);
            for passes in [&[2, 2, 4, 8, 16, 32][..], &[1, 1, 1, 5, 55, 1], &[63, 1]] {
                assert_eq!(sums(&job, passes), at_once, "{kind}, {passes:?}");
            }
            let whole = job.run().expect("the threads start");
            let in_job: Vec<u64> = (16..32).map(|x| pixel_bits(&whole.tiles, x, 3)).collect();
            let in_tile: Vec<u64> = (0..16).map(|i| at_once[3 * i].0).collect();
            assert_eq!(in_job, in_tile, "{kind}: the job's own passes");
        }
    }
}

/// Returns the bits of the red mean of a pixel.
fn pixel_bits(tiles: &[Tile], x: u32, y: u32) -> u64 {
    let tile = tiles
        .iter()
        .find(|t| {
            (t.rect.x..t.rect.x + t.rect.width).contains(&x)
                && (t.rect.y..t.rect.y + t.rect.height).contains(&y)
        })
        .expect("every pixel is in a tile");
    tile.estimate(((y - tile.rect.y) * tile.rect.width + x - tile.rect.x) as usize, 0).mean.to_bits()
}
