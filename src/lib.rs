//! Buffon is a Monte-Carlo renderer that reports speed against error.
//!
//! The `buffon` program is documented in the README. This page documents the library: examples first, then the
//! conventions of the whole crate. Conventions differ between renderers, so they are stated explicitly.
//!
//! # Rendering a scene
//!
//! [`session`] has the three steps that every command uses. A [`SceneFile`](session::SceneFile) is loaded, compiled to
//! a [`Session`](session::Session), and rendered according to a [`Plan`](session::Plan).
//!
//! ```
//! use buffon::accel::AccelKind;
//! use buffon::image::{self, WriteOptions};
//! use buffon::render::{Progress, StopRules};
//! use buffon::session::{Choices, SceneChoices, SceneFile, default_threads};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let folder = tempfile::tempdir()?;
//! let scene = folder.path().join("sphere.xml");
//! std::fs::write(
//!     &scene,
//!     r#"<scene version="3.0.0">
//!         <integrator type="path"/>
//!         <sensor type="perspective">
//!             <transform name="to_world">
//!                 <lookat origin="0, 0, 5" target="0, 0, 0" up="0, 1, 0"/>
//!             </transform>
//!             <film type="hdrfilm">
//!                 <integer name="width" value="32"/>
//!                 <integer name="height" value="24"/>
//!             </film>
//!         </sensor>
//!         <emitter type="constant"/>
//!         <shape type="sphere"/>
//!     </scene>"#,
//! )?;
//!
//! let file = SceneFile::load(&scene, &SceneChoices::default())?;
//! let session = file.compile(AccelKind::Auto, default_threads())?;
//!
//! let stop = StopRules { samples: Some(16), ..StopRules::default() };
//! let plan = session.plan(&Choices { stop, seed: 1, ..Choices::default() })?;
//! let rendered = session.render(&plan, &Progress::new())?;
//! println!("{} samples per pixel, estimated relMSE {:?}", rendered.samples_per_pixel, rendered.relmse);
//!
//! let output = session.image(&plan, &rendered);
//! assert_eq!((output.width, output.height), (32, 24));
//! image::write(&folder.path().join("sphere.exr"), &output, &WriteOptions::default())?;
//! # Ok(())
//! # }
//! ```
//!
//! # Comparing two images
//!
//! [`compare::compare`] computes error metrics of an image against a reference, for each layer.
//!
//! ```
//! use buffon::compare::compare;
//! use buffon::image::Image;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let mut reference = Image::new(2, 2, &["R", "G", "B"]);
//! reference.data.fill(0.5);
//! let mut image = reference.clone();
//! image.pixel_mut(1, 0)[0] = 0.6;
//!
//! let comparison = compare(&image, &reference)?;
//! let base = &comparison.layers[0];
//! assert!((base.mean_absolute - 0.1 / 12.0).abs() < 1e-6);
//! assert_eq!((base.max_at.x, base.max_at.y, base.max_at.channel.as_str()), (1, 0, "R"));
//! println!("relMSE {:.1e}, PSNR {:.1} dB", base.relmse, base.psnr);
//! # Ok(())
//! # }
//! ```
//!
//! [`compare::z_test`] tests whether the difference of two renders is due to noise alone. It needs their variances,
//! which the layer `variance` contains. Here, two renders with different seeds pass. A render with direct light only
//! fails, because indirect light is missing.
//!
//! ```
//! use buffon::accel::AccelKind;
//! use buffon::compare::z_test;
//! use buffon::image::Image;
//! use buffon::render::{Progress, StopRules};
//! use buffon::session::{Choices, SceneChoices, SceneFile, Session, default_threads};
//! # use std::path::Path;
//!
//! fn render(session: &Session, integrator: &str, seed: u64) -> buffon::error::Result<Image> {
//!     let plan = session.plan(&Choices {
//!         integrator: Some(integrator.into()),
//!         stop: StopRules { samples: Some(64), ..StopRules::default() },
//!         seed,
//!         aov: vec!["variance".into()],
//!         ..Choices::default()
//!     })?;
//!     let rendered = session.render(&plan, &Progress::new())?;
//!     Ok(session.image(&plan, &rendered))
//! }
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let scene = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box/cornell-box.xml"));
//! # let choices = SceneChoices { size: Some((32, 32)), ..SceneChoices::default() };
//! let session = SceneFile::load(scene, &choices)?.compile(AccelKind::Auto, default_threads())?;
//! let reference = render(&session, "path", 1)?;
//!
//! let test = z_test(&render(&session, "path", 2)?, &reference, None, 0.01)?;
//! assert!(test.passes(), "{} of {} blocks rejected", test.rejected, test.blocks);
//!
//! let test = z_test(&render(&session, "direct", 2)?, &reference, None, 0.01)?;
//! assert!(!test.passes());
//! # Ok(())
//! # }
//! ```
//!
//! # Directions, cosine, densities
//!
//! - `wo` is the known direction, `wi` the sampled one. Both point away from the surface. In the local frame
//!   the normal is z.
//! - `f` is the bare BSDF, without the cosine. The weight of a sampled direction is `f·|cosθ|/pdf`.
//! - A `pdf` is per unit solid angle unless its name says otherwise (`pdf_area`, `pmf`). Only
//!   [`sampling::mis::area_to_solid_angle`] converts between measures.
//! - Sampling returns an `Option` of a struct; `None` means that nothing is scattered or emitted there.
//! - A delta distribution has an infinite density, for which the power heuristic gives the weight 1.
//!
//! # Units
//!
//! - Colours are linear Rec.709 RGB. Radiance is W·m⁻²·sr⁻¹, radiant intensity W·sr⁻¹. Lengths are scene units.
//! - Angles are radians; only scene files use degrees.
//!
//! # Error
//!
//! - relMSE is the mean over pixels and channels of `(x − r)² / (r² + 0.01)` for an image x and a reference r.
//! - Efficiency is `1 / (relMSE · seconds)`.
//! - An error estimate uses the differences of independently scrambled replicates, not the variance within a
//!   quasi-random sequence. There are two replicates (the halves of the samples), or eight if pixels share noise.
//!
//! # Determinism
//!
//! A value depends only on (scene, seed, pixel, sample index, dimension). It does not depend on the number of threads,
//! the order of tiles, or where a render was stopped.
//!
//! # Robustness
//!
//! There is no epsilon in world units. Surface points have a bound on their rounding error. Rays start at an offset
//! derived from this bound, and shadow rays end before their target by the target's offset.
//!
//! # Bibliography
//!
//! - `[Abramowitz and Stegun 1964]` Handbook of Mathematical Functions. National Bureau of Standards.
//! - `[Ahmed and Wonka 2020]` Screen-space blue-noise diffusion of Monte Carlo sampling error via hierarchical
//!   ordering of pixels. ACM Transactions on Graphics 39(6).
//! - `[Andersson 2020]` Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild: ꟻLIP: A difference evaluator
//!   for alternating images. Proc. ACM Comput. Graph. Interact. Tech. 3 (2).
//! - `[Andersson 2021]` Andersson, Nilsson, Shirley, Akenine-Möller: Visualizing errors in rendered high dynamic range
//!   images. Eurographics short papers.
//! - `[Appleby 2011]` MurmurHash3.
//! - `[Arvo 1986]` Backward ray tracing. SIGGRAPH course notes.
//! - `[Arvo and Kirk 1990]` Particle transport and image synthesis. SIGGRAPH.
//! - `[Arya and Mount 1993]` Algorithms for fast vector quantization. Data Compression Conference.
//! - `[Astronomical Almanac 2010]` The Astronomical Almanac for the Year 2010. US Naval Observatory, HM Nautical
//!   Almanac Office.
//! - `[Bayer 1973]` An optimum method for two-level rendition of continuous-tone pictures. ICC.
//! - `[Bekaert 2002]` Bekaert, Sbert, Halton: Accelerating path tracing by re-using paths. Eurographics Workshop on
//!   Rendering.
//! - `[Bentley 1975]` Multidimensional binary search trees used for associative searching. CACM 18(9).
//! - `[Blanco-Muriel 2001]` Blanco-Muriel, Alarcón-Padilla, López-Moratalla, Lara-Coira: Computing the solar vector.
//!   Solar Energy 70(5).
//! - `[Blinn 1978]` Simulation of wrinkled surfaces. SIGGRAPH.
//! - `[Born and Wolf 1999]` Principles of Optics, 7th edition.
//! - `[Burley 2012]` Physically based shading at Disney. SIGGRAPH course notes.
//! - `[Burley 2015]` Extending the Disney BRDF to a BSDF with integrated subsurface scattering. SIGGRAPH course
//!   notes.
//! - `[Burley 2020]` Practical hash-based Owen scrambling. JCGT 9(4).
//! - `[Catmull and Rom 1974]` A class of local interpolating splines. Computer Aided Geometric Design.
//! - `[Chiang 2016]` Chiang, Bitterli, Tappan, Burley: A practical and controllable hair and fur model for production
//!   path tracing. Computer Graphics Forum 35(2).
//! - `[Christensen 1999]` Faster photon map global illumination. JGT 4(3).
//! - `[Cigolle 2014]` Cigolle et al.: A survey of efficient representations for independent unit vectors. JCGT 3(2).
//! - `[Cody and Waite 1980]` Software Manual for the Elementary Functions. Prentice Hall.
//! - `[Conty Estevez and Kulla 2018]` Importance sampling of many lights with adaptive tree splitting. HPG.
//! - `[Cook 1984]` Cook, Porter, Carpenter: Distributed ray tracing. SIGGRAPH.
//! - `[Cook 1986]` Stochastic sampling in computer graphics. ACM Transactions on Graphics 5(1).
//! - `[d'Eon and Irving 2011]` A quantized-diffusion model for rendering translucent materials. SIGGRAPH.
//! - `[Duff 2017]` Building an orthonormal basis, revisited. JCGT 6(1).
//! - `[Dupuy and Benyoub 2023]` Sampling visible GGX normals with spherical caps. HPG.
//! - `[Dupuy and Jakob 2018]` An adaptive parameterization for efficient material acquisition and rendering. TOG
//!   37(6).
//! - `[Egan and Hilgeman 1973]` Spectral reflectance of particulate materials: a Monte Carlo model including asperity
//!   scattering. Applied Optics 12.
//! - `[Ernst, Stamminger and Greiner 2006]` Filter importance sampling. IEEE Symposium on Interactive Ray Tracing.
//! - `[Estevez 2019]` Estevez, Lecocq, Stein: A microfacet-based shadowing function to solve the bump terminator
//!   problem. Ray Tracing Gems.
//! - `[Fliegel 1968]` Fliegel, Van Flandern: A machine algorithm for processing calendar dates. CACM 11(10).
//! - `[Georgiev 2012]` Implementing vertex connection and merging. Technical report, Saarland University.
//! - `[Georgiev et al. 2012]` Georgiev, Křivánek, Davidovič, Slusallek: Light transport simulation with vertex
//!   connection and merging. TOG 31(6).
//! - `[Giles 2012]` Approximating the erfinv function. GPU Computing Gems Jade.
//! - `[Hable 2010]` Uncharted 2: HDR lighting. Game Developers Conference.
//! - `[Hachisuka and Jensen 2009]` Stochastic progressive photon mapping. SIGGRAPH Asia.
//! - `[Hachisuka et al. 2012]` Hachisuka, Pantaleoni, Jensen: A path space extension for robust light transport
//!   simulation. TOG 31(6).
//! - `[Haines, Günther, Akenine-Möller 2019]` Precision improvements for ray/sphere intersection. Ray Tracing Gems.
//! - `[Halton 1960]` On the efficiency of certain quasi-random sequences of points in evaluating multi-dimensional
//!   integrals. Numerische Mathematik 2.
//! - `[Heitz 2014]` Understanding the masking-shadowing function in microfacet-based BRDFs. JCGT 3(2).
//! - `[Heitz 2018]` Sampling the GGX distribution of visible normals. JCGT 7(4).
//! - `[Heitz 2019]` A low-distortion map between triangle and square.
//! - `[Heitz and d'Eon 2014]` Importance sampling microfacet-based BSDFs using the distribution of visible normals.
//!   EGSR.
//! - `[Henyey and Greenstein 1941]` Diffuse radiation in the Galaxy. Astrophysical Journal 93.
//! - `[Higham 2002]` Accuracy and Stability of Numerical Algorithms, 2nd edition.
//! - `[Hofmann et al. 2021]` Hofmann, Hasselgren, Clarberg, Munkberg: Interactive path tracing and reconstruction of
//!   sparse volumes. Proceedings of the ACM on Computer Graphics and Interactive Techniques 4(1).
//! - `[Hosek 2012]` Hošek, Wilkie: An analytic model for full spectral sky-dome radiance. ACM Transactions on Graphics
//!   31(4).
//! - `[Hosek 2013]` Hošek, Wilkie: Adding a solar-radiance function to the Hošek-Wilkie skylight model. IEEE Computer
//!   Graphics and Applications 33(3).
//! - `[Jakob 2014]` An improved visible normal sampling routine for the Beckmann distribution. ETH Zürich.
//! - `[Jarosz et al. 2012]` Theory, analysis and applications of 2D global illumination. TOG 31(5).
//! - `[Jarzynski and Olano 2020]` Hash functions for GPU rendering. JCGT 9(3).
//! - `[Jensen 1995]` Importance driven path tracing using the photon map. Eurographics Workshop on Rendering.
//! - `[Jensen 1996]` Global illumination using photon maps. Eurographics Workshop on Rendering.
//! - `[Jensen 2001]` Realistic image synthesis using photon mapping. A K Peters.
//! - `[Jensen et al. 2001]` Jensen, Marschner, Levoy, Hanrahan: A practical model for subsurface light transport.
//!   SIGGRAPH.
//! - `[Kajiya 1986]` The rendering equation. SIGGRAPH.
//! - `[Karlík 2019]` Karlík, Šik, Vévoda, Skřivan, Křivánek: MIS compensation: optimizing sampling techniques in
//!   multiple importance sampling. ACM Transactions on Graphics 38(6).
//! - `[Kelemen et al. 2002]` Kelemen, Szirmay-Kalos, Antal, Csonka: A simple and robust mutation strategy for the
//!   Metropolis light transport algorithm. Computer Graphics Forum 21(3).
//! - `[Kensler 2013]` Correlated multi-jittered sampling. Pixar technical memo 13-01.
//! - `[Knaus and Zwicker 2011]` Progressive photon mapping: a probabilistic approach. ACM Transactions on Graphics
//!   30(3).
//! - `[Knuth 1998]` The Art of Computer Programming 2: Seminumerical Algorithms, 3rd edition.
//! - `[Křivánek 2005]` Radiance caching for global illumination computation on glossy surfaces. PhD thesis, Rennes.
//! - `[Křivánek 2006]` Křivánek, Bouatouch, Pattanaik, Žára: Making radiance and irradiance caching practical:
//!   adaptive caching and neighbor clamping. EGSR.
//! - `[Kulla and Fajardo 2012]` Importance sampling techniques for path tracing in participating media. EGSR.
//! - `[Kutz et al. 2017]` Kutz, Habel, Li, Novák: Spectral and decomposition tracking for rendering heterogeneous
//!   volumes. TOG 36(4).
//! - `[Lagarde 2013]` Memo on Fresnel equations.
//! - `[Laine and Karras 2011]` Stratified sampling for stochastic transparency. EGSR.
//! - `[Lambert 1760]` Photometria.
//! - `[Lauterbach et al. 2009]` Fast BVH construction on GPUs. Computer Graphics Forum 28(2).
//! - `[Malley 1988]` A shading method for computer generated images. Master's thesis, University of Utah.
//! - `[Miller 2019]` Miller, Georgiev, Jarosz: A null-scattering path integral formulation of light transport. TOG
//!   38(4).
//! - `[Mitchell 1991]` Spectrally optimal sampling for distribution ray tracing. SIGGRAPH.
//! - `[Mitchell and Netravali 1988]` Reconstruction filters in computer graphics. SIGGRAPH.
//! - `[Moshier 1992]` Cephes mathematical library, single precision.
//! - `[Müller 2017]` Müller, Gross, Novák: Practical path guiding for efficient light-transport simulation. Computer
//!   Graphics Forum 36(4).
//! - `[Neumaier 1974]` Rundungsfehleranalyse einiger Verfahren zur Summation endlicher Summen. ZAMM 54.
//! - `[Novák et al. 2014]` Novák, Selle, Jarosz: Residual ratio tracking for estimating attenuation in participating
//!   media. TOG 33(6).
//! - `[Oren and Nayar 1994]` Generalization of Lambert's reflectance model. SIGGRAPH.
//! - `[Owen 1995]` Randomly permuted (t,m,s)-nets and (t,s)-sequences. MCQMC.
//! - `[pbrt]` Pharr, Jakob, Humphreys: Physically Based Rendering, 4th edition, 2023, by section.
//! - `[Reda 2004]` Reda, Andreas: Solar position algorithm for solar radiation applications. Solar Energy 76(5).
//! - `[Satterthwaite 1946]` An approximate distribution of estimates of variance components. Biometrics Bulletin
//!   2(6).
//! - `[Schüßler 2017]` Schüßler, Heitz, Hanika, Dachsbacher: Microfacet-based normal mapping for robust Monte Carlo
//!   path tracing. TOG 36(6).
//! - `[Schwarzhaupt et al. 2012]` Schwarzhaupt, Jensen, Jarosz: Practical Hessian-based error control for irradiance
//!   caching. TOG 31(6).
//! - `[Shirley and Chiu 1997]` A low distortion map between disk and square. JGT 2(3).
//! - `[Shoemake 1985]` Animating rotation with quaternion curves. SIGGRAPH.
//! - `[Šidák 1967]` Rectangular confidence regions for the means of multivariate normal distributions. JASA 62(318).
//! - `[Siegel and Howell 1992]` Thermal Radiation Heat Transfer, 3rd edition.
//! - `[Silverman 1986]` Density estimation for statistics and data analysis. Chapman and Hall.
//! - `[Smith & van der Walt 2015]` The colour maps magma, inferno, plasma and viridis of matplotlib.
//! - `[Sobotka 2022]` AgX: a display rendering transform. github.com/sobotka/AgX.
//! - `[Tabellion and Lamorlette 2004]` An approximate global illumination system for computer generated films.
//!   SIGGRAPH.
//! - `[Thürmer and Wüthrich 1998]` Computing vertex normals from polygonal facets. JGT 3(1).
//! - `[Ureña 2013]` An area-preserving parametrization for spherical rectangles. EGSR.
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
//! - `[Wilkie 2014]` Wilkie, Nawaz, Droske, Weidlich, Hanika: Hero wavelength spectral sampling. Computer Graphics
//!   Forum 33(4).
//! - `[Woop 2013]` Woop, Benthin, Wald: Watertight ray/triangle intersection. JCGT 2(1).
//! - `[Wrensch 2023]` Minimal AgX implementation. iolite-engine.com.
//! - `[Ylitie, Karras, Laine 2017]` Efficient incoherent ray traversal on GPUs through compressed wide BVHs. HPG.
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
pub mod farm;
pub mod film;
pub mod ids;
pub mod image;
pub mod integrator;
pub mod lab;
pub mod loader;
pub mod material;
pub mod math;
pub mod medium;
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
