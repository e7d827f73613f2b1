//! Cryptomatte layers, and the names of shapes and materials in an image.

use crate::support::cli::Folder;
use buffon::image::{Image, Value, read};
use std::collections::BTreeMap;

const SCENE: &str = r#"<scene version="3.0.0">
  <sensor type="orthographic">
    <transform name="to_world"><lookat origin="0,0,5" target="0,0,0" up="0,1,0"/></transform>
    <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/>
      <rfilter type="box"/></film>
  </sensor>
  <bsdf type="diffuse" id="chalk"/>
  <shape type="rectangle" id="left"><transform name="to_world"><scale x="0.5"/><translate x="-0.46875"/></transform>
    <ref id="chalk"/></shape>
  <shape type="shapegroup" id="group"><shape type="sphere" id="ball"><float name="radius" value="0.25"/>
    <bsdf type="twosided" id="paper"><bsdf type="diffuse"/></bsdf></shape></shape>
  <shape type="instance" id="planet"><ref id="group"/>
    <transform name="to_world"><translate x="0.5"/></transform></shape>
  <shape type="rectangle"><transform name="to_world"><scale value="2"/><translate z="-2"/></transform></shape>
  <emitter type="constant"/>
</scene>"#;

fn text(image: &Image, name: &str) -> String {
    match image.metadata.get(name) {
        Some(Value::Text(text)) => text.clone(),
        other => panic!("{name}: {other:?}"),
    }
}

/// Returns the mean coverage of each name of a layer, read as the specification says.
fn coverages(image: &Image, layer: &str) -> BTreeMap<String, f32> {
    let key = image.metadata.iter().find_map(|(name, value)| {
        let key = name.strip_prefix("cryptomatte/")?.strip_suffix("/name")?;
        (*value == Value::Text(layer.into())).then(|| key.to_owned())
    });
    let key = key.expect("the layer's key");
    assert_eq!(text(image, &format!("cryptomatte/{key}/hash")), "MurmurHash3_32");
    assert_eq!(text(image, &format!("cryptomatte/{key}/conversion")), "uint32_to_float32");
    let manifest = text(image, &format!("cryptomatte/{key}/manifest"));
    let manifest: BTreeMap<String, String> = serde_json::from_str(&manifest).expect("JSON");
    let channel = |i: usize, c: &str| image.channel(&format!("{layer}{i:02}.{c}")).expect("a channel");
    let pairs: Vec<[usize; 2]> =
        (0..3).flat_map(|i| [["R", "G"], ["B", "A"]].map(|pair| pair.map(|c| channel(i, c)))).collect();
    let pixels = image.data.chunks_exact(image.channels.len());
    let mean = |hash: &str| {
        let id = u32::from_str_radix(hash, 16).expect("hexadecimal digits");
        let of_pixel = |pixel: &[f32]| -> f32 {
            pairs.iter().filter(|[i, _]| pixel[*i].to_bits() == id).map(|[_, c]| pixel[*c]).sum()
        };
        pixels.clone().map(of_pixel).sum::<f32>() / 256.0
    };
    manifest.iter().map(|(name, hash)| (name.clone(), mean(hash))).collect()
}

fn picture(folder: &Folder, options: &str) -> Image {
    folder.render(&format!("s.xml -q -o p.exr {options}"));
    read(&folder.path("p.exr")).expect("an image")
}

/// Names have the areas that they cover: objects, among them instances, and materials.
#[test]
fn layers_have_the_areas_of_objects_and_materials() {
    let image = picture(&Folder::with(SCENE), "--cryptomatte --spp 1");
    // The film is 2 x 2. The edges of the left rectangle, at -0.96875 and 0.03125, divide columns of pixels.
    let (left, ball) = (0.5, std::f32::consts::PI * 0.0625 / 4.0);
    let objects = coverages(&image, "crypto_object");
    let materials = coverages(&image, "crypto_material");
    let check = |found: &BTreeMap<String, f32>, name: &str, expected: f32| {
        let seen = found.get(name).copied().unwrap_or_else(|| panic!("{name} is not in {found:?}"));
        assert!((seen - expected).abs() < 1e-3, "{name}: {seen} {expected}");
    };
    check(&objects, "left", left);
    check(&objects, "planet", ball);
    check(&objects, "shape.1", 1.0 - left - ball);
    check(&materials, "chalk", left);
    check(&materials, "paper", ball);
    // A group's shapes come after those of the scene.
    assert_eq!(objects.get("ball"), Some(&0.0));
}

/// The layers depend on neither threads nor samples, and a crop has the pixels of the whole image.
#[test]
fn layers_are_the_same_for_any_division() {
    let folder = Folder::with(SCENE);
    let whole = picture(&folder, "--cryptomatte --spp 2 -t 2");
    let mattes = |image: &Image, x: usize, y: usize| -> Vec<u32> {
        let names = image.channels.iter().zip(image.pixel(x, y));
        names.filter(|(name, _)| name.starts_with("crypto_")).map(|(_, v)| v.to_bits()).collect()
    };
    let crop = picture(&folder, "--cryptomatte -t 1 --crop 6,5,4,3 --sample-range 2..5 --spp 7");
    for (x, y) in (0..3).flat_map(|y| (0..4).map(move |x| (x, y))) {
        assert_eq!(mattes(&crop, x, y), mattes(&whole, x + 6, y + 5), "{x} {y}");
        assert_eq!(mattes(&crop, x, y).len(), 24);
    }
}

#[test]
fn layers_of_indices_come_with_names() {
    let image = picture(&Folder::with(SCENE), "--aov shape_index,material_index --spp 1");
    let names = |name: &str| -> Vec<String> { serde_json::from_str(&text(&image, name)).expect("JSON") };
    let (shapes, materials) = (names("buffon:shapes"), names("buffon:materials"));
    let value =
        |channel: &str, x: usize| image.pixel(x, 8)[image.channel(channel).expect("a layer")] as usize;
    assert_eq!(shapes[value("shape_index.I", 2)], "left");
    assert_eq!(shapes[value("shape_index.I", 11)], "ball");
    assert_eq!(materials[value("material_index.I", 2)], "chalk");
    assert_eq!(materials[value("material_index.I", 11)], "paper");
}

/// What does not fit into memory is refused before the render.
#[test]
fn layers_are_in_the_memory_plan() {
    let big = SCENE.replace("value=\"16\"", "value=\"2000\"");
    let run =
        Folder::with(&big).run("render s.xml -q --cryptomatte --spp 100000 -o p.exr --memory-limit 800M");
    assert_eq!(run.code, 4, "{run:?}");
    assert!(run.stderr.contains("the Cryptomatte layers would take"), "{}", run.stderr);
}

#[test]
fn layers_need_an_exr() {
    let run = Folder::with(SCENE).run("render s.xml -q --cryptomatte -o p.png");
    assert_eq!(run.code, 2, "{run:?}");
    assert!(
        run.stderr.contains("--cryptomatte: layers need an .exr or .npy, which p.png is not"),
        "{}",
        run.stderr
    );
}
