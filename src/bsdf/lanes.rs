//! BSDF evaluation and sampling for sixteen points at a time.
//!
//! Diffuse reflection, plastics, boundaries of conductors and dielectrics, and the principled model without
//! transmission are computed in parallel lanes, and so are blends and perturbed normals, except where light paths are
//! sampled. Other BSDFs are computed one lane after the other. The result of a lane does not depend on the other lanes.

use super::conductor::ConductorX16;
use super::dielectric::DielectricX16;
use super::nested_lanes::{BlendX16, TiltedX16};
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
    /// Whether the BSDF contains others. If so, its adjoint may differ from it.
    const IS_NESTED: bool = false;

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
        let mut like = LaneBsdfs { bsdfs: [one; LANES], lanes: rest, equal: true };
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
        like.lanes = lanes;
        Some((lanes, Self::gather(&like)))
    }
}

/// The BSDFs of one kind, from which a kernel takes its parameters.
pub(super) struct LaneBsdfs<'a, T> {
    /// The BSDF of each lane.
    pub bsdfs: [&'a T; LANES],
    /// Mask of the lanes that have one. The others repeat that of another lane.
    pub lanes: u32,
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
        #[expect(clippy::large_enum_variant, reason = "there are as many as a block has kinds of BSDFs")]
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
        }

        // A kernel is large: these use one where it was made.

        /// Computes [`Bsdf::eval`] in those lanes of the mask `rest` that are like the lane `first`. Returns their
        /// mask, too; `None` if no kernel is of its kind. Kernels of BSDFs that contain others are used if `NESTED` is
        /// true.
        #[inline(always)]
        fn eval_like<'a, const NESTED: bool>(
            first: usize,
            bsdfs: &[&'a Bsdf<'a>; LANES],
            rest: u32,
            [wo, wi]: [&Vec3x16; 2],
        ) -> Option<(u32, BsdfEvalX16)> {
            $(if (NESTED || !<$kernel>::IS_NESTED)
                && let Some((lanes, kernel)) = <$kernel>::like(first, bsdfs, rest)
            {
                return Some((lanes, kernel.eval(wo, wi)));
            })*
            None
        }

        /// Computes [`Bsdf::sample`] as [`eval_like`] does.
        #[inline(always)]
        fn sample_like<'a, const NESTED: bool>(
            first: usize,
            bsdfs: &[&'a Bsdf<'a>; LANES],
            rest: u32,
            wo: &Vec3x16,
            (u_lobe, u): (f32x16, [f32x16; 2]),
        ) -> Option<(u32, BsdfSampleX16)> {
            $(if (NESTED || !<$kernel>::IS_NESTED)
                && let Some((lanes, kernel)) = <$kernel>::like(first, bsdfs, rest)
            {
                return Some((lanes, kernel.sample(wo, u_lobe, u)));
            })*
            None
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
    Blend(BlendX16<'a>),
    Tilted(TiltedX16<'a>),
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
pub fn eval_x16<'a>(bsdfs: &[&'a Bsdf<'a>; LANES], wo: &Vec3x16, wi: &Vec3x16, active: u32) -> BsdfEvalX16 {
    let (mut eval, others) = eval_kernels::<true>(bsdfs, wo, wi, active);
    for i in bits(others) {
        eval.set_lane(i, &bsdfs[i].eval(wo.lane(i), wi.lane(i)));
    }
    eval
}

/// Computes [`Bsdf::pdf_adjoint`] of `bsdfs[i]` in lane `i`, for the lanes in the mask `active`.
pub fn pdf_adjoint_x16<'a>(bsdfs: &[&'a Bsdf<'a>; LANES], wo: &Vec3x16, wi: &Vec3x16, active: u32) -> f32x16 {
    // For BSDFs that contain no others and have a kernel, the density does not depend on what light is.
    let (BsdfEvalX16 { mut pdf, .. }, others) = eval_kernels::<false>(bsdfs, wo, wi, active);
    for i in bits(others) {
        pdf.as_mut_array()[i] = bsdfs[i].pdf_adjoint(wo.lane(i), wi.lane(i));
    }
    pdf
}

/// Evaluates the BSDFs with a kernel. Returns a mask of the other lanes, too. `NESTED` is that of [`eval_like`].
#[inline(always)]
fn eval_kernels<'a, const NESTED: bool>(
    bsdfs: &[&'a Bsdf<'a>; LANES],
    wo: &Vec3x16,
    wi: &Vec3x16,
    active: u32,
) -> (BsdfEvalX16, u32) {
    let (reflectance, others) = gather_diffuse(bsdfs);
    let mut eval = BsdfEvalX16::diffuse(reflectance, wo, wi);
    let (mut rest, mut others) = (others & active, 0);
    while rest != 0 {
        let i = rest.trailing_zeros() as usize;
        if let Some((lanes, of_kernel)) = eval_like::<NESTED>(i, bsdfs, rest, [wo, wi]) {
            eval.set_lanes(lanes, &of_kernel);
            rest &= !lanes;
        } else {
            others |= 1 << i;
            rest &= rest - 1;
        }
    }
    (eval, others)
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
pub fn sample_x16<'a>(
    bsdfs: &[&'a Bsdf<'a>; LANES],
    wo: &Vec3x16,
    u_lobe: f32x16,
    u: [f32x16; 2],
    active: u32,
) -> BsdfSampleX16 {
    let (mut samples, others) = sample_kernels::<true>(bsdfs, wo, u_lobe, u, active);
    for i in bits(others) {
        let u = Vec2::new(u[0].as_array()[i], u[1].as_array()[i]);
        samples.set_lane(i, bsdfs[i].sample(wo.lane(i), u_lobe.as_array()[i], u));
    }
    samples
}

/// Computes [`Bsdf::sample_adjoint`] of `bsdfs[i]` in lane `i`, for the lanes in the mask `active`.
pub fn sample_adjoint_x16<'a>(
    bsdfs: &[&'a Bsdf<'a>; LANES],
    wo: &Vec3x16,
    u_lobe: f32x16,
    u: [f32x16; 2],
    active: u32,
) -> BsdfSampleX16 {
    let (mut samples, others) = sample_kernels::<false>(bsdfs, wo, u_lobe, u, active);
    for i in bits(others) {
        let u = Vec2::new(u[0].as_array()[i], u[1].as_array()[i]);
        samples.set_lane(i, bsdfs[i].sample_adjoint(wo.lane(i), u_lobe.as_array()[i], u));
    }
    let in_lanes = mask_from_bits(active & !others);
    // The scaling at a boundary applies to radiance, but not to power.
    let scale = in_lanes.select(samples.eta * samples.eta, f32x16::ONE);
    samples.weight = samples.weight.map(|channel| channel * scale);
    let finite = in_lanes & !samples.pdf.simd_eq(f32x16::splat(f32::INFINITY)) & samples.valid;
    let lanes = finite.to_bitmask() & active;
    if lanes != 0 {
        let pdf = pdf_adjoint_x16(bsdfs, wo, &samples.wi, lanes);
        let f = eval_x16(bsdfs, &samples.wi, wo, lanes).f;
        let factor = samples.wi.z.abs() / pdf;
        for (weight, f) in samples.weight.iter_mut().zip(f) {
            *weight = finite.select(f * factor, *weight);
        }
        samples.pdf = finite.select(pdf, samples.pdf);
        samples.valid &= !finite | pdf.simd_gt(f32x16::ZERO);
    }
    samples
}

/// Samples the BSDFs with a kernel. Returns a mask of the other lanes, too. `NESTED` is that of [`eval_like`].
#[inline(always)]
fn sample_kernels<'a, const NESTED: bool>(
    bsdfs: &[&'a Bsdf<'a>; LANES],
    wo: &Vec3x16,
    u_lobe: f32x16,
    u: [f32x16; 2],
    active: u32,
) -> (BsdfSampleX16, u32) {
    let (reflectance, others) = gather_diffuse(bsdfs);
    let wi = warp::square_to_cosine_hemisphere_x16(u);
    let mut samples = BsdfSampleX16 {
        wi,
        weight: reflectance,
        pdf: wi.z * f32x16::splat(FRAC_1_PI),
        eta: f32x16::ONE,
        valid: wo.z.simd_gt(f32x16::ZERO),
    };
    let (mut rest, mut others) = (others & active, 0);
    while rest != 0 {
        let i = rest.trailing_zeros() as usize;
        if let Some((lanes, of_kernel)) = sample_like::<NESTED>(i, bsdfs, rest, wo, (u_lobe, u)) {
            samples.set_lanes(lanes, &of_kernel);
            rest &= !lanes;
        } else {
            others |= 1 << i;
            rest &= rest - 1;
        }
    }
    (samples, others)
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
