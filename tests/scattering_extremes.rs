//! All BSDFs at the ends of their parameters, directions and random numbers.

use crate::support::bsdfs::check_sample;
use buffon::bsdf::microfacet::{Distribution, Microfacets};
use buffon::bsdf::{
    Bsdf, Lobe, Plastic, Principled, PrincipledThin, RoughDielectric, RoughPlastic, RoughTransmittance,
    ThinDielectric,
};
use buffon::color::Rgb;
use buffon::math::{Vec2, Vec3};

const LAST: f32 = 1f32.next_down();
const COLORS: [Rgb; 3] = [Rgb::BLACK, Rgb::WHITE, Rgb::new(0.0, 0.0, 1.0)];
const ETAS: [f32; 6] = [0.4, 1.0 / 1.5, 1.0, 1.000_3, 1.5, 4.0];

/// Checks for finite weights and values and positive densities. For broad lobes, samples and evaluation must agree.
fn check(bsdf: &Bsdf, broad: bool) {
    let cosines = [1.0, 0.5, 1e-3, 1e-6, 0.0, -1e-6, -1e-3, -0.5, -1.0];
    let directions: Vec<Vec3> = cosines
        .iter()
        .flat_map(|&z: &f32| {
            let r = (1.0 - z * z).sqrt();
            [Vec3::new(r, 0.0, z), Vec3::new(-r * 0.6, r * 0.8, z)]
        })
        .collect();
    for &wo in &directions {
        for u_lobe in [0.0, 0.3, 0.7, LAST] {
            for u in [[0.0, 0.0], [LAST, LAST], [0.0, LAST], [LAST, 0.0], [0.5, 0.5], [0.2, 0.9]] {
                let Some(s) = bsdf.sample(wo, u_lobe, Vec2::from(u)) else { continue };
                assert!(
                    s.weight.is_valid() && s.pdf > 0.0 && s.eta > 0.0,
                    "{bsdf:?} {wo} {u_lobe} {u:?}: {s:?}"
                );
                assert!((s.wi.length() - 1.0).abs() < 1e-5, "{bsdf:?} {wo} {u_lobe} {u:?}: {s:?}");
                // At the corners microfacets are grazing, and rounding decides on which side of their horizon light is.
                let inside = u.into_iter().all(|u| (0.1..=0.9).contains(&u));
                if broad && inside && s.lobe != Lobe::Specular && wo.z.abs() > 0.1 && s.wi.z.abs() > 0.01 {
                    check_sample(&format!("{bsdf:?} {wo}"), bsdf, wo, &s, 1e-2);
                }
            }
        }
        for &wi in &directions {
            let e = bsdf.eval(wo, wi);
            assert!(e.f.is_valid() && (0.0..f32::INFINITY).contains(&e.pdf), "{bsdf:?} {wo} {wi}: {e:?}");
            if !bsdf.transmits() && wo.z * wi.z < 0.0 {
                assert!(e.f.is_black() && e.pdf == 0.0, "{bsdf:?} {wo} {wi}: {e:?}");
            }
        }
    }
    assert!(bsdf.albedo().is_valid(), "{bsdf:?}: {:?}", bsdf.albedo());
}

fn facets(distribution: Distribution, alpha: f32, sample_visible: bool) -> Microfacets {
    Microfacets { distribution, alpha_x: alpha, alpha_y: alpha, sample_visible }
}

#[test]
fn dielectrics() {
    for eta in ETAS {
        for (specular_reflectance, specular_transmittance) in COLORS.into_iter().zip(COLORS.into_iter().rev())
        {
            check(
                &Bsdf::ThinDielectric(ThinDielectric {
                    eta,
                    specular_reflectance,
                    specular_transmittance,
                    passing: 0.0,
                }),
                true,
            );
            for distribution in [Distribution::Beckmann, Distribution::Ggx] {
                for alpha in [1e-4, 0.1, 1.0] {
                    for visible in [true, false] {
                        let microfacets = facets(distribution, alpha, visible);
                        let glass = RoughDielectric {
                            microfacets,
                            eta,
                            specular_reflectance,
                            specular_transmittance,
                        };
                        let resolved = !(0.9..1.1).contains(&eta);
                        check(&Bsdf::RoughDielectric(glass), alpha >= 0.1 && resolved);
                    }
                }
            }
        }
    }
}

#[test]
fn plastics() {
    for eta in [0.4, 1.0 / 1.5, 1.0, 1.000_3, 1.5, 3.0] {
        for (diffuse, specular) in COLORS.into_iter().zip(COLORS.into_iter().rev()) {
            check(&Bsdf::Plastic(Plastic::new(diffuse, specular, eta, true)), true);
            check(&Bsdf::Plastic(Plastic::new(diffuse, specular, eta, false)), true);
        }
    }
    for (distribution, alpha, eta) in [
        (Distribution::Beckmann, 1e-4, 1.5),
        (Distribution::Ggx, 1.0, 2.4),
        (Distribution::Ggx, 1e-4, 1.000_3),
        (Distribution::Beckmann, 0.3, 0.7),
    ] {
        let transmittance = RoughTransmittance::new(distribution, alpha, eta);
        for visible in [true, false] {
            for diffuse_reflectance in COLORS {
                check(
                    &Bsdf::RoughPlastic(RoughPlastic {
                        microfacets: facets(distribution, alpha, visible),
                        diffuse_reflectance,
                        specular_reflectance: Rgb::WHITE,
                        eta,
                        nonlinear: false,
                        transmittance: &transmittance,
                    }),
                    true,
                );
            }
        }
    }
}

#[test]
fn principled_models() {
    for bits in 0..1u32 << 10 {
        let on = |bit: u32| (bits >> bit & 1) as f32;
        let base_color = COLORS[bits as usize % 3];
        let eta = ETAS[bits as usize % ETAS.len()];
        check(
            &Bsdf::Principled(Principled {
                base_color,
                roughness: on(0),
                anisotropy: on(1),
                metallic: on(2),
                spec_trans: on(3),
                eta,
                spec_tint: on(4),
                sheen: on(5),
                sheen_tint: on(6),
                flatness: on(7),
                clearcoat: on(8),
                clearcoat_gloss: on(9),
            }),
            true,
        );
        check(
            &Bsdf::PrincipledThin(PrincipledThin {
                base_color,
                roughness: on(0),
                anisotropy: on(1),
                spec_trans: on(2),
                eta,
                spec_tint: on(3),
                sheen: on(4),
                sheen_tint: on(5),
                flatness: on(6),
                diff_trans: on(7) + on(8),
            }),
            true,
        );
    }
}
