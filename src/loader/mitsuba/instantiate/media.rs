//! Participating media and their phase functions.

use super::{Builder, unknown_plugin};
use crate::color::Rgb;
use crate::color::spectrum::Quantity;
use crate::error::Result;
use crate::ids::MediumId;
use crate::loader::mitsuba::graph::ObjectId;
use crate::loader::mitsuba::props::Props;
use crate::loader::mitsuba::values;
use crate::loader::volume;
use crate::math::DAffine3;
use crate::medium::{Heterogeneous, Homogeneous, Medium, MediumBoundary, PRESETS, Phase, Tabulated, Volume};
use crate::texture::{FilterType, WrapMode};
use crate::util::wording::did_you_mean;
use std::sync::Arc;

pub const MEDIA: [&str; 2] = ["heterogeneous", "homogeneous"];
const PHASES: [&str; 10] = [
    "blendphase",
    "hg",
    "isotropic",
    "kkay",
    "microflake",
    "mixturephase",
    "rayleigh",
    "sggx",
    "tabphase",
    "tabphase_polarized",
];
/// What to do about a medium that cannot be rendered.
const WITHOUT: &str = "--integrator path renders the scene without media";
/// The unit of the coefficients of presets.
const PRESET_UNIT: &str = "coefficients of presets are in inverse millimetres, which scale converts";
/// The coefficients that a medium has by default, as in Mitsuba 3.
const DEFAULT_SIGMA_T: f32 = 1.0;
const DEFAULT_ALBEDO: f32 = 0.75;
/// The asymmetry that `hg` has by default.
const DEFAULT_G: f64 = 0.8;

impl Builder<'_> {
    /// Returns a medium. Each is instantiated once. If the integrator ignores media, one that cannot be rendered is no
    /// error. The stand-in is vacuum.
    ///
    /// # Errors
    /// As for [`instantiate`](super::instantiate).
    pub fn medium(&mut self, object: ObjectId) -> Result<MediumId> {
        if let Some(id) = self.media.get(&object) {
            return Ok(*id);
        }
        let (warnings, missing) = (self.loaded.warnings.len(), self.missing.len());
        let mut read = self.read_medium(object);
        if self.renders_media {
            let vacuum = Homogeneous { sigma_t: Rgb::BLACK, sigma_s: Rgb::BLACK, phase: Phase::Isotropic };
            read = self.or_stand_in(read, "rendered as vacuum", |_| Medium::Homogeneous(vacuum));
        }
        let mut medium = match read {
            Err(error) if self.renders_media => return Err(error),
            Err(error) => Medium::Unsupported(error.to_string()),
            Ok(medium) => medium,
        };
        if !self.renders_media {
            // What is ignored needs no warnings.
            self.loaded.warnings.truncate(warnings);
            if let Some(error) = self.missing.drain(missing..).next() {
                medium = Medium::Unsupported(error.to_string());
            }
        }
        let media = &mut self.loaded.description.media;
        media.push(medium);
        let id = MediumId::from(media.len() - 1);
        self.media.insert(object, id);
        Ok(id)
    }

    /// Returns the medium inside an object that is in a medium, such as a sensor.
    ///
    /// # Errors
    /// As for [`medium`](Self::medium), and if there are several.
    pub fn medium_around(&mut self, props: &Props) -> Result<Option<MediumId>> {
        let medium = props.child("medium")?;
        medium.map(|object| self.medium(object)).transpose()
    }

    /// Returns the media on the two sides of a shape.
    ///
    /// # Errors
    /// As for [`medium`](Self::medium), and if a medium is on neither side, or two on the same.
    pub fn boundary(&mut self, props: &Props) -> Result<MediumBoundary> {
        let mut boundary = MediumBoundary::default();
        for child in props.children("medium") {
            let error =
                |message: &str| self.graph.objects[child.object].error(message).at(child.spot.place());
            let side = match child.name.as_deref() {
                Some("interior") => &mut boundary.interior,
                Some("exterior") => &mut boundary.exterior,
                _ if !self.renders_media => continue,
                _ => {
                    return Err(error(
                        "expected name=\"interior\" or name=\"exterior\" of a medium in a shape",
                    ));
                }
            };
            if side.is_some() && self.renders_media {
                return Err(error("expected one medium on each side of a shape, found two"));
            }
            *side = Some(self.medium(child.object)?);
        }
        Ok(boundary)
    }

    fn read_medium(&mut self, object: ObjectId) -> Result<Medium> {
        let props = Props::new(self.graph, object);
        let medium = match props.object.plugin.as_str() {
            "homogeneous" => self.homogeneous(&props)?,
            "heterogeneous" => self.heterogeneous(&props)?,
            _ => return Err(unknown_plugin(props.object, &MEDIA, &[])),
        };
        if let Some(emitter) = props.child("emitter")? {
            let message = format!("expected a medium that emits no light; {WITHOUT}");
            return Err(self.graph.objects[emitter].unsupported(message));
        }
        self.ignore(&props, &["sample_emitters"], "emitters are sampled at every scattering event");
        self.ignore(
            &props,
            &["strategy", "medium_sampling_weight", "sampling_density", "channel"],
            "distances are sampled by the extinction of all channels",
        );
        self.finish(props);
        Ok(medium)
    }

    fn homogeneous(&mut self, props: &Props) -> Result<Medium> {
        let [sigma_t, sigma_s] = self.coefficients(props)?;
        let scale = scale_of(props, |scale| (sigma_t * scale).is_valid())?;
        let phase = self.phase(props)?;
        Ok(Medium::Homogeneous(Homogeneous { sigma_t: sigma_t * scale, sigma_s: sigma_s * scale, phase }))
    }

    /// Returns a medium of grids. The extinction is `density` in Mitsuba 0.6.
    fn heterogeneous(&mut self, props: &Props) -> Result<Medium> {
        let old = props.has("density");
        let extinction = if old { "density" } else { "sigma_t" };
        let sigma_t = self.volume(props, extinction, Quantity::Unbounded, DEFAULT_SIGMA_T, old)?;
        let albedo = self.volume(props, "albedo", Quantity::Reflectance, DEFAULT_ALBEDO, old)?;
        if let Some(orientation) = props.named_child("orientation") {
            let message = format!("expected a medium without orientations; {WITHOUT}");
            return Err(self.graph.objects[orientation].unsupported(message));
        }
        self.ignore(
            props,
            &["method", "step_size", "sampling_mode", "has_spectral_extinction"],
            "distances are sampled by spectral tracking",
        );
        let phase = self.phase(props)?;
        // The volumes of Mitsuba 0.6 that are the same everywhere have no box.
        if let (true, Some(sigma_t), Some(albedo)) = (old, sigma_t.constant_value(), albedo.constant_value())
        {
            let sigma_t = sigma_t * scale_of(props, |scale| (sigma_t * scale).is_valid())?;
            return Ok(Medium::Homogeneous(Homogeneous { sigma_t, sigma_s: sigma_t * albedo, phase }));
        }
        let medium = |scale| Heterogeneous::new(sigma_t.clone(), albedo.clone(), scale, phase.clone());
        let scale = scale_of(props, |scale| medium(scale).is_finite())?;
        Ok(Medium::Heterogeneous(Box::new(medium(scale))))
    }

    /// Returns a property that is a volume or a colour, or the default. A colour is a volume in the unit cube. A grid
    /// of Mitsuba 0.6 (`old`) is always in the box of its file.
    fn volume(
        &mut self,
        props: &Props,
        name: &'static str,
        quantity: Quantity,
        default: f32,
        old: bool,
    ) -> Result<Volume> {
        let Some(id) = props.named_child(name).filter(|id| self.graph.objects[*id].class == "volume") else {
            return Volume::constant(self.colour(props, name, quantity, default)?, DAffine3::IDENTITY);
        };
        let props = Props::new(self.graph, id);
        let to_world = props.to_world()?;
        let volume = match props.object.plugin.as_str() {
            "constvolume" => {
                let value = self.required_colour(&props, quantity)?;
                Volume::constant(value, to_world)
            }
            "gridvolume" => {
                let filters = [("trilinear", FilterType::Bilinear), ("nearest", FilterType::Nearest)];
                let filter = props.choice("filter_type", &filters, FilterType::Bilinear)?;
                let wraps =
                    [("repeat", WrapMode::Repeat), ("mirror", WrapMode::Mirror), ("clamp", WrapMode::Clamp)];
                let wrap = props.choice("wrap_mode", &wraps, WrapMode::Clamp)?;
                let in_box = props.boolean("use_grid_bbox", old)?;
                self.ignore(&props, &["raw", "accel"], "values are coefficients of R, G and B");
                let Some(path) = self.find_file(&props, "filename")? else {
                    return Volume::constant(Rgb::BLACK, to_world);
                };
                let (grid, of_file) = volume::load(&path, filter, wrap, self.memory)?;
                Volume::grid(Arc::new(grid), if in_box { to_world * of_file } else { to_world })
            }
            _ => {
                let message =
                    format!("expected a constvolume or gridvolume, others are not supported; {WITHOUT}");
                return Err(props.object.unsupported(message));
            }
        };
        let volume = volume.map_err(|e| props.object.error(e.message))?;
        self.finish(props);
        Ok(volume)
    }

    /// Returns the extinction and the scattering coefficient, without the scale: of `sigma_t` and `albedo`, of
    /// `sigma_a` and `sigma_s`, or of a preset.
    fn coefficients(&mut self, props: &Props) -> Result<[Rgb; 2]> {
        let has = |names: &[&str]| names.iter().any(|name| props.has(name));
        let (by_parts, by_preset) = (has(&["sigma_a", "sigma_s"]), has(&["material"]));
        if u32::from(by_parts) + u32::from(by_preset) + u32::from(has(&["sigma_t", "albedo"])) > 1 {
            let message =
                "expected either sigma_t and albedo, or sigma_a and sigma_s, or a material, found several";
            return Err(props.object.error(message));
        }
        if by_parts {
            if let Some(name) = ["sigma_a", "sigma_s"].into_iter().find(|name| !props.has(name)) {
                return Err(props.object.error(format!("the property {name} is missing")));
            }
            let [sigma_a, sigma_s] = [
                self.constant(props, "sigma_a", Quantity::Unbounded, 0.0)?,
                self.constant(props, "sigma_s", Quantity::Unbounded, 0.0)?,
            ];
            return Ok([sigma_a + sigma_s, sigma_s]);
        }
        if by_preset {
            let name = props.text("material")?.unwrap_or_default().to_ascii_lowercase();
            let Some(preset) = PRESETS.iter().find(|preset| preset.name == name) else {
                let near = did_you_mean(&name, PRESETS.iter().map(|preset| preset.name));
                let names: Vec<_> = PRESETS.iter().map(|preset| preset.name).collect();
                let message = format!("there is no such material{near}; there are {}", names.join(", "));
                return Err(props.error("material", &message));
            };
            self.note(format!("{}: {PRESET_UNIT}", props.object.thing()));
            let [sigma_s, sigma_a] = [preset.sigma_s, preset.sigma_a].map(Rgb::from);
            return Ok([sigma_a + sigma_s, sigma_s]);
        }
        let sigma_t = self.constant(props, "sigma_t", Quantity::Unbounded, DEFAULT_SIGMA_T)?;
        let albedo = self.constant(props, "albedo", Quantity::Reflectance, DEFAULT_ALBEDO)?;
        Ok([sigma_t, sigma_t * albedo])
    }

    /// Returns a colour property that may also be a constant volume, or the default.
    fn constant(
        &mut self,
        props: &Props,
        name: &'static str,
        quantity: Quantity,
        default: f32,
    ) -> Result<Rgb> {
        let object = props.named_child(name).map(|id| (id, &self.graph.objects[id]));
        match object.filter(|(_, object)| object.class == "volume") {
            Some((id, object)) => self.constant_volume(id, quantity)?.ok_or_else(|| {
                object.unsupported(format!("expected a constvolume, others are not supported; {WITHOUT}"))
            }),
            None => self.colour(props, name, quantity, default),
        }
    }

    /// Returns the value of a volume; `None` if it is not the same everywhere.
    pub fn constant_volume(&mut self, object: ObjectId, quantity: Quantity) -> Result<Option<Rgb>> {
        let props = Props::new(self.graph, object);
        if props.object.plugin != "constvolume" {
            return Ok(None);
        }
        let value = self.required_colour(&props, quantity)?;
        self.ignore(&props, &["to_world"], "the value is the same everywhere");
        self.finish(props);
        Ok(Some(value))
    }

    /// Returns the phase function of a medium.
    fn phase(&mut self, medium: &Props) -> Result<Phase> {
        let Some(object) = medium.child("phase")? else {
            // The parameter of Mitsuba 0.4.
            return match medium.has("g") {
                true => asymmetry(medium),
                false => Ok(Phase::Isotropic),
            };
        };
        self.phase_function(object)
    }

    fn phase_function(&mut self, object: ObjectId) -> Result<Phase> {
        let props = Props::new(self.graph, object);
        let phase = match props.object.plugin.as_str() {
            "isotropic" => Phase::Isotropic,
            "hg" => asymmetry(&props)?,
            "rayleigh" => Phase::Rayleigh,
            "tabphase" => {
                let text = props.text("values")?;
                let text = text.ok_or_else(|| props.object.error("the property values is missing"))?;
                let values = values::floats(text).map_err(|error| props.error("values", &error))?;
                Phase::Tabulated(Tabulated::new(&values).map_err(|e| props.error("values", &e.message))?)
            }
            "blendphase" => {
                let children = props.children("phase");
                let [first, second] = children[..] else {
                    let found = children.len();
                    return Err(props
                        .object
                        .error(format!("expected two phase functions inside it, found {found}")));
                };
                let weight = self.constant(&props, "weight", Quantity::Unbounded, 0.5)?.mean();
                if !(0.0..=1.0).contains(&weight) {
                    return Err(props.error("weight", "expected a number from 0 to 1"));
                }
                let phases = [self.phase_function(first.object)?, self.phase_function(second.object)?];
                Phase::Blend { weight, phases: Box::new(phases) }
            }
            plugin if PHASES.contains(&plugin) => {
                return Err(props
                    .object
                    .unsupported(format!("this phase function is not supported; {WITHOUT}")));
            }
            _ => return Err(unknown_plugin(props.object, &PHASES, &[])),
        };
        self.finish(props);
        Ok(phase)
    }
}

/// Returns the factor of the coefficients, which must be finite with it.
fn scale_of(props: &Props, is_finite: impl Fn(f32) -> bool) -> Result<f32> {
    let scales = ["scale", "density_multiplier"];
    let name = if props.has(scales[1]) { scales[1] } else { scales[0] };
    let scale = props.float(name)?.unwrap_or(1.0) as f32;
    match scale >= 0.0 && is_finite(scale) {
        true => Ok(scale),
        false => {
            Err(props.refusal(name, "expected a number of at least 0 for which the coefficients are finite"))
        }
    }
}

/// Returns the phase function with the property `g`.
fn asymmetry(props: &Props) -> Result<Phase> {
    let g = props.float("g")?.unwrap_or(DEFAULT_G) as f32;
    match g > -1.0 && g < 1.0 {
        true => Ok(Phase::HenyeyGreenstein { g }),
        false => Err(props.refusal("g", "expected a number between -1 and 1, both excluded")),
    }
}
