//! BSDF evaluation and sampling for sixteen points at a time.
//!
//! Diffuse reflection, plastics, boundaries of conductors and dielectrics, and the principled model without
//! transmission are computed in parallel lanes, other BSDFs one lane after the other. The result of a lane does not
//! depend on the other lanes.

use super::conductor::ConductorX16;
use super::dielectric::DielectricX16;
use super::plastic::PlasticX16;
use super::principled_lanes::PrincipledX16;
use super::rough_conductor::RoughConductorX16;
use super::rough_dielectric::RoughDielectricX16;
use super::rough_plastic::RoughPlasticX16;
use super::{Bsdf, BsdfEval, BsdfSample};
use crate::color::Rgb;
use crate::math::Vec2;
use crate::math::lanes::{LANES, Vec3x16, bits, f32x16, mask_from_bits};
use crate::sampling::warp;
use std::f32::consts::FRAC_1_PI;

/// A [`BsdfEval`] in each of sixteen lanes.
#[derive(Clone, Copy, Debug)]
pub struct BsdfEvalX16 {
    /// The bare BSDF by channel, sr⁻¹.
    pub f: [f32x16; 3],
    /// Densities per unit solid angle.
    pub pdf: f32x16,
}

/// A [`BsdfSample`] in each of sixteen lanes.
#[derive(Clone, Copy, Debug)]
pub struct BsdfSampleX16 {
    /// The directions.
    pub wi: Vec3x16,
    /// `f·|cosθ|/pdf` by channel.
    pub weight: [f32x16; 3],
    /// Densities per unit solid angle; infinite for a specular lobe.
    pub pdf: f32x16,
    /// Relative indices of refraction.
    pub eta: f32x16,
    /// Mask of the lanes with a sample.
    pub valid: f32x16,
}

/// A BSDF of one kind in each of sixteen lanes.
pub(super) trait Kernel<'a>: Sized {
    /// The BSDF of one lane.
    type Scalar: 'a;

    /// Returns the BSDF if it is of this kind, with parameters that the kernel can have.
    fn of(bsdf: &'a Bsdf<'a>) -> Option<&'a Self::Scalar>;

    /// Returns whether two BSDFs of this kind can be in the same kernel.
    fn alike(_: &Self::Scalar, _: &Self::Scalar) -> bool {
        true
    }

    /// Creates the lanes.
    fn gather(lanes: &LaneBsdfs<'a, Self::Scalar>) -> Self;

    /// Computes [`Bsdf::eval`] in each lane.
    fn eval(&self, wo: &Vec3x16, wi: &Vec3x16) -> BsdfEvalX16;

    /// Computes [`Bsdf::sample`] in each lane.
    fn sample(&self, wo: &Vec3x16, u_lobe: f32x16, u: [f32x16; 2]) -> BsdfSampleX16;

    /// Gathers those lanes of the mask `rest` that are like the lane `first`; `None` if it is not of this kind.
    #[inline(always)]
    fn like(first: usize, bsdfs: &[&'a Bsdf<'a>; LANES], rest: u32) -> Option<(u32, Self)> {
        let one = Self::of(bsdfs[first])?;
        let mut lanes = rest;
        let mut like = LaneBsdfs { bsdfs: [one; LANES], equal: true };
        if !all_equal(bsdfs) {
            lanes = 0;
            for i in bits(rest) {
                if let Some(bsdf) = Self::of(bsdfs[i]).filter(|bsdf| Self::alike(bsdf, one)) {
                    like.bsdfs[i] = bsdf;
                    like.equal &= std::ptr::eq(bsdf, one);
                    lanes |= 1 << i;
                }
            }
        }
        Some((lanes, Self::gather(&like)))
    }
}

/// The BSDFs of one kind, from which a kernel takes its parameters.
pub(super) struct LaneBsdfs<'a, T> {
    /// The BSDF of each lane.
    pub bsdfs: [&'a T; LANES],
    /// Whether all lanes have the same.
    equal: bool,
}

impl<T> LaneBsdfs<'_, T> {
    /// Returns a number of each BSDF.
    #[inline(always)]
    pub fn numbers(&self, number: impl Fn(&T) -> f32) -> f32x16 {
        if self.equal {
            return f32x16::splat(number(self.bsdfs[0]));
        }
        let mut numbers = [0.0; LANES];
        for (to, bsdf) in numbers.iter_mut().zip(&self.bsdfs) {
            *to = number(bsdf);
        }
        f32x16::new(numbers)
    }

    /// Returns a colour of each BSDF, by channel.
    #[inline(always)]
    pub fn colors(&self, color: impl Fn(&T) -> Rgb) -> [f32x16; 3] {
        if self.equal {
            return color(self.bsdfs[0]).to_array().map(f32x16::splat);
        }
        let mut channels = [[0.0; LANES]; 3];
        let [r, g, b] = &mut channels;
        for (i, bsdf) in self.bsdfs.iter().enumerate() {
            let color = color(bsdf);
            (r[i], g[i], b[i]) = (color.r, color.g, color.b);
        }
        channels.map(f32x16::new)
    }
}

/// Returns whether all lanes have the same BSDF.
#[inline(always)]
fn all_equal(bsdfs: &[&Bsdf<'_>; LANES]) -> bool {
    bsdfs.iter().all(|&bsdf| std::ptr::eq(bsdf, bsdfs[0]))
}

/// Declares [`AnyKernel`] from the list of kernels.
macro_rules! kernels {
    ($($name:ident($kernel:ty),)*) => {
        /// A kernel of any kind.
        #[expect(clippy::large_enum_variant, reason = "one is on the stack, for the time of one call")]
        enum AnyKernel<'a> {
            $($name($kernel),)*
        }

        impl<'a> AnyKernel<'a> {
            /// Gathers those lanes of the mask `rest` that are like the lane `first`; `None` if no kernel is of its
            /// kind.
            #[inline(always)]
            fn like(first: usize, bsdfs: &[&'a Bsdf<'a>; LANES], rest: u32) -> Option<(u32, Self)> {
                $(if let Some((lanes, kernel)) = <$kernel>::like(first, bsdfs, rest) {
                    return Some((lanes, AnyKernel::$name(kernel)));
                })*
                None
            }

            #[inline(always)]
            fn eval(&self, wo: &Vec3x16, wi: &Vec3x16) -> BsdfEvalX16 {
                match self { $(AnyKernel::$name(kernel) => kernel.eval(wo, wi),)* }
            }

            #[inline(always)]
            fn sample(&self, wo: &Vec3x16, u_lobe: f32x16, u: [f32x16; 2]) -> BsdfSampleX16 {
                match self { $(AnyKernel::$name(kernel) => kernel.sample(wo, u_lobe, u),)* }
            }
        }
    };
}

kernels! {
    RoughConductor(RoughConductorX16),
    RoughDielectric(RoughDielectricX16),
    RoughPlastic(RoughPlasticX16<'a>),
    Plastic(PlasticX16),
    Principled(PrincipledX16),
    Dielectric(DielectricX16),
    Conductor(ConductorX16),
}

/// Returns the reflectances of the diffuse lanes by channel, and a mask of the other lanes.
#[inline(always)]
fn gather_diffuse(bsdfs: &[&Bsdf<'_>; LANES]) -> ([f32x16; 3], u32) {
    if all_equal(bsdfs) {
        return match bsdfs[0] {
            Bsdf::Diffuse(diffuse) => (diffuse.reflectance.to_array().map(f32x16::splat), 0),
            _ => ([f32x16::ZERO; 3], u32::MAX),
        };
    }
    let mut reflectance = [[0.0; LANES]; 3];
    let mut others = 0;
    for (i, bsdf) in bsdfs.iter().enumerate() {
        match bsdf {
            Bsdf::Diffuse(diffuse) => {
                let [r, g, b] = &mut reflectance;
                (r[i], g[i], b[i]) = (diffuse.reflectance.r, diffuse.reflectance.g, diffuse.reflectance.b);
            }
            _ => others |= 1 << i,
        }
    }
    (reflectance.map(f32x16::new), others)
}

/// Computes [`Bsdf::eval`] of `bsdfs[i]` in lane `i`, for the lanes in the mask `active`.
#[inline]
pub fn eval_x16<'a>(bsdfs: &[&'a Bsdf<'a>; LANES], wo: &Vec3x16, wi: &Vec3x16, active: u32) -> BsdfEvalX16 {
    eval_or(bsdfs, wo, wi, active, |i| bsdfs[i].eval(wo.lane(i), wi.lane(i)))
}

/// Computes [`Bsdf::pdf_adjoint`] of `bsdfs[i]` in lane `i`, for the lanes in the mask `active`.
#[inline]
pub fn pdf_adjoint_x16<'a>(bsdfs: &[&'a Bsdf<'a>; LANES], wo: &Vec3x16, wi: &Vec3x16, active: u32) -> f32x16 {
    // The density does not depend on what light is, for the BSDFs that have a kernel.
    let one = |i: usize| BsdfEval { f: Rgb::BLACK, pdf: bsdfs[i].pdf_adjoint(wo.lane(i), wi.lane(i)) };
    eval_or(bsdfs, wo, wi, active, one).pdf
}

/// Evaluates the BSDFs with a kernel, and calls `one` for each other lane.
#[inline(always)]
fn eval_or<'a>(
    bsdfs: &[&'a Bsdf<'a>; LANES],
    wo: &Vec3x16,
    wi: &Vec3x16,
    active: u32,
    one: impl Fn(usize) -> BsdfEval,
) -> BsdfEvalX16 {
    let (reflectance, others) = gather_diffuse(bsdfs);
    let mut eval = BsdfEvalX16::diffuse(reflectance, wo, wi);
    let mut rest = others & active;
    while rest != 0 {
        let i = rest.trailing_zeros() as usize;
        if let Some((lanes, kernel)) = AnyKernel::like(i, bsdfs, rest) {
            eval.set_lanes(lanes, &kernel.eval(wo, wi));
            rest &= !lanes;
        } else {
            eval.set_lane(i, &one(i));
            rest &= rest - 1;
        }
    }
    eval
}

/// BSDFs whose parameters were gathered, to be evaluated several times.
pub struct BsdfX16<'a> {
    bsdfs: [&'a Bsdf<'a>; LANES],
    /// The reflectances of the diffuse lanes by channel.
    reflectance: [f32x16; 3],
    /// Kernels with the masks of their lanes.
    kernels: Vec<(u32, AnyKernel<'a>)>,
    /// Mask of the lanes without a kernel.
    others: u32,
}

impl<'a> BsdfX16<'a> {
    /// Gathers the parameters of the lanes in the mask `active`.
    pub fn new(bsdfs: [&'a Bsdf<'a>; LANES], active: u32) -> Self {
        let (reflectance, others) = gather_diffuse(&bsdfs);
        let (mut rest, mut others, mut kernels) = (others & active, 0, Vec::new());
        while rest != 0 {
            let i = rest.trailing_zeros() as usize;
            if let Some((lanes, kernel)) = AnyKernel::like(i, &bsdfs, rest) {
                kernels.push((lanes, kernel));
                rest &= !lanes;
            } else {
                others |= 1 << i;
                rest &= rest - 1;
            }
        }
        BsdfX16 { bsdfs, reflectance, kernels, others }
    }

    /// Computes [`Bsdf::eval`] in each lane.
    pub fn eval(&self, wo: &Vec3x16, wi: &Vec3x16) -> BsdfEvalX16 {
        let mut eval = BsdfEvalX16::diffuse(self.reflectance, wo, wi);
        for (lanes, kernel) in &self.kernels {
            eval.set_lanes(*lanes, &kernel.eval(wo, wi));
        }
        for i in bits(self.others) {
            eval.set_lane(i, &self.bsdfs[i].eval(wo.lane(i), wi.lane(i)));
        }
        eval
    }
}

/// Computes [`Bsdf::sample`] of `bsdfs[i]` in lane `i`, for the lanes in the mask `active`.
#[inline]
pub fn sample_x16<'a>(
    bsdfs: &[&'a Bsdf<'a>; LANES],
    wo: &Vec3x16,
    u_lobe: f32x16,
    u: [f32x16; 2],
    active: u32,
) -> BsdfSampleX16 {
    let (reflectance, others) = gather_diffuse(bsdfs);
    let wi = warp::square_to_cosine_hemisphere_x16(u);
    let mut samples = BsdfSampleX16 {
        wi,
        weight: reflectance,
        pdf: wi.z * f32x16::splat(FRAC_1_PI),
        eta: f32x16::ONE,
        valid: wo.z.simd_gt(f32x16::ZERO),
    };
    let mut rest = others & active;
    while rest != 0 {
        let i = rest.trailing_zeros() as usize;
        if let Some((lanes, kernel)) = AnyKernel::like(i, bsdfs, rest) {
            samples.set_lanes(lanes, &kernel.sample(wo, u_lobe, u));
            rest &= !lanes;
        } else {
            let u = Vec2::new(u[0].as_array()[i], u[1].as_array()[i]);
            samples.set_lane(i, bsdfs[i].sample(wo.lane(i), u_lobe.as_array()[i], u));
            rest &= rest - 1;
        }
    }
    samples
}

impl BsdfEvalX16 {
    /// No scattering in any lane.
    pub(super) const ZERO: BsdfEvalX16 = BsdfEvalX16 { f: [f32x16::ZERO; 3], pdf: f32x16::ZERO };

    /// Returns diffuse reflection.
    #[inline(always)]
    fn diffuse(reflectance: [f32x16; 3], wo: &Vec3x16, wi: &Vec3x16) -> Self {
        let above = wo.z.simd_gt(f32x16::ZERO) & wi.z.simd_gt(f32x16::ZERO);
        let inverse_pi = f32x16::splat(FRAC_1_PI);
        BsdfEvalX16 { f: reflectance.map(|r| (r * inverse_pi) & above), pdf: (wi.z * inverse_pi) & above }
    }

    fn set_lane(&mut self, i: usize, eval: &BsdfEval) {
        for (channel, value) in self.f.iter_mut().zip(eval.f.to_array()) {
            channel.as_mut_array()[i] = value;
        }
        self.pdf.as_mut_array()[i] = eval.pdf;
    }

    #[inline(always)]
    fn set_lanes(&mut self, lanes: u32, other: &Self) {
        let mask = mask_from_bits(lanes);
        for (channel, value) in self.f.iter_mut().zip(other.f) {
            *channel = mask.select(value, *channel);
        }
        self.pdf = mask.select(other.pdf, self.pdf);
    }
}

impl BsdfSampleX16 {
    #[inline(always)]
    fn set_lanes(&mut self, lanes: u32, other: &Self) {
        let mask = mask_from_bits(lanes);
        self.wi = Vec3x16::select(mask, other.wi, self.wi);
        for (channel, value) in self.weight.iter_mut().zip(other.weight) {
            *channel = mask.select(value, *channel);
        }
        self.pdf = mask.select(other.pdf, self.pdf);
        self.eta = mask.select(other.eta, self.eta);
        self.valid = mask.select(other.valid, self.valid);
    }

    fn set_lane(&mut self, i: usize, sample: Option<BsdfSample>) {
        self.valid.as_mut_array()[i] = f32::from_bits(if sample.is_some() { u32::MAX } else { 0 });
        let Some(sample) = sample else { return };
        self.wi.set_lane(i, sample.wi);
        for (channel, value) in self.weight.iter_mut().zip(sample.weight.to_array()) {
            channel.as_mut_array()[i] = value;
        }
        self.pdf.as_mut_array()[i] = sample.pdf;
        self.eta.as_mut_array()[i] = sample.eta;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsdf::fresnel::ConductorFresnel;
    use crate::bsdf::microfacet::{Distribution, Microfacets};
    use crate::bsdf::{
        Conductor, Dielectric, Diffuse, Plastic, Principled, RoughConductor, RoughDielectric, RoughPlastic,
        RoughTransmittance,
    };
    use crate::math::Vec3;
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
            let bsdfs = std::array::from_fn(|i| &all[i]);
            let mut direction = || {
                let z = 2.0 * random() - 1.0;
                let (sin, cos) = (std::f32::consts::TAU * random()).sin_cos();
                let r = (1.0 - z * z).sqrt();
                Vec3::new(r * cos, r * sin, z)
            };
            let (mut wo, mut wi) = (Vec3x16::default(), Vec3x16::default());
            for i in 0..LANES {
                wo.set_lane(i, direction());
                wi.set_lane(i, direction());
            }
            let mut numbers = || f32x16::new(std::array::from_fn(|_| random()));
            let (u_lobe, u) = (numbers(), [numbers(), numbers()]);
            let eval = eval_x16(&bsdfs, &wo, &wi, 0xffff);
            let values =
                |eval: BsdfEvalX16| [eval.f[0], eval.f[1], eval.f[2], eval.pdf].map(f32x16::to_array);
            assert_eq!(values(BsdfX16::new(bsdfs, 0xffff).eval(&wo, &wi)), values(eval));
            // Parameters that are equal in all lanes are read once, and the result is the same.
            for (i, bsdf) in bsdfs.into_iter().enumerate() {
                let all = values(eval_x16(&[bsdf; LANES], &wo, &wi, 0xffff));
                assert_eq!(all.map(|v| v[i]), values(eval).map(|v| v[i]), "{bsdf:?}");
            }
            let sample = sample_x16(&bsdfs, &wo, u_lobe, u, 0xffff);
            for (i, bsdf) in bsdfs.into_iter().enumerate() {
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
}
