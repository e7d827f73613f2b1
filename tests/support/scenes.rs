//! Scenes built in code, and their rendering.

use buffon::accel::AccelKind;
use buffon::color::Rgb;
use buffon::emitter::Emitter;
use buffon::film::tile::variance_of_mean;
use buffon::film::{ComponentFormat, FilmSettings, Filter, PixelFormat};
use buffon::ids::MaterialId;
use buffon::image::Image;
use buffon::integrator::settings::WhenPays;
use buffon::integrator::{self, Preparation, Settings};
use buffon::material::{Diffuse, Material};
use buffon::math::{DAffine3, DMat3, DVec3, Vec3};
use buffon::medium::MediumBoundary;
use buffon::memory::Budget;
use buffon::render::output::replicate_images;
use buffon::render::{Job, JobSettings, Progress, Rendered, StopRules, thread_pool};
use buffon::sampling::{Sampler, SamplerKind};
use buffon::scene::description::{Description, PlacedShape};
use buffon::scene::{CompileOptions, Scene, compile};
use buffon::sensor::{FovAxis, Projection, SensorSettings};
use buffon::shape::Shape;

/// Adds a shape with its own material and returns its index.
pub fn add(scene: &mut Description, shape: Shape, to_world: DAffine3, material: Material) -> usize {
    let id = MaterialId::from(scene.materials.len());
    scene.materials.push(material);
    scene.shapes.push(PlacedShape {
        name: String::new(),
        place: None,
        shape,
        to_world: to_world.into(),
        flip_normals: false,
        material: id,
        emission: None,
        boundary: MediumBoundary::default(),
    });
    scene.shapes.len() - 1
}

/// Returns a grey diffuse material.
pub fn diffuse(reflectance: f32) -> Material {
    Material::Diffuse(Diffuse { reflectance: Rgb::splat(reflectance).into() })
}

/// Returns a sphere around the origin.
pub fn sphere(radius: f32) -> Shape {
    Shape::Sphere { center: Vec3::ZERO, radius }
}

/// Returns a constant environment.
pub fn constant(radiance: f32) -> Emitter {
    Emitter::Constant { radiance: Rgb::splat(radiance) }
}

/// Returns a camera at `eye`, directed towards `target`, with a small square image.
pub fn camera(eye: DVec3, target: DVec3, fov_degrees: f64, size: u32) -> SensorSettings {
    let z = (target - eye).normalize();
    let up = if z.y.abs() > 0.99 { DVec3::Z } else { DVec3::Y };
    let x = up.cross(z).normalize();
    SensorSettings {
        name: String::new(),
        to_world: DAffine3::from_mat3_translation(DMat3::from_cols(x, z.cross(x), z), eye).into(),
        projection: Projection::Perspective {
            fov: fov_degrees.to_radians(),
            fov_axis: FovAxis::X,
            principal_point_offset: [0.0; 2],
        },
        lens: None,
        shutter: [0.0; 2],
        near_clip: 1e-4,
        far_clip: 1e30,
        film: FilmSettings {
            width: size,
            height: size,
            crop: None,
            filter: Filter::Box { radius: 0.5 },
            pixel_format: PixelFormat::Rgb,
            component_format: ComponentFormat::Float,
            for_display: false,
        },
        medium: None,
    }
}

/// Compiles a scene in which panes scatter all rays.
pub fn compiled(description: Description, accel: AccelKind) -> Scene {
    compile(description, CompileOptions { accel, threads: 2, sensor: 0, passes_panes: false })
        .expect("the test scene compiles")
        .0
}

/// Renders the scene's first sensor. Paths are reused and light paths find caustics only if the settings say `always`,
/// because the errors of means assume pixels with independent errors.
pub fn render(scene: &Scene, settings: &Settings, sampler: SamplerKind, spp: u64, seed: u64) -> Rendered {
    let mut settings = settings.clone();
    if let Some(path) = settings.path_mut() {
        for option in [&mut path.reuse, &mut path.caustics] {
            if *option == WhenPays::Auto {
                *option = WhenPays::Never;
            }
        }
    }
    let mut integrator = settings.create();
    let progress = Progress::new();
    let replicates = integrator::replicates(integrator.as_ref(), sampler);
    let sampler = Sampler::with_replicates(sampler, Some(spp), replicates);
    let pool = thread_pool(2).expect("the threads start");
    let preparation = Preparation {
        scene,
        camera: &scene.sensors[0],
        sampler,
        seed,
        pool: &pool,
        interrupt: &buffon::integrator::Interrupt::default(),
        cache: None,
        memory: &Budget::unlimited(),
    };
    integrator.prepare(&preparation).expect("nothing is read or written");
    let job = JobSettings {
        sampler,
        seed,
        threads: 2,
        stop: StopRules { samples: Some(spp), ..StopRules::default() },
        layers: Vec::new(),
        squared_bias: None,
    };
    Job::new(scene, integrator.as_ref(), &scene.sensors[0], job, &progress).run_with(pool)
}

/// Returns the mean over the image of each channel, and an estimate of its standard error from the replicates.
pub fn mean(rendered: &Rendered) -> ([f64; 3], [f64; 3]) {
    let (mut mean, mut variance, mut n) = ([0.0; 3], [0.0; 3], 0.0);
    for tile in &rendered.tiles {
        for i in 0..tile.pixel_count() {
            for c in 0..3 {
                let estimate = tile.estimate(i, c);
                mean[c] += estimate.mean;
                variance[c] += estimate.variance.unwrap_or(0.0);
            }
            n += 1.0;
        }
    }
    let images = replicate_images(rendered);
    if images.len() > 2 {
        let sum = |image: &Image, c: usize| image.data.chunks_exact(3).map(|p| f64::from(p[c])).sum::<f64>();
        variance = [0, 1, 2]
            .map(|c| variance_of_mean(images.iter().map(|i| sum(i, c))).expect("several replicates"));
    }
    (mean.map(|m| m / n), variance.map(|v| v.sqrt() / n))
}

/// Returns the means of the pixels, row by row.
pub fn pixels(rendered: &Rendered) -> Vec<[f64; 3]> {
    let rect = rendered.rect;
    let mut image = vec![[0.0; 3]; (rect.width * rect.height) as usize];
    for tile in &rendered.tiles {
        for i in 0..tile.pixel_count() {
            let (x, y) = tile.position(i);
            let pixel = &mut image[((y - rect.y) * rect.width + x - rect.x) as usize];
            *pixel = [0, 1, 2].map(|c| tile.estimate(i, c).mean);
        }
    }
    image
}
