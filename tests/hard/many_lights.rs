//! A hundred thousand point emitters with powers over nine orders of magnitude.

use super::{expect_known, report};
use std::fmt::Write;

const LAMPS: u32 = 100_000;

/// The emitters are on a circle of radius 1 at height 1 above the receiver: all have the distance √2 and the cosine
/// 1/√2, so E = ΣI / (2√2) and L = ρ/π·E. A few of them emit 90 % of the light. The noise comes from the 5 % of the
/// samples that are distributed equally.
#[test]
#[ignore = "takes long: make test-all"]
fn a_hundred_thousand_lamps_of_very_different_power() {
    let folder = tempfile::tempdir().expect("a folder for temporary files");
    let mut scene = String::from(
        r#"<scene version="3.0.0"><integrator type="path"/>
        <sensor type="perspective"><float name="fov" value="0.002"/>
        <transform name="to_world"><lookat origin="0, -4, 0.4" target="0, 0, 0" up="0, 0, 1"/></transform>
        <sampler type="independent"><integer name="sample_count" value="9600"/></sampler>
        <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/>
        <rfilter type="box"/></film></sensor>
        <shape type="rectangle"><bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></shape>
        "#,
    );
    let mut sum = 0.0;
    for i in 0..LAMPS {
        let share = f64::from(i) / f64::from(LAMPS - 1);
        // With the golden angle, emitters of similar power are not near each other.
        let (sin, cos) = (2.399_963_229_728_653 * f64::from(i)).sin_cos();
        let intensity = 1e-9f64.powf(share);
        sum += intensity;
        writeln!(
            scene,
            r#"<emitter type="point"><point name="position" value="{cos}, {sin}, 1"/><rgb name="intensity" value="{intensity}"/></emitter>"#
        )
        .expect("a text grows");
    }
    scene.push_str("</scene>");
    let expected = 0.5 / std::f64::consts::PI * sum / 8f64.sqrt();
    let cases = format!(
        "about = 'Lamps'\nintegrators = ['path', 'direct']\n\
         [[case]]\nname = 'lamps'\nwhy = 'the sum'\nexpect = {expected}\nwithin = 1e-3\n"
    );
    std::fs::write(folder.path().join("lamps.xml"), scene).expect("the scene can be written");
    std::fs::write(folder.path().join("lamps.toml"), cases).expect("the cases can be written");
    let report = report(folder.path());
    assert_eq!((expect_known(&report), report.rows.len()), (0, 2));
}
