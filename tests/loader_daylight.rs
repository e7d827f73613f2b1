//! `sunsky`, `sun` and `sky` in scene files.

use crate::loader::{Files, SENSOR, loaded, scene};
use crate::loader_errors::error;
use buffon::color::Rgb;
use buffon::emitter::daylight::{SUN_HALF_APERTURE, one_minus_cos, sun_radiance};
use buffon::emitter::{Emitter, Sky};
use buffon::loader::LoadOptions;
use buffon::math::{DVec3, Vec3};
use std::f64::consts::TAU;

/// Loads the elements of a scene of version 0.6, which cause no warning.
fn old(inside: &str) -> Vec<Emitter> {
    let text = scene(&format!("{SENSOR}{inside}")).replace("3.0.0", "0.6.0");
    let loaded = Files::new(&[("scene.xml", &text)]).load(&LoadOptions::default());
    let loaded = loaded.unwrap_or_else(|e| panic!("{e}"));
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    loaded.description.emitters
}

fn emitters(inside: &str) -> Vec<Emitter> {
    loaded(inside).description.emitters
}

/// Returns the direction, half angle, zenith and radiance of the sun, which follows a sky.
fn sun(emitters: &[Emitter]) -> (Vec3, f64, Vec3, Rgb) {
    match emitters {
        [Emitter::Sky(_), Emitter::Sun { direction, half_angle, up, radiance }] => {
            (*direction, *half_angle, *up, *radiance)
        }
        _ => panic!("{emitters:?}"),
    }
}

fn sky(emitters: &[Emitter]) -> &Sky {
    match &emitters[0] {
        Emitter::Sky(sky) => sky,
        other => panic!("{other:?}"),
    }
}

#[track_caller]
fn close(a: Rgb, b: Rgb) {
    assert!((a - b).map(f32::abs).max_component() < 1e-4 * b.max_component(), "{a:?}, not {b:?}");
}

/// Golden, Colorado, on 17 October 2003 at 12:30:30. [Reda 2004, table A5.1]
const GOLDEN: [(&str, &str, &str); 9] = [
    ("integer", "year", "2003"),
    ("integer", "month", "10"),
    ("integer", "day", "17"),
    ("float", "hour", "12"),
    ("float", "minute", "30"),
    ("float", "second", "30"),
    ("float", "latitude", "39.742476"),
    ("float", "longitude", "-105.1786"),
    ("float", "timezone", "-7"),
];
/// Its zenith angle without refraction, and its azimuth from the north towards the east, in degrees.
const GOLDEN_SUN: [f64; 2] = [50.1279, 194.3402];

/// The sun is where the published position is: in version 3, +z is up, +x south and +y west; in version 0.6, +y is up,
/// −z north and +x east.
#[test]
fn date_and_place_give_the_direction_of_the_sun() {
    let date: String =
        GOLDEN.iter().map(|(tag, name, value)| format!("<{tag} name='{name}' value='{value}'/>")).collect();
    let [(sin, cos), (east, north)] = GOLDEN_SUN.map(|angle| angle.to_radians().sin_cos());
    let emitter = format!("<emitter type='sunsky'>{date}</emitter>");
    let (direction, _, up, _) = sun(&emitters(&emitter));
    assert_eq!(up, Vec3::Z);
    let published = DVec3::new(-north * sin, -east * sin, cos);
    assert!(direction.as_dvec3().angle_between(published) < 3e-4, "{direction} {published}");
    let (direction, _, up, _) = sun(&old(&emitter));
    assert_eq!(up, Vec3::Y);
    let published = DVec3::new(east * sin, cos, -north * sin);
    assert!(direction.as_dvec3().angle_between(published) < 3e-4, "{direction} {published}");
}

/// The defaults are 10 July 2010, 15:00, in Tokyo. Version 3 has an albedo of 0.3, version 0.6 of 0.2.
#[test]
fn defaults_are_those_of_the_scene_language() {
    let (new, all) = (emitters("<emitter type='sunsky'/>"), old("<emitter type='sunsky'/>"));
    let (direction, half_angle, _, radiance) = sun(&new);
    assert!((direction.z.asin().to_degrees() - 46.08).abs() < 0.05, "{direction}");
    assert!((half_angle - SUN_HALF_APERTURE.to_radians()).abs() < 1e-12);
    close(radiance, sun_radiance(3.0, f64::from(direction.z).asin()));
    for (defaults, albedo) in [(&new, "0.3"), (&all, "0.2")] {
        let emitter = format!("<emitter type='sunsky'><float name='albedo' value='{albedo}'/></emitter>");
        let same = if albedo == "0.3" { emitters(&emitter) } else { old(&emitter) };
        assert_eq!(defaults, &same);
    }
    assert_ne!(sky(&new).eval(direction), sky(&old("<emitter type='sky'/>")).eval(sun(&all).0));
}

/// Scales multiply, in the names of both versions, and zero removes the emitter.
#[test]
fn scales_are_factors() {
    let (plain, plain_old) = (emitters("<emitter type='sunsky'/>"), old("<emitter type='sunsky'/>"));
    let scaled = emitters(
        "<emitter type='sunsky'><float name='sun_scale' value='2'/><float name='sky_scale' value='3'/></emitter>",
    );
    let scaled_old = old("<emitter type='sunsky'><float name='scale' value='3'/>
        <float name='sunScale' value='2'/></emitter>");
    for (plain, scaled) in [(&plain, &scaled), (&plain_old, &scaled_old)] {
        close(sun(scaled).3, sun(plain).3 * 2.0);
        let d = Vec3::new(0.5, 0.6, 0.7).normalize();
        close(sky(scaled).eval(d), sky(plain).eval(d) * 3.0);
    }
    let without =
        |name: &str| emitters(&format!("<emitter type='sunsky'><float name='{name}' value='0'/></emitter>"));
    assert!(matches!(without("sun_scale")[..], [Emitter::Sky(_)]));
    assert!(matches!(without("sky_scale")[..], [Emitter::Sun { .. }]));
    let both = old("<emitter type='sky'/><emitter type='sun'><float name='scale' value='2'/></emitter>");
    close(sun(&both).3, sun(&plain_old).3 * 2.0);
    assert_eq!(sky(&both), sky(&plain_old));
}

/// A wider sun is dimmer, with the same irradiance; without width it is parallel light.
#[test]
fn the_irradiance_does_not_depend_on_the_aperture() {
    let energy = |(_, half_angle, _, radiance): (Vec3, f64, Vec3, Rgb)| {
        radiance * (TAU * one_minus_cos(half_angle)) as f32
    };
    let plain = energy(sun(&emitters("<emitter type='sunsky'/>")));
    let wide = "<emitter type='sunsky'><float name='sun_aperture' value='8'/></emitter>";
    let wide = sun(&emitters(wide));
    assert!((wide.1 - 4f64.to_radians()).abs() < 1e-6);
    close(energy(wide), plain);
    let with =
        |scale: &str| format!("<emitter type='sun'><float name='sunRadiusScale' value='{scale}'/></emitter>");
    let [Emitter::Sun { half_angle, .. }] = old(&with("10"))[..] else { panic!("no sun") };
    assert!((half_angle - 10.0 * SUN_HALF_APERTURE.to_radians()).abs() < 1e-6);
    let parallel = old(&with("0"));
    let [Emitter::Directional { irradiance, .. }] = parallel[..] else { panic!("{parallel:?}") };
    close(irradiance, plain);
}

/// `sun_direction` is in world space; `to_world` turns the zenith, and the sun of a date.
#[test]
fn to_world_turns_the_zenith() {
    let turn = "<transform name='to_world'><rotate x='1' angle='-90'/></transform>";
    let given =
        format!("<emitter type='sunsky'><vector name='sun_direction' value='1,2,2'/>{turn}</emitter>");
    let (direction, _, up, radiance) = sun(&emitters(&given));
    assert!((direction - Vec3::new(1.0, 2.0, 2.0) / 3.0).length() < 1e-6 && (up - Vec3::Y).length() < 1e-6);
    close(radiance, sun_radiance(3.0, (2f64 / 3.0).asin()));
    let (plain, ..) = sun(&emitters("<emitter type='sunsky'/>"));
    let (turned, ..) = sun(&emitters(&format!("<emitter type='sunsky'>{turn}</emitter>")));
    assert!((turned - Vec3::new(plain.x, plain.z, -plain.y)).length() < 1e-6);
}

/// Below the horizon there is neither sun nor sky.
#[test]
fn at_night_there_is_a_warning_and_no_light() {
    let night = scene(&format!("{SENSOR}\n<emitter type='sunsky'><float name='hour' value='23'/></emitter>"));
    let files = Files::new(&[("scene.xml", &night)]);
    let loaded = files.load(&LoadOptions::default()).expect("a scene");
    assert!(loaded.description.emitters.is_empty());
    let [warning] = &loaded.warnings[..] else { panic!("{:?}", loaded.warnings) };
    assert_eq!(warning.message, "the sun is below the horizon and emits no light");
}

/// What makes no difference is noted.
#[test]
fn what_does_not_apply_is_noted() {
    let loaded = loaded("<emitter type='sunsky'><boolean name='complex_sun' value='true'/></emitter>");
    assert_eq!(loaded.approximations, ["<emitter type=\"sunsky\">: the disc of the sun is uniform"]);
    let text =
        scene(&format!("{SENSOR}<emitter type='sky'><integer name='resolution' value='64'/></emitter>"));
    let loaded = Files::new(&[("scene.xml", &text)]).load(&LoadOptions::default()).expect("a scene");
    assert_eq!(
        loaded.notes[1..],
        ["<emitter type=\"sky\">: resolution is ignored: the sun and the sky are not images"]
    );
}

#[test]
fn values_out_of_range() {
    let cases = [
        ("turbidity", "0.9", "expected a number from 1 to 10, found 0.9"),
        ("turbidity", "11", "expected a number from 1 to 10, found 11"),
        ("albedo", "1.5", "expected values from 0 to 1, found 1.5, 1.5, 1.5"),
        ("sun_scale", "-1", "expected a number of at least 0, found -1"),
        ("sky_scale", "-2", "expected a number of at least 0, found -2"),
        ("sun_aperture", "0", "expected degrees above 0 and below 180, found 0"),
        ("sun_aperture", "180", "expected degrees above 0 and below 180, found 180"),
        ("latitude", "91", "expected a number from -90 to 90, found 91"),
    ];
    for (name, value, message) in cases {
        let found =
            error(&format!("<emitter type='sunsky'>\n<float name='{name}' value='{value}'/></emitter>"));
        assert_eq!(found, format!("scene.xml:3:1: <float name=\"{name}\">: {message}"));
    }
    let cases = [
        (
            "sunsky'>\n<integer name='month' value='13'/>",
            "<integer name=\"month\">: expected a whole number from 1 to 12, found 13",
        ),
        (
            "sunsky'>\n<vector name='sun_direction' value='0,0,0'/>",
            "<vector name=\"sun_direction\">: expected a direction, found 0, 0, 0",
        ),
        (
            "sunsky'><vector name='sun_direction' value='0,0,1'/>\n<float name='hour' value='1'/>",
            "<float name=\"hour\">: expected either sun_direction or a date and a place, found both",
        ),
        (
            "sunsky'>\n<transform name='to_world'><scale x='2'/></transform>",
            "<transform name=\"to_world\">: expected a to_world transform that rotates, mirrors or scales evenly",
        ),
        (
            "sky'>\n<float name='stretch' value='1.2'/>",
            "<float name=\"stretch\">: expected 1, because the sky cannot be stretched, found 1.2",
        ),
        (
            "sun'>\n<float name='sun_radius_scale' value='-1'/>",
            "<float name=\"sun_radius_scale\">: expected a number of at least 0 and below 335.9, found -1",
        ),
        ("sun'/>\n<emitter type='sun'>", "<emitter type=\"sun\">: a scene has room for one sun"),
        ("constant'/>\n<emitter type='sky'>", "<emitter type=\"sky\">: a scene has room for one environment"),
    ];
    for (inside, message) in cases {
        assert_eq!(error(&format!("<emitter type='{inside}</emitter>")), format!("scene.xml:3:1: {message}"));
    }
}
