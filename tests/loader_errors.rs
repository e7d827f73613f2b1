//! Every sentence that the loader says when something is wrong, whole.

use crate::loader::{Files, scene};
use buffon::loader::{LoadOptions, load};

/// The error for a scene's elements, without the lines shown under it.
fn error(inside: &str) -> String {
    error_of(&[("scene.xml", &scene(inside))])
}

fn error_of(files: &[(&str, &str)]) -> String {
    let files = Files::new(files);
    let error = files.load(&LoadOptions::default()).expect_err("the scene should be refused");
    without_excerpts(&files.relative(error))
}

fn without_excerpts(text: &str) -> String {
    text.lines().filter(|line| !line.starts_with("  |")).collect::<Vec<_>>().join("\n")
}

/// The warnings for a scene's elements.
fn warnings(inside: &str) -> Vec<String> {
    let files = Files::new(&[("scene.xml", &scene(inside))]);
    let loaded = files.load(&LoadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
    loaded.warnings.iter().map(|w| without_excerpts(&files.relative(w))).collect()
}

const SENSOR: &str = "<sensor type='perspective'/>";

#[test]
fn an_error_shows_its_line() {
    let files = Files::new(&[(
        "scene.xml",
        &scene("  <bsdf type='diffuse'>\n\t<float name='alpha' value='1,0'/></bsdf>"),
    )]);
    let error = files.load(&LoadOptions::default()).unwrap_err();
    insta::assert_snapshot!(files.relative(error), @r#"
    scene.xml:3:2: <float name="alpha">: expected a number, found "1,0"
      |  <float name='alpha' value='1,0'/></bsdf>
      |  ^
    "#);
}

#[test]
fn files_that_are_no_scene() {
    let files = Files::new(&[
        ("a.txt", ""),
        ("latin.xml", ""),
        ("empty.obj", "v 0 0 0\n"),
        ("dot.obj", "v 0 0 0\nf 1 1 1\n"),
    ]);
    std::fs::write(files.path().join("latin.xml"), b"<scene>\n <\xe9/>").unwrap();
    let message =
        |name: &str| files.relative(load(&files.path().join(name), &LoadOptions::default()).unwrap_err());
    assert_eq!(message("a.txt"), "a.txt: expected a scene (.xml) or a mesh (.obj, .ply)");
    assert_eq!(message("none.xml"), "none.xml: cannot be read: no such file or directory");
    assert_eq!(message("latin.xml"), "latin.xml:2:3: expected text in UTF-8, found an invalid byte");
    assert_eq!(message("empty.obj"), "empty.obj: the file has no faces");
    assert_eq!(message("dot.obj"), "dot.obj: the mesh has no extent");
    assert_eq!(
        error_of(&[("scene.xml", "<scene/>")]),
        "scene.xml:1:1: <scene>: the attribute version is missing, e.g. version=\"3.0.0\""
    );
    assert_eq!(
        error_of(&[("scene.xml", "<scene version='new'/>")]),
        "scene.xml:1:1: <scene>: expected a version such as 3.0.0, found \"new\""
    );
    assert_eq!(
        error_of(&[("scene.xml", "<bsdf version='3.0.0' type='diffuse'/>")]),
        "scene.xml:1:1: <bsdf type=\"diffuse\">: expected <scene> as the outermost element"
    );
}

#[test]
fn elements_and_attributes() {
    assert_eq!(
        error("<shap type='disk'/>"),
        "scene.xml:2:1: <shap type=\"disk\">: unknown element (did you mean \"shape\"?)"
    );
    assert_eq!(error("<shape/>"), "scene.xml:2:1: <shape>: the attribute type is missing");
    assert_eq!(
        error("<scene type='x'/>"),
        "scene.xml:2:1: <scene type=\"x\">: a scene cannot be inside another object"
    );
    assert_eq!(
        error("<shape type='disk'><float name='a' valu='1'/></shape>"),
        "scene.xml:2:20: <float name=\"a\">: the attribute value is missing"
    );
    assert_eq!(
        error("<shape type='disk' tpye='x'/>"),
        "scene.xml:2:1: <shape type=\"disk\">: unknown attribute tpye (did you mean \"type\"?)"
    );
    assert_eq!(
        error("<float name='a' value='1'><shape type='disk'/></float>"),
        "scene.xml:2:27: <shape type=\"disk\">: <float name=\"a\"> cannot have elements inside it"
    );
    assert_eq!(
        error("<translate x='1'/>"),
        "scene.xml:2:1: <translate>: a transformation belongs inside a <transform>"
    );
    assert_eq!(
        error("<shape type='disk'><float name='a' value='1'/>\n<float name='a' value='2'/></shape>"),
        "scene.xml:3:1: <float name=\"a\">: given twice in <shape type=\"disk\">"
    );
}

#[test]
fn values_of_the_wrong_kind() {
    let value = |element: &str| error(&format!("<bsdf type='diffuse'>\n{element}</bsdf>"));
    assert_eq!(
        value("<integer name='x' value='1.5'/>"),
        "scene.xml:3:1: <integer name=\"x\">: expected a whole number, found \"1.5\""
    );
    assert_eq!(
        value("<boolean name='x' value='yes'/>"),
        "scene.xml:3:1: <boolean name=\"x\">: expected true or false, found \"yes\""
    );
    assert_eq!(
        value("<rgb name='x' value='1 2'/>"),
        "scene.xml:3:1: <rgb name=\"x\">: expected one or three numbers, found 2"
    );
    assert_eq!(
        value("<rgb name='x' value='#12'/>"),
        "scene.xml:3:1: <rgb name=\"x\">: expected a colour like #ff8000, found \"#12\""
    );
    assert_eq!(
        value("<spectrum name='x' value='700:1, 400:2'/>"),
        "scene.xml:3:1: <spectrum name=\"x\">: expected increasing wavelengths, found 400 after 700"
    );
    assert_eq!(
        value("<spectrum name='x'/>"),
        "scene.xml:3:1: <spectrum name=\"x\">: expected either value or filename"
    );
    assert_eq!(
        value("<point name='x' y='1'/>"),
        "scene.xml:3:1: <point name=\"x\">: expected either value or x, y and z"
    );
    assert_eq!(
        value("<string name='reflectance' value='red'/>"),
        "scene.xml:3:1: <string name=\"reflectance\">: expected a colour, found a string"
    );
    assert_eq!(
        error("<shape type='disk'><float name='flip_normals' value='1'/></shape>"),
        "scene.xml:2:20: <float name=\"flip_normals\">: expected true or false, found a float"
    );
}

#[test]
fn transformations() {
    let step = |element: &str| {
        error(&format!("<shape type='disk'><transform name='to_world'>\n{element}</transform></shape>"))
    };
    assert_eq!(step("<rotate angle='3'/>"), "scene.xml:3:1: <rotate>: expected an axis that is not zero");
    assert_eq!(step("<rotate x='1'/>"), "scene.xml:3:1: <rotate>: the attribute angle is missing");
    assert_eq!(
        step("<scale x='0'/>"),
        "scene.xml:3:1: <scale>: the transformation is singular: it flattens space"
    );
    assert_eq!(step("<scale value='1e300'/>"), "scene.xml:3:1: <scale>: the transformation is not finite");
    assert_eq!(
        step("<translate x='1' value='2'/>"),
        "scene.xml:3:1: <translate>: expected either value or x, y and z, found both"
    );
    assert_eq!(step("<matrix value='1 2 3'/>"), "scene.xml:3:1: <matrix>: expected 9 or 16 numbers, found 3");
    assert_eq!(
        step("<matrix value='1 0 0 0 0 1 0 0 0 0 1 0 0 0 1 1'/>"),
        "scene.xml:3:1: <matrix>: expected 0 0 0 1 in the last row"
    );
    assert_eq!(
        step("<lookat origin='1 1 1' target='1 1 1'/>"),
        "scene.xml:3:1: <lookat>: expected a target away from the origin"
    );
    assert_eq!(
        step("<lookat origin='0 0 0' target='0 1 0' up='0 1 0'/>"),
        "scene.xml:3:1: <lookat>: expected an up that is not parallel to the viewing direction"
    );
    assert_eq!(
        step("<lookAt/>"),
        "scene.xml:3:1: <lookAt>: unknown transformation (did you mean \"lookat\"?)"
    );
}

#[test]
fn parameters_includes_and_references() {
    assert_eq!(
        error("<default name='spp' value='1'/><float name='x' value='$sp'/>"),
        "scene.xml:2:32: <float name=\"x\">: the parameter $sp has no value (did you mean \"spp\"?)"
    );
    assert_eq!(
        error("<include filename='no.xml'/>"),
        "scene.xml:2:1: <include>: there is no file \"no.xml\""
    );
    assert_eq!(error("<path value='no'/>"), "scene.xml:2:1: <path>: there is no folder \"no\"");
    assert_eq!(
        error("<include filename='scene.xml'/>"),
        "scene.xml:2:1: <include>: scene.xml: the file includes itself"
    );
    assert_eq!(
        error("<bsdf type='diffuse' id='red'/><shape type='disk'><ref id='rad'/></shape>"),
        "scene.xml:2:51: <ref id=\"rad\">: no object has the id \"rad\" (did you mean \"red\"?)"
    );
    assert_eq!(
        error("<alias id='a' as='b'/>"),
        "scene.xml:2:1: <alias id=\"a\">: no object has the id \"a\""
    );
    assert_eq!(
        error("<bsdf type='diffuse' id='a'/>\n<bsdf type='diffuse' id='a'/>"),
        "scene.xml:3:1: <bsdf type=\"diffuse\">: the id \"a\" is given twice\nscene.xml:2:1: <bsdf type=\"diffuse\">: the other one"
    );
    assert_eq!(
        error(
            "<bsdf type='twosided' id='a'><ref id='b'/></bsdf>\n<bsdf type='twosided' id='b'><ref id='a'/></bsdf>"
        ),
        "scene.xml:3:1: <bsdf type=\"twosided\">: it contains itself: \"b\" contains \"a\" contains \"b\""
    );
    let chain: String =
        (0..5000).map(|i| format!("<bsdf type='twosided' id='{i}'><ref id='{}'/></bsdf>\n", i + 1)).collect();
    let error = error(&format!("{chain}<bsdf type='diffuse' id='5000'/>"));
    assert!(error.ends_with(": <bsdf type=\"twosided\">: nested deeper than 100 levels"), "{error}");
}

#[test]
fn all_missing_files_are_listed_at_once() {
    let text = "<shape type='obj'><string name='filename' value='a.obj'/></shape>
<shape type='ply'><string name='filename' value='b.ply'/></shape>
<bsdf type='diffuse'><spectrum name='reflectance' filename='c.spd'/></bsdf>";
    assert_eq!(
        error(text),
        "scene.xml:4:22: <spectrum name=\"reflectance\">: there is no file \"c.spd\"\n\
         scene.xml:2:19: <string name=\"filename\">: there is no file \"a.obj\"\n\
         scene.xml:3:19: <string name=\"filename\">: there is no file \"b.ply\""
    );
    assert_eq!(
        error("<shape type='obj'/>"),
        "scene.xml:2:1: <shape type=\"obj\">: the property filename is missing"
    );
}

#[test]
fn unknown_and_unsupported_plugins() {
    let cases = [
        ("<bsdf type='difuse'/>", "<bsdf type=\"difuse\">: unknown bsdf (did you mean \"diffuse\"?)"),
        ("<bsdf type='plastic'/>", "<bsdf type=\"plastic\">: this bsdf is not supported"),
        ("<shape type='spere'/>", "<shape type=\"spere\">: unknown shape (did you mean \"sphere\"?)"),
        ("<shape type='cylinder'/>", "<shape type=\"cylinder\">: this shape is not supported"),
        ("<emitter type='envmap'/>", "<emitter type=\"envmap\">: this emitter is not supported"),
        (
            "<integrator type='pth'/>",
            "<integrator type=\"pth\">: unknown integrator (did you mean \"path\"?)",
        ),
        ("<integrator type='volpath'/>", "<integrator type=\"volpath\">: this integrator is not supported"),
        ("<sensor type='thinlens'/>", "<sensor type=\"thinlens\">: this sensor is not supported"),
        ("<medium type='homogeneous'/>", "<medium type=\"homogeneous\">: this medium is not supported"),
        ("<texture type='bitmap'/>", "<texture type=\"bitmap\">: this texture is not supported"),
    ];
    for (element, message) in cases {
        assert_eq!(error(element), format!("scene.xml:2:1: {message}"));
    }
    let inside = "<sensor type='perspective'>\n<sampler type='halton'/></sensor>";
    assert_eq!(error(inside), "scene.xml:3:1: <sampler type=\"halton\">: unknown sampler");
    let inside =
        "<sensor type='perspective'><film type='hdrfilm'>\n<rfilter type='mitchell'/></film></sensor>";
    assert_eq!(error(inside), "scene.xml:3:1: <rfilter type=\"mitchell\">: this rfilter is not supported");
    let inside = "<bsdf type='diffuse'>\n<texture type='bitmap' name='reflectance'/></bsdf>";
    assert_eq!(error(inside), "scene.xml:3:1: <texture type=\"bitmap\">: this texture is not supported");
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
            "<float name=\"alpha\">: expected a number greater than 0, found -0.1",
        ),
        (
            "'roughconductor'>\n<string name='distribution' value='phong'/>",
            "<string name=\"distribution\">: expected one of beckmann, ggx, found \"phong\"",
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
        ("'twosided'>", "<bsdf type=\"twosided\">: expected a bsdf inside it"),
        (
            "'twosided'><bsdf type='dielectric'/>",
            "<bsdf type=\"twosided\">: a material that transmits light cannot be made two-sided",
        ),
    ];
    for (text, message) in cases {
        assert_eq!(bsdf(text), format!("scene.xml:2:1: {message}"));
    }
    assert_eq!(
        bsdf("'twosided'><bsdf type='diffuse'/>\n<bsdf type='conductor'/>"),
        "scene.xml:3:1: <bsdf type=\"twosided\">: different materials on the two sides are not supported"
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

#[test]
fn what_nobody_asked_for_is_a_warning() {
    assert_eq!(
        warnings(&format!("{SENSOR}<bsdf type='diffuse'><rgb name='reflektance' value='0.1'/></bsdf>")),
        [
            "scene.xml:2:50: <rgb name=\"reflektance\">: <bsdf type=\"diffuse\"> has no such property (did you mean \"reflectance\"?)"
        ]
    );
    assert_eq!(
        warnings(&format!("{SENSOR}<bsdf type='diffuse'><film type='hdrfilm'/></bsdf>")),
        ["scene.xml:2:50: <film type=\"hdrfilm\">: <bsdf type=\"diffuse\"> has no use for it"]
    );
    assert_eq!(
        warnings(&format!("{SENSOR}hello")),
        ["scene.xml:2:29: <scene>: the text inside it is ignored"]
    );
    assert_eq!(warnings(""), ["scene.xml:1:1: <scene>: the scene has no sensor"]);
    assert_eq!(
        warnings(&format!(
            "{SENSOR}<bsdf type='diffuse'><spectrum name='reflectance' value='400:2,700:3'/></bsdf>"
        )),
        [
            "scene.xml:2:50: <spectrum name=\"reflectance\">: the spectrum's colour 2.795, 2.476, 2.126 is out of range and clamped"
        ]
    );
}
