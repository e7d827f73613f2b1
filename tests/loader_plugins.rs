//! The loaded description of each family of plugins.

use crate::loader::{Files, loaded, scene};
use buffon::bsdf::empirical::WardVariant;
use buffon::color::Rgb;
use buffon::emitter::Emitter;
use buffon::film::{ComponentFormat, Filter, PixelFormat, PixelRect};
use buffon::integrator::Settings;
use buffon::integrator::settings::{
    AoSettings, Aov, AovSettings, DepthSettings, DirectSettings, Layer, PathLimits,
};
use buffon::loader::LoadOptions;
use buffon::material::{Conductor, Distribution, Material, Metal, RoughConductor};
use buffon::math::{Vec2, Vec3};
use buffon::sampling::SamplerKind;
use buffon::sensor::{FovAxis, Projection};
use buffon::shape::Shape;
use buffon::texture::{Texture, TexturePoint};

#[test]
fn every_value_of_film_and_sensor_is_read() {
    let loaded = {
        let text = scene(
            "<sensor type='perspective' id='cam'>
                <string name='focal_length' value='50mm'/>
                <float name='far_clip' value='1e3'/><float name='principal_point_offset_y' value='-0.1'/>
                <film type='hdrfilm'>
                    <integer name='width' value='640'/><integer name='height' value='480'/>
                    <integer name='crop_offset_x' value='10'/><integer name='crop_width' value='20'/>
                    <string name='pixel_format' value='RGBA'/><string name='component_format' value='float32'/>
                    <rfilter type='gaussian'><float name='stddev' value='0.7'/></rfilter>
                    <boolean name='sample_border' value='true'/>
                </film>
                <sampler type='multijitter'><integer name='seed' value='1'/></sampler>
            </sensor>",
        );
        Files::new(&[("scene.xml", &text)]).load(&LoadOptions::default()).unwrap()
    };
    let sensor = &loaded.description.sensors[0];
    assert_eq!(sensor.name, "cam");
    // Mitsuba's horizontal field of view is 38.1848 degrees for an image of 4:3 with this diagonal field of view.
    let Projection::Perspective { fov, fov_axis, principal_point_offset } = sensor.projection else {
        panic!()
    };
    let x = 2.0 * ((0.5 * fov).tan() * 0.8).atan();
    assert!((x.to_degrees() - 38.1848).abs() < 1e-4 && fov_axis == FovAxis::Diagonal);
    assert_eq!((sensor.near_clip, sensor.far_clip), (f64::from(0.01f32), 1e3));
    assert_eq!(principal_point_offset, [0.0, -0.1]);
    assert_eq!(sensor.film.crop, Some(PixelRect { x: 10, y: 0, width: 20, height: 480 }));
    assert_eq!(
        (sensor.film.pixel_format, sensor.film.component_format),
        (PixelFormat::Rgba, ComponentFormat::Float)
    );
    assert_eq!(sensor.film.filter, Filter::Gaussian { stddev: 0.7 });
    assert_eq!((loaded.sampler, loaded.samples_per_pixel), (Some(SamplerKind::Multijitter), None));
    assert_eq!(
        loaded.notes,
        [
            "the scene names no integrator: path is used",
            "<film type=\"hdrfilm\">: sample_border is ignored: a sample belongs to one pixel, so borders need none",
            "<sampler type=\"multijitter\">: seed is ignored: the command line's --seed decides",
        ]
    );
}

#[test]
fn every_integrator_is_read() {
    let integrator = |inside: &str| loaded(&format!("<integrator {inside}</integrator>")).integrator;
    assert_eq!(integrator("type='depth'>"), Settings::Depth(DepthSettings));
    assert_eq!(integrator("type='ao'>"), Settings::Ao(AoSettings { radius: f32::INFINITY }));
    for name in ["radius", "ray_length"] {
        let inside = format!("type='ao'><float name='{name}' value='2.5'/>");
        assert_eq!(integrator(&inside), Settings::Ao(AoSettings { radius: 2.5 }));
    }
    let direct = DirectSettings { emitter_samples: 4, bsdf_samples: 4, hide_emitters: false };
    assert_eq!(
        integrator("type='direct'><integer name='shading_samples' value='4'/>"),
        Settings::Direct(direct)
    );
    let direct = DirectSettings { emitter_samples: 3, bsdf_samples: 1, hide_emitters: true };
    let text = "type='direct'><integer name='emitter_samples' value='3'/><boolean name='hide_emitters' value='true'/>";
    assert_eq!(integrator(text), Settings::Direct(direct));
    let text = "type='aov'><string name='aovs' value='dd.y:depth,nn:sh_normal'/><integrator type='path' name='image'/>";
    let layer = |name: &str, aov| Layer { name: name.to_owned(), aov };
    let layers = vec![layer("dd.y", Aov::Depth), layer("nn", Aov::ShadingNormal)];
    assert_eq!(
        integrator(text),
        Settings::Aov(AovSettings { layers, image: Some(Box::new(Settings::default())) })
    );
}

#[test]
fn emitters_spheres_and_conductors_are_read() {
    let loaded = loaded(
        "<emitter type='point'><point name='position' value='1, 2, 3'/><float name='intensity' value='5'/></emitter>
         <emitter type='point'><transform name='to_world'><translate y='2'/></transform></emitter>
         <emitter type='constant'><spectrum name='radiance' value='1'/></emitter>
         <shape type='sphere'><point name='center' x='1' y='0' z='0'/><boolean name='flip_normals' value='true'/>
            <bsdf type='conductor'><string name='material' value='Au'/></bsdf></shape>
         <shape type='disk'><bsdf type='roughconductor'><float name='alpha_u' value='.1'/><float name='alpha_v' value='.2'/>
            <string name='distribution' value='ggx'/><boolean name='sample_visible' value='false'/></bsdf></shape>",
    );
    let scene = &loaded.description;
    assert_eq!(
        scene.emitters[0],
        Emitter::Point { position: Vec3::new(1.0, 2.0, 3.0), intensity: Rgb::splat(5.0) }
    );
    assert_eq!(
        scene.emitters[1],
        Emitter::Point { position: Vec3::new(0.0, 2.0, 0.0), intensity: Rgb::WHITE }
    );
    let Emitter::Constant { radiance } = scene.emitters[2] else { panic!() };
    assert!((radiance.r - 1.20479).abs() < 1e-4, "{radiance:?}");
    assert_eq!(scene.shapes[0].shape, Shape::Sphere { center: Vec3::X, radius: 1.0 });
    assert!(scene.shapes[0].flip_normals);
    let eta = Rgb::new(0.143036, 0.375307, 1.44205);
    let k = Rgb::new(3.983, 2.38556, 1.60336);
    let metal = Metal { eta: eta.into(), k: k.into(), specular_reflectance: Rgb::WHITE.into() };
    assert_eq!(scene.materials[0], Material::Conductor(Conductor { metal }));
    let Material::RoughConductor(RoughConductor { metal, roughness }) = scene.materials[1] else { panic!() };
    assert_eq!(roughness.alpha, [0.1.into(), 0.2.into()]);
    assert_eq!((roughness.distribution, roughness.sample_visible), (Distribution::Ggx, false));
    assert_eq!(metal.k, Rgb::WHITE.into());
}

/// Integrators of Mitsuba that estimate the same image are rendered by the nearest of Buffon's, with a note.
#[test]
fn integrators_of_the_same_image_are_replaced() {
    let load = |text: &str, replacement: Option<&str>| {
        let integrator = replacement.map(str::to_owned);
        let options = LoadOptions { integrator, ..LoadOptions::default() };
        let text = scene(&format!("<sensor type='perspective'/>{text}"));
        Files::new(&[("scene.xml", &text)]).load(&options)
    };
    let path = Settings::Path(PathLimits { max_depth: Some(7), ..PathLimits::default() }.into());
    let depth = "<integer name='max_depth' value='7'/>";
    for name in ["volpath", "prb", "vpl"] {
        let loaded = load(&format!("<integrator type='{name}'>{depth}</integrator>"), None).unwrap();
        assert_eq!(loaded.integrator, path);
        assert!(loaded.notes.contains(&format!("the integrator {name} is rendered as path")));
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    }
    let chains = load("<integrator type='mlt'/>", None).unwrap().integrator;
    assert_eq!(chains, Settings::Pssmlt(PathLimits::default()));
    let inside =
        format!("<integrator type='stokes'><integrator type='path'>{depth}</integrator></integrator>");
    assert_eq!(load(&inside, None).unwrap().integrator, path);
    // The user's choice replaces an integrator that nobody knows; the limits of its paths are kept.
    let unknown = format!("<integrator type='my_own'>{depth}</integrator>");
    assert!(load(&unknown, None).is_err());
    let loaded = load(&unknown, Some("path")).unwrap();
    assert_eq!(loaded.integrator, path);
    assert!(loaded.notes.contains(&"the integrator of the scene is not used: unknown integrator".to_owned()));
}

/// Integrators for surfaces render a scene with media as if every medium were vacuum, and say so once.
#[test]
fn media_are_vacuum_with_a_note() {
    let medium = "<medium type='homogeneous' name='interior'><float name='albedo' value='0.5'/></medium>";
    let text = format!(
        "<integrator type='path'/><medium type='homogeneous' id='fog'/>
         <shape type='sphere'>{medium}<ref id='fog' name='exterior'/></shape>"
    );
    let loaded = loaded(&text);
    let note = "the scene has media, which are not rendered: every medium is vacuum";
    assert_eq!(loaded.notes.iter().filter(|text| *text == note).count(), 1);
    assert!(loaded.warnings.iter().all(|w| !w.message.contains("medium")), "{:?}", loaded.warnings);
}

/// A colour where a number is expected is the mean of its channels. Before version 2, a spectrum of three values was a
/// colour.
#[test]
fn colours_stand_for_numbers_and_old_spectra_for_colours() {
    let rough = |value: &str| {
        let text = format!("<bsdf type='roughconductor'>{value}</bsdf>");
        let Material::RoughConductor(material) = loaded(&text).description.materials[0].clone() else {
            panic!()
        };
        material.roughness.alpha[0].constant().expect("a number")
    };
    assert_eq!(rough("<rgb name='alpha' value='0.9, 0.3, 0.1'/>"), (0.9 + 0.3 + 0.1) / 3.0);
    assert_eq!(rough("<spectrum name='alpha' value='0.25'/>"), 0.25);
    let text = "<scene version='0.6.0'><bsdf type='diffuse'>
        <spectrum name='reflectance' value='0.1, 0.2, 0.3'/></bsdf></scene>";
    let loaded = Files::new(&[("scene.xml", text)]).load(&LoadOptions::default()).unwrap();
    let Material::Diffuse(diffuse) = &loaded.description.materials[0] else { panic!() };
    assert_eq!(diffuse.reflectance.constant(), Some([0.1, 0.2, 0.3].into()));
}

/// Filters for mipmaps are bilinear; a rotation by 0 degrees needs no axis.
#[test]
fn what_old_exporters_write_is_read() {
    let text = "<shape type='sphere'><transform name='to_world'><rotate angle='0'/></transform>
        <bsdf type='diffuse'><texture type='bitmap' name='reflectance'>
        <string name='filename' value='a.png'/><string name='filter_type' value='trilinear'/></texture></bsdf></shape>";
    let files = Files::new(&[("scene.xml", &scene(text))]);
    let image = crate::support::gltf::png(1, &[[9, 9, 9, 255]]);
    std::fs::write(files.path().join("a.png"), image).unwrap();
    let loaded = files.load(&LoadOptions::default()).unwrap();
    let note = "bitmap: filter_type trilinear is rendered as bilinear: there are no mipmaps";
    assert_eq!(loaded.approximations, [note]);
}

/// Materials of version 0.6, which Mitsuba 3 does not have.
#[test]
fn materials_of_older_versions_are_read() {
    let materials = |text: &str| {
        let text = format!(
            "<scene version='0.6.0'><sensor type='perspective'/><shape type='sphere'>{text}</shape></scene>"
        );
        let files = Files::new(&[("scene.xml", &text)]);
        files.load(&LoadOptions::default()).map(|loaded| loaded.description.materials)
    };
    let one = |text: &str| materials(text).expect("the scene loads").pop().expect("there is a material");
    let Material::Phong(phong) =
        one("<bsdf type='phong'><rgb name='diffuseReflectance' value='.1,.2,.3'/></bsdf>")
    else {
        panic!()
    };
    assert_eq!(phong.exponent, 30.0.into());
    assert_eq!(phong.reflectances.diffuse_reflectance, Rgb::new(0.1, 0.2, 0.3).into());
    assert_eq!(phong.reflectances.specular_reflectance, Rgb::splat(0.2).into());
    let Material::Ward(ward) = one("<bsdf type='ward'><float name='alphaU' value='.3'/></bsdf>") else {
        panic!()
    };
    assert_eq!((ward.alpha, ward.variant), ([0.3.into(), 0.1.into()], WardVariant::Balanced));
    let Material::RoughDiffuse(rough) =
        one("<bsdf type='roughdiffuse'><spectrum name='diffuseReflectance' value='.25'/></bsdf>")
    else {
        panic!()
    };
    assert_eq!((rough.alpha, rough.reflectance), (0.2.into(), Rgb::splat(0.25).into()));
    let Material::DiffuseTransmitter(paper) = one("<bsdf type='difftrans'/>") else { panic!() };
    assert_eq!(paper.transmittance, Rgb::splat(0.5).into());
    let Material::Coating(coating) =
        one("<bsdf type='coating'><float name='thickness' value='2'/><bsdf type='conductor'/></bsdf>")
    else {
        panic!()
    };
    assert_eq!((coating.thickness, coating.sigma_a), (2.0, Rgb::BLACK.into()));
    assert!((coating.interface.eta() - 1.5042).abs() < 1e-3, "{}", coating.interface.eta());
    let Material::RoughCoating(rough) = one("<bsdf type='roughcoating'><bsdf type='conductor'/></bsdf>")
    else {
        panic!()
    };
    assert_eq!(
        (rough.distribution, rough.alpha, rough.coating.thickness),
        (Distribution::Beckmann, 0.1, 1.0)
    );
    for name in ["coating", "roughcoating"] {
        let text = format!("<bsdf type='{name}'><bsdf type='null'/></bsdf>");
        let error = materials(&text).expect_err("it is refused");
        assert!(error.to_string().contains("a material that transmits light cannot be coated"), "{error}");
    }
    let mixture = |weights: &str| {
        let inner = "<bsdf type='diffuse'/><bsdf type='conductor'/><bsdf type='null'/>";
        materials(&format!("<bsdf type='mixturebsdf'>{weights}{inner}</bsdf>"))
    };
    let Some(Material::Mixture(sum)) =
        mixture("<string name='weights' value='1, 2 1'/>").expect("the scene loads").pop()
    else {
        panic!()
    };
    assert_eq!((sum.weights, sum.inner.len()), (vec![0.25, 0.5, 0.25], 3));
    for (weights, message) in [
        ("<string name='weights' value='1, -2, 3'/>", "expected numbers that are not negative"),
        ("<string name='weights' value='1, two, 3'/>", "expected numbers that are not negative"),
        ("<string name='weights' value='.5 .5'/>", "expected 2 bsdfs inside it, found 3"),
        ("", "the property weights is missing"),
    ] {
        let error = mixture(weights).expect_err("it is refused").to_string();
        assert!(error.contains(message), "{error}");
    }
}

/// Light is not polarised: filters of polarisation are sheets that pass half of it, or all.
#[test]
fn filters_of_polarisation_dim_light() {
    let filter = |text: &str| {
        let text = format!(
            "<scene version='3.0.0'><sensor type='perspective'/><shape type='rectangle'>{text}</shape></scene>"
        );
        let loaded = Files::new(&[("scene.xml", &text)]).load(&LoadOptions::default()).expect("it loads");
        let mut description = loaded.description;
        let Some(Material::ThinDielectric(sheet)) = description.materials.pop() else { panic!() };
        assert_eq!(sheet.interface.int_ior, sheet.interface.ext_ior);
        (sheet.specular_transmittance, description.textures, loaded.approximations)
    };
    let tint = "<rgb name='transmittance' value='.8, .4, .2'/>";
    for (text, expected) in [
        ("<bsdf type='polarizer'><float name='theta' value='30'/></bsdf>".to_owned(), Rgb::splat(0.5)),
        (format!("<bsdf type='circular'>{tint}</bsdf>"), Rgb::new(0.4, 0.2, 0.1)),
        (format!("<bsdf type='retarder'>{tint}</bsdf>"), Rgb::new(0.8, 0.4, 0.2)),
    ] {
        let (transmittance, _, notes) = filter(&text);
        assert_eq!(transmittance, expected.into());
        assert!(notes.iter().any(|note| note.contains("light is not polarised")), "{notes:?}");
    }
    let board = "<texture type='checkerboard' name='transmittance'/>";
    let (transmittance, textures, _) = filter(&format!("<bsdf type='polarizer'>{board}</bsdf>"));
    let texture = transmittance.texture().expect("there is a texture");
    assert_eq!(textures[texture.index()].mean(), Rgb::splat(0.15));
}

/// A texture may be a constant volume or a raw constant. Volumes of which the values differ are refused.
#[test]
fn textures_may_be_constant_volumes() {
    let reflectance = |texture: &str| -> Result<Rgb, String> {
        let text = format!(
            "<scene version='3.0.0'><sensor type='perspective'/><shape type='sphere'><bsdf type='diffuse'>{texture}
            </bsdf></shape></scene>"
        );
        let loaded = Files::new(&[("scene.xml", &text)]).load(&LoadOptions::default());
        let description = loaded.map_err(|e| e.to_string())?.description;
        let Material::Diffuse(diffuse) = &description.materials[0] else { panic!() };
        Ok(match diffuse.reflectance.texture() {
            Some(texture) => description.textures[texture.index()].mean(),
            None => diffuse.reflectance.constant().expect("a colour"),
        })
    };
    let volume =
        |inside: &str| reflectance(&format!("<texture type='volume' name='reflectance'>{inside}</texture>"));
    let value = "<rgb name='value' value='.1, .2, .3'/>";
    let constant = volume(&format!("<volume type='constvolume' name='volume'>{value}</volume>"));
    assert_eq!(constant, Ok(Rgb::new(0.1, 0.2, 0.3)));
    let raw = reflectance(&format!("<texture type='rawconstant' name='reflectance'>{value}</texture>"));
    assert_eq!(raw, constant);
    for (inside, message) in [
        ("<volume type='gridvolume' name='volume'/>", "expected a constvolume"),
        ("<volume type='constvolume' name='volume'/>", "the property value is missing"),
        ("", "expected a volume inside it"),
    ] {
        let error = volume(inside).expect_err("it is refused");
        assert!(error.contains(message), "{error}");
    }
}

/// Textures of version 0.6: `scale`, and coordinates with an offset and then a scale, as Mitsuba 3 reads them.
#[test]
fn textures_of_older_versions_are_read() {
    let text = "<scene version='0.6.0'><sensor type='perspective'/><shape type='sphere'><bsdf type='diffuse'>
        <texture type='scale' name='reflectance'><rgb name='scale' value='.5,1,2'/>
            <texture type='checkerboard'>
                <float name='uscale' value='3'/><float name='vscale' value='2'/><float name='uoffset' value='.25'/>
                <rgb name='color0' value='.4,.4,.4'/><rgb name='color1' value='.1,.1,.1'/>
            </texture>
        </texture></bsdf></shape></scene>";
    let loaded = Files::new(&[("scene.xml", text)]).load(&LoadOptions::default()).expect("the scene loads");
    let Material::Diffuse(diffuse) = &loaded.description.materials[0] else { panic!() };
    let id = diffuse.reflectance.texture().expect("a texture");
    let color = |u, v| loaded.description.textures[id.index()].eval(&TexturePoint::at(Vec2::new(u, v)));
    // Mitsuba's matrix is (3, 0, 0.75; 0, 2, 0), so the first square of colour 1 begins at u = -1/12.
    for (u, expected) in [(-0.09, 0.4), (-0.08, 0.1), (0.08, 0.1), (0.09, 0.4)] {
        let found = color(u, 0.1);
        assert!((found - Rgb::new(0.5, 1.0, 2.0) * expected).max_component().abs() < 1e-6, "{u}: {found:?}");
    }
    assert_eq!(color(0.0, 0.2), color(0.0, 0.1));
    assert_ne!(color(0.0, 0.3), color(0.0, 0.1));
}

/// A colour is projected as an even square, as in Mitsuba.
#[test]
fn a_projector_takes_a_colour() {
    let text = scene("<emitter type='projector'><rgb name='irradiance' value='3, 2, 1'/></emitter>");
    let loaded = Files::new(&[("scene.xml", &text)]).load(&LoadOptions::default()).unwrap();
    let Emitter::Projector { irradiance, half_extents, .. } = &loaded.description.emitters[0] else {
        panic!()
    };
    let texture = &loaded.description.textures[irradiance.index()];
    assert_eq!(texture.eval(&TexturePoint::at(Vec2::splat(0.3))), Rgb::new(3.0, 2.0, 1.0));
    assert_eq!(half_extents[0], half_extents[1]);
}

/// Textures of version 0.6: lines on a background, and the colours of the vertices.
#[test]
fn patterns_and_colours_of_older_versions_are_read() {
    let textures = |texture: &str| {
        let text = format!(
            "<scene version='0.6.0'><sensor type='perspective'/><bsdf type='diffuse'>{texture}</bsdf></scene>"
        );
        let loaded = Files::new(&[("scene.xml", &text)]).load(&LoadOptions::default()).expect("it loads");
        loaded.description.textures
    };
    let grid = "<texture type='gridtexture' name='reflectance'><float name='lineWidth' value='0.1'/>
        <float name='uscale' value='2'/><rgb name='color0' value='.1,.2,.3'/></texture>";
    let textures_of_grid = textures(grid);
    let at = |u, v| textures_of_grid[0].eval(&TexturePoint::at(Vec2::new(u, v)));
    assert_eq!((at(0.25, 0.5), at(0.54, 0.5)), (Rgb::new(0.1, 0.2, 0.3), Rgb::splat(0.4)));
    let Texture::MeshAttribute(colors) = &*textures("<texture type='vertexcolors' name='reflectance'/>")[0]
    else {
        panic!()
    };
    assert_eq!((colors.name.as_str(), colors.scale), ("vertex_color", 1.0));
}

/// Colours of old scenes, data of measured conductors, and values at the ends of their ranges.
#[test]
fn forms_that_exporters_write_are_read() {
    let read = |version: &str, text: &str| {
        let text = format!(
            "<!DOCTYPE scene>\n<scene version='{version}'>
             <sensor type='thinlens'><float name='aperture_radius' value='0.1'/></sensor>
             <emitter type='area' id='lamp'/><shape type='sphere'><bsdf type='twosided'>{text}</bsdf></shape>
             <shape type='rectangle'><ref id='lamp'/></shape></scene>"
        );
        let loaded = Files::new(&[("scene.xml", &text)]).load(&LoadOptions::default());
        let loaded = loaded.unwrap_or_else(|e| panic!("{text}: {e}"));
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
        (loaded.description.materials[0].clone(), loaded.approximations)
    };
    let diffuse = |version: &str, text: &str| {
        let (Material::Diffuse(diffuse), _) = read(version, &format!("<bsdf type='diffuse'>{text}</bsdf>"))
        else {
            panic!("{text}")
        };
        diffuse.reflectance
    };
    let half = diffuse("0.6.0", "<srgb name='reflectance' value='#808080'/>").constant().expect("a colour");
    let decimal = diffuse("0.6.0", "<srgb name='reflectance' value='0.50196, 0.50196, 0.50196'/>");
    assert!(
        (half.r - 0.215_86).abs() < 1e-4 && (decimal.constant().expect("a colour").g - half.g).abs() < 1e-4
    );
    let raw =
        "<texture type='rawconstant' name='reflectance'><vector name='value' value='.3,.1,.2'/></texture>";
    assert_eq!(diffuse("3.0.0", raw), Rgb::new(0.3, 0.1, 0.2).into());
    let metal = |version: &str, text: &str| {
        let (Material::Conductor(conductor), _) =
            read(version, &format!("<bsdf type='conductor'>{text}</bsdf>"))
        else {
            panic!("{text}")
        };
        conductor.metal.eta.constant().expect("an index")
    };
    assert_eq!(metal("3.0.0", "<rgb name='eta' value='.3, -.0485, .4'/>"), Rgb::new(0.3, -0.0485, 0.4));
    let measured = metal("3.0.0", "<spectrum name='eta' value='400:.3, 500:-.0485, 600:.4, 700:1.2'/>");
    assert!(measured.is_valid(), "{measured:?}");
    // The default of Mitsuba 0.6 is copper, and its indices are relative to the outside.
    let copper = metal("0.6.0", "");
    assert!(copper.r < copper.g && metal("3.0.0", "") == Rgb::BLACK, "{copper:?}");
    let wet = metal("0.6.0", "<string name='material' value='Cu'/><float name='extEta' value='2'/>");
    assert!((wet * 2.0 - copper).map(f32::abs).max_component() < 1e-6, "{wet:?}");
    for (text, approximated) in [
        ("<bsdf type='roughconductor'><float name='alpha' value='0'/></bsdf>", false),
        ("<bsdf type='roughconductor'><string name='distribution' value='phong'/></bsdf>", true),
        ("<bsdf type='roughplastic'><float name='alpha' value='0'/></bsdf>", false),
        ("<bsdf type='roughplastic'><texture name='alpha' type='checkerboard'/></bsdf>", true),
        ("<bsdf type='coating'><float name='thickness' value='0'/><bsdf type='diffuse'/></bsdf>", false),
        ("<bsdf type='normalmap'><texture type='checkerboard'/><bsdf type='diffuse'/></bsdf>", false),
        (
            "<bsdf type='normalmap'><rgb name='normalmap' value='.5,.5,1'/><bsdf type='diffuse'/></bsdf>",
            false,
        ),
        ("<bsdf type='phong'><float name='specularSamplingWeight' value='1'/></bsdf>", false),
    ] {
        let (_, approximations) = read("0.6.0", text);
        assert_eq!(!approximations.is_empty(), approximated, "{text}: {approximations:?}");
    }
}

/// What changes the noise alone is a note, and what changes the image is an approximation.
#[test]
fn options_of_older_integrators_and_emitters_are_noted() {
    let text = "<scene version='0.6.0'><integrator type='path'><boolean name='strictNormals' value='true'/></integrator>
        <sensor type='perspective'/><emitter type='point'><float name='samplingWeight' value='2'/></emitter></scene>";
    let loaded = Files::new(&[("scene.xml", text)]).load(&LoadOptions::default()).expect("it loads");
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    assert!(
        loaded.notes.iter().any(|note| note.contains("sampling_weight is ignored")),
        "{:?}",
        loaded.notes
    );
    let [strict] = &loaded.approximations[..] else { panic!("{:?}", loaded.approximations) };
    assert!(strict.starts_with("strict_normals is ignored"), "{strict}");
}

#[test]
fn black_bodies_of_older_versions_emit_as_the_spectrum_does() {
    let radiance = |text: &str| {
        let text = format!("<shape type='sphere'><emitter type='area'>{text}</emitter></shape>");
        loaded(&text).description.shapes[0].emission.expect("it emits").constant().expect("a colour")
    };
    let element = radiance("<blackbody name='radiance' temperature='5000K' scale='2'/>");
    let spectrum = radiance(
        "<spectrum type='blackbody' name='radiance'><float name='temperature' value='5000'/></spectrum>",
    );
    assert!(
        (element - spectrum * 2.0).map(f32::abs).max_component() < 1e-3 * element.r,
        "{element:?} {spectrum:?}"
    );
    let tinted = "<spectrum type='d65' name='radiance'><float name='scale' value='2'/>
        <rgb name='color' value='.5,.2,.1'/></spectrum>";
    assert_eq!(radiance(tinted), Rgb::new(1.0, 0.4, 0.2));
}

/// What the user replaces or does not use may be unknown.
#[test]
fn the_command_line_decides_before_plugins_are_read() {
    let text = scene(
        "<sensor type='telescope'/><sensor type='perspective'><sampler type='dice'/></sensor><shape type='sphere'/>",
    );
    let files = Files::new(&[("scene.xml", &text)]);
    let load = |sensor, replaces_sampler| {
        files.load(&LoadOptions { sensor, replaces_sampler, ..LoadOptions::default() })
    };
    let loaded = load(Some(1), true).expect("it loads");
    assert_eq!(loaded.description.sensors.len(), 2);
    for note in
        ["sensor 0 is not used: unknown sensor", "the sampler of the scene is not used: unknown sampler"]
    {
        assert!(loaded.notes.iter().any(|text| text == note), "{:?}", loaded.notes);
    }
    for (sensor, replaces_sampler) in [(Some(1), false), (Some(0), true), (None, true)] {
        assert!(load(sensor, replaces_sampler).is_err());
    }
}
