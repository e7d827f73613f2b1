//! The choice of emitters for glossy lobes has no bias, and less noise than the choice by irradiance alone.

use crate::path_reuse::{blocks, expect_reference, from_xml, limited, reference};
use buffon::integrator::Settings;
use buffon::integrator::settings::{DirectSettings, PathLimits, PathSettings, WhenPays};

const SKY: &str = "<emitter type='constant'><rgb name='radiance' value='0.1, 0.15, 0.2'/></emitter>";
const DIRECTIONAL: &str = "<emitter type='directional'><vector name='direction' x='0.3' y='-1' z='-0.2'/>\
    <rgb name='irradiance' value='0.5'/></emitter>";

/// A floor with the given BSDF.
fn floor(bsdf: &str) -> String {
    format!(
        "<shape type='rectangle'><transform name='to_world'><rotate x='1' angle='-90'/><scale value='2'/>\
         </transform>{bsdf}</shape>"
    )
}

/// Lamps in a ring above the floor.
fn lamps(count: usize) -> String {
    let lamp = |i: usize| {
        let (sin, cos) = (i as f32 * std::f32::consts::TAU / count as f32).sin_cos();
        let radiance = 70.0 * (1 + i % 3) as f32 / count as f32;
        format!(
            "<shape type='sphere'><point name='center' x='{}' y='{}' z='{}'/><float name='radius' value='0.12'/>\
             <emitter type='area'><rgb name='radiance' value='{radiance}'/></emitter></shape>",
            1.5 * cos,
            0.8 + 0.1 * (i % 4) as f32,
            1.5 * sin
        )
    };
    (0..count).map(lamp).collect()
}

fn path(reuse: WhenPays, limits: PathLimits) -> Settings {
    Settings::Path(PathSettings { reuse, ..PathSettings::independent(limits) })
}

/// bdpt chooses emitters by irradiance. More than sixteen emitters are in a tree.
#[test]
#[ignore = "takes long: make test-all"]
fn lobes_do_not_change_the_expectation() {
    let alpha = |alpha: f32| format!("<float name='alpha' value='{alpha}'/>");
    let conductor = |a: f32| format!("<bsdf type='roughconductor'>{}</bsdf>", alpha(a));
    let base = format!("<bsdf type='diffuse'/>{}", conductor(0.2));
    let bsdfs = [
        ("conductor", format!("<bsdf type='twosided'>{}</bsdf>", conductor(0.1))),
        ("plastic", format!("<bsdf type='roughplastic'>{}</bsdf>", alpha(0.15))),
        ("principled", "<bsdf type='principled'><float name='roughness' value='0.4'/></bsdf>".to_string()),
        ("blend", format!("<bsdf type='blendbsdf'><float name='weight' value='0.5'/>{base}</bsdf>")),
        ("ward", "<bsdf type='ward'/>".to_string()),
        ("phong", "<bsdf type='phong'/>".to_string()),
    ];
    let emitters = [(5, ""), (3, SKY), (20, DIRECTIONAL)];
    for ((name, bsdf), (count, others)) in bsdfs.into_iter().zip(emitters.into_iter().cycle()) {
        let scene = from_xml(&format!("{}{}{others}", floor(&bsdf), lamps(count)), 16);
        let bdpt = Settings::by_name("bdpt", limited(3)).expect("it exists");
        let reference = reference(&scene, &bdpt, 16, 32);
        for reuse in [WhenPays::Never, WhenPays::Always] {
            let (name, path) = (format!("{name}, {count} lamps, reuse {reuse:?}"), path(reuse, limited(3)));
            expect_reference(&name, &scene, &path, &reference, 16, 32);
        }
    }
}

/// `direct` chooses emitters by irradiance.
#[test]
fn lobes_reduce_noise() {
    let bsdf = "<bsdf type='roughconductor'><float name='alpha' value='0.1'/></bsdf>";
    for count in [8, 32] {
        let scene = from_xml(&format!("{}{}", floor(bsdf), lamps(count)), 16);
        let noise = |settings: &Settings| {
            blocks(&scene, settings, 16, 0..8, 64).iter().map(|[_, variance]| variance).sum::<f64>()
        };
        // Edges of visible lamps have noise of their own.
        let direct = DirectSettings { hide_emitters: true, ..DirectSettings::default() };
        let limits = PathLimits { hide_emitters: true, ..limited(2) };
        let settings = [path(WhenPays::Never, limits), Settings::Direct(direct)];
        let noise = settings.map(|settings| noise(&settings));
        assert!(noise[0] < 0.6 * noise[1], "{count} lamps: {noise:?}");
    }
}
