//! Participating media: closed forms, energy, and independence of threads.
//!
//! Each group of comparisons has a significance of 1 % with fixed seeds.

use crate::support::chi2::check_directions;
use crate::support::cli::Folder;
use crate::support::expect::Means;
use crate::support::quadrature::over_square;
use crate::support::scenes::{add, camera, compiled, constant, diffuse, pixels, render, sphere};
use buffon::accel::AccelKind;
use buffon::color::Rgb;
use buffon::emitter::Emitter;
use buffon::ids::MediumId;
use buffon::integrator::Settings;
use buffon::integrator::bdpt::BdptSettings;
use buffon::integrator::settings::PathLimits;
use buffon::material::{Dielectric, Interface, Mask, Material, Null};
use buffon::math::{DAffine3, DQuat, DVec3, Vec2, Vec3};
use buffon::medium::{Homogeneous, Medium, MediumBoundary, Phase, Tabulated};
use buffon::sampling::SamplerKind;
use buffon::scene::Description;
use buffon::scene::description::{PlacedGroup, PlacedShape};
use buffon::sensor::Projection;
use buffon::shape::Shape;
use std::f64::consts::PI;

pub const SIGMA: [f32; 3] = [0.25, 1.0, 2.5];
const HG: Phase = Phase::HenyeyGreenstein { g: 0.6 };

pub fn volpath(max_depth: Option<u32>) -> Settings {
    Settings::Volpath(PathLimits { max_depth, ..PathLimits::default() })
}

/// The integrators that render media.
pub fn integrators(max_depth: Option<u32>) -> [(&'static str, Settings); 2] {
    let limits = PathLimits { max_depth, ..PathLimits::default() };
    let bdpt = BdptSettings { limits, ..BdptSettings::default() };
    [("volpath", volpath(max_depth)), ("bdpt", Settings::Bdpt(bdpt))]
}

/// Every integrator renders media, ignores them as in Mitsuba 3, or refuses the scene. One of a file that would
/// estimate the same image but for the media is `volpath`.
#[test]
fn no_integrator_renders_another_image_in_silence() {
    let of_integrator = |integrator: &str| {
        format!(
            r#"<scene version="3.0.0">{integrator}<sensor type="perspective"/><emitter type="constant"/>
  <shape type="sphere"><bsdf type="null"/><medium type="homogeneous" name="interior"/></shape></scene>"#
        )
    };
    let folder = Folder::with(&of_integrator(""));
    let render = |name: &str| folder.run(&format!("render s.xml {name} --size 4x4 --spp 1 -o f.exr"));
    const IGNORED: &str = "every medium is vacuum";
    for name in Settings::NAMES.iter().chain([&"auto"]).filter(|name| **name != "aov") {
        let run = render(&format!("--integrator {name}"));
        let expected = match *name {
            "volpath" | "bdpt" | "auto" => (0, false, false),
            "path" | "direct" | "ptracer" | "ao" | "depth" => (0, true, false),
            _ => (3, false, true),
        };
        let refused = run.stderr.contains(&format!("{name} does not render the scene's media"));
        assert_eq!((run.code, run.stderr.contains(IGNORED), refused), expected, "{name}: {}", run.stderr);
    }
    for (integrator, note) in [
        ("ppm", "sppm does not render media: the integrator is volpath"),
        ("mlt", "pssmlt does not render media: the integrator is volpath"),
        ("photonmapper", "photonmapper does not render media: the integrator is volpath"),
        ("direct", IGNORED),
    ] {
        folder.write("s.xml", of_integrator(&format!("<integrator type='{integrator}'/>")).as_bytes());
        let run = render("");
        assert!(run.code == 0 && run.stderr.contains(note), "{integrator}: {}", run.stderr);
    }
}

/// Adds a medium with the given extinction and albedo.
pub fn medium(scene: &mut Description, sigma_t: [f32; 3], albedo: [f32; 3], phase: Phase) -> MediumId {
    let sigma_s = [0, 1, 2].map(|c| sigma_t[c] * albedo[c]);
    let medium = Homogeneous { sigma_t: sigma_t.into(), sigma_s: sigma_s.into(), phase };
    scene.media.push(Medium::Homogeneous(medium));
    MediumId::from(scene.media.len() - 1)
}

/// Adds a shape around a medium.
pub fn filled(
    scene: &mut Description,
    shape: Shape,
    to_world: DAffine3,
    material: Material,
    inside: MediumId,
) {
    let id = add(scene, shape, to_world, material);
    scene.shapes[id].boundary = MediumBoundary { interior: Some(inside), exterior: None };
}

/// Returns a scene with a camera at `eye` that looks along −z at a spot of no extent, before a uniform environment.
fn spot(eye: DVec3) -> Description {
    let mut scene = Description { emitters: vec![constant(1.0)], ..Description::default() };
    scene.sensors.push(camera(eye, eye - DVec3::Z, 1e-3, 4));
    scene
}

fn black() -> Material {
    diffuse(0.0)
}

fn transmitted(length: f64) -> [f64; 3] {
    SIGMA.map(|sigma| (-f64::from(sigma) * length).exp())
}

/// A scene, its name and the exact radiance.
type Case = (&'static str, Description, [f64; 3]);

fn slabs() -> Vec<Case> {
    let mut cases = Vec::new();
    let eye = DVec3::new(0.1, 0.2, 5.0);
    let mut scene = spot(eye);
    let fog = medium(&mut scene, SIGMA, [0.0; 3], Phase::Isotropic);
    filled(
        &mut scene,
        Shape::Cube,
        DAffine3::from_scale(DVec3::new(2.0, 2.0, 0.4)),
        Material::Null(Null),
        fog,
    );
    cases.push(("a cube", scene.clone(), transmitted(0.8)));

    // The same cube in a group that is instanced with another scale.
    let mut instanced = scene.clone();
    let placed: PlacedShape = instanced.shapes.pop().expect("a shape");
    instanced.groups.push(vec![placed]);
    let to_world = DAffine3::from_scale(DVec3::new(1.0, 1.0, 2.0)).into();
    instanced.instances.push(PlacedGroup { name: String::new(), place: None, group: 0, to_world });
    cases.push(("an instance", instanced, transmitted(1.6)));

    // A bubble of vacuum inside the medium.
    let mut bubble = scene.clone();
    let id = add(
        &mut bubble,
        sphere(0.3),
        DAffine3::from_translation(DVec3::new(0.1, 0.2, 0.0)),
        Material::Null(Null),
    );
    bubble.shapes[id].boundary.exterior = Some(fog);
    cases.push(("a bubble", bubble, transmitted(0.2)));

    // The camera inside the medium.
    let mut inside = scene.clone();
    inside.sensors[0] = camera(DVec3::ZERO, -DVec3::Z, 1e-3, 4);
    inside.sensors[0].medium = Some(fog);
    // The ray starts on the near clipping plane.
    cases.push(("the camera inside", inside, transmitted(0.4 - 1e-4)));

    // Flipped normals exchange the sides.
    let mut flipped = scene.clone();
    flipped.shapes[0].flip_normals = true;
    let MediumBoundary { interior, exterior } = flipped.shapes[0].boundary;
    flipped.shapes[0].boundary = MediumBoundary { interior: exterior, exterior: interior };
    cases.push(("flipped normals", flipped, transmitted(0.8)));

    // A black surface with holes: each of its two sides lets a third pass.
    let mut holes = spot(eye);
    let fog = medium(&mut holes, SIGMA, [0.0; 3], Phase::Isotropic);
    let inner = holes.add_material(black());
    let mask = Material::Mask(Mask { opacity: (2.0 / 3.0).into(), inner });
    filled(&mut holes, Shape::Cube, DAffine3::from_scale(DVec3::new(2.0, 2.0, 0.4)), mask, fog);
    cases.push(("a mask", holes, transmitted(0.8).map(|t| t / 9.0)));
    cases
}

/// Rays lose light as e^(−σ·length), also with a depth of 1: boundaries are no bounces. [Lambert 1760]
#[test]
fn a_slab_transmits_by_its_thickness() {
    let cases = slabs();
    let group = Means::of_images(cases.len() * AccelKind::CHOICES.len() * 4, 2e-2);
    for (name, scene, exact) in cases {
        for &accel in AccelKind::CHOICES {
            let compiled = compiled(scene.clone(), accel);
            for (integrator, settings) in [Some(1), None].into_iter().flat_map(integrators) {
                let spp = if name == "a mask" { 16_384 } else { 16 };
                let rendered = render(&compiled, &settings, SamplerKind::Sobol, spp, 1);
                group.expect(&format!("{name}, {accel}, {integrator}"), &rendered, exact);
            }
        }
    }
}

/// An absorbing sphere of radius 1 in an image of 2 × 2: the mean of e^(−2σ√(1−r²)) over the disk, and 1 outside.
#[test]
fn a_sphere_absorbs_by_its_chords() {
    let group = Means::of_images(AccelKind::CHOICES.len(), 2e-3);
    let mut scene = spot(DVec3::new(0.0, 0.0, 3.0));
    scene.sensors[0] = camera(DVec3::new(0.0, 0.0, 3.0), DVec3::ZERO, 1.0, 16);
    scene.sensors[0].projection = Projection::Orthographic;
    let fog = medium(&mut scene, SIGMA, [0.0; 3], Phase::Isotropic);
    filled(&mut scene, sphere(1.0), DAffine3::IDENTITY, Material::Null(Null), fog);
    let exact = SIGMA.map(|sigma| {
        let b = 2.0 * f64::from(sigma);
        (2.0 * PI * (1.0 - (1.0 + b) * (-b).exp()) / (b * b) + 4.0 - PI) / 4.0
    });
    for &accel in AccelKind::CHOICES {
        let rendered = render(&compiled(scene.clone(), accel), &volpath(None), SamplerKind::Sobol, 256, 1);
        group.expect(&format!("{accel}"), &rendered, exact);
    }
}

/// A pane of absorbing glass at normal incidence before a uniform environment: R + T²a/(1 − Ra), where a is the
/// transmittance of one passage.
#[test]
fn glass_absorbs_between_its_reflections() {
    let group = Means::of_images(AccelKind::CHOICES.len(), 5e-3);
    let mut scene = spot(DVec3::new(0.1, 0.2, 5.0));
    let ink = medium(&mut scene, SIGMA, [0.0; 3], Phase::Isotropic);
    filled(&mut scene, Shape::Cube, DAffine3::from_scale(DVec3::new(2.0, 2.0, 0.4)), glass(1.5), ink);
    let r = 0.04;
    let exact = transmitted(0.8).map(|a| r + (1.0 - r) * (1.0 - r) * a / (1.0 - r * a));
    for &accel in AccelKind::CHOICES {
        let rendered = render(&compiled(scene.clone(), accel), &volpath(None), SamplerKind::Sobol, 4096, 1);
        group.expect(&format!("{accel}"), &rendered, exact);
    }
}

pub fn glass(eta: f32) -> Material {
    let interface = Interface { int_ior: eta, ext_ior: 1.0, specular_reflectance: Rgb::WHITE.into() };
    Material::Dielectric(Dielectric { interface, specular_transmittance: Rgb::WHITE.into() })
}

/// Shadow rays pass boundaries: a diffuse floor under absorbing fog that rests on it, lit from above. The bottom of the
/// fog coincides with the floor.
#[test]
fn light_and_view_pass_fog_that_rests_on_a_floor() {
    let lights = [
        Emitter::Directional { direction: -Vec3::Z, irradiance: Rgb::splat(PI as f32) },
        Emitter::Point { position: Vec3::Z * 4.0, intensity: Rgb::splat(16.0 * PI as f32) },
    ];
    let group = Means::of_images(2 * 2 * AccelKind::CHOICES.len(), 1e-3);
    for light in lights {
        for turn in
            [DAffine3::IDENTITY, DAffine3::from_axis_angle(DVec3::new(0.3, -0.5, 0.7).normalize(), 1.1)]
        {
            let mut scene = Description::default();
            let at = |p: DVec3| turn.transform_point3(p);
            scene.sensors.push(camera(at(DVec3::new(0.0, 0.0, 9.0)), at(DVec3::ZERO), 1e-3, 4));
            scene.emitters.push(match &light {
                Emitter::Directional { irradiance, .. } => Emitter::Directional {
                    direction: -turn.transform_vector3(DVec3::Z).as_vec3(),
                    irradiance: *irradiance,
                },
                Emitter::Point { position, intensity } => {
                    Emitter::Point { position: at(position.as_dvec3()).as_vec3(), intensity: *intensity }
                }
                other => other.clone(),
            });
            add(&mut scene, Shape::Rectangle, turn * DAffine3::from_scale(DVec3::splat(2.5)), diffuse(0.5));
            let fog = medium(&mut scene, SIGMA, [0.0; 3], Phase::Isotropic);
            let to_world = turn
                * DAffine3::from_translation(DVec3::Z * 0.5)
                * DAffine3::from_scale(DVec3::new(2.0, 2.0, 0.5));
            filled(&mut scene, Shape::Cube, to_world, Material::Null(Null), fog);
            for &accel in AccelKind::CHOICES {
                let rendered =
                    render(&compiled(scene.clone(), accel), &volpath(None), SamplerKind::Sobol, 64, 1);
                group.expect(&format!("{light:?}, {accel}"), &rendered, transmitted(2.0).map(|t| 0.5 * t));
            }
        }
    }
}

/// In a uniform environment, a medium that absorbs nothing is invisible.
#[test]
fn media_without_absorption_conserve_energy() {
    let group = Means::of_images(10 * AccelKind::CHOICES.len(), 2e-2);
    let white = [1.0; 3];
    for (name, material, sigma, phase) in [
        ("null", Material::Null(Null), SIGMA, Phase::Isotropic),
        ("null, forward", Material::Null(Null), SIGMA, HG),
        ("null, only blue", Material::Null(Null), [0.0, 0.0, 3.0], Phase::HenyeyGreenstein { g: -0.4 }),
        ("matched glass", glass(1.0), SIGMA, Phase::Isotropic),
        ("glass", glass(1.5), SIGMA, HG),
    ] {
        let mut scene = spot(DVec3::ZERO);
        scene.sensors[0] = camera(DVec3::new(1.0, 2.0, 3.0), DVec3::ZERO, 30.0, 12);
        let fog = medium(&mut scene, sigma, white, phase);
        filled(&mut scene, sphere(1.0), DAffine3::IDENTITY, material, fog);
        for &accel in AccelKind::CHOICES {
            let compiled = compiled(scene.clone(), accel);
            for (integrator, settings) in integrators(None) {
                let rendered = render(&compiled, &settings, SamplerKind::Sobol, 512, 3);
                group.expect(&format!("{name}, {accel}, {integrator}"), &rendered, [1.0; 3]);
            }
        }
    }
}

/// In a closed room with walls of emission 1/2 and reflectance 1/2, the radiance is 1 also in scattering fog.
#[test]
fn fog_in_a_furnace_is_invisible() {
    let group = Means::of_images(2 * AccelKind::CHOICES.len(), 1e-2);
    let mut scene = Description::default();
    let room = add(&mut scene, sphere(1.0), DAffine3::IDENTITY, diffuse(0.5));
    scene.shapes[room].emission = Some(Rgb::splat(0.5).into());
    scene.shapes[room].flip_normals = true;
    let fog = medium(&mut scene, SIGMA, [1.0; 3], HG);
    scene.shapes[room].boundary.exterior = Some(fog);
    scene.sensors.push(camera(DVec3::new(0.2, 0.1, -0.3), DVec3::new(-0.3, 0.4, 0.5), 90.0, 12));
    scene.sensors[0].medium = Some(fog);
    for &accel in AccelKind::CHOICES {
        let compiled = compiled(scene.clone(), accel);
        for (integrator, settings) in integrators(None) {
            // With 256 samples the standard error of bdpt is .009, in some runs more than the bound.
            let samples = if integrator == "bdpt" { 1024 } else { 256 };
            let rendered = render(&compiled, &settings, SamplerKind::Sobol, samples, 3);
            group.expect(&format!("{accel}, {integrator}"), &rendered, [1.0; 3]);
        }
    }
}

/// Light of a uniform environment that a half-space scatters once towards its normal. It does not depend on the
/// extinction, so it shows any error of the distances from the boundary.
#[test]
fn single_scattering_of_a_half_space_does_not_depend_on_its_density() {
    let sigmas = [1.0, 60.0, 1e3, 1e4];
    let group = Means::of_images(2 * sigmas.len() * AccelKind::CHOICES.len(), 1e-2);
    let albedo = [0.9, 0.6, 0.3];
    // ϖ/2 · ∫ μ/(1 + μ) dμ over [0, 1].
    let exact = albedo.map(|albedo| 0.5 * f64::from(albedo) * (1.0 - 2f64.ln()));
    for sigma in sigmas {
        let mut scene = spot(DVec3::Z);
        let fog = medium(&mut scene, [sigma; 3], albedo, Phase::Isotropic);
        let below = DAffine3::from_scale_rotation_translation(
            DVec3::splat(1e3),
            DQuat::IDENTITY,
            DVec3::new(0.0, 0.0, -1e3),
        );
        filled(&mut scene, Shape::Cube, below, Material::Null(Null), fog);
        for &accel in AccelKind::CHOICES {
            let compiled = compiled(scene.clone(), accel);
            for (integrator, settings) in integrators(Some(2)) {
                let rendered = render(&compiled, &settings, SamplerKind::Sobol, 2048, 6);
                group.expect(&format!("{sigma}, {accel}, {integrator}"), &rendered, exact);
            }
        }
    }
}

/// A density that is linear in the cosine on each side: 1 backward, 0 across, 3 forward.
fn table() -> Phase {
    Phase::Tabulated(Tabulated::new(&[1.0, 0.0, 3.0]).expect("a density"))
}

fn blend() -> Phase {
    Phase::Blend { weight: 0.25, phases: Box::new([Phase::Rayleigh, HG]) }
}

/// Returns the value of a phase function by its formula, sr⁻¹.
pub fn density(phase: &Phase, cos: f64) -> f64 {
    match phase {
        Phase::Isotropic => 0.25 / PI,
        Phase::HenyeyGreenstein { g } => {
            let g = f64::from(*g);
            (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * cos).powf(1.5))
        }
        Phase::Rayleigh => 3.0 * (1.0 + cos * cos) / (16.0 * PI),
        // The integral of the table [1, 0, 3] over the cosine is 2.
        Phase::Tabulated(_) => (if cos < 0.0 { -cos } else { 3.0 * cos }) / (4.0 * PI),
        Phase::Blend { weight, phases } => {
            let weight = f64::from(*weight);
            density(&phases[0], cos) * (1.0 - weight) + density(&phases[1], cos) * weight
        }
    }
}

/// Light of a point emitter that an infinite medium scatters once, by quadrature over the camera ray.
#[test]
fn single_scattering_of_a_point_emitter_is_its_integral() {
    let albedo = [0.9f32, 0.6, 0.3];
    let phases = [Phase::Isotropic, HG, Phase::Rayleigh, table(), blend()];
    let group = Means::of_images(2 * phases.len() * AccelKind::CHOICES.len(), 1e-2);
    for phase in phases {
        let mut scene = Description::default();
        scene.sensors.push(camera(DVec3::ZERO, -DVec3::Z, 1e-3, 8));
        let fog = medium(&mut scene, SIGMA, albedo, phase.clone());
        scene.sensors[0].medium = Some(fog);
        let light = DVec3::new(0.4, 0.0, -1.0);
        scene.emitters.push(Emitter::Point { position: light.as_vec3(), intensity: Rgb::splat(2.0) });
        let exact = [0, 1, 2].map(|c| {
            let (sigma, albedo) = (f64::from(SIGMA[c]), f64::from(albedo[c]));
            // The substitution t = −ln(1 − x)/σ makes the range finite.
            albedo
                * over_square(|[x, _]| {
                    let p = DVec3::Z * ((1.0 - x).ln() / sigma);
                    let to_light = light - p;
                    let distance = to_light.length();
                    let cos = -to_light.z / distance;
                    let phase = density(&phase, cos);
                    2.0 * phase * (-sigma * distance).exp() / (distance * distance)
                })
        });
        for &accel in AccelKind::CHOICES {
            let compiled = compiled(scene.clone(), accel);
            for (integrator, settings) in integrators(Some(2)) {
                let rendered = render(&compiled, &settings, SamplerKind::Sobol, 2048, 5);
                group.expect(&format!("{phase:?}, {accel}, {integrator}"), &rendered, exact);
            }
        }
    }
}

#[test]
fn phase_functions_sample_their_density() {
    let functions = [-0.9, -0.3, 0.0, 0.5, 0.85].map(|g| Phase::HenyeyGreenstein { g });
    let others = [Phase::Isotropic, Phase::Rayleigh, table(), blend()];
    for phase in functions.into_iter().chain(others) {
        let d = Vec3::new(0.48, -0.6, 0.64);
        let integral = check_directions(
            &format!("{phase:?}"),
            9,
            |_, u| Some(phase.sample(d, u)),
            |wi| phase.eval(d.dot(wi)),
        );
        assert!((integral - 1.0).abs() < 2e-3, "{phase:?}: {integral}");
    }
}

/// The mean cosine of the angle of deflection is g.
#[test]
fn the_mean_cosine_is_the_asymmetry() {
    const N: u32 = 1000;
    for g in [-0.95f32, -0.2, 0.0, 0.4, 0.99] {
        let phase = Phase::HenyeyGreenstein { g };
        // A midpoint rule over the random numbers.
        let u = |i: u32| Vec2::new((i as f32 + 0.5) / N as f32, 0.3);
        let sum: f64 = (0..N).map(|i| f64::from(phase.sample(Vec3::Y, u(i)).y)).sum();
        assert!((sum / f64::from(N) - f64::from(g)).abs() < 2e-3, "{g}: {}", sum / f64::from(N));
    }
}

/// Without media, `volpath` has the very pixels of `path`, and `path` ignores media to the bit.
#[test]
fn without_media_volpath_is_path() {
    let mut scene = Description { emitters: vec![constant(0.7)], ..Description::default() };
    scene.sensors.push(camera(DVec3::new(0.5, 1.0, 4.0), DVec3::ZERO, 40.0, 16));
    add(&mut scene, sphere(1.0), DAffine3::IDENTITY, diffuse(0.6));
    add(&mut scene, sphere(1.5), DAffine3::from_translation(DVec3::X), Material::Null(Null));
    let of = |scene: &Description, settings: &Settings| {
        pixels(&render(&compiled(scene.clone(), AccelKind::Auto), settings, SamplerKind::Sobol, 8, 1))
    };
    let path = Settings::Path(PathLimits::default().into());
    let expected = of(&scene, &path);
    assert_eq!(of(&scene, &volpath(None)), expected);
    let fog = medium(&mut scene, SIGMA, [0.5; 3], HG);
    scene.shapes[1].boundary.interior = Some(fog);
    assert_eq!(of(&scene, &path), expected);
    assert_ne!(of(&scene, &volpath(None)), expected);
}

const FOG: &str = "<scene version='3.0.0'><integrator type='volpath'/>
    <sensor type='perspective'><transform name='to_world'><lookat origin='0, 1, 5' target='0, 0, 0' up='0, 1, 0'/>
    </transform><ref id='air' name='medium'/>
    <film type='hdrfilm'><integer name='width' value='40'/><integer name='height' value='30'/></film></sensor>
    <medium type='homogeneous' id='air'><rgb name='sigma_t' value='.1, .05, .02'/><float name='albedo' value='.5'/></medium>
    <emitter type='point'><point name='position' x='1' y='2' z='1'/><float name='intensity' value='9'/></emitter>
    <emitter type='constant'/>
    <shape type='sphere'><bsdf type='dielectric'/><ref id='air' name='exterior'/>
    <medium type='homogeneous' name='interior'><rgb name='sigma_t' value='1, 2, 3'/><phase type='hg'/></medium></shape>
    </scene>";

/// Paths that are scattered until nothing is left of them have the light of those that end by Russian roulette. None is
/// invalid, although their throughputs become as small as numbers can be.
#[test]
fn throughputs_that_vanish_are_valid() {
    let settings = |rr_depth| Settings::Volpath(PathLimits { rr_depth, ..PathLimits::default() });
    let bdpt = |rr_depth| {
        let limits = PathLimits { rr_depth, ..PathLimits::default() };
        Settings::Bdpt(BdptSettings { limits, ..BdptSettings::default() })
    };
    let group = Means::of_images(2, 3e-2);
    for material in [Material::Null(Null), glass(1.5)] {
        let mut scene = spot(DVec3::Z * 5.0);
        let dense = medium(&mut scene, [0.5, 0.4, 0.3], [0.5, 0.5, 0.3], HG);
        filled(&mut scene, Shape::Cube, DAffine3::from_scale(DVec3::splat(200.0)), material, dense);
        scene.sensors[0].to_world = camera(DVec3::Z * 300.0, DVec3::ZERO, 1e-3, 4).to_world;
        let compiled = compiled(scene, AccelKind::Auto);
        let render = |settings: Settings, spp, seed| {
            let rendered = render(&compiled, &settings, SamplerKind::Sobol, spp, seed);
            assert_eq!(rendered.invalid_count, 0, "{settings:?}");
            rendered
        };
        let [a, b] = [(5, 1), (1_000_000, 2)].map(|(rr_depth, seed)| render(settings(rr_depth), 4096, seed));
        group.expect_same("volpath", &a, &b);
        render(bdpt(1_000_000), 32, 3);
    }
}

#[test]
fn threads_change_no_bit_of_media() {
    let folder = Folder::with(FOG);
    for (integrator, _) in integrators(None) {
        for (name, options) in [("one", "-t 1"), ("two", "-t 2"), ("again", "-t 2")] {
            folder.render(&format!("s.xml -q --integrator {integrator} --spp 9 -o {name}.pfm {options}"));
        }
        assert_eq!(folder.read("one.pfm"), folder.read("two.pfm"));
        assert_eq!(folder.read("one.pfm"), folder.read("again.pfm"));
    }
}
