//! OBJ files without a scene, and the materials of their MTL files.

use crate::loader::Files;
use crate::support::gltf::png;
use buffon::color::Rgb;
use buffon::emitter::Emitter;
use buffon::ids::MaterialId;
use buffon::loader::{LoadOptions, Loaded, load};
use buffon::material::{
    Coated, Conductor, Dielectric, Diffuse, Distribution, Input, Interface, Material, Metal,
};
use buffon::material::{RoughConductor, RoughPlastic, Roughness};
use buffon::math::Vec2;
use buffon::shape::{Mesh, Shape};
use buffon::texture::TexturePoint;

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n";

/// Returns an OBJ file with a square of each material.
fn squares(names: &[&str]) -> String {
    let uses = names.iter().map(|name| format!("usemtl {name}\nf 1/1 2/2 3/3 4/4\n"));
    format!("mtllib m.mtl\n{SQUARE}{}", uses.collect::<String>())
}

fn loaded(files: &Files) -> Loaded {
    load(&files.path().join("m.obj"), &LoadOptions::default()).unwrap()
}

/// Loads an OBJ file with a square of each material, and the MTL file.
fn load_squares(names: &[&str], mtl: &str) -> Loaded {
    loaded(&Files::new(&[("m.obj", &squares(names)), ("m.mtl", mtl)]))
}

/// Returns the first line of each warning, without the name of the folder.
fn warnings(files: &Files, loaded: &Loaded) -> Vec<String> {
    let first = |text: String| text.lines().next().unwrap_or_default().to_owned();
    loaded.warnings.iter().map(|warning| files.relative(first(warning.to_string()))).collect()
}

fn material(loaded: &Loaded, id: MaterialId) -> &Material {
    &loaded.description.materials[id.index()]
}

/// Returns the material inside the two-sided material of a shape.
fn base(loaded: &Loaded, shape: usize) -> &Material {
    match material(loaded, loaded.description.shapes[shape].material) {
        Material::TwoSided(two) => material(loaded, two.sides[0]),
        other => panic!("expected a two-sided material, found {other:?}"),
    }
}

fn mesh(loaded: &Loaded, shape: usize) -> &Mesh {
    match &loaded.description.shapes[shape].shape {
        Shape::Mesh(mesh) => mesh,
        other => panic!("expected a mesh, found {other:?}"),
    }
}

fn color_at(loaded: &Loaded, input: Input<Rgb>, uv: [f32; 2]) -> [f32; 3] {
    let id = input.texture().expect("a texture");
    loaded.description.textures[id.index()].eval(&TexturePoint::at(Vec2::from(uv))).to_array()
}

#[test]
fn colours_and_exponents_become_materials() {
    let mtl = "newmtl matt\nKd 0.2 0.4 0.6\nNs 10\nillum 1\nnewmtl shiny\nKd 0.3\nKs 0.5 0.5 0.5\nNs 198\nNi 1.25\n\
               newmtl metal\nKd 0 0 0\nKs 0.9 0.8 0.7\nNs 6\nillum 2\nnewmtl mirror\nKd 0 0 0\nKs 1 1 1\nillum 3\n\
               newmtl plain\nKa 1 1 1\n";
    let loaded = load_squares(&["matt", "shiny", "metal", "mirror", "plain"], mtl);
    let rgb = |r, g, b| Input::Constant(Rgb::new(r, g, b));
    let white = Input::Constant(Rgb::WHITE);
    let metal = |specular_reflectance| Metal { eta: Rgb::BLACK.into(), k: white, specular_reflectance };
    assert_eq!(*base(&loaded, 0), Diffuse { reflectance: rgb(0.2, 0.4, 0.6) }.into());
    assert_eq!(
        *base(&loaded, 1),
        Material::RoughPlastic(RoughPlastic {
            interface: Interface { int_ior: 1.25, ext_ior: 1.0, specular_reflectance: rgb(0.5, 0.5, 0.5) },
            base: Coated { diffuse_reflectance: rgb(0.3, 0.3, 0.3), nonlinear: false },
            distribution: Distribution::Beckmann,
            alpha: 0.1,
            sample_visible: true,
        })
    );
    let alpha = [Input::Constant(0.5); 2];
    let roughness = Roughness { distribution: Distribution::Beckmann, alpha, sample_visible: true };
    assert_eq!(*base(&loaded, 2), RoughConductor { metal: metal(rgb(0.9, 0.8, 0.7)), roughness }.into());
    assert_eq!(*base(&loaded, 3), Conductor { metal: metal(white) }.into());
    assert_eq!(*base(&loaded, 4), Diffuse { reflectance: rgb(0.5, 0.5, 0.5) }.into());
    assert_eq!(loaded.description.shapes[1].name, "shiny");
    assert_eq!(loaded.description.emitters, [Emitter::Constant { radiance: Rgb::WHITE }]);
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    assert!(loaded.notes[0].starts_with("a mesh alone: it is of the materials of its MTL files, in an even"));
}

#[test]
fn glass_holes_and_lamps() {
    let mtl = "newmtl glass\nKd 1 1 1\nNi 1.33\nd 0.1\nTf 0.5 0.6 0.7\nillum 7\nnewmtl veil\nKd 0.5\nd 0.25\n\
               newmtl veil2\nKd 0.5\nTr 0.25\nnewmtl lamp\nKd 0 0 0\nKe 5 4 3\n";
    let loaded = load_squares(&["glass", "veil", "veil2", "lamp"], mtl);
    let shapes = &loaded.description.shapes;
    assert_eq!(
        *material(&loaded, shapes[0].material),
        Material::Dielectric(Dielectric {
            interface: Interface { int_ior: 1.33, ext_ior: 1.0, specular_reflectance: Rgb::WHITE.into() },
            specular_transmittance: Rgb::new(0.5, 0.6, 0.7).into(),
        })
    );
    let opacity = |shape: usize| match material(&loaded, shapes[shape].material) {
        Material::Mask(mask) => mask.opacity,
        other => panic!("expected a mask, found {other:?}"),
    };
    assert_eq!([opacity(1), opacity(2)], [0.25, 0.75].map(Input::Constant));
    assert_eq!(shapes[3].emission, Some(Input::Constant(Rgb::new(5.0, 4.0, 3.0))));
    assert_eq!(shapes.iter().filter(|shape| shape.emission.is_some()).count(), 1);
    assert!(loaded.description.emitters.is_empty(), "a scene with a lamp has no other light");
}

#[test]
fn pictures_are_seen_where_the_file_says() {
    let names = ["a", "b", "c"];
    let mtl = "newmtl a\nKd 0.5 0.5 0.5\nmap_Kd four.png\nmap_d four.png\nnewmtl b\n\
               map_Kd -o 0.5 -s 1 -1 pictures\\four.png\n\
               newmtl c\nKd 0 0 0\nmap_Kd none.png\nmap_Ns four.png\nPm 0.5\nnorm four.png\n";
    let files = Files::new(&[("m.obj", &squares(&names)), ("m.mtl", mtl), ("pictures/x", "")]);
    let four = png(2, &[[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [255, 255, 255, 51]]);
    for name in ["four.png", "pictures/four.png"] {
        std::fs::write(files.path().join(name), &four).unwrap();
    }
    let loaded = loaded(&files);
    // The loaded v points down, as the rows of an image do, so the first corner is at (0, 1).
    assert_eq!(mesh(&loaded, 0).uvs[0], Vec2::Y);
    let Material::Mask(mask) = material(&loaded, loaded.description.shapes[0].material) else { panic!() };
    let Material::TwoSided(two) = material(&loaded, mask.inner) else { panic!() };
    let Material::Diffuse(diffuse) = material(&loaded, two.sides[0]) else { panic!() };
    let blue = color_at(&loaded, diffuse.reflectance, [0.25, 0.75]);
    assert_eq!(blue, [0.0, 0.0, 0.5]);
    let opacity = mask.opacity.texture().unwrap();
    let opacity = &loaded.description.textures[opacity.index()];
    assert_eq!(opacity.eval_scalar(&TexturePoint::at(Vec2::new(0.25, 0.25))), 1.0);
    assert!((opacity.eval_scalar(&TexturePoint::at(Vec2::new(0.75, 0.75))) - 0.2).abs() < 1e-6);
    // The options move the texture by half its width and turn it upside down.
    let Material::Diffuse(diffuse) = base(&loaded, 1) else { panic!() };
    assert_eq!(color_at(&loaded, diffuse.reflectance, [0.75, 0.25]), [0.0, 0.0, 1.0]);
    let Material::NormalMap(_) = base(&loaded, 2) else { panic!() };
    assert_eq!(
        warnings(&files, &loaded),
        ["m.mtl: newmtl c: there is no file \"none.png\": the texture is left out"]
    );
    let [ignored] = &loaded.approximations[..] else { panic!("{:?}", loaded.approximations) };
    assert!(ignored.ends_with("m.mtl: newmtl c: ignored: Pm, map_Ns"), "{ignored}");
}

#[test]
fn what_is_wrong_with_materials_is_told_and_the_rest_is_read() {
    let mtl =
        "# c\nnewmtl a\nKd 0.1 0.2\nKs spectral a.rfl\nKd 2 0.5 -1\nNs x\nmap_d\nKe 1 nan 0\nd -halo 1\n";
    let obj = format!(
        "mtllib none.mtl\nmtllib m.mtl\n{SQUARE}f 1 2 3\nusemtl a\nf 1 2 3\n\
         usemtl b\nf 1 2 3\nf 1 2 3\nusemtl a\nf 3 2 1\n"
    );
    let files = Files::new(&[("m.obj", &obj), ("m.mtl", mtl)]);
    let loaded = loaded(&files);
    let names: Vec<_> = loaded.description.shapes.iter().map(|shape| &shape.name[..]).collect();
    assert_eq!(names, ["m", "a", "b"]);
    assert_eq!(mesh(&loaded, 1).indices.len(), 2);
    assert_eq!(*base(&loaded, 1), Diffuse { reflectance: Rgb::new(1.0, 0.5, 0.0).into() }.into());
    assert_eq!(loaded.description.shapes[0].material, loaded.description.shapes[2].material);
    assert_eq!(
        warnings(&files, &loaded),
        [
            "m.obj:1:1: there is no file \"none.mtl\": its materials are grey",
            "m.mtl:3:1: the line is ignored: material parse error",
            "m.mtl:4:1: the line is ignored: material parse error",
            "m.mtl:6:1: the line is ignored: material parse error",
            "m.mtl:7:1: the line is ignored: material parse error",
            "m.mtl: newmtl a: expected a Ke that is finite and not negative: there is no emission",
            "m.mtl: newmtl a: expected a Kd in [0, 1]: it is limited to that",
            "m.obj:14:1: its MTL files have no material \"b\": it is grey",
        ]
    );
    let files = Files::new(&[("m.obj", &squares(&["a"])), ("m.mtl", &"Kd x\n".repeat(30))]);
    let error = load(&files.path().join("m.obj"), &LoadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("m.mtl: more than 20 lines are wrong"), "{error}");
    let files =
        Files::new(&[("m.obj", &squares(&["a"])), ("m.mtl", "newmtl a\nmap_Kd b.png\n"), ("b.png", "?")]);
    let error = load(&files.path().join("m.obj"), &LoadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("b.png: "), "{error}");
}

#[test]
fn materials_of_meshes_in_scenes_are_ignored() {
    let scene = "<scene version='3.0.0'><sensor type='perspective'/>\
                 <shape type='obj'><string name='filename' value='m.obj'/></shape></scene>";
    let files = Files::new(&[("scene.xml", scene), ("m.obj", &squares(&["a", "b"]))]);
    let loaded = files.load(&LoadOptions::default()).unwrap();
    assert_eq!((loaded.description.shapes.len(), loaded.warnings.len()), (1, 0));
    assert_eq!(mesh(&loaded, 0).indices.len(), 4);
}

/// Compares a file on the fast path with the same file after a line `vp`, which the fast path leaves to `tobj`.
#[test]
fn large_files_are_read_as_small_ones() {
    let mut obj = String::from("mtllib m.mtl\n");
    for i in 0..120_000 {
        let [x, y] = [i % 400, i / 400].map(|n| n as f32 * 0.37);
        obj += &format!("v {x:.6} {y:.6} {:.6}\nvt {x:.5} {y:.5}\n", (x + y).sin());
        if i > 400 {
            let [a, b, c] = [i + 1, i, i - 399];
            obj += &format!("usemtl {}\nf {a}/{a} {b}/{b} {c}/{c}\n", ["a", "b"][i / 1000 % 2]);
        }
    }
    assert!(obj.len() > 8 << 20, "{} bytes", obj.len());
    let mtl = "newmtl a\nKd 0.1\nnewmtl b\nKd 0.2\n";
    let fast = loaded(&Files::new(&[("m.obj", &obj), ("m.mtl", mtl)]));
    let slow = loaded(&Files::new(&[("m.obj", &format!("vp 0\n{obj}")), ("m.mtl", mtl)]));
    assert_eq!((fast.warnings.len(), slow.warnings.len()), (0, 1));
    assert_eq!(fast.description.shapes.len(), 2);
    for shape in 0..2 {
        assert!(mesh(&fast, shape) == mesh(&slow, shape), "shape {shape}");
    }
}
