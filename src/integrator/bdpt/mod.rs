//! Bidirectional path tracing. [Lafortune & Willems 1993; Veach 1997, chapter 10]
//!
//! Each camera path has a light path, which it shares with those of neighbouring pixels ([`sharing`]). Every vertex of
//! the camera path is a possible end: it may lie on an emitter, it samples an emitter, and it is connected to one
//! vertex of the light path, which is chosen by an estimate of its contribution. The first vertex with a finite lobe
//! is also connected to light paths of pixels nearby. The light paths of a second set, as many as there
//! are pixels, are connected to the camera. The techniques are combined by multiple importance sampling ([`weights`]).
//! Both kinds of paths may be scattered in participating media ([`in_media`], [`light_paths`]).

mod camera_paths;
mod connections;
mod emitter_media;
mod in_media;
mod light_paths;
pub(super) mod merging;
pub mod sharing;
pub(super) mod targets;
pub mod technique;
mod vertex;
pub(super) mod weights;

use self::camera_paths::CameraPaths;
use self::emitter_media::EmitterMedia;
pub(super) use self::light_paths::{Caustics, LightPathSettings, RenderedMedia};
use self::light_paths::{LightPaths, StoredVertex, of_light_path};
use self::merging::Merging;
use self::sharing::SharedLightPaths;
use self::technique::Techniques;
use self::vertex::Vertex;
use self::weights::Merged;
use super::flight::{Departure, stream};
use super::photon::{EmissionGuide, VisibleSurfaces};
use super::preparation::Statistic;
use super::ptracer::{LightTracer, Splat};
use super::settings::{HiddenLight, PathLimits, Plugin, Read, Source, WhenPays};
use super::worker::draw_2d;
use super::{Integrator, Preparation, Radiance, RadianceQuery, Wave, Worker};
use crate::accel::Coherence;
use crate::color::Rgb;
use crate::error::{Error, Result};
use crate::ids::ShapeId;
use crate::math::{DVec2, Ray, Vec2};
use crate::sampling::{Dimension, SampleKey};
use crate::scene::{Scene, SceneMedia};
use crate::sensor::Camera;
use bumpalo::Bump;

/// The parameters of bidirectional path tracing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct BdptSettings {
    /// The paths.
    pub limits: PathLimits,
    /// The techniques that contribute.
    pub techniques: Techniques,
    /// Whether paths are connected. If a pilot finds that it does not pay, another integrator renders the image with
    /// camera paths alone.
    pub connections: WhenPays,
}

/// When paths are connected.
pub const CONNECTIONS: [(&str, WhenPays); 2] = [("auto", WhenPays::Auto), ("always", WhenPays::Always)];

/// Bidirectional path tracing.
pub struct Bdpt {
    settings: BdptSettings,
    /// The camera to which light paths are connected.
    camera: Option<Camera>,
    guide: Option<EmissionGuide>,
    /// The media in which light paths start.
    of_emitters: EmitterMedia,
}

impl Bdpt {
    /// Returns the media of a scene.
    fn media<'a>(&'a self, scene: &'a Scene) -> Option<RenderedMedia<'a>> {
        scene.media.as_deref().map(|list| RenderedMedia { list, of_emitters: &self.of_emitters })
    }
}

impl Plugin for Bdpt {
    const NAME: &'static str = "bdpt";
    const HIDDEN_LIGHT: HiddenLight = HiddenLight::Direct;
    type Settings = BdptSettings;

    fn read(source: &mut dyn Source) -> Result<BdptSettings> {
        source.ignore(&["light_image", "sample_direct"], "all techniques are used");
        let limits = PathLimits::read(source)?;
        let connections = source.choice("connections", &CONNECTIONS, WhenPays::Auto)?;
        Ok(BdptSettings { limits, techniques: Techniques::read(source, limits)?, connections })
    }

    fn with_limits(limits: PathLimits) -> BdptSettings {
        BdptSettings { limits, ..BdptSettings::default() }
    }

    fn limits(settings: &BdptSettings) -> PathLimits {
        settings.limits
    }

    fn create(settings: &BdptSettings) -> Box<dyn Integrator> {
        Box::new(Bdpt {
            settings: *settings,
            camera: None,
            guide: None,
            of_emitters: EmitterMedia::default(),
        })
    }
}

impl Integrator for Bdpt {
    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn shares_noise(&self) -> bool {
        true
    }

    fn shows_environment(&self) -> bool {
        !self.settings.limits.hide_emitters
    }

    fn shows_emitters(&self) -> bool {
        !self.settings.limits.hide_emitters && self.settings.limits.allows(1)
    }

    fn light_tracer(&self) -> Option<&dyn LightTracer> {
        Some(self)
    }

    fn check(&self, scene: &Scene) -> Result<()> {
        scene.check_media()?;
        let bounds_media = |media: &SceneMedia| {
            let emitting = (0..scene.shapes.len()).filter(|&i| scene.shapes[i].emitter.is_some());
            emitting.map(ShapeId::from).any(|shape| media.is_boundary(shape))
        };
        if self.settings.limits.hide_emitters && scene.media.as_deref().is_some_and(bounds_media) {
            let message = "cannot hide an emitting shape that bounds a medium; use volpath";
            return Err(Error::scene(message).about(Self::NAME));
        }
        Ok(())
    }

    fn prepare(&mut self, preparation: &Preparation<'_>) -> Result<()> {
        let scene = preparation.scene;
        if let Some(media) = &scene.media {
            self.of_emitters = EmitterMedia::find(scene, media)?;
        }
        // A guide knows only light on surfaces.
        if !scene.media.as_ref().is_some_and(|media| media.scatters()) {
            let visible_surfaces = VisibleSurfaces::of(preparation);
            self.guide = EmissionGuide::towards(&visible_surfaces, preparation, self.settings.limits);
        }
        self.camera = Some(preparation.camera.clone());
        Ok(())
    }

    fn prepares(&self) -> bool {
        true
    }

    fn statistics(&self) -> Vec<Statistic> {
        vec![Statistic { name: "guided", value: f64::from(u8::from(self.guide.is_some())) }]
    }

    fn li(
        &self,
        scene: &Scene,
        wave: Wave<'_>,
        query: RadianceQuery,
        worker: &mut Worker,
        out: &mut [Radiance],
    ) {
        let camera = self.camera.as_ref().expect("prepare comes first");
        let light = LightPathSettings {
            limits: self.settings.limits,
            guide: self.guide.as_ref(),
            techniques: self.settings.techniques,
            beyond: 2,
            merged: Merged::default(),
            media: self.media(scene),
            caustics: None,
        };
        trace_both(scene, camera, light, None, wave, query, worker, out);
    }
}

impl LightTracer for Bdpt {
    fn trace(
        &self,
        scene: &Scene,
        camera: &Camera,
        margin: f64,
        keys: &[SampleKey],
        worker: &mut Worker,
        out: &mut Vec<Splat>,
    ) {
        let BdptSettings { limits, techniques, .. } = self.settings;
        let (query, merged) = (RadianceQuery::ALL, Merged::default());
        let lens = LensConnections {
            scene,
            camera,
            guide: self.guide.as_ref(),
            limits,
            techniques,
            query,
            margin,
            merged,
            media: self.media(scene),
            caustics: None,
        };
        lens.splat(keys, worker, |_, splat| out.push(splat));
    }
}

/// Traces the camera paths of a wave and the light paths to which they are connected, and merges them with those of
/// `merging`.
#[expect(clippy::too_many_arguments, reason = "those of `Integrator::li`")]
pub(super) fn trace_both(
    scene: &Scene,
    camera: &Camera,
    settings: LightPathSettings<'_>,
    merging: Option<&Merging>,
    wave: Wave<'_>,
    query: RadianceQuery,
    worker: &mut Worker,
    out: &mut [Radiance],
) {
    out.fill(Radiance::NONE);
    // BSDFs of the light paths are used until the camera paths end.
    let mut arena = std::mem::take(&mut worker.kept_arena);
    arena.reset();
    // In a scene with motion, each camera path has a light path with its time.
    let mut taken = std::mem::take(&mut worker.shared_light);
    let is_shared = !scene.needs.motion && taken.camera_paths() == wave.keys.len();
    let shared = if is_shared { std::mem::take(&mut taken) } else { SharedLightPaths::unshared(wave.keys) };
    let light = LightPaths::trace(scene, &arena, settings, &shared.keys, worker);
    let LightPathSettings { limits, guide, techniques, media, .. } = settings;
    let media = media.map(|media| media.list);
    let mut paths =
        CameraPaths { scene, camera, guide, limits, techniques, query, light, shared, media, merging };
    paths.trace(wave, worker, out);
    if is_shared {
        taken = std::mem::take(&mut paths.shared);
    }
    drop(paths);
    worker.shared_light = taken;
    worker.kept_arena = arena;
}

/// A vertex of a light path that is connected to the camera.
#[derive(Clone, Copy)]
pub(super) struct LensPoint {
    /// The position on the film in pixels.
    film: DVec2,
    /// The index of the light path.
    pub path: u32,
    /// The weight of the technique, which is a factor of the contribution.
    pub weight: f64,
}

/// Connections of light paths to the camera.
#[derive(Clone, Copy)]
pub(super) struct LensConnections<'a> {
    pub scene: &'a Scene,
    pub camera: &'a Camera,
    /// The density of the starts of light paths.
    pub guide: Option<&'a EmissionGuide>,
    pub limits: PathLimits,
    /// The techniques that contribute.
    pub techniques: Techniques,
    /// The light that counts.
    pub query: RadianceQuery,
    /// The extent of the reconstruction filter beyond the image, in pixels.
    pub margin: f64,
    pub merged: Merged,
    /// The media, if they are rendered.
    pub media: Option<RenderedMedia<'a>>,
    /// If only caustics are traced: how.
    pub caustics: Option<CausticPaths<'a>>,
}

/// Light paths for caustics only.
#[derive(Clone, Copy)]
pub(super) struct CausticPaths<'a> {
    /// The density of light paths relative to one for each camera path.
    pub density: f64,
    /// Which caustics: each vertex of a light path that is kept is connected to the camera.
    pub which: Caustics<'a>,
}

impl<'a> LensConnections<'a> {
    /// Traces a light path for each key, and calls `add` with each of its contributions to the film.
    pub fn splat(&self, keys: &[SampleKey], worker: &mut Worker, add: impl FnMut(&LensPoint, Splat)) {
        let mut arena = std::mem::take(&mut worker.kept_arena);
        arena.reset();
        let paths = self.light_paths(&arena, keys, worker);
        let points = self.queue(&paths, keys, worker);
        drop(paths);
        worker.kept_arena = arena;
        self.trace(&points, worker, add);
    }

    /// Traces a light path for each key.
    fn light_paths<'s>(&self, arena: &'s Bump, keys: &[SampleKey], worker: &mut Worker) -> LightPaths<'s>
    where
        'a: 's,
    {
        let settings = LightPathSettings {
            limits: self.limits,
            guide: self.guide,
            techniques: self.techniques,
            beyond: 1,
            merged: self.merged,
            media: self.media,
            caustics: self.caustics.map(|caustics| caustics.which),
        };
        LightPaths::trace(self.scene, arena, settings, keys, worker)
    }

    fn hides_emitters(&self) -> bool {
        self.limits.hide_emitters && self.scene.needs.hit_emitters
    }

    /// Queues a shadow ray to the camera from each vertex.
    fn queue(&self, paths: &LightPaths<'_>, keys: &[SampleKey], worker: &mut Worker) -> Vec<LensPoint> {
        let lens = lens_numbers(self.camera, keys, paths, worker);
        let mut points = Vec::new();
        for (i, stored) in paths.vertices.iter().enumerate() {
            let emits = || match &stored.vertex {
                Vertex::Surface(surface) => self.scene.shapes[surface.at.shape().index()].emitter.is_some(),
                Vertex::Medium(_) => false,
            };
            if (self.hides_emitters() && emits()) || !self.query.wants(stored.edges + 1) {
                continue;
            }
            let u = lens.get(i).copied().unwrap_or_default();
            if let Some((ray, point, value)) = self.connect(stored, u) {
                let slot = points.len() as u32;
                points.push(point);
                let Some(RenderedMedia { list: media, .. }) = self.media else {
                    worker.shadows.push_one(ray, slot, value);
                    continue;
                };
                let medium = stored.vertex.medium_towards(self.scene, media, ray.d, stored.medium);
                let random = stream(of_light_path(keys[stored.path as usize]), stored.edges, 1);
                worker.shadows.push_through_media(ray, slot, value, Departure { medium, random });
            }
        }
        points
    }

    /// Traces the queued rays, and calls `add` for each point that is unoccluded.
    fn trace(&self, points: &[LensPoint], worker: &mut Worker, mut add: impl FnMut(&LensPoint, Splat)) {
        let splat = |slot: usize, value| add(&points[slot], Splat { film: points[slot].film, value });
        match self.hides_emitters() {
            false => worker.trace_shadows(self.scene, Coherence::Incoherent, splat),
            true => worker.trace_shadows_past_emitters(self.scene, splat),
        }
    }

    /// Traces a camera path and a light path for each ray of a wave. Writes the radiance of all techniques that
    /// contribute to the ray's own position on the film, and calls `add` with the index of the ray for all that
    /// contribute elsewhere.
    pub fn trace_pairs(
        &self,
        wave: Wave<'_>,
        worker: &mut Worker,
        out: &mut [Radiance],
        mut add: impl FnMut(u32, Splat),
    ) {
        let LensConnections { scene, camera, guide, limits, techniques, query, media, .. } = *self;
        let media = media.map(|media| media.list);
        out.fill(Radiance::NONE);
        let mut arena = std::mem::take(&mut worker.kept_arena);
        arena.reset();
        let light = self.light_paths(&arena, wave.keys, worker);
        let points = self.queue(&light, wave.keys, worker);
        self.trace(&points, worker, |point, splat| add(point.path, splat));
        let shared = SharedLightPaths::unshared(wave.keys);
        let merging = None;
        let paths =
            CameraPaths { scene, camera, guide, limits, techniques, query, light, shared, media, merging };
        paths.trace(wave, worker, out);
        drop(paths);
        worker.kept_arena = arena;
    }

    /// Returns the ray from a vertex to the camera, the connection and its contribution.
    fn connect(&self, stored: &StoredVertex<'_>, u_lens: Vec2) -> Option<(Ray, LensPoint, Rgb)> {
        let vertex = &stored.vertex;
        let seen = self.camera.importance(vertex.p(), u_lens, vertex.time(), self.margin)?;
        let (scattered, reverse) = vertex.emerging_with_reverse(seen.wi);
        if scattered.is_black() {
            return None;
        }
        let density = f64::from(seen.weight * vertex.cosine(seen.wi))
            / self.caustics.map_or(1.0, |caustics| caustics.density);
        let weight = stored.partial.of_camera_connection(density, reverse.into(), self.merged);
        let weight = self.techniques.weight(stored.edges + 1, 1, weight);
        let value = stored.power * scattered * (seen.weight * weight as f32);
        let point = LensPoint { film: seen.film, path: stored.path, weight };
        Some((vertex.ray_to(self.scene, seen.target, seen.wi), point, value))
    }
}

/// Returns random numbers for positions on the lens, one pair for each vertex; none if there is no lens.
fn lens_numbers(camera: &Camera, keys: &[SampleKey], paths: &LightPaths<'_>, worker: &Worker) -> Vec<Vec2> {
    let mut lens = Vec::new();
    if !camera.has_lens() {
        return lens;
    }
    let mut numbers = [Vec::new(), Vec::new()];
    for vertices in paths.vertices.chunk_by(|a, b| a.edges == b.edges) {
        let keys: Vec<SampleKey> = vertices.iter().map(|vertex| keys[vertex.path as usize]).collect();
        let dimension = Dimension::emitter_point(vertices[0].edges - 1).repeat(1);
        draw_2d(worker.sampler, dimension, &keys, &mut numbers);
        lens.extend((0..keys.len()).map(|i| Vec2::new(numbers[0][i], numbers[1][i])));
    }
    lens
}
