//! Bidirectional path tracing in participating media, compared with `volpath`.

use crate::bidirectional::{agree, check_bits};
use crate::support::cli::Folder;

const NULL: &str = "<bsdf type='null'/><ref id='m' name='interior'/>";
const LAMP: &str = "<shape type='rectangle'><transform name='to_world'><rotate x='1' angle='90'/>
    <scale value='.6'/><translate y='3'/></transform>
    <emitter type='area'><rgb name='radiance' value='8,7,6'/></emitter></shape>";
const BULB: &str =
    "<shape type='sphere'><point name='center' x='1.2' y='2.2' z='.3'/><float name='radius' value='.3'/>
    <emitter type='area'><rgb name='radiance' value='30,28,25'/></emitter></shape>";
const POINT: &str = "<emitter type='point'><point name='position' x='1' y='2.4' z='.5'/>
    <rgb name='intensity' value='8,8,9'/></emitter>";
const SKY: &str = "<emitter type='constant'><rgb name='radiance' value='.6,.7,.9'/></emitter>
    <emitter type='directional'><vector name='direction' x='-.4' y='-1' z='-.3'/>
    <float name='irradiance' value='3'/></emitter>";

/// Returns a scene with a diffuse floor, and with the medium `m`.
fn scene(integrator: &str, sensor: &str, medium: &str, contents: &str) -> String {
    format!(
        "<scene version='3.0.0'>{integrator}{medium}
        <sensor {sensor}<transform name='to_world'><lookat origin='0,1,6' target='0,.8,0' up='0,1,0'/></transform>
        <film type='hdrfilm'><integer name='width' value='24'/><integer name='height' value='20'/></film></sensor>
        <shape type='rectangle'><transform name='to_world'><rotate x='1' angle='-90'/><scale value='4'/></transform>
        <bsdf type='diffuse'><rgb name='reflectance' value='.6,.5,.4'/></bsdf></shape>{contents}</scene>"
    )
}

const PINHOLE: &str = "type='perspective'><float name='fov' value='45'/>";
const LENS: &str = "type='thinlens'><float name='fov' value='45'/><float name='aperture_radius' value='.2'/>
    <float name='focus_distance' value='6'/>";

fn fog(sigma_t: &str, albedo: &str) -> String {
    format!(
        "<medium type='homogeneous' id='m'><rgb name='sigma_t' value='{sigma_t}'/><rgb name='albedo' value='{albedo}'/>
        <phase type='hg'><float name='g' value='.5'/></phase></medium>"
    )
}

fn cube(y: f32) -> String {
    format!(
        "<shape type='cube'><transform name='to_world'><rotate y='1' angle='20'/><translate y='{y}'/></transform>
        {NULL}</shape>"
    )
}

fn ball(radius: f32, medium: &str) -> String {
    format!(
        "<shape type='sphere'><point name='center' x='-.3' y='1.1' z='0'/><float name='radius' value='{radius}'/>
        <bsdf type='dielectric'/>{medium}</shape>"
    )
}

/// Returns a scene of a ball of glass in fog below a small lamp.
pub fn glass_in_fog(integrator: &str) -> String {
    let wide =
        "<shape type='cube'><transform name='to_world'><scale value='1.9'/><translate y='1.95'/></transform>";
    let contents = format!("{wide}{NULL}</shape>{}{BULB}", ball(0.6, "<ref id='m' name='exterior'/>"));
    scene(integrator, PINHOLE, &fog(".2, .3, .4", ".9, .9, .9"), &contents)
}

/// All techniques together give the image of camera paths: fog behind `null`, behind glass, and around glass and the
/// sensor; chromatic fog, fog that only absorbs, and a grid.
#[test]
fn paths_from_both_ends_agree_with_camera_paths_in_media() {
    let chromatic = fog(".8, 1.5, 3", ".9, .8, .7");
    let grid = "<medium type='heterogeneous' id='m'><float name='scale' value='3'/>
        <volume name='sigma_t' type='gridvolume'><string name='filename' value='g.vol'/>
        <transform name='to_world'><scale value='2'/><translate x='-1' y='.1' z='-1'/></transform></volume>
        <volume name='albedo' type='constvolume'><rgb name='value' value='.9,.8,.7'/></volume></medium>";
    let in_fog = format!("{PINHOLE}<ref id='m' name='medium'/>");
    let ends = format!("{in_fog}<float name='far_clip' value='6.5'/>");
    let turns = [
        "y='1' angle='90'",
        "y='1' angle='-90'",
        "y='1' angle='0'",
        "y='1' angle='180'",
        "x='1' angle='-90'",
    ];
    let side = |turn: &str| {
        format!(
            "<shape type='rectangle'><transform name='to_world'><translate z='1'/><rotate {turn}/><translate y='1'/>
            </transform>
            {NULL}</shape>"
        )
    };
    let sides: String = turns.into_iter().map(side).collect();
    for (name, sensor, medium, contents) in [
        ("lamp above fog", LENS, &chromatic, cube(1.05) + LAMP),
        ("point and sky", PINHOLE, &chromatic, cube(1.05) + POINT + SKY),
        ("fog in glass", PINHOLE, &chromatic, ball(1.0, "<ref id='m' name='interior'/>") + LAMP),
        ("absorption", PINHOLE, &fog(".5, 1, 2", "0, 0, 0"), cube(1.05) + LAMP),
        ("grid", PINHOLE, &grid.to_owned(), cube(1.05) + LAMP + POINT),
        (
            "grid around the sensor",
            in_fog.as_str(),
            &grid
                .replace("value='2'/>", "value='20'/>")
                .replace("x='-1'", "x='-10'")
                .replace("y='.1' z='-1'", "y='-5' z='-10'")
                .replace("value='3'/>", "value='.1'/>"),
            SKY.to_owned(),
        ),
        ("fog without a bottom", PINHOLE, &chromatic, sides + SKY),
        ("fog up to the far plane", ends.as_str(), &fog(".2, .15, .1", ".8, .9, .9"), BULB.to_owned()),
        ("sensor in fog", in_fog.as_str(), &fog(".2, .15, .1", ".8, .9, .9"), BULB.to_owned()),
    ] {
        let folder = Folder::with(&scene("<integrator type='volpath'/>", sensor, medium, &contents));
        write_grid(&folder);
        println!("{name}");
        agree(&folder, "--spp 512", ["volpath", "bdpt"]);
    }
    agree(&Folder::with(&glass_in_fog("<integrator type='volpath'/>")), "--spp 512", ["volpath", "bdpt"]);
    // The passage through a lamp with holes counts as an edge.
    let limited = "<integrator type='volpath'><integer name='max_depth' value='3'/></integrator>";
    let lamp = glass_in_fog(limited).replace("<emitter", "<bsdf type='null'/><emitter");
    agree(&Folder::with(&lamp), "--spp 512", ["volpath", "bdpt"]);
}

/// Writes a grid of 4 × 4 × 4 densities.
fn write_grid(folder: &Folder) {
    let header = [1i32, 4, 4, 4, 1].map(i32::to_le_bytes).concat();
    let bounds = [0f32, 0.0, 0.0, 1.0, 1.0, 1.0].map(f32::to_le_bytes).concat();
    let values = (0..64u32).flat_map(|i| ((i * 37 % 64) as f32 / 64.0).to_le_bytes());
    let bytes: Vec<u8> = b"VOL\x03".iter().copied().chain(header).chain(bounds).chain(values).collect();
    folder.write("g.vol", &bytes);
}

/// Each technique alone, unweighted, finds all light that is scattered once or twice by fog and a floor. Connections of
/// two points in fog are left out: unweighted, their variance is infinite.
#[test]
fn every_technique_alone_finds_the_light_of_its_length_in_fog() {
    let contents = cube(1.05) + LAMP;
    let image = |folder: &Folder, integrator: &str, name: &str| {
        let text = scene(integrator, PINHOLE, &fog(".8, 1, 1.2", ".9, .8, .7"), &contents);
        folder.write("s.xml", text.as_bytes());
        folder.render(&format!("s.xml -q --sampler scene --aov variance --spp 1024 -o {name}.exr"));
    };
    const HIDE: &str = "<boolean name='hide_emitters' value='true'/>";
    let folder = Folder::new();
    let alone = |technique: &str| {
        format!(
            "<integrator type='bdpt'><string name='technique' value='{technique}'/>
            <boolean name='weighted' value='false'/>{HIDE}</integrator>"
        )
    };
    let twice =
        format!("<integrator type='volpath'><integer name='max_depth' value='2'/>{HIDE}</integrator>");
    image(&folder, &twice, "two");
    for (first, others) in [("two", vec!["0,3", "1,2", "2,1"]), ("1,3", vec!["0,4", "3,1"])] {
        if first != "two" {
            image(&folder, &alone(first), first);
        }
        for technique in others {
            image(&folder, &alone(technique), technique);
            let run = folder.run(&format!("diff {first}.exr {technique}.exr --z"));
            assert_eq!(run.code, 0, "{technique}: {}{}", run.stdout, run.stderr);
        }
    }
}

/// Threads, interruptions and ranges change no bit.
#[test]
fn media_change_no_bit_of_paths_from_both_ends() {
    let contents = cube(1.05) + &ball(0.5, "") + LAMP + POINT;
    let scene = scene("<integrator type='bdpt'/>", PINHOLE, &fog(".8, 1, 1.2", ".9, .8, .7"), &contents);
    check_bits(&Folder::with(&scene), "bdpt");
}

/// Light paths start in the medium around their emitter, inside and outside of a room of fog. The room has no boundary
/// but its open front, so its walls do not tell what is inside.
#[test]
fn light_paths_start_in_the_medium_around_their_emitter() {
    let wall = |turn: &str| {
        format!(
            "<shape type='rectangle'><transform name='to_world'><scale value='1.5'/><translate z='-1.5'/>{turn}
            <translate y='1.5'/></transform>
            <bsdf type='twosided'><bsdf type='diffuse'/></bsdf></shape>"
        )
    };
    let turned =
        ["<rotate y='1' angle='90'/>", "<rotate y='1' angle='-90'/>", "", "<rotate x='1' angle='90'/>"];
    let walls: String = turned.into_iter().map(wall).collect();
    let front =
        "<shape type='rectangle'><transform name='to_world'><scale value='1.5'/><translate y='1.5' z='1.5'/>
        </transform>
        <bsdf type='null'/><ref id='m' name='interior'/></shape>";
    let room = walls + front;
    for emitter in [BULB.replace("x='1.2'", "x='.6'"), BULB.replace("x='1.2'", "x='3.2'"), SKY.to_owned()] {
        let integrator = "<integrator type='volpath'><integer name='max_depth' value='5'/></integrator>";
        let contents = format!("{room}{emitter}");
        let folder = Folder::with(&scene(integrator, PINHOLE, &fog(".3, .3, .3", ".9, .8, .7"), &contents));
        agree(&folder, "--spp 512", ["volpath", "bdpt"]);
    }
}

#[test]
fn emitters_in_several_media_and_hidden_ones_around_media_are_refused() {
    let lamp = "<shape type='rectangle'><transform name='to_world'><translate x='1' y='1'/></transform>
        <emitter type='area'/></shape>";
    let contents = format!("<shape type='cube'>{NULL}</shape>{lamp}");
    let folder =
        Folder::with(&scene("<integrator type='bdpt'/>", PINHOLE, &fog("1, 1, 1", ".5, .5, .5"), &contents));
    // Pilots, which only large images have, hide nothing.
    for options in ["--spp 1", "--size 128x128 --crop 0,0,8,8 --spp 64"] {
        let run = folder.run(&format!("render s.xml -q {options} -o a.exr"));
        assert_eq!(run.code, 3, "{options}: {run:?}");
        assert!(run.stderr.contains("emitter 0 is in several media"), "{options}: {run:?}");
    }
    let hidden = "<integrator type='bdpt'><boolean name='hide_emitters' value='true'/></integrator>";
    let contents = format!("<shape type='cube'>{NULL}<emitter type='area'/></shape>");
    folder.write("s.xml", scene(hidden, PINHOLE, &fog("1, 1, 1", ".5, .5, .5"), &contents).as_bytes());
    let run = folder.run("render s.xml -q --spp 1 -o a.exr");
    assert_eq!(run.code, 3, "{run:?}");
    assert!(run.stderr.contains("cannot hide an emitting shape that bounds a medium"), "{run:?}");
}
