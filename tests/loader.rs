//! Whole scene files: the loaded description.

use buffon::color::Rgb;
use buffon::emitter::Emitter;
use buffon::error::Result;
use buffon::film::Filter;
use buffon::integrator::Settings;
use buffon::integrator::settings::PathLimits;
use buffon::loader::{LoadOptions, Loaded, load};
use buffon::material::{
    Dielectric, Diffuse, Distribution, Input, Material, Metal, RoughConductor, Roughness, TwoSided,
};
use buffon::math::{DAffine3, DVec3, Vec3};
use buffon::sampling::SamplerKind;
use buffon::sensor::{FovAxis, Projection};
use buffon::shape::Shape;
use std::path::Path;
use tempfile::TempDir;

/// A folder with files. The scene is `scene.xml`.
pub struct Files(TempDir);

impl Files {
    /// Writes the files.
    pub fn new(files: &[(&str, &str)]) -> Self {
        let dir = TempDir::new().unwrap();
        for (name, text) in files {
            let path = dir.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        }
        Files(dir)
    }

    /// Loads `scene.xml`.
    pub fn load(&self, options: &LoadOptions) -> Result<Loaded> {
        load(&self.0.path().join("scene.xml"), options)
    }

    /// Returns the folder.
    pub fn path(&self) -> &Path {
        self.0.path()
    }

    /// Returns a text without the name of the folder.
    pub fn relative(&self, text: impl ToString) -> String {
        text.to_string().replace(&format!("{}/", self.0.path().display()), "")
    }
}

/// Returns a scene of the current version with the given elements.
pub fn scene(inside: &str) -> String {
    format!("<scene version=\"3.0.0\">\n{inside}\n</scene>")
}

/// Loads the elements of a scene and checks that there are no warnings.
pub fn loaded(inside: &str) -> Loaded {
    let files = Files::new(&[("scene.xml", &scene(&format!("{SENSOR}{inside}")))]);
    let loaded = files.load(&LoadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    loaded
}

/// The minimum content of a scene.
pub const SENSOR: &str = "<sensor type='perspective'/>";
/// A triangle in OBJ.
pub const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0.25\nf 1/1 2/1 3/1\n";

/// A scene similar to the Cornell box for Mitsuba 3 in Bitterli's collection.
pub const BOX: &str = r#"<scene version="3.0.0">
	<default name="integrator" value="path" />
	<default name="spp" value="64" />
	<default name="resy" value="512" />
	<default name="resx" value="1024" />
	<default name="max_depth" value="30" />
	<integrator type="$integrator">
		<integer name="max_depth" value="$max_depth" />
	</integrator>
	<sensor type="perspective">
		<float name="fov" value="19.5" />
		<transform name="to_world">
			<matrix value="-1 0 0 0 0 1 0 1 0 0 -1 6.8 0 0 0 1" />
		</transform>
		<sampler type="independent">
			<integer name="sample_count" value="$spp" />
		</sampler>
		<film type="hdrfilm">
			<integer name="width" value="$resx" />
			<integer name="height" value="$resy" />
			<string name="file_format" value="openexr" />
			<string name="pixel_format" value="rgb" />
			<rfilter type="tent" />
		</film>
	</sensor>
	<bsdf type="twosided" id="LeftWallBSDF">
		<bsdf type="diffuse">
			<rgb name="reflectance" value="0.63, 0.065, 0.05" />
		</bsdf>
	</bsdf>
	<bsdf type="twosided" id="LightBSDF">
		<bsdf type="diffuse">
			<rgb name="reflectance" value="0, 0, 0" />
		</bsdf>
	</bsdf>
	<shape type="rectangle" id="LeftWall">
		<transform name="to_world">
			<matrix value="-4.37114e-008 8.74228e-008 -2 -1 1 3.82137e-015 -8.74228e-008 1 0 -1 -4.37114e-008 0 0 0 0 1" />
		</transform>
		<ref id="LeftWallBSDF" />
	</shape>
	<shape type="cube" id="ShortBox">
		<transform name="to_world">
			<matrix value="0.0851643 0.289542 1.31134e-008 0.328631 3.72265e-009 1.26563e-008 -0.3 0.3 -0.284951 0.0865363 5.73206e-016 0.374592 0 0 0 1" />
		</transform>
		<ref id="LeftWallBSDF" />
	</shape>
	<shape type="rectangle" id="Light">
		<transform name="to_world">
			<matrix value="0.235 -1.66103e-008 -7.80685e-009 -0.005 -2.05444e-008 3.90343e-009 -0.0893 1.98 2.05444e-008 0.19 8.30516e-009 -0.03 0 0 0 1" />
		</transform>
		<ref id="LightBSDF" />
		<emitter type="area">
			<rgb name="radiance" value="17, 12, 4" />
		</emitter>
	</shape>
</scene>"#;

#[test]
fn a_box_of_the_collection_is_read() {
    let files = Files::new(&[("scene.xml", BOX)]);
    let loaded = files.load(&LoadOptions::default()).unwrap();
    assert!(loaded.warnings.is_empty() && loaded.notes.is_empty(), "{loaded:?}");
    let path = PathLimits { max_depth: Some(30), ..PathLimits::default() };
    assert_eq!(loaded.integrator, Settings::Path(path.into()));
    assert_eq!((loaded.sampler, loaded.samples_per_pixel), (Some(SamplerKind::Independent), Some(64)));
    let scene = &loaded.description;
    let sensor = &scene.sensors[0];
    let Projection::Perspective { fov, fov_axis, .. } = sensor.projection else { panic!() };
    assert_eq!((fov, fov_axis), (19.5f64.to_radians(), FovAxis::X));
    assert_eq!(sensor.to_world.at(0.0).translation, DVec3::new(0.0, 1.0, 6.8));
    assert_eq!((sensor.film.width, sensor.film.height), (1024, 512));
    assert_eq!(sensor.film.filter, Filter::Tent { radius: 1.0 });
    assert_eq!(
        scene.shapes.iter().map(|s| s.name.as_str()).collect::<Vec<_>>(),
        ["LeftWall", "ShortBox", "Light"]
    );
    assert_eq!(scene.shapes[0].material, scene.shapes[1].material);
    assert_eq!(scene.shapes[0].to_world.at(0.0).translation, DVec3::new(-1.0, 1.0, 0.0));
    assert_eq!(scene.shapes[2].emission, Some(Rgb::new(17.0, 12.0, 4.0).into()));
    let Material::TwoSided(TwoSided { sides: [inner, _] }) =
        scene.materials[scene.shapes[0].material.index()]
    else {
        panic!("{scene:?}")
    };
    assert_eq!(
        scene.materials[inner.index()],
        Material::Diffuse(Diffuse { reflectance: Rgb::new(0.63, 0.065, 0.05).into() })
    );
    assert_eq!(scene.shapes[1].place.as_ref().unwrap().line, 42);
}

/// A scene similar to the one with a glass egg and a metal lamp in that collection.
const LAMP: &str = r#"<scene version="3.0.0">
	<sensor type="perspective"><float name="fov" value="35" /></sensor>
	<bsdf type="dielectric" id="GlassBSDF">
		<float name="int_ior" value="1.5" />
		<float name="ext_ior" value="1" />
	</bsdf>
	<bsdf type="twosided" id="LampBSDF">
		<bsdf type="roughconductor">
			<float name="alpha" value="0.25" />
			<string name="distribution" value="beckmann" />
			<rgb name="specular_reflectance" value="1, 1, 1" />
			<rgb name="eta" value="2.8656, 2.11918, 1.94008" />
			<rgb name="k" value="3.03233, 2.05611, 1.61629" />
		</bsdf>
	</bsdf>
	<shape type="obj" id="Lamp_0001">
		<string name="filename" value="models/Mesh007.obj" />
		<transform name="to_world"><matrix value="1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1" /></transform>
		<boolean name="face_normals" value="true" />
		<ref id="LampBSDF" />
	</shape>
	<shape type="obj"><string name="filename" value="models/Mesh007.obj" /><ref id="GlassBSDF" /></shape>
	<shape type="rectangle" id="Bulb">
		<emitter type="area"><rgb name="radiance" value="523.258, 523.258, 523.258" /></emitter>
	</shape>
</scene>"#;

#[test]
fn a_lamp_of_the_collection_is_read() {
    let files = Files::new(&[("scene.xml", LAMP), ("models/Mesh007.obj", TRIANGLE)]);
    let loaded = files.load(&LoadOptions::default()).unwrap();
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    assert_eq!(loaded.notes, ["the scene names no integrator: path is used"]);
    let scene = &loaded.description;
    let Shape::Mesh(faceted) = &scene.shapes[0].shape else { panic!() };
    assert!(faceted.normals.is_empty());
    assert_eq!(faceted.uvs[0].y, 0.75);
    let Shape::Mesh(smooth) = &scene.shapes[1].shape else { panic!() };
    assert_eq!(smooth.normals, [Vec3::Z; 3]);
    let Material::TwoSided(TwoSided { sides: [lamp, _] }) = scene.materials[scene.shapes[0].material.index()]
    else {
        panic!()
    };
    let metal = Metal {
        eta: Rgb::new(2.8656, 2.11918, 1.94008).into(),
        k: Rgb::new(3.03233, 2.05611, 1.61629).into(),
        specular_reflectance: Rgb::WHITE.into(),
    };
    let roughness =
        Roughness { distribution: Distribution::Beckmann, alpha: [0.25.into(); 2], sample_visible: true };
    let expected = Material::RoughConductor(RoughConductor { metal, roughness });
    assert_eq!(scene.materials[lamp.index()], expected);
    let default = &scene.materials[scene.shapes[2].material.index()];
    assert_eq!(*default, Material::Diffuse(Diffuse { reflectance: Rgb::BLACK.into() }));
}

/// As in Mitsuba, an emitter without a material reflects nothing.
#[test]
fn shapes_that_name_no_material_are_grey_and_lamps_black() {
    let scene = loaded(
        "<shape type='disk'><emitter type='area'/></shape>
        <shape type='disk'/>
        <shape type='sphere'><emitter type='area'/></shape>
        <shape type='disk'><bsdf type='diffuse'/><emitter type='area'/></shape>",
    );
    let scene = scene.description;
    let reflectances =
        [0, 1, 2, 3].map(|shape| match &scene.materials[scene.shapes[shape].material.index()] {
            Material::Diffuse(Diffuse { reflectance }) => *reflectance,
            other => panic!("{other:?}"),
        });
    assert_eq!(reflectances, [0.0, 0.5, 0.0, 0.5].map(|r| Rgb::splat(r).into()));
}

#[track_caller]
fn assert_transform(steps: &str, expected: [[f64; 4]; 3]) {
    let loaded =
        loaded(&format!("<shape type='disk'><transform name='to_world'>{steps}</transform></shape>"));
    let found: DAffine3 = loaded.description.shapes[0].to_world.at(0.0);
    for (i, row) in expected.iter().enumerate() {
        let m = found.matrix3;
        let found = [m.x_axis[i], m.y_axis[i], m.z_axis[i], found.translation[i]];
        for (f, e) in found.iter().zip(row) {
            assert!((f - e).abs() < 1e-5, "row {i}: {found:?} instead of {row:?}");
        }
    }
}

#[test]
fn transformations_apply_in_order() {
    // The values of Mitsuba 3.9.1.
    assert_transform(
        "<scale value='2'/><lookat origin='1,2,3' target='4,5,7' up='0,1,0'/><translate x='5'/>",
        [[1.6, -0.617395, 1.02899, 6.0], [0.0, 1.71499, 1.02899, 2.0], [-1.2, -0.823193, 1.37199, 3.0]],
    );
    assert_transform(
        "<translate x='1'/><rotate z='1' angle='90'/>",
        [[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0, 0.0]],
    );
    assert_transform(
        "<rotate z='1' angle='90'/><translate x='1'/><scale x='2' y='3'/>",
        [[0.0, -2.0, 0.0, 2.0], [3.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
    );
    assert_transform(
        "<matrix value='1 2 3  0 1 4  0 0 1'/>",
        [[1.0, 2.0, 3.0, 0.0], [0.0, 1.0, 4.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
    );
    assert_transform(
        "<lookat origin='0 0 0' target='1 2 -3'/>",
        [
            [-0.0792865, 0.960357, 0.267261, 0.0],
            [0.841427, -0.0792865, 0.534522, 0.0],
            [0.534522, 0.267261, -0.801784, 0.0],
        ],
    );
    // The length of a rotation axis has no effect. (Mitsuba 3.9.1 scales by it.)
    assert_transform(
        "<rotate z='2' angle='90'/>",
        [[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
    );
}

#[test]
fn the_first_default_counts_and_the_users_value_before_it() {
    let text = scene(&format!(
        "{SENSOR}<default name='d' value='3'/><integrator type='path'><integer name='max_depth' value='$d'/></integrator>"
    ));
    let files = Files::new(&[("scene.xml", &text)]);
    let depth = |defines: &[(&str, &str)]| {
        let defines = defines.iter().map(|(n, v)| (n.to_string(), v.to_string())).collect();
        let loaded = files.load(&LoadOptions { defines, ..LoadOptions::default() }).unwrap();
        let Settings::Path(path) = loaded.integrator else { panic!() };
        (path.limits.max_depth, loaded.warnings.iter().map(ToString::to_string).collect::<Vec<_>>())
    };
    assert_eq!(depth(&[]), (Some(3), vec![]));
    assert_eq!(depth(&[("d", "-1")]), (None, vec![]));
    assert_eq!(depth(&[("dd", "8")]).1, ["-D dd=8: the scene never uses $dd (did you mean \"d\"?)"]);
}

#[test]
fn includes_folders_aliases_and_later_references_are_followed() {
    let files = Files::new(&[
        (
            "scene.xml",
            &scene(&format!(
                "{SENSOR}<path value='assets'/>
                <shape type='disk'><ref id='second'/></shape>
                <include filename='parts/materials.xml'/>
                <alias id='first' as='second'/>
                <shape type='obj'><string name='filename' value='a.obj'/></shape>
                <shape type='disk'><bsdf type='diffuse'><spectrum name='reflectance' filename='grey.spd'/></bsdf></shape>"
            )),
        ),
        ("parts/materials.xml", &scene("<default name='r' value='0.25'/><include filename='first.xml'/>")),
        (
            "parts/first.xml",
            "<bsdf version='3.0.0' type='diffuse' id='first'><float name='reflectance' value='$r'/></bsdf>",
        ),
        ("assets/a.obj", TRIANGLE),
        ("assets/grey.spd", "# a comment\n400 0.5\n700 0.5\n"),
    ]);
    let loaded = files.load(&LoadOptions::default()).unwrap();
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    let scene = &loaded.description;
    let material = |i: usize| &scene.materials[scene.shapes[i].material.index()];
    assert_eq!(*material(0), Material::Diffuse(Diffuse { reflectance: Rgb::splat(0.25).into() }));
    assert!(matches!(scene.shapes[1].shape, Shape::Mesh(_)));
    let Material::Diffuse(Diffuse { reflectance: Input::Constant(reflectance) }) = material(2) else {
        panic!()
    };
    assert!((reflectance.g - 0.5).abs() < 0.01, "{reflectance:?}");
}

#[test]
fn the_users_folders_are_searched_last() {
    let assets = Files::new(&[("a.obj", TRIANGLE)]);
    let text = scene(&format!("{SENSOR}<shape type='obj'><string name='filename' value='a.obj'/></shape>"));
    let files = Files::new(&[("scene.xml", &text)]);
    assert!(files.load(&LoadOptions::default()).is_err());
    let search_paths = vec![assets.path().to_path_buf()];
    assert!(files.load(&LoadOptions { search_paths, ..LoadOptions::default() }).is_ok());
}

#[test]
fn old_scenes_are_upgraded() {
    let text = r#"<scene version="0.6.0">
        <integrator type="path"><integer name="maxDepth" value="5"/><boolean name="hideEmitters" value="true"/></integrator>
        <sensor type="perspective">
            <float name="nearClip" value="1"/><float name="fov" value="45"/><string name="fovAxis" value="smaller"/>
            <transform name="toWorld"><lookAt origin="0,0,5" target="0,0,0" up="0,1,0"/></transform>
            <sampler type="hammersley"><integer name="sampleCount" value="16"/></sampler>
        </sensor>
        <bsdf type="dielectric" id="glass"><string name="intIOR" value="water"/><float name="extIOR" value="1"/></bsdf>
        <bsdf type="diffuse" id="d"><rgb name="diffuseReflectance" value=".1"/></bsdf>
        <shape type="sphere"><float name="radius" value="2"/><ref id="glass"/></shape>
    </scene>"#;
    let files = Files::new(&[("scene.xml", text)]);
    let loaded = files.load(&LoadOptions::default()).unwrap();
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    let notes: Vec<_> = loaded.notes.iter().map(|n| files.relative(n)).collect();
    assert_eq!(
        notes,
        [
            "scene.xml: upgraded from version 0.6.0: camelCase names became snake_case",
            "the sampler hammersley is mapped to sobol"
        ]
    );
    assert_eq!(
        loaded.integrator,
        Settings::Path(PathLimits { max_depth: Some(5), rr_depth: 5, hide_emitters: true }.into())
    );
    assert_eq!(loaded.samples_per_pixel, Some(16));
    let sensor = &loaded.description.sensors[0];
    let Projection::Perspective { fov_axis, .. } = sensor.projection else { panic!() };
    assert_eq!((sensor.near_clip, fov_axis), (1.0, FovAxis::Smaller));
    let Material::Dielectric(Dielectric { interface, .. }) = loaded.description.materials[0] else {
        panic!()
    };
    assert_eq!((interface.int_ior, interface.ext_ior), (1.333, 1.0));
    assert_eq!(
        loaded.description.materials[1],
        Material::Diffuse(Diffuse { reflectance: Rgb::splat(0.1).into() })
    );
}

#[test]
fn a_mesh_alone_is_framed() {
    let files = Files::new(&[("tri.obj", TRIANGLE)]);
    let loaded = load(&files.path().join("tri.obj"), &LoadOptions::default()).unwrap();
    let scene = &loaded.description;
    assert_eq!(scene.emitters, [Emitter::Constant { radiance: Rgb::WHITE }]);
    assert_eq!(
        scene.materials[scene.shapes[0].material.index()],
        Material::TwoSided(TwoSided { sides: [buffon::ids::MaterialId(0); 2] })
    );
    assert_eq!(loaded.notes.len(), 1);
    let sensor = &scene.sensors[0];
    let Shape::Mesh(mesh) = &scene.shapes[0].shape else { panic!() };
    let Projection::Perspective { fov, .. } = sensor.projection else { panic!() };
    let (half, to_world) = ((0.5 * fov).tan(), sensor.to_world.at(0.0));
    for p in &mesh.positions {
        let seen = to_world.inverse().transform_point3(p.as_dvec3());
        assert!(seen.z > sensor.near_clip && seen.z < sensor.far_clip, "{seen}");
        assert!(seen.x.abs() < half * seen.z && seen.y.abs() < half * seen.z, "{seen}");
    }
    assert!(to_world.translation.y > 0.5 && to_world.translation.z > 0.5);
}

/// Without a sensor, the camera sees the whole of every shape. A sphere at the origin is in the middle of the picture.
#[test]
fn a_scene_without_a_sensor_gets_one_that_sees_it() {
    for (shapes, center) in [
        ("<shape type='sphere'><float name='radius' value='2'/></shape>", DVec3::ZERO),
        (
            "<shape type='cylinder'><transform name='to_world'><translate x='5'/></transform></shape>",
            DVec3::new(5.0, 0.0, 0.5),
        ),
        (
            "<shape type='shapegroup' id='g'><shape type='cube'/></shape><shape type='instance'><ref id='g'/>
             <transform name='to_world'><translate y='-7'/></transform></shape>",
            DVec3::NEG_Y * 7.0,
        ),
    ] {
        let files = Files::new(&[("scene.xml", &scene(shapes))]);
        let loaded = files.load(&LoadOptions::default()).expect("it loads");
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
        let note =
            "the scene has no sensor: everything is seen from the front and above (y is up, z to the viewer)";
        assert!(loaded.notes.iter().any(|n| n == note), "{:?}", loaded.notes);
        let camera = loaded.description.sensors[0].to_world.at(0.0);
        let direction = (center - camera.translation).normalize();
        assert!((direction - camera.matrix3.z_axis.normalize()).length() < 1e-6, "{camera:?}");
    }
}
