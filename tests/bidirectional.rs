//! Bidirectional path tracing, compared with path tracing, light tracing and closed forms.

use crate::support::cli::{Folder, connected};
use std::ops::RangeInclusive;

/// Renders a scene with two integrators and checks that the images differ by noise alone.
#[track_caller]
pub fn agree(folder: &Folder, common: &str, integrators: [&str; 2]) {
    for (i, name) in integrators.iter().enumerate() {
        let options = format!("--aov variance --integrator {} --seed {i} -o {i}.exr", connected(name));
        folder.render(&format!("s.xml -q --sampler scene {common} {options}"));
    }
    let run = folder.run("diff 0.exr 1.exr --z");
    assert_eq!(run.code, 0, "{integrators:?} {common}: {}{}", run.stdout, run.stderr);
}

/// All techniques together give the image of camera paths, with a pinhole, a thin lens and an orthographic camera.
#[test]
fn paths_from_both_ends_agree_with_camera_paths() {
    let folder = Folder::of_scene("light-tracing", "lights.xml");
    for sensor in 0..3 {
        agree(&folder, &format!("--size 32x24 -s {sensor} --spp 512"), ["path", "bdpt"]);
    }
}

#[test]
fn paths_from_both_ends_agree_on_every_kind_of_emitter() {
    let folder = Folder::of_scene("photon", "emitters.xml");
    agree(&folder, "--size 52x28 --spp 512", ["path", "bdpt"]);
}

#[test]
#[ignore = "takes long: make test-all"]
fn paths_from_both_ends_agree_with_light_paths_on_every_kind_of_emitter() {
    let folder = Folder::of_scene("photon", "emitters.xml");
    agree(&folder, "--size 52x28 --spp 512", ["ptracer", "bdpt"]);
}

#[test]
fn depths_mean_what_they_mean_to_camera_paths() {
    check_depths(2..=3);
}

#[test]
#[ignore = "takes long: make test-all"]
fn other_depths_mean_what_they_mean_to_camera_paths() {
    check_depths(1..=1);
    check_depths(4..=4);
}

/// `max_depth` has the same meaning as for camera paths. With few edges, few techniques exist, so that each one counts.
fn check_depths(depths: RangeInclusive<u32>) {
    let folder = Folder::of_scene("light-tracing", "lights.xml");
    let text = String::from_utf8(folder.read("s.xml")).expect("a scene is text");
    for depth in depths {
        let limit = format!("name=\"max_depth\" value=\"{depth}\"");
        let scene = text.replace("name=\"max_depth\" value=\"6\"", &limit);
        assert_ne!(scene, text);
        folder.write("s.xml", scene.as_bytes());
        agree(&folder, "--size 24x16 --spp 4096", ["path", "bdpt"]);
    }
}

/// The image does not depend on threads, interruptions or the division into ranges.
#[test]
fn images_are_the_same_bits() {
    for integrator in ["bdpt", "vcm", "pssmlt"] {
        check_bits(&Folder::of_scene("light-tracing", "lights.xml"), integrator);
    }
}

#[track_caller]
pub fn check_bits(folder: &Folder, integrator: &str) {
    let common = &format!("s.xml -q --integrator {integrator} --size 32x24");
    let data = |name: &str| buffon::image::read(&folder.path(name)).expect("an image").data;
    for threads in [1, 2, 5] {
        folder.render(&format!("{common} --spp 8 -t {threads} -o {threads}.exr"));
    }
    assert!(data("1.exr") == data("2.exr") && data("1.exr") == data("5.exr"));
    folder.render(&format!("{common} --spp 4 --checkpoint c.bck -o c.exr"));
    folder.render(&format!("{common} --spp 8 --checkpoint c.bck --resume -o c.exr"));
    assert!(data("1.exr") == data("c.exr"));
    for (part, range) in ["0..2", "2..8"].iter().enumerate() {
        let options = format!("--spp 8 --sample-range {range} --checkpoint {part}.bck -o part.exr");
        folder.render(&format!("{common} {options}"));
    }
    let run = folder.run("merge 0.bck 1.bck -o merged.exr");
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(data("1.exr") == data("merged.exr"));
}

/// Vertex connection and merging without merging is bidirectional path tracing, and without connections progressive
/// photon mapping.
#[test]
fn parts_of_vertex_connection_and_merging_are_integrators() {
    let folder = Folder::of_scene("light-tracing", "lights.xml");
    let text = String::from_utf8(folder.read("s.xml")).expect("a scene is text");
    let (head, rest) = text.split_once("<integrator").expect("an integrator");
    let (_, tail) = rest.split_once("</integrator>").expect("its end");
    let pixels = |integrator: &str| {
        let integrator = format!(
            r#"<integrator type={integrator}<integer name="max_depth" value="5"/>
            <boolean name="hide_emitters" value="true"/></integrator>"#
        );
        folder.write("s.xml", format!("{head}{integrator}{tail}").as_bytes());
        folder.render("s.xml -q --size 32x24 --spp 8 -o a.pfm");
        folder.read("a.pfm")
    };
    let off = |what: &str| format!(r#""vcm"><boolean name="{what}" value="false"/>"#);
    let radius = r#"<float name="initial_radius" value="0.1"/><float name="alpha" value="0.8"/>"#;
    let [both, connections, merging] = ["\"vcm\">".to_owned(), off("merging"), off("connections")]
        .map(|vcm| pixels(&format!("{vcm}{radius}")));
    assert!(connections == pixels("\"bdpt\">") && merging == pixels(&format!("\"sppm\">{radius}")));
    assert!(both != connections && both != merging);
    let neither =
        format!("{head}<integrator type={}{}</integrator>{tail}", off("merging"), &off("connections")[6..]);
    folder.write("s.xml", neither.as_bytes());
    let run = folder.run("render s.xml -o a.pfm");
    assert!(run.code == 3 && run.stderr.contains("no light path counts: use path"), "{run:?}");
}

/// Returns a closed sphere with the reflectance 1/2 that emits the radiance 1, seen from inside.
fn furnace(integrator: &str) -> String {
    format!(
        r#"<scene version="3.0.0">
  {integrator}
  <sensor type="perspective"><transform name="to_world"><lookat origin="0.2,0,0" target="0,0.3,1" up="0,1,0"/></transform>
    <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/></film></sensor>
  <shape type="sphere"><boolean name="flip_normals" value="true"/>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf>
    <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>
</scene>"#
    )
}

/// In a closed sphere that emits, the radiance is that of the geometric series.
#[test]
fn a_furnace_multiplies_light_by_bouncing() {
    for (depth, exact) in [("1", 1.0), ("2", 1.5), ("3", 1.75), ("4", 1.875), ("-1", 2.0)] {
        // The chains of a pass share the estimate of their brightness, from few paths at this size.
        for (integrator, samples, bound) in
            [("bdpt", 256, 0.004), ("vcm", 256, 0.004), ("pssmlt", 1024, 0.015)]
        {
            let scene = furnace(&format!(
                r#"<integrator type="{integrator}"><integer name="max_depth" value="{depth}"/></integrator>"#
            ));
            let mean = mean_of(&Folder::with(&scene), samples);
            assert!(
                (mean / exact - 1.0).abs() < bound,
                "{integrator}, depth {depth}: {mean}, expected {exact}"
            );
        }
    }
}

/// Every technique alone finds all light of the paths that it samples: in a furnace with the reflectance `ρ`, paths of
/// `n` edges bring `ρⁿ⁻¹`. With their weights, all techniques of one length together bring as much.
#[test]
fn every_technique_alone_finds_the_light_of_its_length() {
    for edges in 1..=5u32 {
        let exact = 0.5f64.powi(edges as i32 - 1);
        let mut together = 0.0;
        for light in if edges == 1 { 0..1 } else { 0..edges + 1 } {
            let camera = edges + 1 - light;
            // Four standard deviations are less than the bound. Few light paths hit what the camera sees.
            let samples = if camera == 1 { 2048 } else { 256 };
            let mean = |weighted: bool| {
                let scene = furnace(&format!(
                    r#"<integrator type="bdpt"><string name="technique" value="{light},{camera}"/>
                    <integer name="max_depth" value="{}"/>
                    <boolean name="weighted" value="{weighted}"/></integrator>"#,
                    edges + 1
                ));
                // Weighted techniques have less noise.
                mean_of(&Folder::with(&scene), if weighted { samples / 4 } else { samples })
            };
            let alone = mean(false);
            let difference = (alone / exact - 1.0).abs();
            assert!(difference < 0.035, "{light} + {camera} vertices: {alone}, expected {exact}");
            together += mean(true);
        }
        println!("{edges} edges: {together}, expected {exact}");
        assert!((together / exact - 1.0).abs() < 0.01, "{edges} edges: {together}, expected {exact}");
    }
}

#[test]
fn techniques_that_do_not_exist_are_refused() {
    let technique = |text: &str| format!(r#"<string name="technique" value="{text}"/>"#);
    for (parameters, expected) in [
        (technique("2"), "such as 2,3"),
        (technique("a,b"), "such as 2,3"),
        (technique("1,2,3"), "such as 2,3"),
        (technique("-1,3"), "such as 2,3"),
        (technique("2,0"), "a camera path of at least one vertex"),
        (technique("0,1"), "an emitter that the camera sees (0,2)"),
        (technique("1,1"), "an emitter that the camera sees (0,2)"),
        (technique("4294967295,1"), "4294967294 edges, which is more than max_depth"),
        (technique("4,3"), "6 edges, which is more than max_depth"),
        (r#"<boolean name="weighted" value="false"/>"#.to_owned(), "needs a technique"),
    ] {
        let integrator = format!(
            r#"<integrator type="bdpt"><integer name="max_depth" value="5"/>{parameters}</integrator>"#
        );
        let run = Folder::with(&furnace(&integrator)).run("render s.xml -q --spp 1 -o f.exr");
        assert!(run.code == 3 && run.stderr.contains(expected), "{parameters}: {run:?}");
    }
}

/// The images of all techniques are the parts of the image: they add up to it.
#[test]
fn parts_of_techniques_add_up_to_the_image() {
    let folder = Folder::of_scene("light-tracing", "lights.xml");
    let text = String::from_utf8(folder.read("s.xml")).expect("a scene is text");
    let render = |parameters: &str| {
        let integrator =
            format!(r#"<integrator type="bdpt"><integer name="max_depth" value="3"/>{parameters}"#);
        let old = "<integrator type=\"$integrator\">\n    <integer name=\"max_depth\" value=\"6\"/>";
        let scene =
            text.replace(old, &integrator).replace(r#"<default name="integrator" value="ptracer"/>"#, "");
        assert!(scene.contains(&integrator));
        folder.write("s.xml", scene.as_bytes());
        folder.render("s.xml -q --size 32x24 --spp 16 -o f.exr");
        let image = buffon::image::read(&folder.path("f.exr")).expect("an image");
        image.select(&["R", "G", "B"]).expect("a picture").data
    };
    let whole = render("");
    let mut sum = vec![0.0; whole.len()];
    for edges in 1..=3u32 {
        for light in if edges == 1 { 0..1 } else { 0..edges + 1 } {
            let technique = format!("{light}, {}", edges + 1 - light);
            let part = render(&format!(r#"<string name="technique" value="{technique}"/>"#));
            sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
        }
    }
    for (i, (whole, sum)) in whole.iter().zip(&sum).enumerate() {
        assert!((whole - sum).abs() <= 1e-4 * whole.abs() + 1e-6, "value {i}: {sum}, expected {whole}");
    }
}

/// Renders a scene and returns the mean of the image.
fn mean_of(folder: &Folder, samples: u32) -> f64 {
    folder.render(&format!("s.xml -q --spp {samples} -o f.exr"));
    let image = buffon::image::read(&folder.path("f.exr")).expect("an image");
    let rgb = image.select(&["R", "G", "B"]).expect("a picture").data;
    rgb.iter().map(|v| f64::from(*v)).sum::<f64>() / rgb.len() as f64
}

/// Light of a point that glass sends to a floor is found by light paths only, and is in the image.
#[test]
fn caustics_of_delta_emitters_are_found() {
    let folder = Folder::with(
        r#"<scene version="3.0.0"><integrator type="path"/>
  <sensor type="orthographic"><transform name="to_world"><lookat origin="0,0,2" target="0,0,0" up="0,1,0"/></transform>
    <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/></film></sensor>
  <emitter type="point"><point name="position" value="0,0,-4"/><rgb name="intensity" value="30"/></emitter>
  <shape type="rectangle"><transform name="to_world"><translate z="-2"/></transform>
    <bsdf type="thindielectric"/></shape>
  <shape type="rectangle"><bsdf type="difftrans"><rgb name="transmittance" value="0.8"/></bsdf></shape>
</scene>"#,
    );
    agree(&folder, "--spp 1024", ["ptracer", "pssmlt"]);
    agree(&folder, "--spp 1024", ["ptracer", "bdpt"]);
    let image = buffon::image::read(&folder.path("1.exr")).expect("an image");
    assert!(image.data.iter().take(16).any(|v| *v > 0.1));
}

#[test]
fn chains_agree_with_camera_paths() {
    let folder = Folder::of_scene("light-tracing", "lights.xml");
    for sensor in 0..3 {
        agree(&folder, &format!("--size 32x24 -s {sensor} --spp 256"), ["path", "pssmlt"]);
    }
}

#[test]
#[ignore = "takes long: make test-all"]
fn chains_agree_on_every_kind_of_emitter() {
    let folder = Folder::of_scene("photon", "emitters.xml");
    agree(&folder, "--size 52x28 --spp 256", ["path", "pssmlt"]);
}

/// Checks that the images of `path` and of `vcm` with a small radius differ by noise alone. With the default radius,
/// shadows are blurred, and light leaks past thin boards.
#[track_caller]
fn merging_agrees(folder: &Folder, default: &str, common: &str) {
    let text = String::from_utf8(folder.read("s.xml")).expect("a scene is text");
    let render = |integrator: &str, options: &str| {
        let scene = text.replace(r#"<integrator type="$integrator">"#, integrator).replace(default, "");
        assert!(!scene.contains("$integrator"));
        folder.write("s.xml", scene.as_bytes());
        folder.render(&format!("s.xml -q --sampler scene --aov variance {common} {options}"));
    };
    render(r#"<integrator type="path">"#, "--seed 0 -o 0.exr");
    let small = r#"<integrator type="vcm"><float name="initial_radius" value="0.01"/>"#;
    render(small, "--seed 1 -o 1.exr");
    let run = folder.run("diff 0.exr 1.exr --z");
    assert_eq!(run.code, 0, "{common}: {}{}", run.stdout, run.stderr);
}

#[test]
fn merged_paths_agree_with_camera_paths() {
    for sensor in 0..3 {
        let folder = Folder::of_scene("light-tracing", "lights.xml");
        let default = r#"<default name="integrator" value="ptracer"/>"#;
        merging_agrees(&folder, default, &format!("--size 32x24 --spp 256 -s {sensor}"));
    }
}

#[test]
#[ignore = "takes long: make test-all"]
fn merged_paths_agree_on_every_kind_of_emitter() {
    let folder = Folder::of_scene("photon", "emitters.xml");
    // With 256 samples, 1 of 24 pairs of seeds is rejected, because few paths bring much of the light of some blocks.
    merging_agrees(&folder, r#"<default name="integrator" value="path"/>"#, "--size 52x28 --spp 1024");
}

/// A mirror shows a floor that a spot lights through a pane. Neither camera paths nor connections find that light. The
/// radiance of the floor is known: `ρ/π·I·cos/d²·T`, with the transmittance `T` of the pane.
#[test]
fn merging_finds_caustics_in_a_mirror() {
    let scene = |mirror: &str, target: &str| {
        format!(
            r#"<scene version="3.0.0"><integrator type="vcm"><integer name="max_depth" value="4"/></integrator>
  <sensor type="perspective"><float name="fov" value="2"/>
    <transform name="to_world"><lookat origin="0,3,3" target="{target}" up="0,1,0"/></transform>
    <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/></film></sensor>
  <emitter type="spot"><transform name="to_world"><lookat origin="0,20,0" target="0,0,0" up="0,0,1"/></transform>
    <float name="cutoff_angle" value="1.5"/><float name="beam_width" value="1.4"/>
    <rgb name="intensity" value="1000"/></emitter>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="2"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></shape>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="2"/>
    <translate y="15"/></transform><bsdf type="thindielectric"/></shape>
  {mirror}
</scene>"#
        )
    };
    // The mirror shows the point (0, 0, 0) at (0, 0, -5). No light of the spot hits the mirror.
    let mirror = r#"<shape type="rectangle"><transform name="to_world"><scale value="0.3"/>
    <translate y="0.94" z="-2.5"/></transform>
    <bsdf type="conductor"><string name="material" value="none"/></bsdf></shape>"#;
    // Normal incidence on glass of 1.5046 in 1.000277: the pane reflects 2R/(1 + R).
    let r = ((1.5046f64 - 1.000277) / (1.5046 + 1.000277)).powi(2);
    let exact = 0.5 / std::f64::consts::PI * 1000.0 / 400.0 * (1.0 - 2.0 * r / (1.0 + r));
    for (name, mirror, target) in [("floor", "", "0,0,0"), ("mirror", mirror, "0,0,-5")] {
        let mean = mean_of(&Folder::with(&scene(mirror, target)), 1024);
        assert!((mean / exact - 1.0).abs() < 0.02, "{name}: {mean}, expected {exact}");
    }
}

/// The layers of the techniques add up to the image, and are what the parameter `technique` gives.
#[test]
fn layers_of_techniques_add_up_to_the_image() {
    let folder = Folder::of_scene("light-tracing", "lights.xml");
    let text = String::from_utf8(folder.read("s.xml")).expect("a scene is text");
    let text = text.replace("name=\"max_depth\" value=\"6\"", "name=\"max_depth\" value=\"3\"");
    folder.write("s.xml", text.as_bytes());
    folder.render(
        "s.xml -q --sampler scene --integrator bdpt --size 16x12 --spp 8 --aov strategies -o all.exr",
    );
    let image = buffon::image::read(&folder.path("all.exr")).expect("an image");
    // One technique for emitters that the camera sees, three for direct light, four for one bounce.
    assert_eq!(image.channels.len(), 3 + 6 * (1 + 3 + 4), "{:?}", image.channels);
    let of = |suffix: &str| -> Vec<usize> {
        (0..image.channels.len()).filter(|i| image.channels[*i].ends_with(suffix)).collect()
    };
    for c in ["R", "G", "B"] {
        let (parts, whole) = (of(&format!(".weighted.{c}")), image.channel(c).expect("a channel"));
        assert_eq!(parts.len(), 8);
        for pixel in image.data.chunks_exact(image.channels.len()) {
            let sum: f32 = parts.iter().map(|i| pixel[*i]).sum();
            assert!((sum - pixel[whole]).abs() <= 1e-5 * (1.0 + sum), "{c} {sum} {}", pixel[whole]);
        }
    }
    let alone = of("s1_t3.alone.G")[0];
    assert!(image.data.chunks_exact(image.channels.len()).any(|pixel| pixel[alone] > 0.0));
    for (more, sentence) in [
        ("--integrator path", "path has no such techniques; use bdpt"),
        ("--integrator bdpt --sample-range 0..2", "its layers are rendered in one piece"),
    ] {
        let run = folder.run(&format!("render s.xml -q --spp 8 --aov strategies {more} -o no.exr"));
        assert_eq!(run.code, 2, "{run:?}");
        assert!(run.stderr.contains(sentence), "{}", run.stderr);
    }
}
