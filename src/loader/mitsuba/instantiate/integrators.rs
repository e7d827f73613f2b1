//! Integrators: the plugins of [`integrator`](crate::integrator) read their parameters from objects of the file.

use super::{Builder, ObjectSource, unknown_plugin};
use crate::error::Result;
use crate::integrator::settings::{AUTO, AovSettings, AutoSettings};
use crate::integrator::{PathLimits, Plugin, Settings, Source, VolpathIntegrator, aov};
use crate::loader::mitsuba::graph::{Child, Object, ObjectId};
use crate::loader::mitsuba::props::Props;

const MITSUBA: [&str; 2] = ["batch", "volprim_rf_basic"];
/// Integrators of Mitsuba that estimate the same image as one of Buffon's.
const NEAREST: [(&str, &str); 13] = [
    ("direct_projective", "direct"),
    ("erpt", "pssmlt"),
    ("mlt", "pssmlt"),
    ("ppm", "sppm"),
    ("prb", "path"),
    ("prb_basic", "path"),
    ("prb_projective", "path"),
    ("prb_threepoint", "path"),
    ("prbvolpath", "path"),
    ("volpath", "path"),
    ("volpath_simple", "path"),
    ("volpathmis", "path"),
    ("vpl", "path"),
];
/// Integrators of Mitsuba that render media as `volpath` does.
const VOLUMETRIC: [&str; 4] = ["prbvolpath", "volpath", "volpath_simple", "volpathmis"];
/// Integrators around another one, which alone determines the image.
const WRAPPERS: [&str; 2] = ["adaptive", "stokes"];

impl Builder<'_> {
    /// Returns the settings of the scene's integrator. If the user replaces it by another one, only its limits count,
    /// and its errors are notes. The stand-in is `path` with its limits.
    pub(super) fn scene_integrator(
        &mut self,
        object: ObjectId,
        replacement: Option<&str>,
    ) -> Result<Settings> {
        let settings = match Props::new(self.graph, object).object.plugin.as_str() {
            AUTO => self.automatic(object),
            _ => self.integrator(object),
        };
        match settings {
            Err(error) if replacement.is_some() => {
                self.note(format!("the integrator of the scene is not used: {}", error.message));
            }
            Err(error) => self.or_stand_in(Err(error), "replaced by path", |_| ())?,
            Ok(known) => return Ok(self.for_media(known, replacement)),
        }
        let mut props = Props::new(self.graph, object);
        while let Ok(Some(inner)) = props.child("integrator") {
            props = Props::new(self.graph, inner);
        }
        let limits = PathLimits::read(&mut ObjectSource { builder: self, props: &props });
        Ok(Settings::Path(limits.unwrap_or_default().into()))
    }

    /// Returns whether the file has media.
    pub(super) fn has_media(&self) -> bool {
        self.graph.objects.iter().any(|object| object.class == "medium")
    }

    /// Returns whether a shape or a sensor of the file is in a medium.
    fn uses_media(&self) -> bool {
        let is_medium = |child: &Child| self.graph.objects[child.object].class == "medium";
        let in_medium = |object: &Object| object.class != "scene" && object.children.iter().any(is_medium);
        self.graph.objects.iter().any(in_medium)
    }

    /// Returns `volpath` in place of an integrator that would estimate the same image, but for the media of the file.
    fn for_media(&mut self, known: Settings, replacement: Option<&str>) -> Settings {
        if let Settings::Aov(AovSettings { image: Some(image), layers }) = known {
            let image = Some(Box::new(self.for_media(*image, replacement)));
            return Settings::Aov(AovSettings { image, layers });
        }
        let same_image = matches!(
            known,
            Settings::Photonmapper(_)
                | Settings::Sppm(_)
                | Settings::Vcm(_)
                | Settings::Pssmlt(_)
                | Settings::Irrcache(_)
        );
        if replacement.is_some() || !same_image || known.renders_media() || !self.uses_media() {
            return known;
        }
        self.note(format!("{} does not render media: the integrator is volpath", known.name()));
        Settings::Volpath(known.limits())
    }

    /// Leaves the choice of the integrator to pilots; returns what renders media and has its limits.
    fn automatic(&mut self, object: ObjectId) -> Result<Settings> {
        let props = Props::new(self.graph, object);
        let (auto, limits) = AutoSettings::read(&mut ObjectSource { builder: self, props: &props })?;
        self.finish(props);
        self.loaded.auto = Some(auto);
        Ok(Settings::Volpath(limits))
    }

    /// Returns the settings of an integrator.
    ///
    /// # Errors
    /// As for [`instantiate`](super::instantiate).
    pub fn integrator(&mut self, object: ObjectId) -> Result<Settings> {
        let props = Props::new(self.graph, object);
        let plugin = props.object.plugin.as_str();
        if WRAPPERS.contains(&plugin) {
            let Some(inner) = props.child("integrator")? else {
                return Err(props.object.error("expected an integrator inside it"));
            };
            self.note(format!("the integrator {plugin} is rendered as the one inside it"));
            return self.integrator(inner);
        }
        let nearest = match VOLUMETRIC.contains(&plugin) && self.has_media() {
            true => (plugin != VolpathIntegrator::NAME).then_some(VolpathIntegrator::NAME),
            false => NEAREST.iter().find(|(other, _)| *other == plugin).map(|(_, nearest)| *nearest),
        };
        let name = nearest.unwrap_or(plugin);
        if name == AUTO {
            let message = "auto chooses the integrator of the whole scene, and is not inside another one";
            return Err(props.object.error(message));
        }
        let read = Settings::read(name, &mut ObjectSource { builder: self, props: &props })?;
        let Some(settings) = read else {
            let names = [Settings::NAMES, &[aov::MOMENT, AUTO]].concat();
            return Err(unknown_plugin(props.object, &names, &MITSUBA));
        };
        if let Some(nearest) = nearest {
            self.note(format!("the integrator {plugin} is rendered as {nearest}"));
            // Its own parameters are unknown here, but a misspelled one is reported.
            let misspelled =
                props.finish().into_iter().filter(|warning| warning.message.contains("did you mean"));
            self.loaded.warnings.extend(misspelled);
            return Ok(settings);
        }
        if props.object.old && props.boolean("strict_normals", false)? {
            self.approximate(
                "strict_normals is ignored: light may pass where shading and geometric normals disagree",
            );
        }
        self.ignore(&props, &["samples_per_pass", "block_size", "timeout"], "the render job decides");
        self.finish(props);
        Ok(settings)
    }
}

impl Source for ObjectSource<'_, '_> {
    fn integrator(&mut self) -> Result<Option<Settings>> {
        let inner = self.props.child("integrator")?;
        inner.map(|object| self.builder.integrator(object)).transpose()
    }

    fn note(&mut self, text: &str) {
        self.builder.note(text);
    }
}
