//! Thin panes that rays pass as they pass holes: the same images as with panes that scatter all rays.

use crate::path_caustics::LAMP;
use crate::path_reuse::{described, expect_reference, from_xml, reference};
use crate::support::cli::Folder;
use crate::support::expect::Means;
use crate::support::scenes::{camera, mean, render};
use buffon::accel::AccelKind;
use buffon::color::Rgb;
use buffon::integrator::Settings;
use buffon::integrator::settings::{PathLimits, PathSettings, WhenPays};
use buffon::material::{Input, Material};
use buffon::math::DVec3;
use buffon::sampling::SamplerKind;
use buffon::scene::{CompileOptions, Description, Scene, compile};
use buffon::sensor::{Projection, SensorSettings};
use buffon::session::{SceneChoices, SceneFile};
use buffon::texture::Texture;
use std::sync::Arc;

const FLOOR: &str = "<shape type='rectangle'><transform name='to_world'><rotate x='1' angle='-90'/><scale value='3'/>\
    </transform><bsdf type='diffuse'/></shape>";
const SKY: &str = "<emitter type='constant'><rgb name='radiance' value='0.3, 0.4, 0.5'/></emitter>";
/// Panes of every shape, clear and tinted, one of them a mesh with interpolated normals.
const PANES: &str = "<shape type='rectangle'><transform name='to_world'><rotate x='1' angle='70'/><scale value='0.6'/>\
    <translate x='-0.5' y='1.2' z='0.3'/></transform><bsdf type='thindielectric'>\
    <rgb name='specular_transmittance' value='0.9, 0.6, 0.3'/></bsdf></shape>\
    <shape type='sphere'><point name='center' x='0.6' y='0.7' z='0.2'/><float name='radius' value='0.4'/>\
    <bsdf type='thindielectric'><rgb name='specular_reflectance' value='0.5'/></bsdf></shape>\
    <shape type='cylinder'><point name='p0' x='-1' y='0.2' z='0.6'/><point name='p1' x='0' y='0.4' z='0.9'/>\
    <float name='radius' value='0.2'/><bsdf type='thindielectric'><float name='int_ior' value='2'/></bsdf></shape>\
    <shape type='disk'><transform name='to_world'><scale value='0.4'/><translate x='0.1' y='0.5' z='1.2'/>\
    </transform><bsdf type='mask'><float name='opacity' value='0.7'/><bsdf type='thindielectric'/></bsdf></shape>\
    <shape type='cube'><transform name='to_world'><scale value='0.15'/><rotate y='1' angle='30'/>\
    <translate x='1' y='0.2' z='0.9'/></transform><bsdf type='thindielectric'/></shape>";

/// Returns a scene in which rays pass panes.
fn passing(body: &str, size: u32) -> Scene {
    passed(described(body, size))
}

fn passed(description: Description) -> Scene {
    let options = CompileOptions { accel: AccelKind::default(), threads: 2, sensor: 0, passes_panes: true };
    compile(description, options).expect("the scene compiles").0
}

/// Returns a camera at z = 4 that looks along the z axis at the origin.
fn straight() -> SensorSettings {
    camera(DVec3::Z * 4.0, DVec3::ZERO, 0.01, 4)
}

fn path() -> Settings {
    Settings::Path(PathSettings::independent(PathLimits::default()))
}

#[test]
fn passing_panes_does_not_change_the_expectation() {
    let body = format!("{FLOOR}{PANES}{LAMP}{SKY}");
    let [scene, scattering] = [passing(&body, 16), from_xml(&body, 16)];
    assert!(scene.needs.holes);
    let limits = PathLimits::default();
    let path = PathSettings::independent(limits);
    let expected = reference(&scattering, &Settings::Path(path), 16, 256);
    let always = WhenPays::Always;
    let by_name = |name: &str| Settings::by_name(name, limits).expect("an integrator");
    for (name, settings) in [
        ("path", Settings::Path(path)),
        ("reuse", Settings::Path(PathSettings { reuse: always, ..path })),
        ("splitting", Settings::Path(PathSettings { splitting: always, ..path })),
        ("caustics", Settings::Path(PathSettings { caustics: always, ..path })),
        ("bdpt", by_name("bdpt")),
        ("volpath", by_name("volpath")),
    ] {
        expect_reference(name, &scene, &settings, &expected, 16, 64);
    }
}

/// A lamp behind a tinted pane under an angle of 45°, and nothing else: its radiance times the transmittance with all
/// internal reflections.
#[test]
fn a_pane_transmits_what_fresnel_says() {
    let tint = [1.0, 0.6, 0.2];
    let body = "<shape type='rectangle'><transform name='to_world'><scale value='9'/><translate z='-2'/></transform>\
        <emitter type='area'><rgb name='radiance' value='3'/></emitter></shape>\
        <shape type='rectangle'><transform name='to_world'><scale value='9'/><rotate y='1' angle='45'/></transform>\
        <bsdf type='thindielectric'><float name='int_ior' value='1.5'/><float name='ext_ior' value='1'/>\
        <rgb name='specular_transmittance' value='1, 0.6, 0.2'/></bsdf></shape>";
    let mut description = described(body, 4);
    description.sensors[0] = straight();
    let scene = passed(description);
    let (sin, eta) = (0.5f64.sqrt(), 1.5);
    let (inside, outside) = ((1.0 - (sin / eta).powi(2)).sqrt(), sin);
    let parallel = (eta * outside - inside) / (eta * outside + inside);
    let perpendicular = (outside - eta * inside) / (outside + eta * inside);
    let r = 0.5 * (parallel.powi(2) + perpendicular.powi(2));
    let transmitted = 1.0 - 2.0 * r / (1.0 + r);
    let rendered = render(&scene, &path(), SamplerKind::Independent, 1 << 14, 1);
    Means::of_images(1, 0.01).expect("a pane", &rendered, tint.map(|c| 3.0 * c * transmitted));
}

/// Samples that share a ray pass a pane or a hole independently of each other.
#[test]
fn samples_of_one_ray_pass_holes_independently() {
    let lamp = "<shape type='rectangle'><transform name='to_world'><scale value='9'/><translate z='-2'/></transform>\
        <emitter type='area'><rgb name='radiance' value='3'/></emitter></shape>";
    let r = 0.04;
    let pane = "<bsdf type='thindielectric'><float name='int_ior' value='1.5'/><float name='ext_ior' value='1'/></bsdf>";
    let mask = "<bsdf type='mask'><float name='opacity' value='0.3'/>\
        <bsdf type='diffuse'><rgb name='reflectance' value='0'/></bsdf></bsdf>";
    let bodies = [(pane, 3.0 * (1.0 - 2.0 * r / (1.0 + r))), (mask, 3.0 * 0.7)];
    let projections = [Projection::Axis, Projection::Distant { target: Some([0.0; 3]) }];
    let means = Means::of_images(bodies.len() * projections.len(), 0.01);
    for (material, expected) in bodies {
        for projection in projections {
            let mut description = described(&format!("{lamp}<shape type='rectangle'>{material}</shape>"), 4);
            description.sensors[0] = SensorSettings { projection, ..straight() };
            let rendered = render(&passed(description), &path(), SamplerKind::Independent, 1 << 12, 1);
            means.expect(&format!("{material} {projection:?}"), &rendered, [expected; 3]);
        }
    }
}

/// A texture may transmit more than all light. No light of it is lost.
#[test]
fn panes_transmit_what_their_texture_says() {
    for tint in [Rgb::new(1.5, 1.2, 1.1), Rgb::new(2.0, 0.5, 0.0), Rgb::new(0.5, 0.0, 1.0)] {
        let sheets = ["", "<shape type='rectangle'><bsdf type='thindielectric'/></shape>"];
        let [bare, covered] = sheets.map(|sheet| {
            let mut description = described(&format!("{sheet}{SKY}"), 4);
            description.sensors[0] = straight();
            let texture = description.add_texture(Arc::new(Texture::Constant(tint)));
            for material in &mut description.materials {
                if let Material::ThinDielectric(pane) = material {
                    pane.specular_transmittance = Input::Texture(texture);
                }
            }
            let rendered = render(&passed(description), &path(), SamplerKind::Independent, 1 << 12, 1);
            mean(&rendered).0
        });
        let r = 2.0 * 0.04 / 1.04;
        for (c, factor) in tint.to_array().map(f64::from).into_iter().enumerate() {
            let ratio = covered[c] / bare[c];
            // The default index of refraction is 1.5046, which changes the ratio by less than 0.003.
            assert!((ratio - (r + (1.0 - r) * factor)).abs() < 0.02, "{tint:?} {c}: {ratio}");
        }
    }
}

/// As in Mitsuba, panes stop the light of emitters that no ray can hit, and panes that emit or bound media are hit by
/// all rays.
#[test]
fn some_panes_are_not_passed() {
    let glass = "<bsdf type='thindielectric'/>";
    let point = "<emitter type='point'><rgb name='intensity' value='1'/></emitter>";
    let sun = "<emitter type='directional'><rgb name='irradiance' value='1'/></emitter>";
    let emitting = format!("<shape type='rectangle'>{glass}<emitter type='area'/></shape>");
    let filled = format!("<shape type='sphere'>{glass}<medium type='homogeneous' name='interior'/></shape>");
    let pane = format!("<shape type='rectangle'>{glass}</shape>");
    for body in [format!("{pane}{point}"), format!("{pane}{sun}"), emitting, filled] {
        assert!(!passing(&format!("{FLOOR}{body}"), 4).needs.holes, "{body}");
    }
    assert!(passing(&format!("{FLOOR}{pane}{SKY}"), 4).needs.holes);
}

/// Panes are passed only if all integrators that render the scene allow it, and if paths may be long.
#[test]
fn integrators_decide_whether_panes_are_passed() {
    let passes = |depth: i32, hidden: bool, integrators: &[&str]| {
        let body =
            "<sensor type='perspective'/><shape type='rectangle'><bsdf type='thindielectric'/></shape>";
        let path = format!(
            "<integrator type='path'><integer name='max_depth' value='{depth}'/>\
            <boolean name='hide_emitters' value='{hidden}'/></integrator>"
        );
        let folder = Folder::with(&format!("<scene version='3.0.0'>{path}{body}{SKY}</scene>"));
        let file = SceneFile::load(&folder.path("s.xml"), &SceneChoices::default());
        let mut file = file.expect("the scene loads");
        file.pass_panes(integrators.iter().copied());
        file.compile(AccelKind::default(), 1).expect("the scene compiles").scene.needs.holes
    };
    for (depth, hidden, integrators, expected) in [
        (-1, false, &[][..], true),
        (16, false, &[], true),
        (15, false, &[], false),
        (-1, true, &[], false),
        (-1, false, &["auto"], true),
        (15, false, &["auto"], false),
        (-1, true, &["auto"], false),
        (-1, false, &["volpath", "bdpt"], true),
        (-1, false, &["path", "whitted"], false),
        (-1, false, &["distribution"], false),
        (-1, false, &["photonmapper"], false),
    ] {
        assert_eq!(passes(depth, hidden, integrators), expected, "{depth} {hidden} {integrators:?}");
    }
}
