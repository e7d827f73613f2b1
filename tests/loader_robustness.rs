//! Broken input of every kind gives a scene or an error, never a panic.

use crate::loader::{BOX, Files};
use crate::support::scenes::render;
use buffon::accel::AccelKind;
use buffon::integrator::Settings;
use buffon::integrator::settings::PathLimits;
use buffon::loader::LoadOptions;
use buffon::sampling::SamplerKind;
use buffon::scene::{CompileOptions, compile};
use proptest::prelude::*;

/// A scene with a plugin of every family.
const EVERYTHING: &str = r#"<scene version="3.0.0">
  <default name="spp" value="4"/>
  <integrator type="aov"><string name="aovs" value="n:sh_normal,uv:uv"/><integrator type="path"/></integrator>
  <sensor type="thinlens">
    <float name="fov" value="50"/><float name="aperture_radius" value="0.1"/><float name="focus_distance" value="4"/>
    <float name="shutter_open" value="0"/><float name="shutter_close" value="1"/>
    <animation name="to_world">
      <transform time="0"><lookat origin="0,1,4" target="0,0.5,0" up="0,1,0"/></transform>
      <transform time="1"><lookat origin="0.1,1,4" target="0,0.5,0" up="0,1,0"/></transform>
    </animation>
    <sampler type="multijitter"><integer name="sample_count" value="$spp"/></sampler>
    <film type="hdrfilm">
      <integer name="width" value="8"/><integer name="height" value="6"/><rfilter type="lanczos"/>
    </film>
  </sensor>
  <texture type="checkerboard" id="board"><rgb name="color0" value="0.1,0.2,0.3"/></texture>
  <bsdf type="twosided" id="wall"><bsdf type="diffuse"><ref id="board" name="reflectance"/></bsdf></bsdf>
  <bsdf type="blendbsdf" id="blend"><float name="weight" value="0.3"/>
    <bsdf type="roughplastic"><float name="alpha" value="0.2"/><boolean name="nonlinear" value="true"/></bsdf>
    <bsdf type="principled"><float name="metallic" value="0.5"/><float name="clearcoat" value="0.4"/></bsdf>
  </bsdf>
  <bsdf type="mask" id="holes"><ref id="board" name="opacity"/><ref id="wall"/></bsdf>
  <bsdf type="bumpmap" id="bumps"><texture type="checkerboard"/><float name="scale" value="0.1"/>
    <bsdf type="roughdielectric"><string name="distribution" value="ggx"/></bsdf></bsdf>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="3"/></transform>
    <ref id="wall"/></shape>
  <shape type="cube"><transform name="to_world"><scale value="0.3"/><translate y="0.4"/></transform><ref id="blend"/></shape>
  <shape type="cylinder"><point name="p1" x="0" y="1" z="0"/><float name="radius" value="0.2"/><ref id="holes"/></shape>
  <shape type="disk"><ref id="bumps"/></shape>
  <shape type="shapegroup" id="group"><shape type="sphere"><ref id="blend"/></shape></shape>
  <shape type="instance"><ref id="group"/><transform name="to_world"><scale value="0.2"/></transform></shape>
  <shape type="sphere"><float name="radius" value="0.2"/>
    <animation name="to_world"><transform time="0"><translate y="2"/></transform>
      <transform time="1"><translate y="2.5"/></transform></animation>
    <emitter type="area"><spectrum name="radiance" value="400:1, 700:2"/></emitter></shape>
  <emitter type="spot"><transform name="to_world"><lookat origin="1,3,1" target="0,0,0" up="0,1,0"/></transform></emitter>
  <emitter type="directional"><vector name="direction" x="0" y="-1" z="0.2"/></emitter>
  <emitter type="constant"><rgb name="radiance" value="0.2"/></emitter>
</scene>"#;

/// Returns the number of cases per test: `few`, or the value of the environment variable.
fn cases(few: u32) -> u32 {
    std::env::var("BUFFON_FUZZ_CASES").ok().and_then(|n| n.parse().ok()).unwrap_or(few)
}

/// Returns a strategy for edits: positions, numbers of removed characters, and insertions.
fn edits() -> impl Strategy<Value = Vec<(prop::sample::Index, usize, String)>> {
    let inserted = prop_oneof![
        4 => "[-0-9a-z<>/\"'=$. é]{0,6}",
        1 => Just("1e39".to_owned()),
        1 => Just("-0".to_owned()),
        1 => Just("nan".to_owned()),
        1 => Just("99999999999".to_owned()),
    ];
    proptest::collection::vec((any::<prop::sample::Index>(), 0usize..12, inserted), 1..6)
}

fn mutated(text: &str, edits: Vec<(prop::sample::Index, usize, String)>) -> String {
    let mut text: Vec<char> = text.chars().collect();
    for (at, removed, inserted) in edits {
        let at = at.index(text.len());
        let end = (at + removed).min(text.len());
        text.splice(at..end, inserted.chars());
    }
    text.into_iter().collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: cases(300), failure_persistence: None, ..ProptestConfig::default() })]

    /// Loading a scene with any change of its text gives a scene or an error.
    #[test]
    fn a_mutated_scene_never_panics(edits in edits()) {
        let files = Files::new(&[("scene.xml", &mutated(BOX, edits))]);
        if let Err(error) = files.load(&LoadOptions::default()) {
            prop_assert!(!error.to_string().is_empty());
        }
    }

    /// A loaded scene is compiled or refused, and a compiled scene can be rendered.
    #[test]
    fn a_mutated_scene_renders_or_is_refused(edits in edits()) {
        let files = Files::new(&[("scene.xml", &mutated(EVERYTHING, edits))]);
        let Ok(mut loaded) = files.load(&LoadOptions::default()) else { return Ok(()) };
        for sensor in &mut loaded.description.sensors {
            (sensor.film.width, sensor.film.height, sensor.film.crop) = (4, 3, None);
        }
        let options = CompileOptions { accel: AccelKind::default(), threads: 1, sensor: 0, passes_panes: false };
        let Ok((scene, _)) = compile(loaded.description, options) else { return Ok(()) };
        if !scene.sensors.is_empty() {
            let path = Settings::Path(PathLimits { max_depth: Some(4), ..PathLimits::default() }.into());
            let rendered = render(&scene, &path, SamplerKind::Sobol, 1, 1);
            prop_assert_eq!(rendered.samples_per_pixel, 1);
        }
    }
}

/// The original of the mutated scenes is valid.
#[test]
fn the_scene_of_everything_loads() {
    let loaded = Files::new(&[("scene.xml", EVERYTHING)]).load(&LoadOptions::default()).expect("it loads");
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
}
