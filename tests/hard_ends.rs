//! Hard cases of sampling: filters, BSDFs, emitters and cameras with random numbers at the ends of their range.

use crate::hard_sampling::{LAST, squares};
use crate::support::bsdfs::{plain_models, transmittances, wrapped};
use crate::support::scenes;
use buffon::accel::AccelKind;
use buffon::bsdf::{Bsdf, BsdfSample, Lobe};
use buffon::color::Rgb;
use buffon::emitter::{Emitter, EmitterHit, EnvMap, Light};
use buffon::film::{Filter, FilterSampler};
use buffon::ids::TextureId;
use buffon::image::TextureImage;
use buffon::material::Input;
use buffon::math::{Affine2, DAffine3, DVec3, Ray, Vec2, Vec3};
use buffon::scene::{Description, Scene};
use buffon::sensor::{Camera, Projection, SensorSettings, ThinLens};
use buffon::shape::{Mesh, Shape};
use buffon::texture::{Bitmap, FilterType, Texture, WrapMode};
use std::sync::Arc;

#[test]
fn every_filter_keeps_to_its_radius_at_the_ends() {
    for filter in [
        Filter::Box { radius: 0.5 },
        Filter::Tent { radius: 1.0 },
        Filter::Gaussian { stddev: 0.5 },
        Filter::Gaussian { stddev: 1e-3 },
        Filter::Mitchell { b: 1.0 / 3.0, c: 1.0 / 3.0 },
        Filter::CatmullRom,
        Filter::Lanczos { lobes: 3 },
    ] {
        let sampler = FilterSampler::new(filter);
        for u in squares() {
            let s = sampler.sample(u);
            let reach = s.offset.abs().max_element();
            assert!(reach <= filter.radius() as f32, "{filter:?} at {u}: {}", s.offset);
            assert!(s.weight.is_finite() && s.weight != 0.0, "{filter:?} at {u}: {}", s.weight);
            let value = sampler.eval(s.offset.as_dvec2());
            assert!(value.is_finite(), "{filter:?} at {u}: {value}");
            // The filter has one sign in a cell of the table, but may be zero at the ends of the cell.
            let inner = sampler.eval(s.offset.as_dvec2() * 0.999);
            assert!(value * s.weight >= 0.0 || inner * s.weight >= 0.0, "{filter:?} at {u}: {value}");
        }
    }
}

/// Checks that a sample is finite, has unit length, and has the density and weight of its evaluation.
fn check_sample(what: &str, bsdf: &Bsdf<'_>, wo: Vec3, s: &BsdfSample) {
    assert!((s.wi.length() - 1.0).abs() < 1e-5 && s.weight.is_valid() && s.pdf > 0.0, "{what}: {s:?}");
    assert!(bsdf.transmits() || s.wi.z * wo.z >= 0.0, "{what}: {s:?}");
    if s.lobe == Lobe::Specular {
        assert_eq!(s.pdf, f32::INFINITY, "{what}: {s:?}");
        return;
    }
    let e = bsdf.eval(wo, s.wi);
    // Grazing directions may be below the horizon by a rounding error.
    if s.wi.z.abs() < 1e-3 {
        return;
    }
    assert!((e.pdf / s.pdf - 1.0).abs() < 2e-2, "{what}: density {} and {} at {}", s.pdf, e.pdf, s.wi);
    let weight = e.f * (s.wi.z.abs() / e.pdf);
    for c in 0..3 {
        let off = (weight[c] - s.weight[c]).abs();
        assert!(off <= 2e-2 * weight[c].max(s.weight[c]) + 1e-6, "{what}: {weight:?} and {:?}", s.weight);
    }
}

#[test]
fn every_bsdf_samples_the_ends_of_its_square() {
    let transmittance = transmittances();
    let plain = plain_models(&transmittance);
    let all = wrapped(&plain);
    let (mut drawn, mut none) = (0, 0);
    for bsdf in &all {
        for wo in
            [Vec3::Z, Vec3::new(0.6, 0.0, 0.8), Vec3::new(-0.5, 0.7, 0.509_9), Vec3::new(0.1, 0.2, -0.974_7)]
        {
            let wo = wo.normalize();
            for u_lobe in [0.0, 0.3, 0.7, LAST] {
                for u in squares() {
                    match bsdf.sample(wo, u_lobe, u) {
                        Some(s) => {
                            drawn += 1;
                            check_sample(&format!("{bsdf:?}, {wo}, {u_lobe}, {u}"), bsdf, wo, &s);
                        }
                        None => none += 1,
                    }
                }
            }
        }
    }
    println!("{} models: {drawn} samples at the ends, {none} without any", all.len());
    assert!(drawn > 2 * none, "{drawn} {none}");
}

/// Returns a scene with an emitter of each kind, with and without texture.
fn lights() -> Scene {
    let mut d = Description::default();
    let values = (0..12).map(|i| if i == 5 { 0.0 } else { 0.2 + i as f32 }).collect();
    let image = Arc::new(TextureImage::from_floats(4, 3, 1, values).expect("a picture"));
    let bitmap = Bitmap::new(image.clone(), FilterType::Bilinear, WrapMode::Repeat, Affine2::IDENTITY);
    d.textures.push(Arc::new(Texture::Bitmap(bitmap)));
    let corners = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.3], [0.0, 1.0, 0.2], [0.5, 0.5, 2.0]];
    let mesh = Mesh {
        positions: corners.map(Vec3::from).to_vec(),
        indices: vec![[0, 1, 2], [1, 3, 2]],
        ..Mesh::default()
    };
    let tube = Shape::Cylinder { p0: Vec3::ZERO, p1: Vec3::new(0.3, 0.2, 1.0), radius: 0.4 };
    let shapes = [Shape::Rectangle, scenes::sphere(0.7), Shape::Disk, tube, Shape::Mesh(mesh), Shape::Cube];
    for (i, shape) in shapes.into_iter().enumerate() {
        for textured in [false, true] {
            let place =
                DAffine3::from_translation(DVec3::new(4.0 * i as f64, if textured { 4.0 } else { 0.0 }, 0.0))
                    * DAffine3::from_rotation_x(0.4);
            let id = scenes::add(&mut d, shape.clone(), place, scenes::diffuse(0.5));
            d.shapes[id].emission = Some(match textured {
                true => Input::Texture(TextureId(0)),
                false => Rgb::WHITE.into(),
            });
        }
    }
    let place = DAffine3::from_translation(DVec3::new(0.0, 0.0, 5.0)) * DAffine3::from_rotation_x(3.0);
    d.emitters = vec![
        Emitter::Point { position: Vec3::Z, intensity: Rgb::WHITE },
        Emitter::Spot {
            to_world: place,
            intensity: Rgb::WHITE,
            texture: None,
            cutoff_angle: 0.5,
            beam_width: 0.4,
        },
        Emitter::Spot {
            to_world: place,
            intensity: Rgb::WHITE,
            texture: Some(TextureId(0)),
            cutoff_angle: 1.5,
            beam_width: 1.5,
        },
        Emitter::Directional { direction: -Vec3::Z, irradiance: Rgb::WHITE },
        Emitter::Projector {
            to_world: place,
            irradiance: TextureId(0),
            scale: 1.0,
            half_extents: [0.3, 0.2],
        },
        Emitter::EnvironmentMap(Arc::new(
            EnvMap::new(TextureImage::clone(&image), 1.0, &DAffine3::IDENTITY).expect("a map"),
        )),
        Emitter::Sun { direction: Vec3::Y, half_angle: 0.2, up: Vec3::Y, radiance: Rgb::WHITE },
    ];
    scenes::compiled(d, AccelKind::default())
}

#[test]
fn every_emitter_samples_the_ends_of_its_square() {
    let scene = lights();
    let receivers =
        [[0.1, 0.2, 3.0], [0.0, 0.0, 1.001], [2.0, 2.0, 2.0], [1e4, 3.0, -20.0], [0.0, -3.0, 1.0]];
    for (i, light) in scene.lights.iter().enumerate() {
        let (mut drawn, mut compared, mut differ) = (0, 0, 0);
        for u in squares() {
            for from in receivers.map(Vec3::from) {
                let Some(s) = light.sample(from, u, 0.0) else { continue };
                drawn += 1;
                let what = format!("{} {i} from {from} at {u}: {s:?}", light.kind());
                assert!((s.wi.length() - 1.0).abs() < 1e-5 && s.radiance.is_valid(), "{what}");
                assert!(s.pdf > 0.0 && s.pdf.is_finite(), "{what}");
                let pdf = match light {
                    Light::Environment(environment) => environment.pdf(s.wi),
                    // Rounding moves samples over the edge of the disc.
                    Light::Sun(_) if light.distant_pdf(s.wi, false) == 0.0 => continue,
                    Light::Sun(_) => light.distant_pdf(s.wi, false),
                    Light::Area(area) => {
                        // A ray to a point on the edge may miss, or hit another surface.
                        let ray = Ray::new(from, s.wi);
                        let Some(hit) = scene.accel.intersect(&ray) else { continue };
                        let at = scene.interaction(&ray, &hit);
                        if scene.emitter_at(&at).map(|e| e.index()) != Some(i) {
                            continue;
                        }
                        let place = EmitterHit { p: at.p, n: at.ng, hit, local: at.p, time: 0.0 };
                        area.pdf(from, &place)
                    }
                    _ => {
                        assert!(s.delta && s.pdf == 1.0, "{what}");
                        continue;
                    }
                };
                compared += 1;
                // The edge of a texel or triangle may be between the sample and the hit.
                assert!(pdf > 0.0 && pdf.is_finite(), "{what}: density {pdf}");
                differ += usize::from((pdf / s.pdf - 1.0).abs() > if from.x > 1e3 { 0.1 } else { 1e-2 });
            }
            for v in squares() {
                for ray in [light.sample_ray(u, v, 0.0), light.sample_ray_by_direction(u, v, 0.0)] {
                    let Some(ray) = ray else { continue };
                    let what = format!("{} {i} at {u} {v}: {ray:?}", light.kind());
                    assert!(ray.power.is_valid() && ray.ray.o.is_finite(), "{what}");
                    assert!((ray.ray.d.length() - 1.0).abs() < 1e-5, "{what}");
                }
            }
        }
        println!("{} {i}: {drawn} samples, {compared} densities compared, {differ} differ", light.kind());
        // Half of these samples are on edges, at which the ray may hit the adjacent face of a cube.
        assert!(differ * 4 <= compared, "{} {i}: {differ} of {compared} densities differ", light.kind());
        assert!(drawn > 0, "{} {i}", light.kind());
        assert!(
            compared > 0 || !matches!(light, Light::Area(_) | Light::Environment(_) | Light::Sun(_)),
            "{} {i}",
            light.kind()
        );
    }
}

#[test]
fn every_camera_makes_rays_of_the_ends_of_film_and_lens() {
    let base = scenes::camera(DVec3::new(1.0, 2.0, 3.0), DVec3::ZERO, 40.0, 16);
    let lens = Some(ThinLens { aperture_radius: 0.1, focus_distance: 3.0 });
    let parallel = SensorSettings { projection: Projection::Orthographic, ..base.clone() };
    let spherical = SensorSettings { projection: Projection::Spherical, ..base.clone() };
    for settings in [base.clone(), SensorSettings { lens, ..base.clone() }, parallel, spherical] {
        let camera = Camera::new(&settings).expect("a camera");
        let mut corners = vec![0.0, 1e-30, 8.0, 16f32.next_down(), 16.0, -2.0, 18.0];
        // The left border of all directions is the right one, and each corner is a pole.
        if settings.projection == Projection::Spherical {
            corners = vec![0.1, 8.0, 15.9];
        }
        for p in corners.iter().flat_map(|x| corners.iter().map(|y| Vec2::new(*x, *y))) {
            for u in squares() {
                for time in [0.0, 0.5, LAST] {
                    let ray = camera.ray(p.as_dvec2(), u, time);
                    let fine = ray.o.is_finite() && (ray.d.length() - 1.0).abs() < 1e-6 && ray.t_max > 0.0;
                    assert!(fine, "{} {p} {u} {time}: {ray:?}", settings.kind());
                    // A point on the ray projects to the film position of the ray.
                    let at = ray.at(5.0);
                    let Some(seen) = camera.importance(at, u, time, 4.0) else {
                        panic!("{} {p} {u}: {at} is not seen", settings.kind())
                    };
                    assert!(
                        (seen.film - p.as_dvec2()).abs().max_element() < 2e-4,
                        "{} {p} {u}: {}",
                        settings.kind(),
                        seen.film
                    );
                    assert!(seen.weight > 0.0 && seen.weight.is_finite(), "{} {p} {u}", settings.kind());
                }
            }
        }
    }
}
