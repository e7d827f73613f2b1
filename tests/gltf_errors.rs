//! Malformed glTF files give errors that name the location. Nothing panics.

use crate::support::gltf::{Model, load_bytes};
use proptest::prelude::*;
use serde_json::json;

/// Returns a small model with all kinds of content.
fn model() -> Model {
    let mut model = Model::new(json!([
        { "mesh": 0, "children": [1, 2] },
        { "mesh": 0, "translation": [3, 0, 0], "rotation": [0, 0, 0, 1], "scale": [1, 2, 1] },
        { "camera": 0, "translation": [0, 0, 5] },
        { "extensions": { "KHR_lights_punctual": { "light": 0 } } }
    ]));
    let mut square = model.square();
    let texture =
        model.texture(2, &[[255, 0, 0, 255], [0, 255, 0, 9], [1, 2, 3, 4], [5, 6, 7, 8]], json!({}));
    square["material"] = json!(model.add(
        "materials",
        json!({
            "pbrMetallicRoughness": { "baseColorTexture": { "index": texture } },
            "normalTexture": { "index": texture, "scale": 2.0 }, "alphaMode": "MASK", "doubleSided": true
        })
    ));
    model.mesh(square);
    model.add("cameras", json!({ "type": "perspective", "perspective": { "yfov": 0.5, "znear": 0.1 } }));
    model.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [{ "type": "spot", "spot": { "outerConeAngle": 0.5 } }] } });
    model
}

/// Returns the error of loading the model after a change.
fn error(change: impl FnOnce(&mut Model)) -> String {
    let mut model = model();
    change(&mut model);
    model.error()
}

#[test]
fn the_scene_that_the_others_are_made_of_is_valid() {
    assert!(model().loaded().notes.iter().any(|note| note.starts_with("spot light")));
    load_bytes("scene.glb", &model().binary()).unwrap_or_else(|e| panic!("{e}"));
}

#[test]
fn missing_files_are_listed_together() {
    let mut model = model();
    model.json["buffers"] = json!([{ "byteLength": 100, "uri": "numbers.bin" }]);
    model.json["images"] = json!([{ "uri": "sky.png" }]);
    let error = load_bytes("scene.gltf", model.json.to_string().as_bytes()).unwrap_err();
    assert_eq!(
        error.to_string(),
        "scene.gltf: buffers[0]: there is no file \"numbers.bin\"\n\
         scene.gltf: images[0]: there is no file \"sky.png\""
    );
}

#[test]
fn what_is_out_of_range_is_said() {
    assert_eq!(
        error(|m| m.json["accessors"][0]["count"] = json!(5)),
        "scene.gltf: accessors[0]: it needs 60 bytes, but its bufferViews[0] has 48 bytes"
    );
    assert_eq!(
        error(|m| m.json["accessors"][0]["count"] = json!(u64::MAX / 2)),
        format!("scene.gltf: accessors[0]: it needs {} bytes, but its bufferViews[0] has 48 bytes", u64::MAX)
    );
    assert_eq!(
        error(|m| m.json["bufferViews"][1]["byteOffset"] = json!(4000)),
        format!(
            "scene.gltf: bufferViews[1]: expected 32 bytes from 4000 on in buffers[0], which has {}",
            model().bytes.len()
        )
    );
    assert_eq!(
        error(|m| m.bytes[80] = 7),
        "scene.gltf: meshes[0].primitives[0]: a triangle refers to vertex 7 of 4 vertices"
    );
    assert_eq!(
        error(|m| m.json["accessors"][1]["count"] = json!(3)),
        "scene.gltf: meshes[0].primitives[0]: expected TEXCOORD for each of 4 vertices, found 3"
    );
    assert_eq!(
        error(|m| m.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = json!(99)),
        "scene.gltf: there is no accessors[99], which a mesh refers to"
    );
    assert_eq!(
        error(|m| m.json["nodes"][1]["mesh"] = json!(9)),
        "scene.gltf: nodes[1].mesh: the index is out of range"
    );
    let zeros = error(|m| {
        m.json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
        m.json["accessors"][0]["count"] = json!(1u64 << 40);
        m.json["accessors"][0]["sparse"] = json!({
            "count": 1, "indices": { "bufferView": 0, "componentType": 5121 }, "values": { "bufferView": 0 }
        });
    });
    assert_eq!(
        zeros,
        "scene.gltf: accessors[0]: expected at most 16777216 elements without a bufferView, found 1099511627776"
    );
}

#[test]
fn nodes_that_are_no_trees_are_refused() {
    let message = "it is inside itself or at two places, but nodes must form trees";
    let cyclic = error(|m| m.json["nodes"][1]["children"] = json!([0]));
    assert_eq!(cyclic, format!("scene.gltf: nodes[0]: {message}"));
    let shared = error(|m| m.json["nodes"][3]["children"] = json!([1]));
    assert_eq!(shared, format!("scene.gltf: nodes[1]: {message}"));
}

#[test]
fn extensions_that_are_required_and_unknown_are_refused() {
    let draco = "KHR_draco_mesh_compression";
    assert_eq!(
        error(|m| m.json["extensionsRequired"] = json!([draco, "KHR_materials_ior"])),
        "scene.gltf: the extension \"KHR_draco_mesh_compression\" is required and not supported"
    );
    let mut model = model();
    model.json["extensionsUsed"] = json!(["KHR_materials_sheen", "KHR_lights_punctual"]);
    let warnings = model.load().unwrap().warnings;
    let text = warnings.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n");
    assert!(text.ends_with("scene.gltf: the extension \"KHR_materials_sheen\" is ignored"), "{text}");
}

#[test]
fn other_mistakes_are_said_too() {
    let cases: [(&str, serde_json::Value, &str); 6] = [
        ("/asset/version", json!("1.0"), "asset: expected glTF 2.0, found version \"1.0\""),
        ("/cameras/0/perspective/yfov", json!(4.0), "cameras[0]: expected a yfov between 0 and π, found 4"),
        (
            "/cameras/0/perspective/znear",
            json!(0.0),
            "cameras[0]: expected 0 < znear < zfar, found 0 and 10000",
        ),
        ("/cameras/0/type", json!("fisheye"), "cameras[0].type: the value is invalid"),
        ("/nodes/1/rotation", json!([0, 0, 0, 0]), "nodes[1]: expected a rotation other than zero"),
        ("/nodes/1/translation", json!([1e300, 0, 0]), "nodes[1]: its transformation is not finite"),
    ];
    for (pointer, value, expected) in cases {
        let found = error(|m| *m.json.pointer_mut(pointer).unwrap() = value);
        assert_eq!(found, format!("scene.gltf: {expected}"), "{pointer}");
    }
    let text = "{\n  \"asset\": { \"version\": 2 }\n}";
    let found = load_bytes("scene.gltf", text.as_bytes()).unwrap_err().to_string();
    assert!(found.starts_with("scene.gltf:2:25: invalid type: integer `2`, expected a string\n"), "{found}");
    assert_eq!(error(|m| m.json["scenes"] = json!([])).split(": ").last(), Some("the index is out of range"));
}

#[test]
fn binary_files_that_are_cut_short_are_refused() {
    let bytes = model().binary();
    for cut in 0..bytes.len() {
        let error = load_bytes("scene.glb", &bytes[..cut]).unwrap_err().to_string();
        assert!(error.starts_with("scene.glb: ") || error.starts_with("scene.glb:1:"), "{cut}: {error}");
        if cut > 12 {
            let expected =
                format!("scene.glb: the file is cut short: expected {} bytes, found {cut}", bytes.len());
            assert_eq!(error, expected);
        }
    }
    let mut other = bytes.clone();
    other[4] = 1;
    let error = load_bytes("scene.glb", &other).unwrap_err().to_string();
    assert_eq!(error, "scene.glb: expected version 2 of the binary format, found version 1");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    /// Loading a file with any change of its text gives a scene or an error.
    #[test]
    fn a_mutated_text_never_panics(
        edits in proptest::collection::vec((any::<prop::sample::Index>(), 0usize..6, "[-0-9a-z\\[\\]{}\",:. é]{0,4}"), 1..4)
    ) {
        let mut text: Vec<char> = model().text().chars().collect();
        for (at, removed, inserted) in edits {
            let at = at.index(text.len());
            let end = (at + removed).min(text.len());
            text.splice(at..end, inserted.chars());
        }
        if let Err(error) = load_bytes("scene.gltf", text.iter().collect::<String>().as_bytes()) {
            prop_assert!(!error.to_string().is_empty());
        }
    }

    /// The same for a number that replaces another one.
    #[test]
    fn a_replaced_number_never_panics(
        edits in proptest::collection::vec((any::<prop::sample::Index>(), prop_oneof![
            Just(json!(-1)), Just(json!(0)), Just(json!(1)), Just(json!(5126)), Just(json!(1e38)), Just(json!(u64::MAX)), Just(json!(7))
        ]), 1..4)
    ) {
        let mut model = model();
        for (at, value) in edits {
            let mut numbers = Vec::new();
            numbers_in(&mut model.json, &mut numbers);
            let at = at.index(numbers.len());
            *numbers.swap_remove(at) = value;
        }
        if let Err(error) = model.load() {
            prop_assert!(!error.to_string().is_empty());
        }
    }

    /// The same for changed bytes of a binary file.
    #[test]
    fn mutated_bytes_never_panic(edits in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8)) {
        let mut bytes = model().binary();
        for (at, byte) in edits {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        if let Err(error) = load_bytes("scene.glb", &bytes) {
            prop_assert!(!error.to_string().is_empty());
        }
    }
}

/// Collects the numbers in a value.
fn numbers_in<'a>(value: &'a mut serde_json::Value, found: &mut Vec<&'a mut serde_json::Value>) {
    match value {
        serde_json::Value::Array(list) => list.iter_mut().for_each(|v| numbers_in(v, found)),
        serde_json::Value::Object(map) => map.values_mut().for_each(|v| numbers_in(v, found)),
        serde_json::Value::Number(_) => found.push(value),
        _ => {}
    }
}
