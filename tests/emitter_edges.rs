//! Pixels at the edges of emitters, whose samples are means of several paths.

use crate::support::cli::Folder;

/// A scene of 8 × 8 pixels with a lamp whose edge is inside pixels, above a grey floor.
fn scene(filter: &str, distance: f64) -> String {
    format!(
        r#"<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="4"/></integrator>
  <sensor type="orthographic"><transform name="to_world"><lookat origin="0,0,4" target="0,0,0" up="0,1,0"/></transform>
    <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/>
      <string name="component_format" value="float32"/><rfilter type="{filter}"/></film></sensor>
  <shape type="rectangle"><transform name="to_world"><scale value="3"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></shape>
  <shape type="rectangle"><transform name="to_world"><scale x="0.3" y="0.3"/><translate z="{distance}"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>
    <emitter type="area"><rgb name="radiance" value="50"/></emitter></shape>
</scene>"#
    )
}

/// The lamp covers .6² of the 2² units of the image, whatever the filter. On the floor, none of its light arrives.
#[test]
fn lamps_have_the_brightness_of_their_area() {
    // On the floor, the lamp emits away from it.
    let folder = Folder::with(&scene("box", 1e-4));
    const RENDERS: usize = 64;
    let means: Vec<f64> = (0..RENDERS)
        .map(|seed| {
            folder.render(&format!("s.xml -q --spp 4 --seed {seed} -o f.exr"));
            let image = buffon::image::read(&folder.path("f.exr")).expect("an image");
            image.data.iter().map(|v| f64::from(*v)).sum::<f64>() / image.data.len() as f64
        })
        .collect();
    let mean = means.iter().sum::<f64>() / RENDERS as f64;
    let variance = means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (RENDERS - 1) as f64;
    let exact = 50.0 * 0.09;
    // Four standard errors: a probability of 6·10⁻⁵.
    let bound = 4.0 * (variance / RENDERS as f64).sqrt();
    assert!((mean - exact).abs() < bound, "{mean}, expected {exact} ± {bound}");
    // Four independent points in each of the 8 pixels that the edge crosses on a side would have a standard deviation
    // of .16; that of stratified ones is smaller, and that of 36 is smaller still.
    assert!(variance.sqrt() < 0.03, "{}", variance.sqrt());
}

/// Paths that are reused agree with paths that are not, with narrow and wide filters, and in a crop.
#[test]
fn edges_agree_with_and_without_reuse() {
    let z = |folder: &Folder, a: &str, b: &str| {
        for (seed, options) in [a, b].into_iter().enumerate() {
            folder
                .render(&format!("s.xml -q --spp 256 --seed {seed} --aov variance {options} -o {seed}.exr"));
        }
        let run = folder.run("diff 0.exr 1.exr --z");
        assert_eq!(run.code, 0, "{a}, {b}: {}{}", run.stdout, run.stderr);
    };
    for filter in ["box", "gaussian"] {
        let lamp = scene(filter, 1.0).replace("</scene>", LAMP_ABOVE);
        let folder = Folder::with(&lamp);
        z(&folder, "--path-reuse always --size 16x16", "--path-reuse never --size 16x16");
        z(
            &folder,
            "--path-reuse never --size 16x16",
            "--integrator bdpt --bdpt-connections always --size 16x16",
        );
    }
}

/// A second lamp, which faces the floor and the back of which the camera sees.
const LAMP_ABOVE: &str = r#"  <shape type="rectangle"><transform name="to_world"><scale value="0.4"/>
    <rotate x="1" angle="180"/><translate x="0.6" y="0.6" z="1.5"/></transform>
    <emitter type="area"><rgb name="radiance" value="9"/></emitter></shape>
</scene>"#;
