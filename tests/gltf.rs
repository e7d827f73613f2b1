//! glTF files: the loaded description.

use crate::support::gltf::{Model, data_uri, load_bytes, png};
use crate::support::scenes;
use buffon::accel::AccelKind;
use buffon::color::Rgb;
use buffon::emitter::Emitter;
use buffon::loader::{LoadOptions, Loaded, load};
use buffon::material::{Input, Mask, Material, MaterialPoint, Materials, NormalMap};
use buffon::math::{DAffine3, DVec3, Frame, Vec2, Vec3};
use buffon::sampling::SamplerKind;
use buffon::scene::description::PlacedShape;
use buffon::sensor::{FovAxis, Projection};
use buffon::shape::{Mesh, Shape};
use buffon::texture::{Texture, TexturePoint};
use bumpalo::Bump;
use serde_json::json;
use std::f64::consts::FRAC_1_SQRT_2;

fn mesh(placed: &PlacedShape) -> &Mesh {
    match &placed.shape {
        Shape::Mesh(mesh) => mesh,
        other => panic!("expected a mesh, found {other:?}"),
    }
}

/// Returns a model of one square with a material.
fn square_of(material: serde_json::Value) -> Model {
    let mut model = Model::new(json!([{ "mesh": 0 }]));
    let mut square = model.square();
    square["material"] = json!(model.add("materials", material));
    model.mesh(square);
    model
}

/// Returns the material of the first shape.
fn material(loaded: &Loaded) -> &Material {
    &loaded.description.materials[loaded.description.shapes[0].material.index()]
}

/// Returns the principled material inside the material of the first shape.
fn principled(loaded: &Loaded) -> buffon::material::Principled {
    let materials = &loaded.description.materials;
    let mut found = material(loaded);
    while let Some(inner) = found.inner().first() {
        found = &materials[inner.index()];
    }
    match found {
        Material::Principled(p) => **p,
        other => panic!("expected a principled material, found {other:?}"),
    }
}

/// Returns the colour of a texture at a point.
fn color_at(loaded: &Loaded, input: Input<Rgb>, uv: [f32; 2]) -> [f32; 3] {
    texture(loaded, input.texture()).eval(&TexturePoint::at(Vec2::from(uv))).to_array()
}

/// Returns the value of a texture at a point.
fn number_at(loaded: &Loaded, input: Input<f32>, uv: [f32; 2]) -> f32 {
    texture(loaded, input.texture()).eval_scalar(&TexturePoint::at(Vec2::from(uv)))
}

fn texture(loaded: &Loaded, id: Option<buffon::ids::TextureId>) -> &Texture {
    &loaded.description.textures[id.expect("a texture").index()]
}

const NEAREST: &str = r#"{ "magFilter": 9728 }"#;
/// Red and green in the first row; blue, and white with an alpha of 0.2, in the second.
const FOUR: [[u8; 4]; 4] = [[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [255, 255, 255, 51]];
/// The centres of the four texels of such a texture.
const MIDDLES: [[f32; 2]; 4] = [[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]];

/// Returns a square with a texture of 2×2 texels.
fn textured(pixels: &[[u8; 4]; 4], set: impl FnOnce(usize) -> serde_json::Value) -> Model {
    let mut model = Model::new(json!([{ "mesh": 0 }]));
    let mut square = model.square();
    let texture = model.texture(2, pixels, serde_json::from_str(NEAREST).unwrap());
    square["material"] = json!(model.add("materials", set(texture)));
    model.mesh(square);
    model
}

#[test]
fn a_mesh_has_the_files_numbers_and_the_nodes_place() {
    let mut model = Model::new(json!([
        { "children": [1], "translation": [1.0, 2.0, 3.0], "rotation": [0.0, 0.0, FRAC_1_SQRT_2, FRAC_1_SQRT_2] },
        { "mesh": 0, "scale": [2.0, 3.0, 4.0], "name": "square" }
    ]));
    let square = model.square();
    model.mesh(square);
    let loaded = model.loaded();
    let [shape] = loaded.description.shapes.as_slice() else { panic!("expected one shape") };
    let found = mesh(shape);
    assert_eq!(found.positions[2], Vec3::new(1.0, 1.0, 0.0));
    assert_eq!(found.uvs, [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]].map(Vec2::from));
    assert_eq!(found.indices, [[0, 1, 2], [0, 2, 3]]);
    assert!(found.normals.is_empty(), "without normals it is faceted");
    assert_eq!((shape.name.as_str(), shape.flip_normals), ("square", false));
    let corner = shape.to_world.at(0.0).transform_point3(DVec3::ONE);
    assert!((corner - DVec3::new(-2.0, 4.0, 7.0)).length() < 1e-6, "{corner}");
    assert_eq!(load_bytes("scene.glb", &model.binary()).unwrap().description.shapes[0].shape, shape.shape);
}

#[test]
fn matrices_place_nodes_and_mirrors_keep_the_front() {
    let mirror = [-1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 5., 6., 7., 1.];
    for (normals, flipped) in [(false, true), (true, false)] {
        let mut model = Model::new(json!([{ "mesh": 0, "matrix": mirror }]));
        let mut square = model.square();
        if normals {
            square["attributes"]["NORMAL"] = json!(model.floats("VEC3", &[0.0, 0.0, 2.0].repeat(4)));
        }
        model.mesh(square);
        let loaded = model.loaded();
        let shape = &loaded.description.shapes[0];
        assert_eq!(shape.to_world.at(0.0).translation, DVec3::new(5.0, 6.0, 7.0));
        assert_eq!(shape.flip_normals, flipped);
        assert!(mesh(shape).normals.iter().all(|n| *n == Vec3::Z));
    }
}

#[test]
fn a_mesh_of_several_nodes_is_a_group_unless_it_shines() {
    let nodes =
        json!([{ "mesh": 0 }, { "mesh": 0, "scale": [-1, 1, 1] }, { "mesh": 0, "translation": [3, 0, 0] }]);
    let mut model = Model::new(nodes);
    let dark = model.square();
    let mut bright = model.square();
    bright["material"] = json!(model.add("materials", json!({ "emissiveFactor": [1, 0.5, 0] })));
    model.add("meshes", json!({ "primitives": [dark, bright] }));
    let loaded = model.loaded();
    let description = &loaded.description;
    assert_eq!(description.instances.iter().map(|i| i.group).collect::<Vec<_>>(), [0; 3]);
    assert_eq!(description.groups.iter().map(Vec::len).collect::<Vec<_>>(), [1]);
    assert!(!description.groups[0][0].flip_normals);
    assert_eq!(description.instances[2].to_world.at(0.0), DAffine3::from_translation(DVec3::X * 3.0));
    let lamps: Vec<_> = description.shapes.iter().map(|s| (s.emission, s.flip_normals)).collect();
    let light = Some(Input::Constant(Rgb::new(1.0, 0.5, 0.0)));
    assert_eq!(lamps, [(light, false), (light, true), (light, false)]);
}

#[test]
fn integers_sparse_accessors_and_shared_vertices_are_read() {
    let mut model = Model::new(json!([{ "mesh": 0 }]));
    let positions = model.floats("VEC3", &[0.0; 15]);
    let places = model.view(&[1, 0, 4, 0]);
    let values: Vec<u8> = [1f32, 0., 0., 0., 1., 0.].iter().flat_map(|v| v.to_le_bytes()).collect();
    let values = model.view(&values);
    model.json["accessors"][positions]["sparse"] = json!({
        "count": 2, "indices": { "bufferView": places, "componentType": 5123 }, "values": { "bufferView": values }
    });
    let uvs = model.accessor("VEC2", 5121, &[0, 51, 102, 153, 204, 255, 0, 0, 255, 0], 5);
    model.json["accessors"][uvs]["normalized"] = json!(true);
    let indices = model.accessor("SCALAR", 5123, &[0, 0, 1, 0, 4, 0], 3);
    let attributes = json!({ "POSITION": positions, "TEXCOORD_0": uvs });
    model.mesh(json!({ "attributes": attributes, "indices": indices, "mode": 6 }));
    let loaded = model.loaded();
    let found = mesh(&loaded.description.shapes[0]);
    assert_eq!(found.positions, [Vec3::ZERO, Vec3::X, Vec3::Y]);
    assert_eq!(found.uvs, [[0.0, 0.2], [0.4, 0.6], [1.0, 0.0]].map(Vec2::from));
    assert_eq!(found.indices, [[1, 2, 0]]);
}

#[test]
fn metal_and_roughness_become_the_principled_model() {
    let loaded = square_of(json!({
        "pbrMetallicRoughness":
            { "baseColorFactor": [0.5, 0.25, 1.0, 0.3], "metallicFactor": 0.75, "roughnessFactor": 0.4 },
        "extensions": {
            "KHR_materials_ior": { "ior": 1.33 },
            "KHR_materials_transmission": { "transmissionFactor": 0.5 }
        },
        "doubleSided": true
    }))
    .loaded();
    assert!(
        matches!(material(&loaded), Material::Principled(_)),
        "what transmits light is not made two-sided"
    );
    let p = principled(&loaded);
    assert_eq!(p.base_color, Input::Constant(Rgb::new(0.5, 0.25, 1.0)));
    assert_eq!((p.metallic, p.roughness), (Input::Constant(0.75), Input::Constant(0.4)));
    assert_eq!((p.spec_trans, p.eta), (Input::Constant(0.5), 1.33));
    let plain = square_of(json!({ "doubleSided": true })).loaded();
    assert!(matches!(material(&plain), Material::TwoSided(_)));
    assert_eq!(principled(&plain).metallic, Input::Constant(1.0));
    assert_eq!(principled(&plain).eta, 1.5);
}

/// Returns two squares that face away from each other, of one mesh or of two: the faces of a pane of thickness 1/2.
fn pane(meshes: [usize; 2], volume: serde_json::Value) -> Model {
    let mut model = Model::new(json!([
        { "mesh": meshes[0] },
        { "mesh": meshes[1], "translation": [0, 0, -0.5], "rotation": [0, 1, 0, 0] },
        { "camera": 0, "translation": [0, 0, 5] }
    ]));
    let perspective = json!({ "yfov": 0.01, "aspectRatio": 1.0, "znear": 0.25, "zfar": 50.0 });
    model.add("cameras", json!({ "type": "perspective", "perspective": perspective }));
    let material = model.add(
        "materials",
        json!({
            "pbrMetallicRoughness": { "metallicFactor": 0, "roughnessFactor": 0 },
            "extensions": {
                "KHR_materials_transmission": { "transmissionFactor": 1 },
                "KHR_materials_volume": volume
            }
        }),
    );
    for _ in 0..=meshes[1] {
        let mut square = model.square();
        square["material"] = json!(material);
        model.mesh(square);
    }
    model
}

/// In a white environment, a pane of the reflectance F that lets the share T pass once has the radiance
/// F + (1 − F)² T / (1 − F T).
#[test]
fn bodies_that_transmit_light_absorb_it() {
    let volume =
        json!({ "thicknessFactor": 1, "attenuationDistance": 0.5, "attenuationColor": [0.5, 0.25, 1.0] });
    for meshes in [[0, 1], [0, 0]] {
        let mut loaded = pane(meshes, volume.clone()).loaded();
        assert!(loaded.approximations.is_empty() && loaded.warnings.is_empty(), "{loaded:?}");
        let film = &mut loaded.description.sensors[0].film;
        (film.width, film.height) = (8, 8);
        let settings = loaded.integrator.clone();
        let scene = scenes::compiled(loaded.description, AccelKind::default());
        let rendered = scenes::render(&scene, &settings, SamplerKind::Sobol, 256, 0);
        let (mean, _) = scenes::mean(&rendered);
        for (found, t) in mean.into_iter().zip([0.5, 0.25, 1.0]) {
            let f = 0.04;
            let expected = f + (1.0 - f) * (1.0 - f) * t / (1.0 - f * t);
            assert!((found - expected).abs() < 0.01, "{meshes:?}: {mean:?}, expected {expected}");
        }
    }
}

/// Only `volpath` renders media: with another integrator the user is told.
#[test]
fn bodies_that_absorb_nothing_because_of_the_integrator_are_noted() {
    let volume =
        json!({ "thicknessFactor": 1, "attenuationDistance": 0.5, "attenuationColor": [0.5, 0.25, 1.0] });
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("pane.gltf");
    std::fs::write(&path, pane([0, 1], volume).text()).expect("the file is written");
    for (integrator, noted) in
        [(None, false), (Some("volpath"), false), (Some("auto"), false), (Some("path"), true)]
    {
        let options = LoadOptions { integrator: integrator.map(str::to_owned), ..LoadOptions::default() };
        let loaded = load(&path, &options).expect("the scene loads");
        let found = loaded.notes.iter().any(|note| note.contains("every medium is vacuum"));
        assert_eq!(found, noted, "{integrator:?}: {:?}", loaded.notes);
    }
}

#[test]
fn thin_walls_and_clear_bodies_absorb_nothing() {
    for (volume, notes) in [
        (json!({ "attenuationDistance": 0.5, "attenuationColor": [0.5, 0.25, 1.0] }), [1, 0]),
        (json!({ "thicknessFactor": 1 }), [0, 0]),
        (json!({ "thicknessFactor": 1, "attenuationDistance": 2 }), [0, 0]),
        (json!({ "thicknessFactor": 1, "attenuationDistance": 2, "attenuationColor": [2, 1, 1] }), [0, 1]),
    ] {
        let mut loaded = pane([0, 1], volume).load().expect("the scene loads");
        assert!(loaded.description.media.is_empty() && loaded.integrator.path_mut().is_some());
        assert_eq!([loaded.approximations.len(), loaded.warnings.len()], notes, "{:?}", loaded.warnings);
    }
}

#[test]
fn texels_are_where_the_specification_puts_them() {
    let loaded = textured(&FOUR, |texture| {
        json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": texture }, "baseColorFactor": [1, 1, 0.5, 1] } })
    })
    .loaded();
    let color = principled(&loaded).base_color;
    let expected = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.5], [1.0, 1.0, 0.5]];
    for (uv, expected) in MIDDLES.into_iter().zip(expected) {
        assert_eq!(color_at(&loaded, color, uv), expected, "{uv:?}");
    }
}

#[test]
fn roughness_is_green_metal_is_blue_and_neither_is_encoded() {
    let pixels = [[9, 51, 102, 255], [0, 102, 204, 255], [0, 0, 0, 255], [0, 255, 255, 255]];
    let loaded = textured(&pixels, |texture| {
        json!({ "pbrMetallicRoughness":
            { "metallicRoughnessTexture": { "index": texture }, "roughnessFactor": 0.5 } })
    })
    .loaded();
    let p = principled(&loaded);
    for (uv, roughness, metallic) in [(MIDDLES[0], 0.1, 0.4), (MIDDLES[1], 0.2, 0.8), (MIDDLES[3], 0.5, 1.0)]
    {
        assert!((number_at(&loaded, p.roughness, uv) - roughness).abs() < 1e-6, "{uv:?}");
        assert!((number_at(&loaded, p.metallic, uv) - metallic).abs() < 1e-6, "{uv:?}");
    }
}

#[test]
fn alpha_makes_holes() {
    let with = |mode: serde_json::Value| {
        let loaded = textured(&FOUR, |texture| {
            let mut material = mode;
            material["doubleSided"] = json!(true);
            material["pbrMetallicRoughness"] =
                json!({ "baseColorTexture": { "index": texture }, "baseColorFactor": [1, 1, 1, 0.5] });
            material
        })
        .loaded();
        let Material::Mask(Mask { opacity, inner }) = *material(&loaded) else { panic!("expected a mask") };
        assert!(matches!(loaded.description.materials[inner.index()], Material::TwoSided(_)));
        MIDDLES.map(|uv| number_at(&loaded, opacity, uv))
    };
    assert_eq!(with(json!({ "alphaMode": "BLEND" })), [0.5, 0.5, 0.5, 0.1]);
    assert_eq!(with(json!({ "alphaMode": "MASK" })), [1.0, 1.0, 1.0, 0.0]);
    assert_eq!(with(json!({ "alphaMode": "MASK", "alphaCutoff": 0.05 })), [1.0; 4]);
    let opaque = square_of(json!({ "alphaMode": "MASK" })).loaded();
    assert!(matches!(material(&opaque), Material::Principled(_)));
}

#[test]
fn double_sided_materials_have_both_sides_between_holes() {
    let loaded = square_of(json!({
        "alphaMode": "BLEND", "doubleSided": true, "pbrMetallicRoughness": { "baseColorFactor": [1, 1, 1, 0.5] }
    }))
    .loaded();
    let (id, description) = (loaded.description.shapes[0].material, loaded.description);
    let materials = Materials::new(description.materials, description.textures).unwrap();
    let f = |wo: Vec3| {
        let texture = TexturePoint::at(Vec2::ZERO);
        let frame = Frame::from_normal(Vec3::Z);
        let at = MaterialPoint { texture, frame, ng: Vec3::Z, dp_duv: [Vec3::X, Vec3::Y], wo: Some(wo) };
        let arena = Bump::new();
        let scattering = materials.scattering(id, &at, &arena);
        assert_eq!(scattering.opacity, 0.5);
        scattering.bsdf.eval(wo, wo).f
    };
    assert!(!f(Vec3::Z).is_black());
    assert_eq!(f(Vec3::NEG_Z), f(Vec3::Z));
}

#[test]
fn normal_maps_lean_and_are_scaled() {
    let pixels = [[255, 128, 128, 255]; 4];
    let loaded =
        textured(&pixels, |texture| json!({ "normalTexture": { "index": texture, "scale": 0.5 } })).loaded();
    let Material::NormalMap(NormalMap { normals, .. }) = *material(&loaded) else {
        panic!("expected a normal map")
    };
    let n = texture(&loaded, Some(normals)).eval(&TexturePoint::at(Vec2::ZERO)).map(|c| 2.0 * c - 1.0);
    let y = 128.0 / 255.0 * 2.0 - 1.0;
    let expected = Rgb::new(0.5, 0.5 * y, y);
    assert!((n - expected).map(f32::abs).max_component() < 1e-6, "{n:?}");
}

#[test]
fn emission_is_factor_times_texture_times_strength() {
    let loaded = textured(&FOUR, |texture| {
        json!({
            "emissiveFactor": [1, 0.5, 0.25], "emissiveTexture": { "index": texture },
            "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 8 } }
        })
    })
    .loaded();
    let emission = loaded.description.shapes[0].emission.unwrap();
    assert_eq!(color_at(&loaded, emission, MIDDLES[3]), [8.0, 4.0, 2.0]);
    assert!(loaded.description.emitters.is_empty(), "it is light enough");
}

#[test]
fn textures_are_moved_by_their_transformation_and_wrapped_along_each_axis() {
    let mut model = textured(&FOUR, |texture| {
        let transform = json!({ "offset": [0.5, 0.0], "rotation": std::f32::consts::FRAC_PI_2 });
        json!({ "pbrMetallicRoughness": { "baseColorTexture":
            { "index": texture, "extensions": { "KHR_texture_transform": transform } } } })
    });
    model.json["samplers"][0]["wrapS"] = json!(33071);
    let loaded = model.loaded();
    let color = principled(&loaded).base_color;
    // (u, v) is evaluated at (0.5 + v, −u): the right column repeats to the right of the image, the lower row above it.
    assert_eq!(color_at(&loaded, color, [0.25, 0.75]), [1.0; 3]);
    assert_eq!(color_at(&loaded, color, [0.75, 0.25]), [0.0, 1.0, 0.0]);
}

#[test]
fn vertex_colours_are_multiplied_into_the_base_colour() {
    let mut model = square_of(json!({
        "pbrMetallicRoughness": { "baseColorFactor": [0.5, 1, 1, 1] }, "alphaMode": "BLEND"
    }));
    let colors = model.accessor("VEC4", 5121, &[255, 0, 0, 51].repeat(4), 4);
    model.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(colors);
    let loaded = model.loaded();
    let shape = &loaded.description.shapes[0];
    let at = TexturePoint { attributes: &mesh(shape).attributes, ..TexturePoint::at(Vec2::ZERO) };
    let color = texture(&loaded, principled(&loaded).base_color.texture()).eval(&at);
    assert_eq!(color, Rgb::new(0.5, 0.0, 0.0));
    let Material::Mask(Mask { opacity, .. }) = *material(&loaded) else { panic!("expected a mask") };
    assert_eq!(texture(&loaded, opacity.texture()).eval_scalar(&at), 0.2);
}

#[test]
fn the_textures_choose_the_set_of_coordinates() {
    let mut model = textured(
        &FOUR,
        |texture| json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": texture, "texCoord": 1 } } }),
    );
    let second = model.floats("VEC2", &[0.5; 8]);
    model.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"] = json!(second);
    assert_eq!(mesh(&model.loaded().description.shapes[0]).uvs, [Vec2::splat(0.5); 4]);
    model.json["materials"][0]["normalTexture"] = json!({ "index": 0 });
    let warnings = model.load().unwrap().warnings;
    let text = warnings[0].to_string();
    assert!(text.ends_with("several sets of texture coordinates: TEXCOORD_1 is taken for all"), "{text}");
}

#[test]
fn lights_stand_at_their_nodes_and_shine_along_minus_z() {
    let light = |i: usize| json!({ "KHR_lights_punctual": { "light": i } });
    let mut model = Model::new(json!([
        { "extensions": light(0), "translation": [1, 2, 3] },
        { "extensions": light(1), "rotation": [-FRAC_1_SQRT_2, 0, 0, FRAC_1_SQRT_2], "scale": [2, 2, 2] },
        { "extensions": light(2) },
        { "mesh": 0 }
    ]));
    let square = model.square();
    model.mesh(square);
    model.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [
        { "type": "point", "color": [1, 0.5, 0], "intensity": 4 },
        { "type": "directional", "intensity": 3 },
        { "type": "spot", "intensity": 2, "spot": { "innerConeAngle": 0.25, "outerConeAngle": 0.5 } }
    ] } });
    let loaded = model.loaded();
    let [point, directional, spot] = loaded.description.emitters.as_slice() else {
        panic!("expected three lights")
    };
    let intensity = Rgb::new(4.0, 2.0, 0.0);
    assert_eq!(*point, Emitter::Point { position: Vec3::new(1.0, 2.0, 3.0), intensity });
    let Emitter::Directional { direction, irradiance } = directional else { panic!("{directional:?}") };
    assert!((*direction - Vec3::NEG_Y).length() < 1e-6 && *irradiance == Rgb::splat(3.0), "{direction}");
    let Emitter::Spot { to_world, intensity, cutoff_angle, beam_width, .. } = spot else {
        panic!("{spot:?}")
    };
    assert_eq!((to_world.matrix3.z_axis, *intensity), (DVec3::NEG_Z, Rgb::splat(2.0)));
    assert_eq!((*cutoff_angle, *beam_width), (0.5, 0.25));
    assert!(
        loaded.notes.iter().any(|note| note.starts_with("point light, in candela")),
        "{:?}",
        loaded.notes
    );
}

#[test]
fn cameras_look_along_minus_z_and_each_is_a_sensor() {
    let mut model = Model::new(json!([
        { "mesh": 0 }, { "camera": 0, "translation": [0, 0, 5], "scale": [2, 2, 2], "name": "front" }, { "camera": 1 }
    ]));
    let square = model.square();
    model.mesh(square);
    let perspective = json!({ "yfov": 0.5, "aspectRatio": 1.5, "znear": 0.25, "zfar": 50.0 });
    model.add("cameras", json!({ "type": "perspective", "perspective": perspective }));
    let orthographic = json!({ "xmag": 4.0, "ymag": 2.0, "znear": 0.0, "zfar": 50.0 });
    model.add("cameras", json!({ "type": "orthographic", "orthographic": orthographic }));
    let loaded = model.loaded();
    let [front, above] = loaded.description.sensors.as_slice() else { panic!("expected two sensors") };
    let to_world = front.to_world.at(0.0);
    assert_eq!(to_world.transform_point3(DVec3::new(1.0, 1.0, 2.0)), DVec3::new(-1.0, 1.0, 3.0));
    assert_eq!((front.name.as_str(), front.near_clip, front.far_clip), ("front", 0.25, 50.0));
    assert_eq!((front.film.width, front.film.height), (1080, 720));
    let Projection::Perspective { fov, fov_axis, .. } = front.projection else { panic!("{front:?}") };
    assert_eq!((fov, fov_axis), (0.5, FovAxis::Y));
    assert_eq!(
        (above.projection, above.film.width, above.film.height),
        (Projection::Orthographic, 1280, 640)
    );
    let m = above.to_world.at(0.0).matrix3;
    assert_eq!([m.x_axis, m.y_axis, m.z_axis], [DVec3::X * -4.0, DVec3::Y * 4.0, DVec3::NEG_Z]);
}

#[test]
fn what_a_file_lacks_is_added_and_said() {
    let mut model = Model::new(json!([{ "mesh": 0, "translation": [10, 0, 0] }, { "mesh": 0 }]));
    let square = model.square();
    model.mesh(square);
    model.add("animations", json!({ "channels": [], "samplers": [] }));
    let loaded = model.loaded();
    assert_eq!(loaded.description.emitters, [Emitter::Constant { radiance: Rgb::WHITE }]);
    assert_eq!(loaded.approximations, ["animations are not played: everything stands as the nodes say"]);
    assert_eq!(
        loaded.notes,
        [
            "the file has no light: everything is in an even white light",
            "the file has no camera: everything is seen from the front and above (y is up, z to the viewer)",
        ]
    );
    let to_world = loaded.description.sensors[0].to_world.at(0.0);
    let middle = to_world.inverse().transform_point3(DVec3::new(5.0, 0.0, 0.0));
    assert!(middle.truncate().length() < 1e-9 && middle.z > 6.0, "{middle}");
}

#[test]
fn buffers_and_images_may_be_files_beside_it() {
    let mut model = textured(
        &FOUR,
        |texture| json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": texture } } }),
    );
    let folder = tempfile::TempDir::new().unwrap();
    std::fs::write(folder.path().join("all numbers.bin"), &model.bytes).unwrap();
    std::fs::write(folder.path().join("four.png"), png(2, &FOUR)).unwrap();
    model.json["buffers"] = json!([{ "byteLength": model.bytes.len(), "uri": "all%20numbers.bin" }]);
    model.json["images"] = json!([{ "uri": "four.png" }]);
    let path = folder.path().join("scene.gltf");
    std::fs::write(&path, model.json.to_string()).unwrap();
    let loaded = load(&path, &LoadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
    let color = principled(&loaded).base_color;
    assert_eq!(color_at(&loaded, color, MIDDLES[1]), [0.0, 1.0, 0.0]);
    model.json["images"] = json!([{ "uri": data_uri(&png(2, &FOUR)) }]);
    assert_eq!(principled(&model.loaded()).metallic, Input::Constant(1.0));
}
