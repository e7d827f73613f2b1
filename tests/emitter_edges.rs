//! Pixels at the edges of emitters, whose samples are means of several paths.

use crate::support::cli::Folder;

/// A scene of 40 × 40 pixels with a lamp of 2.4 × 2.4 pixels above a grey floor.
const SCENE: &str = r#"<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="4"/></integrator>
  <sensor type="orthographic"><transform name="to_world"><lookat origin="0,0,4" target="0,0,0" up="0,1,0"/></transform>
    <film type="hdrfilm"><integer name="width" value="40"/><integer name="height" value="40"/>
      <string name="component_format" value="float32"/><rfilter type="box"/></film></sensor>
  <shape type="rectangle"><transform name="to_world"><scale value="3"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></shape>
  <shape type="rectangle"><transform name="to_world"><scale value="0.06"/><translate z="1e-4"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>
    <emitter type="area"><rgb name="radiance" value="50"/></emitter></shape>
</scene>"#;

const CORNELL_BOX: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box/cornell-box.xml");

/// Returns the mean of the values of the images with different seeds, and the standard deviation of that of one image.
fn mean_and_deviation(folder: &Folder, scene: &str, renders: u32, options: &str) -> [f64; 2] {
    let mean = |seed| {
        folder.render(&format!("{scene} -q --seed {seed} {options} -o f.exr"));
        let image = buffon::image::read(&folder.path("f.exr")).expect("an image");
        image.data.iter().map(|v| f64::from(*v)).sum::<f64>() / image.data.len() as f64
    };
    let means: Vec<f64> = (0..renders).map(mean).collect();
    let mean = means.iter().sum::<f64>() / f64::from(renders);
    let squares = means.iter().map(|m| (m - mean).powi(2)).sum::<f64>();
    [mean, (squares / f64::from(renders - 1)).sqrt()]
}

/// The lamp covers .12² of the 2² units of the image. None of its light arrives on the floor.
#[test]
fn lamps_have_the_brightness_of_their_area() {
    const RENDERS: u32 = 64;
    let [mean, deviation] = mean_and_deviation(&Folder::with(SCENE), "s.xml", RENDERS, "--spp 4");
    let exact = 50.0 * 0.0036;
    // Four standard errors.
    let bound = 4.0 * deviation / f64::from(RENDERS).sqrt();
    assert!((mean - exact).abs() < bound, "{mean}, expected {exact} ± {bound}");
    // It was 0.0022; with one path for each sample, 0.0146.
    assert!(deviation < 0.004, "{deviation}");
}

/// In the Cornell box, whose lamp is seen, paths that are reused and those from both ends agree with other paths.
#[test]
fn edges_agree_with_reuse_and_from_both_ends() {
    const RENDERS: u32 = 8;
    let folder = Folder::new();
    let [independent, reused, from_both_ends] =
        ["--path-reuse never", "--path-reuse always", "--integrator bdpt --bdpt-connections always"].map(
            |options| {
                mean_and_deviation(
                    &folder,
                    CORNELL_BOX,
                    RENDERS,
                    &format!("--size 128x96 --spp 16 {options}"),
                )
            },
        );
    for [mean, deviation] in [reused, from_both_ends] {
        let bound = 4.0 * (deviation.hypot(independent[1])) / f64::from(RENDERS).sqrt();
        assert!((mean - independent[0]).abs() < bound, "{mean}, expected {} ± {bound}", independent[0]);
        // When paths at edges were in no group, they lacked light, and images of 100 × 75 pixels were 1.1 % too dark.
        assert!(bound < 0.005 * mean, "{bound}");
    }
}

/// A crop has the pixels of the whole image, also where a wide filter reaches beyond it.
#[test]
fn crops_have_the_edges_of_the_whole() {
    let folder = Folder::new();
    let image = |options: &str| {
        folder.render(&format!("{CORNELL_BOX} -q --size 128x96 --spp 4 {options} -o f.exr"));
        buffon::image::read(&folder.path("f.exr")).expect("an image")
    };
    let whole = image("");
    let [x, y, width, height] = [52, 8, 20, 9];
    let crop = image(&format!("--crop {x},{y},{width},{height}"));
    for row in 0..height {
        let of_whole = &whole.data[3 * ((y + row) * 128 + x)..][..3 * width];
        assert_eq!(&crop.data[3 * row * width..][..3 * width], of_whole, "row {row}");
    }
}
