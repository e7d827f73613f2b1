//! Errors about plugins: unknown or unsupported plugins, and values out of range.

use crate::loader_errors::error;

#[test]
fn unknown_and_unsupported_plugins() {
    let cases = [
        ("<bsdf type='difuse'/>", "<bsdf type=\"difuse\">: unknown bsdf (did you mean \"diffuse\"?)"),
        ("<bsdf type='openpbr'/>", "<bsdf type=\"openpbr\">: this bsdf is not supported"),
        ("<shape type='spere'/>", "<shape type=\"spere\">: unknown shape (did you mean \"sphere\"?)"),
        ("<shape type='ellipsoids'/>", "<shape type=\"ellipsoids\">: this shape is not supported"),
        ("<emitter type='timed_sunsky'/>", "<emitter type=\"timed_sunsky\">: this emitter is not supported"),
        (
            "<integrator type='pth'/>",
            "<integrator type=\"pth\">: unknown integrator (did you mean \"path\"?)",
        ),
        ("<sensor type='batch'/>", "<sensor type=\"batch\">: this sensor is not supported"),
        ("<sensor type='fluencemeter'/>", "<sensor type=\"fluencemeter\">: this sensor is not supported"),
        ("<emitter type='collimated'/>", "<emitter type=\"collimated\">: this emitter is not supported"),
        ("<bsdf type='hk'/>", "<bsdf type=\"hk\">: this bsdf is not supported"),
        ("<texture type='volume'/>", "<texture type=\"volume\">: expected a volume inside it"),
        ("<texture type='bitmp'/>", "<texture type=\"bitmp\">: unknown texture (did you mean \"bitmap\"?)"),
    ];
    for (element, message) in cases {
        assert_eq!(error(element), format!("scene.xml:2:1: {message}"));
    }
    let inside = "<sensor type='perspective'>\n<sampler type='zsobl'/></sensor>";
    assert_eq!(
        error(inside),
        "scene.xml:3:1: <sampler type=\"zsobl\">: unknown sampler (did you mean \"zsobol\"?)"
    );
    let inside =
        "<sensor type='perspective'><film type='hdrfilm'>\n<rfilter type='mitchel'/></film></sensor>";
    assert_eq!(
        error(inside),
        "scene.xml:3:1: <rfilter type=\"mitchel\">: unknown rfilter (did you mean \"mitchell\"?)"
    );
    let inside = "<bsdf type='diffuse'>\n<texture type='volume' name='reflectance'/></bsdf>";
    assert_eq!(error(inside), "scene.xml:3:1: <texture type=\"volume\">: expected a volume inside it");
}

#[test]
fn materials_out_of_range() {
    let bsdf = |text: &str| error(&format!("<bsdf type={text}</bsdf>"));
    let cases = [
        (
            "'diffuse'>\n<rgb name='reflectance' value='1.1, 0.3, 0.2'/>",
            "<rgb name=\"reflectance\">: expected values from 0 to 1, found 1.1, 0.3, 0.2",
        ),
        (
            "'diffuse'>\n<rgb name='reflectance' value='-1'/>",
            "<rgb name=\"reflectance\">: expected values from 0 to 1, found -1, -1, -1",
        ),
        (
            "'roughconductor'>\n<float name='alpha' value='-0.1'/>",
            "<float name=\"alpha\">: expected a number of at least 0, found -0.1",
        ),
        (
            "'roughconductor'>\n<string name='distribution' value='blinn'/>",
            "<string name=\"distribution\">: expected one of beckmann, ggx, found \"blinn\"",
        ),
        (
            "'conductor'>\n<string name='material' value='au'/>",
            "<string name=\"material\">: expected the name of a conductor (did you mean \"Au\"?), found \"au\"",
        ),
        (
            "'conductor'>\n<float name='k' value='1'/><string name='material' value='Au'/>",
            "<float name=\"k\">: expected either material or eta and k, found both",
        ),
        (
            "'conductor'>\n<float name='k' value='-1'/>",
            "<float name=\"k\">: expected values of at least 0, found -1, -1, -1",
        ),
        (
            "'dielectric'>\n<float name='int_ior' value='0'/>",
            "<float name=\"int_ior\">: expected a number greater than 0, found 0",
        ),
        (
            "'dielectric'>\n<string name='int_ior' value='bk8'/>",
            "<string name=\"int_ior\">: expected a number or the name of a dielectric (did you mean \"bk7\"?), found \"bk8\"",
        ),
    ];
    for (text, message) in cases {
        assert_eq!(bsdf(text), format!("scene.xml:3:1: {message}"));
    }
    let cases = [
        (
            "'roughconductor'><float name='alpha_u' value='1'/>",
            "<bsdf type=\"roughconductor\">: expected either alpha or both alpha_u and alpha_v",
        ),
        ("'twosided'>", "<bsdf type=\"twosided\">: expected a bsdf inside it, found 0"),
        (
            "'twosided'><bsdf type='dielectric'/>",
            "<bsdf type=\"twosided\">: a material that transmits light cannot be made two-sided",
        ),
    ];
    for (text, message) in cases {
        assert_eq!(bsdf(text), format!("scene.xml:2:1: {message}"));
    }
    assert_eq!(
        bsdf("'twosided'><bsdf type='diffuse'/><bsdf type='diffuse'/>\n<bsdf type='conductor'/>"),
        "scene.xml:3:1: <bsdf type=\"twosided\">: expected one or two bsdfs inside it, found more"
    );
}

#[test]
fn shapes_and_emitters_out_of_range() {
    let cases = [
        (
            "<shape type='sphere'>\n<float name='radius' value='0'/></shape>",
            "<float name=\"radius\">: expected a number greater than 0, found 0",
        ),
        (
            "<shape type='sphere'>\n<transform name='to_world'><scale x='2'/></transform></shape>",
            "<transform name=\"to_world\">: a sphere cannot be scaled differently along different axes",
        ),
        (
            "<shape type='disk'><bsdf type='diffuse'/>\n<bsdf type='conductor'/></shape>",
            "<bsdf type=\"conductor\">: <shape type=\"disk\"> has room for one bsdf",
        ),
        (
            "<shape type='disk'>\n<emitter type='point'/></shape>",
            "<emitter type=\"point\">: only an area emitter can be inside a shape",
        ),
        (
            "<shape type='disk'><emitter type='area'>\n<rgb name='radiance' value='-1'/></emitter></shape>",
            "<rgb name=\"radiance\">: expected values of at least 0, found -1, -1, -1",
        ),
        ("\n<emitter type='area'/>", "<emitter type=\"area\">: an area emitter belongs inside a shape"),
        (
            "<emitter type='constant'/>\n<emitter type='constant'/>",
            "<emitter type=\"constant\">: a scene has room for one environment",
        ),
        (
            "<emitter type='point'><point name='position' value='1'/>\n<transform name='to_world'/></emitter>",
            "<transform name=\"to_world\">: expected either position or to_world, found both",
        ),
    ];
    for (text, message) in cases {
        assert_eq!(error(text), format!("scene.xml:3:1: {message}"));
    }
}

#[test]
fn sensors_and_films_out_of_range() {
    let sensor = |text: &str| error(&format!("<sensor type='perspective'>\n{text}</sensor>"));
    let cases = [
        (
            "<float name='fov' value='180'/>",
            "<float name=\"fov\">: expected degrees between 0 and 180, found 180",
        ),
        (
            "<float name='near_clip' value='-1'/>",
            "<float name=\"near_clip\">: expected a number greater than 0, found -1",
        ),
        (
            "<float name='far_clip' value='0.001'/>",
            "<float name=\"far_clip\">: expected near_clip to be less than far_clip, found 0.001",
        ),
        (
            "<string name='focal_length' value='long'/>",
            "<string name=\"focal_length\">: expected a length such as 50mm, found \"long\"",
        ),
        (
            "<string name='focal_length' value='9mm'/><float name='fov' value='9'/>",
            "<string name=\"focal_length\">: expected either fov or focal_length, found both",
        ),
        (
            "<string name='fov_axis' value='z'/>",
            "<string name=\"fov_axis\">: expected one of x, y, diagonal, smaller, larger, found \"z\"",
        ),
        (
            "<transform name='to_world'><scale value='2'/></transform>",
            "<transform name=\"to_world\">: a camera cannot be scaled",
        ),
    ];
    for (text, message) in cases {
        assert_eq!(sensor(text), format!("scene.xml:3:1: {message}"));
    }
    let film = |text: &str| {
        error(&format!("<sensor type='perspective'><film type='hdrfilm'>\n{text}</film></sensor>"))
    };
    let cases = [
        (
            "<integer name='width' value='0'/>",
            "<integer name=\"width\">: expected a whole number from 1 to 65536, found 0",
        ),
        (
            "<integer name='height' value='99999999999'/>",
            "<integer name=\"height\">: expected a whole number from 1 to 65536, found 99999999999",
        ),
        (
            "<string name='component_format' value='uint32'/>",
            "<string name=\"component_format\">: expected one of float16, float32, found \"uint32\"",
        ),
        (
            "<rfilter type='tent'><float name='radius' value='1000'/></rfilter>",
            "<float name=\"radius\">: expected at most 100 pixels, found 1000",
        ),
    ];
    for (text, message) in cases {
        assert!(film(text).ends_with(&format!(": {message}")), "{}", film(text));
    }
    let crop = "<integer name='width' value='10'/><integer name='crop_offset_x' value='5'/><integer name='crop_width' value='6'/>";
    assert_eq!(
        film(crop),
        "scene.xml:2:28: <film type=\"hdrfilm\">: expected a crop within the image of 10 x 576, found 6 x 576 at 5, 0"
    );
    let large = "<integer name='width' value='65536'/><integer name='height' value='65536'/>";
    assert_eq!(
        film(large),
        "scene.xml:2:28: <film type=\"hdrfilm\">: expected at most 268435456 pixels, found 65536 x 65536"
    );
}

#[test]
fn integrators_out_of_range() {
    let integrator = |text: &str| error(&format!("<integrator type={text}</integrator>"));
    let cases = [
        (
            "'path'>\n<integer name='max_depth' value='-2'/>",
            "<integer name=\"max_depth\">: expected a whole number from -1 to 4294967295, found -2",
        ),
        (
            "'path'>\n<integer name='rr_depth' value='0'/>",
            "<integer name=\"rr_depth\">: expected a whole number from 1 to 4294967295, found 0",
        ),
        (
            "'aov'>\n<string name='aovs' value='x:dp_du'/>",
            "<string name=\"aovs\">: the layer kind \"dp_du\" is not supported",
        ),
        (
            "'aov'>\n<string name='aovs' value='x:dept'/>",
            "<string name=\"aovs\">: unknown layer kind \"dept\" (did you mean \"depth\"?)",
        ),
        (
            "'aov'>\n<string name='aovs' value='x'/>",
            "<string name=\"aovs\">: expected name:kind pairs such as dd.y:depth, found \"x\"",
        ),
        (
            "'aov'>\n<string name='aovs' value='x:uv x:uv'/>",
            "<string name=\"aovs\">: two layers are named \"x\"",
        ),
    ];
    for (text, message) in cases {
        assert_eq!(integrator(text), format!("scene.xml:3:1: {message}"));
    }
    assert_eq!(
        integrator(
            "'direct'><integer name='emitter_samples' value='0'/><integer name='bsdf_samples' value='0'/>"
        ),
        "scene.xml:2:1: <integrator type=\"direct\">: expected at least one emitter or bsdf sample"
    );
    assert_eq!(
        integrator("'aov'>"),
        "scene.xml:2:1: <integrator type=\"aov\">: the property aovs is missing"
    );
}
