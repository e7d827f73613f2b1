//! Integrators.

use super::{Builder, unknown_plugin};
use crate::error::Result;
use crate::integrator::Settings;
use crate::integrator::photon::Kernel;
use crate::integrator::settings::{
    Aov, DirectSettings, DistributionSettings, IrrcacheSettings, Layer, PathLimits, PhotonDebug,
    PhotonmapperSettings, SppmSettings, WhittedSettings,
};
use crate::loader::mitsuba::graph::ObjectId;
use crate::loader::mitsuba::props::Props;
use crate::util::wording;
use crate::util::wording::quoted;

const SUPPORTED: [&str; 11] = [
    "aov",
    "depth",
    "direct",
    "distribution",
    "irrcache",
    "moment",
    "path",
    "photonmapper",
    "ptracer",
    "sppm",
    "whitted",
];
const MITSUBA: [&str; 11] = [
    "batch",
    "direct_projective",
    "prb",
    "prb_basic",
    "prb_projective",
    "prbvolpath",
    "stokes",
    "volpath",
    "volpathmis",
    "volprim_rf_basic",
    "prb_threepoint",
];
const AOVS: [(&str, Aov); 8] = [
    ("albedo", Aov::Albedo),
    ("depth", Aov::Depth),
    ("position", Aov::Position),
    ("uv", Aov::Uv),
    ("geo_normal", Aov::GeometricNormal),
    ("sh_normal", Aov::ShadingNormal),
    ("prim_index", Aov::PrimitiveIndex),
    ("shape_index", Aov::ShapeIndex),
];
const UNSUPPORTED_AOVS: [&str; 5] = ["dp_du", "dp_dv", "duv_dx", "duv_dy", "boundary_test"];
/// What the layers of an `aov` integrator look like.
const PAIRS: &str = "expected name:kind pairs such as dd.y:depth";
/// Most samples of a kind at a shading point.
const MAX_SAMPLES: i64 = 65_536;
/// Most light paths of a pass of photons.
const MAX_PHOTONS: i64 = 100_000_000;

impl Builder<'_> {
    /// The settings of an integrator.
    ///
    /// # Errors
    /// As for [`instantiate`](super::instantiate).
    pub fn integrator(&mut self, object: ObjectId) -> Result<Settings> {
        let props = Props::new(self.graph, object);
        let settings = match props.object.plugin.as_str() {
            "path" => Settings::Path(path(&props)?),
            "direct" => Settings::Direct(direct(&props)?),
            "whitted" => Settings::Whitted(whitted(&props)?),
            "distribution" => Settings::Distribution(distribution(&props)?),
            "depth" => Settings::Depth,
            "ptracer" => Settings::Ptracer(path(&props)?),
            "irrcache" => Settings::Irrcache(self.irrcache(&props)?),
            "photonmapper" => {
                self.ignore(&props, &["granularity"], "the render job decides");
                self.ignore(&props, &["volume_photons", "volume_lookup_radius"], "there are no media");
                Settings::Photonmapper(photonmapper(&props)?)
            }
            "sppm" => {
                self.ignore(&props, &["granularity", "max_passes"], "the render job decides");
                Settings::Sppm(sppm(&props)?)
            }
            "moment" => {
                let image = self.only_integrator(&props)?;
                let layers = vec![Layer { name: "variance".to_owned(), aov: Aov::Variance }];
                self.note(
                    "moment: the second moments of its layers are written as the variance of the image",
                );
                Settings::Aov { layers, image: Some(Box::new(image)) }
            }
            "aov" => {
                let image = match props.child("integrator")? {
                    Some(inner) => Some(Box::new(self.integrator(inner)?)),
                    None => None,
                };
                Settings::Aov { layers: layers(&props)?, image }
            }
            _ => return Err(unknown_plugin(props.object, &SUPPORTED, &MITSUBA)),
        };
        self.ignore(&props, &["samples_per_pass", "block_size", "timeout"], "the render job decides");
        self.finish(props);
        Ok(settings)
    }
}

/// What can trace the light that an irradiance cache gathers.
const GATHERERS: [&str; 2] = ["path", "photonmapper"];

impl Builder<'_> {
    fn irrcache(&mut self, props: &Props) -> Result<IrrcacheSettings> {
        let default = IrrcacheSettings::default();
        let child = match props.child("integrator")? {
            Some(inner) => Box::new(self.integrator(inner)?),
            None => default.child,
        };
        if !GATHERERS.contains(&child.name()) {
            return Err(props.object.error(format!(
                "expected an integrator inside it that follows light through any number of bounces ({}), found {}",
                GATHERERS.join(", "),
                quoted(child.name())
            )));
        }
        let quality_adjustment = props.positive("quality_adjustment", default.quality_adjustment)?;
        if quality_adjustment > 1.0 {
            return Err(props.refusal("quality_adjustment", "expected at most 1"));
        }
        let resolution = props.integer("resolution", 2..=256)?;
        Ok(IrrcacheSettings {
            resolution: resolution.map_or(default.resolution, |n| n as u32),
            quality: props.positive("quality", default.quality)?,
            gradients: props.boolean("gradients", default.gradients)?,
            clamp_neighbor: props.boolean("clamp_neighbor", default.clamp_neighbor)?,
            clamp_screen: props.boolean("clamp_screen", default.clamp_screen)?,
            overture: props.boolean("overture", default.overture)?,
            quality_adjustment,
            indirect_only: props.boolean("indirect_only", default.indirect_only)?,
            debug: props.boolean("debug", default.debug)?,
            child,
        })
    }

    /// The integrator inside another.
    fn only_integrator(&mut self, props: &Props) -> Result<Settings> {
        match props.child("integrator")? {
            Some(inner) => self.integrator(inner),
            None => Err(props.object.error("expected an integrator inside it")),
        }
    }
}

fn path(props: &Props) -> Result<PathLimits> {
    let default = PathLimits::default();
    let max_depth = match props.integer("max_depth", -1..=i64::from(u32::MAX))? {
        None => default.max_depth,
        Some(depth) => u32::try_from(depth).ok(),
    };
    let rr_depth = props.integer("rr_depth", 1..=i64::from(u32::MAX))?;
    Ok(PathLimits {
        max_depth,
        rr_depth: rr_depth.map_or(default.rr_depth, |d| d as u32),
        hide_emitters: props.boolean("hide_emitters", default.hide_emitters)?,
    })
}

fn direct(props: &Props) -> Result<DirectSettings> {
    let count = |name| Ok(props.integer(name, 0..=MAX_SAMPLES)?.map(|n| n as u32));
    let shading = count("shading_samples")?;
    let (emitter, bsdf) = (count("emitter_samples")?, count("bsdf_samples")?);
    if shading.is_some() && (emitter.is_some() || bsdf.is_some()) {
        let message = "expected either shading_samples or emitter_samples and bsdf_samples, found both";
        return Err(props.error("shading_samples", message));
    }
    let default = DirectSettings::default();
    let settings = DirectSettings {
        emitter_samples: shading.or(emitter).unwrap_or(default.emitter_samples),
        bsdf_samples: shading.or(bsdf).unwrap_or(default.bsdf_samples),
        hide_emitters: props.boolean("hide_emitters", default.hide_emitters)?,
    };
    match settings.emitter_samples + settings.bsdf_samples {
        0 => Err(props.object.error("expected at least one emitter or bsdf sample")),
        _ => Ok(settings),
    }
}

fn photonmapper(props: &Props) -> Result<PhotonmapperSettings> {
    let default = PhotonmapperSettings::default();
    let number =
        |name, range, or| props.integer(name, range).map(|n: Option<i64>| n.map_or(or, |n| n as u32));
    let radius = |name, or| match props.positive(name, or)? {
        radius if (1e-6..=1e6).contains(&radius) => Ok(radius),
        _ => Err(props.refusal(name, "expected a part of the scene's radius, from 1e-6 to 1e6")),
    };
    let kernels = Kernel::ALL.map(|kernel| (kernel.name(), kernel));
    let shows =
        [("none", PhotonDebug::None), ("photons", PhotonDebug::Photons), ("radiance", PhotonDebug::Radiance)];
    Ok(PhotonmapperSettings {
        limits: path(props)?,
        direct_samples: number("direct_samples", 1..=MAX_SAMPLES, default.direct_samples)?,
        glossy_samples: number("glossy_samples", 1..=MAX_SAMPLES, default.glossy_samples)?,
        gather_samples: number("gather_samples", 1..=MAX_SAMPLES, default.gather_samples)?,
        global_photons: number("global_photons", 0..=MAX_PHOTONS, default.global_photons)?,
        caustic_photons: number("caustic_photons", 0..=MAX_PHOTONS, default.caustic_photons)?,
        global_lookup_radius: radius("global_lookup_radius", default.global_lookup_radius)?,
        caustic_lookup_radius: radius("caustic_lookup_radius", default.caustic_lookup_radius)?,
        lookup_size: number("lookup_size", 2..=MAX_SAMPLES, default.lookup_size)?,
        kernel: props.choice("kernel", &kernels, default.kernel)?,
        debug: props.choice("debug", &shows, default.debug)?,
    })
}

fn sppm(props: &Props) -> Result<SppmSettings> {
    let default = SppmSettings::default();
    let photon_count = props.integer("photon_count", 0..=MAX_PHOTONS)?;
    let number = |name, or, expected: &str, allowed: fn(f64) -> bool| match props.float(name)? {
        None => Ok(or),
        Some(value) if allowed(value) => Ok(value as f32),
        Some(_) => Err(props.refusal(name, expected)),
    };
    Ok(SppmSettings {
        limits: path(props)?,
        photon_count: photon_count.map_or(default.photon_count, |n| n as u32),
        initial_radius: number(
            "initial_radius",
            default.initial_radius,
            "expected a radius of at least 1e-18 and at most 1e18, or 0 for three widths of a pixel",
            |r| r == 0.0 || (1e-18..=1e18).contains(&r),
        )?,
        guided: props.boolean("guided", default.guided)?,
        alpha: number("alpha", default.alpha, "expected a number above 0 and at most 1", |a| {
            a > 0.0 && a <= 1.0
        })?,
    })
}

fn whitted(props: &Props) -> Result<WhittedSettings> {
    let default = WhittedSettings::default();
    let max_depth = props.integer("max_depth", 1..=i64::from(WhittedSettings::MAX_DEPTH))?;
    Ok(WhittedSettings {
        max_depth: max_depth.map_or(default.max_depth, |d| d as u32),
        hide_emitters: props.boolean("hide_emitters", default.hide_emitters)?,
    })
}

fn distribution(props: &Props) -> Result<DistributionSettings> {
    let default = DistributionSettings::default();
    let number =
        |name, range, or| props.integer(name, range).map(|n: Option<i64>| n.map_or(or, |n| n as u32));
    let settings = DistributionSettings {
        max_depth: number("max_depth", 1..=i64::from(u32::MAX), default.max_depth)?,
        emitter_samples: number("emitter_samples", 0..=MAX_SAMPLES, default.emitter_samples)?,
        bsdf_samples: number("bsdf_samples", 1..=MAX_SAMPLES, default.bsdf_samples)?,
        hide_emitters: props.boolean("hide_emitters", default.hide_emitters)?,
    };
    match settings.rays_at_last_level() {
        0..=DistributionSettings::MAX_RAYS => Ok(settings),
        _ => Err(props.object.error(format!(
            "bsdf_samples {} at max_depth {} are more than {} rays for each camera ray: expected fewer of either",
            settings.bsdf_samples,
            settings.max_depth,
            DistributionSettings::MAX_RAYS
        ))),
    }
}

/// The layers of an `aov` integrator: `name:kind` pairs with commas or spaces between them.
fn layers(props: &Props) -> Result<Vec<Layer>> {
    let Some(text) = props.text("aovs")? else {
        return Err(props.object.error("the property aovs is missing"));
    };
    let refuse = |message: String| props.error("aovs", &message);
    let mut layers: Vec<Layer> = Vec::new();
    for word in text.split(|c: char| c == ',' || c.is_whitespace()).filter(|w| !w.is_empty()) {
        let pair = word.split_once(':').filter(|(name, kind)| !name.is_empty() && !kind.is_empty());
        let (name, kind) = pair.ok_or_else(|| props.refusal("aovs", PAIRS))?;
        if UNSUPPORTED_AOVS.contains(&kind) {
            return Err(refuse(format!("the layer kind {} is not supported", quoted(kind))));
        }
        let aov = AOVS.iter().find(|(known, _)| *known == kind).ok_or_else(|| {
            let near = wording::did_you_mean(kind, AOVS.iter().map(|(known, _)| *known));
            refuse(format!("unknown layer kind {}{near}", quoted(kind)))
        })?;
        if layers.iter().any(|layer| layer.name == name) {
            return Err(refuse(format!("two layers are named {}", quoted(name))));
        }
        layers.push(Layer { name: name.to_owned(), aov: aov.1 });
    }
    match layers.is_empty() {
        true => Err(props.refusal("aovs", PAIRS)),
        false => Ok(layers),
    }
}
