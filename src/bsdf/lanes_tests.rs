//! Tests: the lanes of kernels compute what the BSDFs do one by one.

use super::Bsdf;
use super::lanes::*;
use crate::bsdf::fresnel::ConductorFresnel;
use crate::bsdf::microfacet::{Distribution, Microfacets};
use crate::bsdf::{
    Blend, Conductor, Dielectric, Diffuse, Plastic, Principled, RoughConductor, RoughDielectric,
    RoughPlastic, RoughTransmittance, Tilted,
};
use crate::color::Rgb;
use crate::math::lanes::{LANES, Vec3x16, f32x16};
use crate::math::{Frame, Vec2, Vec3};
use crate::sampling::hash::{combine, to_unit};

/// A lane with glass does not change the results of the diffuse lanes.
#[test]
fn lanes_are_independent() {
    let diffuse = Bsdf::Diffuse(Diffuse { reflectance: Rgb::new(0.2, 0.4, 0.8) });
    let glass = Bsdf::Dielectric(Dielectric {
        eta: 1.5,
        specular_reflectance: Rgb::WHITE,
        specular_transmittance: Rgb::WHITE,
    });
    let mut bsdfs = [&diffuse; LANES];
    bsdfs[3] = &glass;
    let mut wo = Vec3x16::splat(Vec3::new(0.6, 0.0, 0.8));
    wo.set_lane(5, Vec3::new(0.6, 0.0, -0.8));
    let wi = Vec3x16::splat(Vec3::new(0.0, 0.28, 0.96));
    let (u_lobe, u) = (0.9, Vec2::new(0.3, 0.7));
    let eval = eval_x16(&bsdfs, &wo, &wi, 0xffff);
    let splat = [f32x16::splat(u.x), f32x16::splat(u.y)];
    let sample = sample_x16(&bsdfs, &wo, f32x16::splat(u_lobe), splat, 0xffff);
    for (i, bsdf) in bsdfs.into_iter().enumerate() {
        let alone = bsdf.eval(wo.lane(i), wi.lane(i));
        assert_eq!(
            (eval.f.map(|c| c.as_array()[i]), eval.pdf.as_array()[i]),
            (alone.f.to_array(), alone.pdf)
        );
        let alone = bsdf.sample(wo.lane(i), u_lobe, u);
        assert_eq!(sample.valid.to_bitmask() >> i & 1 == 1, alone.is_some(), "lane {i}");
        if let Some(alone) = alone {
            assert_eq!(sample.wi.lane(i), alone.wi, "lane {i}");
            assert_eq!(sample.weight.map(|c| c.as_array()[i]), alone.weight.to_array());
            assert_eq!((sample.pdf.as_array()[i], sample.eta.as_array()[i]), (alone.pdf, alone.eta));
        }
    }
}

/// Light that is nearly parallel to the surface, but not to the perturbed one, without shadowing.
#[test]
fn light_along_the_surface_lights_a_perturbed_normal() {
    let diffuse = Bsdf::Diffuse(Diffuse { reflectance: Rgb::WHITE });
    let frame = Frame::from_normal(Vec3::new(0.6, 0.0, 0.8));
    let tilted = Bsdf::Tilted(Tilted { frame, soften: false, inner: &diffuse, turned: None });
    let wi = Vec3::new(1.0, 0.0, 1e-30);
    let alone = tilted.eval(Vec3::Z, wi);
    let lanes = eval_x16(&[&tilted; LANES], &Vec3x16::splat(Vec3::Z), &Vec3x16::splat(wi), 0xffff);
    for f in [alone.f.r, lanes.f[0].as_array()[7]] {
        assert!((f * wi.z * std::f32::consts::PI - 0.6).abs() < 1e-6, "{f}");
    }
}

/// Returns a BSDF around a normal, with shadowing in every other lane.
fn tilted<'a>(normal: Vec3, lane: usize, inner: &'a Bsdf<'a>) -> Tilted<'a> {
    Tilted { frame: Frame::from_normal(normal), soften: lane.is_multiple_of(2), inner, turned: None }
}

/// Returns a BSDF that contains that of a lane, or that BSDF itself if the kind is neither 0 nor 1.
fn container<'a>(
    kind: usize,
    lane: usize,
    inner: &'a [Bsdf<'a>],
    (normals, turned, weights): (&[Vec3; LANES], &'a [Tilted<'a>], &[f32; LANES]),
) -> Bsdf<'a> {
    match kind {
        0 => {
            let turned = lane.is_multiple_of(3).then_some(&turned[lane]);
            Bsdf::Tilted(Tilted { turned, ..tilted(normals[lane], lane, &inner[lane]) })
        }
        1 => {
            let bsdfs = [&inner[lane], &inner[(lane + 3) % LANES]];
            Bsdf::Blend(Blend { weight: weights[lane], bsdfs })
        }
        _ => inner[lane],
    }
}

/// The kernels compute what the BSDFs do one by one, within the rounding of their functions. The density of rough
/// boundaries decreases steeply with the angle between two directions, so the tolerance is 0.1 %.
#[test]
fn kernels_compute_what_the_bsdfs_do() {
    let mut seed = 0;
    let mut random = || {
        seed += 1;
        to_unit(combine(7, seed))
    };
    let close = |a: f32, b: f32| (a - b).abs() <= 1e-3 * a.abs().max(b.abs()) + 1e-12;
    let coats = [Distribution::Beckmann, Distribution::Ggx]
        .map(|distribution| RoughTransmittance::new(distribution, 0.2, 1.5));
    let fresnel = ConductorFresnel { eta: Rgb::new(0.2, 1.0, 0.0), k: Rgb::new(3.0, 2.0, 1.0) };
    let white = Rgb::new(1.0, 0.9, 0.3);
    let (mut sampled, mut different) = (0, 0);
    for round in 0..2000 {
        let mut alpha = || 0.02 + 0.9 * random() * random();
        let all: Vec<Bsdf<'_>> = (0..LANES)
            .map(|i| {
                let family = (i / 3 + round) % 2;
                let distribution = [Distribution::Beckmann, Distribution::Ggx][family];
                let (alpha_x, alpha_y) = (alpha(), alpha());
                let microfacets = Microfacets { distribution, alpha_x, alpha_y, sample_visible: true };
                let nonlinear = i % 2 == 0;
                match (i + round) % 9 {
                    0 => Bsdf::RoughConductor(RoughConductor {
                        microfacets,
                        fresnel,
                        specular_reflectance: white,
                    }),
                    1 => Bsdf::Conductor(Conductor { fresnel, specular_reflectance: white }),
                    2 => Bsdf::Plastic(Plastic::new(Rgb::new(0.5, 0.0, 0.9), white, 1.5, nonlinear)),
                    3 => Bsdf::RoughPlastic(RoughPlastic {
                        microfacets: Microfacets { alpha_x: 0.2, alpha_y: 0.2, ..microfacets },
                        diffuse_reflectance: Rgb::new(0.5, 0.0, 0.9),
                        specular_reflectance: white,
                        eta: 1.5,
                        nonlinear,
                        transmittance: &coats[family],
                    }),
                    kind @ (4 | 5) => Bsdf::Dielectric(Dielectric {
                        eta: [1.5, 0.8][kind - 4],
                        specular_reflectance: Rgb::new(0.5, 0.9, 0.3),
                        specular_transmittance: Rgb::new(1.0, 0.9, 0.2),
                    }),
                    8 => Bsdf::Principled(Principled {
                        base_color: Rgb::new(0.5, 0.9, 0.3),
                        roughness: alpha(),
                        anisotropy: alpha(),
                        metallic: alpha() - 0.02,
                        spec_trans: 0.0,
                        eta: 1.0 + alpha(),
                        spec_tint: if nonlinear { alpha() } else { 0.0 },
                        sheen: alpha(),
                        sheen_tint: alpha(),
                        flatness: alpha(),
                        clearcoat: alpha() - 0.02,
                        clearcoat_gloss: alpha(),
                    }),
                    kind => Bsdf::RoughDielectric(RoughDielectric {
                        microfacets,
                        eta: [1.5, 0.8][kind - 6],
                        specular_reflectance: Rgb::new(0.5, 0.9, 0.3),
                        specular_transmittance: Rgb::new(1.0, 0.9, 0.2),
                    }),
                }
            })
            .collect();
        let mut direction = || {
            let z = 2.0 * random() - 1.0;
            let (sin, cos) = (std::f32::consts::TAU * random()).sin_cos();
            let r = (1.0 - z * z).sqrt();
            Vec3::new(r * cos, r * sin, z)
        };
        let normals: [Vec3; LANES] =
            std::array::from_fn(|_| (Vec3::new(0.4, 0.4, 0.0) * direction() + Vec3::Z).normalize());
        let weights = std::array::from_fn(|i| [0.0, 1.0, direction().z.abs(), 0.3][i % 4]);
        let turned: Vec<Tilted<'_>> = (0..LANES)
            .map(|i| tilted(normals[i] * Vec3::new(-1.0, -1.0, 1.0), i, &all[(i + 1) % LANES]))
            .collect();
        // Some BSDFs contain one that contains others.
        let inner: Vec<_> = (0..LANES)
            .map(|i| container((i / 2 + round) % 5, i, &all, (&normals, &turned, &weights)))
            .collect();
        let nested: Vec<_> = (0..LANES)
            .map(|i| container((i + round) % 7, i, &inner, (&normals, &turned, &weights)))
            .collect();
        let bsdfs = std::array::from_fn(|i| &nested[i]);
        let (mut wo, mut wi) = (Vec3x16::default(), Vec3x16::default());
        for i in 0..LANES {
            wo.set_lane(i, direction());
            wi.set_lane(i, direction());
        }
        let mut numbers = || f32x16::new(std::array::from_fn(|_| random()));
        let (u_lobe, u) = (numbers(), [numbers(), numbers()]);
        let eval = eval_x16(&bsdfs, &wo, &wi, 0xffff);
        let values = |eval: BsdfEvalX16| [eval.f[0], eval.f[1], eval.f[2], eval.pdf].map(f32x16::to_array);
        assert_eq!(values(BsdfX16::new(bsdfs, 0xffff).eval(&wo, &wi)), values(eval));
        // Parameters that are equal in all lanes are read once, and the result is the same.
        for (i, bsdf) in bsdfs.into_iter().enumerate() {
            let all = values(eval_x16(&[bsdf; LANES], &wo, &wi, 0xffff));
            assert_eq!(all.map(|v| v[i]), values(eval).map(|v| v[i]), "{bsdf:?}");
        }
        let sample = sample_x16(&bsdfs, &wo, u_lobe, u, 0xffff);
        let adjoint = sample_adjoint_x16(&bsdfs, &wo, u_lobe, u, 0xffff);
        let adjoint_pdf = pdf_adjoint_x16(&bsdfs, &wo, &wi, 0xffff).to_array();
        for (i, bsdf) in bsdfs.into_iter().enumerate() {
            assert!(close(adjoint_pdf[i], bsdf.pdf_adjoint(wo.lane(i), wi.lane(i))), "{bsdf:?}");
            let pair = Vec2::new(u[0].as_array()[i], u[1].as_array()[i]);
            let valid = adjoint.valid.to_bitmask() >> i & 1 == 1;
            different += u32::from(match bsdf.sample_adjoint(wo.lane(i), u_lobe.as_array()[i], pair) {
                Some(alone) => {
                    let weight = adjoint.weight.map(|c| c.as_array()[i]);
                    let near = |(a, b): (&f32, f32)| (a - b).abs() < 1e-3 * b.max(1.0);
                    !valid
                        || (adjoint.wi.lane(i) - alone.wi).length() >= 1e-3
                        || adjoint.eta.as_array()[i] != alone.eta
                        || adjoint.pdf.as_array()[i].is_infinite() != alone.pdf.is_infinite()
                        || !weight.iter().zip(alone.weight.to_array()).all(near)
                }
                None => valid,
            });
            let alone = bsdf.eval(wo.lane(i), wi.lane(i));
            let [r, g, b] = eval.f.map(|c| c.as_array()[i]);
            let same = close(r, alone.f.r) && close(g, alone.f.g) && close(b, alone.f.b);
            assert!(same && close(eval.pdf.as_array()[i], alone.pdf), "{bsdf:?}: {eval:?} {alone:?}");
            let u = Vec2::new(u[0].as_array()[i], u[1].as_array()[i]);
            let alone = bsdf.sample(wo.lane(i), u_lobe.as_array()[i], u);
            let valid = sample.valid.to_bitmask() >> i & 1 == 1;
            assert_eq!(valid, alone.is_some(), "{bsdf:?}");
            let Some(alone) = alone else { continue };
            sampled += 1;
            // A small error of the slope is a large one of the density in the tail.
            let wi = sample.wi.lane(i);
            let weight = sample.weight.map(|c| c.as_array()[i]);
            let near = (wi - alone.wi).length() < 1e-3
                && weight.iter().zip(alone.weight.to_array()).all(|(a, b)| (a - b).abs() < 1e-3);
            different += u32::from(!near);
            let here = bsdf.eval(wo.lane(i), wi);
            let pdf = sample.pdf.as_array()[i];
            if pdf.is_infinite() || alone.pdf.is_infinite() {
                assert_eq!(pdf, alone.pdf, "{bsdf:?}");
                continue;
            }
            assert!((pdf / here.pdf - 1.0).abs() < 0.02, "{bsdf:?} {}: {pdf} {}", wo.lane(i), here.pdf);
        }
    }
    assert!(sampled > 20_000 && different < sampled / 1000, "{sampled} samples, {different} different");
}
