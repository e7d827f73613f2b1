//! The complete text of every error and warning of the loader.

use crate::loader::{Files, SENSOR, scene};
use buffon::loader::{LoadOptions, load};

/// Returns the error for a scene's elements, without the source lines below it.
pub fn error(inside: &str) -> String {
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

/// Returns the warnings for a scene's elements.
fn warnings(inside: &str) -> Vec<String> {
    let files = Files::new(&[("scene.xml", &scene(inside))]);
    let loaded = files.load(&LoadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
    loaded.warnings.iter().map(|w| without_excerpts(&files.relative(w))).collect()
}

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
    assert_eq!(message("a.txt"), "a.txt: expected a scene (.xml, .gltf, .glb) or a mesh (.obj, .ply)");
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
    assert_eq!(error("<path value='no'/>"), "scene.xml:2:1: <path>: the folder \"no\" does not exist");
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
    let nested = |inside: &str| "<bsdf type='twosided'>".repeat(60) + inside + &"</bsdf>".repeat(60);
    let (outer, inner) = (scene(&nested("<include filename='b.xml'/>")), scene(&nested("")));
    assert_eq!(
        error_of(&[("scene.xml", &outer), ("b.xml", &inner)]),
        "b.xml:2:859: <bsdf type=\"twosided\">: nested deeper than 100 levels"
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
