//! Buffon: a Monte-Carlo renderer that reports speed against error.
//!
//! This page holds the conventions of the whole crate, once. They differ between renderers, so they are said.
//!
//! # Directions, cosine, densities
//!
//! - `wo` is the known direction, `wi` the sampled one. Both point away from the surface. In the local frame
//!   the normal is z.
//! - `f` is the bare BSDF, without the cosine. The weight of a sampled direction is `f·|cosθ|/pdf`.
//! - A `pdf` is per unit solid angle unless its name says otherwise (`pdf_area`, `pmf`).
//!   [`sampling::mis::area_to_solid_angle`] is the one conversion.
//! - Sampling returns an `Option` of a struct; `None` means that nothing is scattered or emitted there.
//! - A delta distribution has the density infinity, which the power heuristic turns into the weight 1.
//!
//! # Units
//!
//! - Colours are linear Rec.709 RGB. Radiance is W·m⁻²·sr⁻¹, radiant intensity W·sr⁻¹. Lengths are scene units.
//! - Angles are radians; only scene files have degrees.
//!
//! # Error
//!
//! - relMSE is the mean over pixels and channels of `(x − r)² / (r² + 0.01)` for an image x and a reference r.
//! - Efficiency is `1 / (relMSE · seconds)`.
//! - An error estimate comes from the differences of replicates that are scrambled independently, never from the
//!   variance within a quasi-random sequence: of two halves of the samples, or of eight replicates where pixels share
//!   noise.
//!
//! # Determinism
//!
//! A value depends on (scene, seed, pixel, sample index, dimension) and on nothing else: not on the number of
//! threads, the order of tiles, or where a render was stopped.
//!
//! # Robustness
//!
//! There is no epsilon in world units. Surface points carry a bound on their rounding error, rays start at an
//! offset derived from it, and shadow rays end short of their target by as much.
//!
//! # Bibliography
//!
//! - `[Ahmed and Wonka 2020]` Screen-space blue-noise diffusion of Monte Carlo sampling error via hierarchical
//!   ordering of pixels. ACM Transactions on Graphics 39(6).
//! - `[Arvo 1986]` Backward ray tracing. SIGGRAPH course notes.
//! - `[Arya and Mount 1993]` Algorithms for fast vector quantization. Data Compression Conference.
//! - `[Bentley 1975]` Multidimensional binary search trees used for associative searching. CACM 18(9).
//! - `[Born and Wolf 1999]` Principles of Optics, 7th edition.
//! - `[Burley 2012]` Physically based shading at Disney. SIGGRAPH course notes.
//! - `[Burley 2015]` Extending the Disney BRDF to a BSDF with integrated subsurface scattering. SIGGRAPH course notes.
//! - `[Burley 2020]` Practical hash-based Owen scrambling. JCGT 9(4).
//! - `[Christensen 1999]` Faster photon map global illumination. JGT 4(3).
//! - `[Cigolle 2014]` Cigolle et al.: A survey of efficient representations for independent unit vectors. JCGT 3(2).
//! - `[Cook 1984]` Cook, Porter, Carpenter: Distributed ray tracing. SIGGRAPH.
//! - `[Cook 1986]` Stochastic sampling in computer graphics. ACM Transactions on Graphics 5(1).
//! - `[d'Eon and Irving 2011]` A quantized-diffusion model for rendering translucent materials. SIGGRAPH.
//! - `[Duff 2017]` Building an orthonormal basis, revisited. JCGT 6(1).
//! - `[Dupuy and Benyoub 2023]` Sampling visible GGX normals with spherical caps. HPG.
//! - `[Egan and Hilgeman 1973]` Spectral reflectance of particulate materials: a Monte Carlo model including asperity
//!   scattering. Applied Optics 12.
//! - `[Giles 2012]` Approximating the erfinv function. GPU Computing Gems Jade.
//! - `[Halton 1960]` On the efficiency of certain quasi-random sequences of points in evaluating multi-dimensional
//!   integrals. Numerische Mathematik 2.
//! - `[Hachisuka and Jensen 2009]` Stochastic progressive photon mapping. SIGGRAPH Asia.
//! - `[Heitz 2014]` Understanding the masking-shadowing function in microfacet-based BRDFs. JCGT 3(2).
//! - `[Heitz and d'Eon 2014]` Importance sampling microfacet-based BSDFs using the distribution of visible normals.
//!   EGSR.
//! - `[Heitz 2018]` Sampling the GGX distribution of visible normals. JCGT 7(4).
//! - `[Heitz 2019]` A low-distortion map between triangle and square.
//! - `[Higham 2002]` Accuracy and Stability of Numerical Algorithms, 2nd edition.
//! - `[Jarosz et al. 2012]` Theory, analysis and applications of 2D global illumination. TOG 31(5).
//! - `[Jarzynski and Olano 2020]` Hash functions for GPU rendering. JCGT 9(3).
//! - `[Jensen 1996]` Global illumination using photon maps. Eurographics Workshop on Rendering.
//! - `[Jensen 2001]` Realistic image synthesis using photon mapping. A K Peters.
//! - `[Kajiya 1986]` The rendering equation. SIGGRAPH.
//! - `[Kensler 2013]` Correlated multi-jittered sampling. Pixar technical memo 13-01.
//! - `[Knaus and Zwicker 2011]` Progressive photon mapping: a probabilistic approach. ACM Transactions on Graphics
//!   30(3).
//! - `[Křivánek 2005]` Radiance caching for global illumination computation on glossy surfaces. PhD thesis, Rennes.
//! - `[Křivánek 2006]` Křivánek, Bouatouch, Pattanaik, Žára: Making radiance and irradiance caching practical:
//!   adaptive caching and neighbor clamping. EGSR.
//! - `[Lagarde 2013]` Memo on Fresnel equations.
//! - `[Laine and Karras 2011]` Stratified sampling for stochastic transparency. EGSR.
//! - `[Lambert 1760]` Photometria.
//! - `[Malley 1988]` A shading method for computer generated images. Master's thesis, University of Utah.
//! - `[Mitchell 1991]` Spectrally optimal sampling for distribution ray tracing. SIGGRAPH.
//! - `[Owen 1995]` Randomly permuted (t,m,s)-nets and (t,s)-sequences. MCQMC.
//! - `[pbrt]` Pharr, Jakob, Humphreys: Physically Based Rendering, 4th edition, 2023, by section.
//! - `[Satterthwaite 1946]` An approximate distribution of estimates of variance components. Biometrics Bulletin 2(6).
//! - `[Schwarzhaupt et al. 2012]` Schwarzhaupt, Jensen, Jarosz: Practical Hessian-based error control for irradiance
//!   caching. TOG 31(6).
//! - `[Shirley and Chiu 1997]` A low distortion map between disk and square. JGT 2(3).
//! - `[Šidák 1967]` Rectangular confidence regions for the means of multivariate normal distributions. JASA 62(318).
//! - `[Silverman 1986]` Density estimation for statistics and data analysis. Chapman and Hall.
//! - `[Tabellion and Lamorlette 2004]` An approximate global illumination system for computer generated films.
//!   SIGGRAPH.
//! - `[Ureña 2013]` An area-preserving parametrization for spherical rectangles. EGSR.
//! - `[Siegel and Howell 1992]` Thermal Radiation Heat Transfer, 3rd edition.
//! - `[Veach 1997]` Robust Monte Carlo methods for light transport simulation. PhD thesis, Stanford.
//! - `[Vegdahl 2021]` Owen scrambling based dithered blue-noise sampling; Building a better LK hash.
//! - `[Wächter and Binder 2019]` A fast and robust method for avoiding self-intersection. Ray Tracing Gems.
//! - `[Walter 2007]` Microfacet models for refraction through rough surfaces. EGSR.
//! - `[Ward 1988]` Ward, Rubinstein, Clear: A ray tracing solution for diffuse interreflection. SIGGRAPH.
//! - `[Ward and Heckbert 1992]` Irradiance gradients. Eurographics Workshop on Rendering.
//! - `[Warnock 1972]` Computational investigations of low-discrepancy point sets. Applications of Number Theory to
//!   Numerical Analysis.
//! - `[Wellons 2018]` Prospecting for hash functions.
//! - `[Whitted 1980]` An improved illumination model for shaded display. CACM 23(6).
//! - `[Woop 2013]` Woop, Benthin, Wald: Watertight ray/triangle intersection. JCGT 2(1).
#![deny(unsafe_code)]

pub mod accel;
pub mod bench;
pub mod bsdf;
pub mod cli;
pub mod color;
pub mod compare;
#[cfg(feature = "embree")]
#[allow(unsafe_code)]
pub mod embree;
pub mod emitter;
pub mod error;
pub mod estimate;
pub mod film;
pub mod ids;
pub mod image;
pub mod integrator;
pub mod lab;
pub mod loader;
pub mod material;
pub mod math;
pub mod memory;
pub mod regress;
pub mod render;
pub mod report;
pub mod sampling;
pub mod scene;
pub mod sensor;
pub mod session;
pub mod shape;
pub mod texture;
pub mod util;
