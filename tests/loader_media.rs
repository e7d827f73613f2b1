//! Participating media in scene files: their values, and errors about them.

use crate::loader::{Files, scene as scene_text};
use crate::support::scenes::compiled;
use buffon::accel::AccelKind;
use buffon::color::Rgb;
use buffon::ids::MediumId;
use buffon::integrator::Settings;
use buffon::integrator::settings::PathLimits;
use buffon::loader::LoadOptions;
use buffon::medium::{Homogeneous, Medium, MediumBoundary, Phase, Tabulated};

fn volpath(max_depth: Option<u32>) -> Settings {
    Settings::Volpath(PathLimits { max_depth, ..PathLimits::default() })
}

/// Returns the media of a scene with the given elements inside a medium, rendered by `volpath`.
fn read(plugin: &str, inside: &str) -> Result<Homogeneous, String> {
    let text = scene_text(&format!(
        "<integrator type='volpath'/><sensor type='perspective'/>\n<medium type='{plugin}'>{inside}</medium>"
    ));
    let loaded = Files::new(&[("scene.xml", &text)]).load(&LoadOptions::default());
    let loaded = loaded.map_err(|error| error.to_string())?;
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    match &loaded.description.media[..] {
        [Medium::Homogeneous(medium)] => Ok(medium.clone()),
        _ => panic!("one medium"),
    }
}

#[test]
fn media_are_read_in_the_language_of_every_version() {
    let homogeneous = |inside: &str| read("homogeneous", inside).expect("a medium");
    let grey = |sigma_t: f32, sigma_s: f32, phase| Homogeneous {
        sigma_t: Rgb::splat(sigma_t),
        sigma_s: Rgb::splat(sigma_s),
        phase,
    };
    assert_eq!(homogeneous(""), grey(1.0, 0.75, Phase::Isotropic));
    assert_eq!(
        homogeneous(
            "<rgb name='albedo' value='.5, .25, 0'/><float name='sigma_t' value='2'/><float name='scale' value='3'/>
             <phase type='hg'><float name='g' value='-0.5'/></phase><boolean name='sample_emitters' value='false'/>"
        ),
        Homogeneous {
            sigma_t: Rgb::splat(6.0),
            sigma_s: Rgb::new(3.0, 1.5, 0.0),
            phase: Phase::HenyeyGreenstein { g: -0.5 }
        }
    );
    let constant = "<volume type='constvolume' name='sigma_t'><float name='value' value='4'/></volume>";
    assert_eq!(homogeneous(constant).sigma_t, Rgb::splat(4.0));
    assert_eq!(homogeneous("<phase type='hg'/>").phase, Phase::HenyeyGreenstein { g: 0.8 });
    assert_eq!(homogeneous("<phase type='isotropic'/>").phase, Phase::Isotropic);
    let table = "<phase type='tabphase'><string name='values' value='1, 0, 3'/></phase>";
    let tabulated = Phase::Tabulated(Tabulated::new(&[1.0, 0.0, 3.0]).unwrap());
    assert_eq!(homogeneous(table).phase, tabulated);
    let blend = format!(
        "<phase type='blendphase'><float name='weight' value='0.25'/><phase type='rayleigh'/>{table}</phase>"
    );
    let phases = Box::new([Phase::Rayleigh, tabulated]);
    assert_eq!(homogeneous(&blend).phase, Phase::Blend { weight: 0.25, phases });
    // Mitsuba 0.6.
    let parts = "<float name='sigma_a' value='.25'/><float name='sigma_s' value='.5'/><float name='density_multiplier' value='2'/>";
    assert_eq!(homogeneous(parts), grey(1.5, 1.0, Phase::Isotropic));
    let ketchup = homogeneous("<string name='material' value='Ketchup'/><float name='scale' value='10'/>");
    assert_eq!(ketchup.sigma_s, Rgb::new(0.18, 0.07, 0.03) * 10.0);
    assert_eq!(ketchup.sigma_t, (Rgb::new(0.061, 0.97, 1.45) + Rgb::new(0.18, 0.07, 0.03)) * 10.0);
    let old = "<scene version='0.6.0'><integrator type='volpath'/><sensor type='perspective'/>
        <medium type='homogeneous'><spectrum name='sigmaT' value='2'/><spectrum name='albedo' value='0.5'/></medium></scene>";
    let loaded = Files::new(&[("scene.xml", old)]).load(&LoadOptions::default()).expect("a scene");
    assert_eq!(loaded.description.media, [Medium::Homogeneous(grey(2.0, 1.0, Phase::Isotropic))]);
}

/// The errors of media, which `path` ignores with its note.
#[test]
fn media_that_cannot_be_rendered_are_named() {
    let without = "--integrator path renders the scene without media";
    let cases = [
        (
            "homogeneous",
            "<float name='sigma_t' value='-1'/>",
            "<float name=\"sigma_t\">: expected values of at least 0, found -1, -1, -1",
        ),
        (
            "homogeneous",
            "<rgb name='albedo' value='.5, 1.5, 0'/>",
            "<rgb name=\"albedo\">: expected values from 0 to 1, found 0.5, 1.5, 0",
        ),
        (
            "homogeneous",
            "<phase type='hg'><float name='g' value='1'/></phase>",
            "<float name=\"g\">: expected a number between -1 and 1, both excluded, found 1",
        ),
        (
            "homogeneous",
            "<float name='scale' value='-2'/>",
            "<float name=\"scale\">: expected a number of at least 0 for which the coefficients are finite, found -2",
        ),
        (
            "homogeneous",
            "<float name='sigma_s' value='2'/>",
            "<medium type=\"homogeneous\">: the property sigma_a is missing",
        ),
        (
            "homogeneous",
            "<float name='sigma_s' value='2'/><float name='albedo' value='1'/>",
            "<medium type=\"homogeneous\">: expected either sigma_t and albedo, or sigma_a and sigma_s, or a material, found several",
        ),
        (
            "homogeneous",
            "<string name='material' value='skimmlk'/>",
            "<string name=\"material\">: there is no such material (did you mean \"skimmilk\"?); there are apple, chicken1, chicken2, cream, \
             ketchup, marble, potato, skimmilk, skin1, skin2, spectralon, wholemilk",
        ),
        (
            "heterogeneous",
            "<volume type='noisevolume' name='sigma_t'/>",
            "<volume type=\"noisevolume\">: expected a constvolume or gridvolume, others are not supported; WITHOUT",
        ),
        ("homogenous", "", "<medium type=\"homogenous\">: unknown medium (did you mean \"homogeneous\"?)"),
        (
            "homogeneous",
            "<phase type='sggx'/>",
            "<phase type=\"sggx\">: this phase function is not supported; WITHOUT",
        ),
        (
            "homogeneous",
            "<phase type='tabphase'><string name='values' value='1'/></phase>",
            "<string name=\"values\">: expected at least two numbers that are not negative, not all of them 0",
        ),
        (
            "homogeneous",
            "<phase type='blendphase'><phase type='hg'/></phase>",
            "<phase type=\"blendphase\">: expected two phase functions inside it, found 1",
        ),
        (
            "homogeneous",
            "<volume type='gridvolume' name='albedo'/>",
            "<volume type=\"gridvolume\">: expected a constvolume, others are not supported; WITHOUT",
        ),
        (
            "homogeneous",
            "<texture type='bitmap' name='albedo'/>",
            "<texture type=\"bitmap\">: expected the same colour everywhere, found a texture",
        ),
    ];
    for (plugin, inside, message) in cases {
        let message = message.replace("WITHOUT", without);
        let found = read(plugin, inside).expect_err("an error");
        assert!(found.contains(&message), "{found}\n{message}");
        // The path integrator does not care. If volpath is chosen later, it tells the same.
        let text = scene_text(&format!(
            "<integrator type='path'/><sensor type='perspective'/>\n<medium type='{plugin}'>{inside}</medium>"
        ));
        let loaded = Files::new(&[("scene.xml", &text)]).load(&LoadOptions::default()).expect("a scene");
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
        let note = "the scene has media, which are not rendered: every medium is vacuum";
        assert!(loaded.notes.iter().any(|text| text == note));
        let compiled = compiled(loaded.description, AccelKind::Auto);
        Settings::Path(PathLimits::default().into()).create().check(&compiled).expect("path renders it");
        let refused = volpath(None).create().check(&compiled).expect_err("refused").to_string();
        assert!(refused.contains(&message), "{refused}");
    }
    let text = scene_text(
        "<integrator type='volpath'/>\n<shape type='sphere'><medium type='homogeneous' name='outside'/></shape>",
    );
    let error =
        Files::new(&[("scene.xml", &text)]).load(&LoadOptions::default()).expect_err("refused").to_string();
    let message = "<medium type=\"homogeneous\">: expected name=\"interior\" or name=\"exterior\" of a medium in a shape";
    assert!(error.contains(message), "{error}");
}

/// With media, the volumetric integrators of Mitsuba are `volpath`; the user's choice decides whether media are read.
#[test]
fn volumetric_integrators_are_volpath() {
    let load = |name: &str, replacement: Option<&str>| {
        let text = scene_text(&format!(
            "<integrator type='{name}'><integer name='max_depth' value='7'/></integrator>
             <sensor type='perspective'/><shape type='sphere'><medium type='homogeneous' name='interior'/></shape>"
        ));
        let integrator = replacement.map(str::to_owned);
        Files::new(&[("scene.xml", &text)])
            .load(&LoadOptions { integrator, ..LoadOptions::default() })
            .expect("a scene")
    };
    for name in ["volpath", "volpathmis", "prbvolpath"] {
        let loaded = load(name, None);
        assert_eq!(loaded.integrator, volpath(Some(7)));
        let note = format!("the integrator {name} is rendered as volpath");
        assert_eq!(loaded.notes.contains(&note), name != "volpath", "{:?}", loaded.notes);
    }
    let vacuum = "the scene has media, which are not rendered: every medium is vacuum".to_owned();
    assert!(load("volpath", Some("path")).notes.contains(&vacuum));
    assert!(!load("path", Some("volpath")).notes.contains(&vacuum));
    let boundary = MediumBoundary { interior: Some(MediumId(0)), exterior: None };
    assert_eq!(load("path", None).description.shapes[0].boundary, boundary);
}
