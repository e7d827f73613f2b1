//! Random scenes.

use crate::node::Node;
use buffon::sampling::hash::{combine, mix};

/// A random generator. A seed gives the same numbers on every machine.
pub struct Random {
    state: u32,
    /// Whether no material has a Dirac delta, so that light paths find all light.
    smooth: bool,
}

impl Random {
    pub fn new(seed: u64, scene: u64) -> Self {
        let state = combine(combine(seed as u32, (seed >> 32) as u32), scene as u32);
        Random { state, smooth: mix(!state) % 5 < 2 }
    }

    fn next(&mut self) -> u32 {
        self.state = self.state.wrapping_add(0x9e37_79b9);
        mix(self.state)
    }

    fn below(&mut self, n: usize) -> usize {
        ((u64::from(self.next()) * n as u64) >> 32) as usize
    }

    fn chance(&mut self, percent: usize) -> bool {
        self.below(100) < percent
    }

    /// Returns a number with three decimals.
    fn between(&mut self, low: f64, high: f64) -> f64 {
        let u = f64::from(self.next()) / 2f64.powi(32);
        ((low + (high - low) * u) * 1000.0).round() / 1000.0
    }

    fn pick<T: Copy>(&mut self, all: &[T]) -> T {
        all[self.below(all.len())]
    }

    fn rgb(&mut self, low: f64, high: f64) -> String {
        format!("{},{},{}", self.between(low, high), self.between(low, high), self.between(low, high))
    }
}

/// The mesh with smooth normals that scenes refer to.
pub const MESH: &str = "v 1 0 0\nv -1 0 0\nv 0 1 0\nv 0 -1 0\nv 0 0 1\nv 0 0 -1\n\
    vt 0 0\nvt 1 0\nvt 0 1\nvt 1 1\nvt 0.5 0.3\nvt 0.3 0.6\n\
    vn 1 0 0\nvn -1 0 0\nvn 0 1 0\nvn 0 -1 0\nvn 0 0 1\nvn 0 0 -1\n\
    f 1/1/1 3/3/3 5/5/5\nf 3/3/3 2/2/2 5/5/5\nf 2/2/2 4/4/4 5/5/5\nf 4/4/4 1/1/1 5/5/5\n\
    f 3/3/3 1/1/1 6/6/6\nf 2/2/2 3/3/3 6/6/6\nf 4/4/4 2/2/2 6/6/6\nf 1/1/1 4/4/4 6/6/6\n";

/// Returns a scene without its integrator.
pub fn scene(random: &mut Random) -> Node {
    let moves = random.chance(10);
    let mut scene = Node::new("scene").with("version", "3.0.0").add(sensor(random, moves));
    let floor = Node::plugin("shape", "rectangle")
        .add(Node::new("transform").named("to_world").add(rotate("x", -90.0)).add(scale("4")));
    let reflects = if random.chance(60) {
        Node::plugin("bsdf", "diffuse").add(color(random, "reflectance", 0.2, 0.9))
    } else {
        bsdf(random, 2, false)
    };
    scene = scene.add(floor.add(reflects));
    for _ in 0..1 + random.below(4) {
        scene = scene.add(shape(random, moves));
    }
    if random.chance(25) {
        let group = Node::plugin("shape", "shapegroup").with("id", "group");
        let group = (0..1 + random.below(2)).fold(group, |group, _| {
            let body = body(random);
            // Every member has its own transformation, because coincident surfaces are hit in an arbitrary order.
            let even = is_even(&body);
            group.add(body.add(transform(random, even).named("to_world")))
        });
        scene = scene.add(group);
        for _ in 0..1 + random.below(2) {
            let reference = Node::new("ref").with("id", "group");
            scene = scene.add(Node::plugin("shape", "instance").add(reference).add(place(random, moves)));
        }
    }
    let lamps = random.below(3);
    for _ in 0..lamps {
        let lamp = light(random);
        let is_sky = |node: &Node| matches!(node.attribute("type"), Some("constant" | "envmap"));
        if !(is_sky(&lamp) && scene.children.iter().any(is_sky)) {
            scene = scene.add(lamp);
        }
    }
    if lamps == 0 || random.chance(70) {
        scene = scene.add(lamp(random));
    }
    scene
}

fn sensor(random: &mut Random, moves: bool) -> Node {
    let kind = random.pick(&["perspective", "perspective", "thinlens", "orthographic"]);
    let eye = format!("{},{},5", random.between(-1.0, 1.0), random.between(0.8, 2.5));
    let look = Node::new("lookat").with("origin", eye).with("target", "0,0.7,0").with("up", "0,1,0");
    let mut to_world = Node::new("transform").named("to_world");
    if kind == "orthographic" {
        to_world = to_world.add(scale("2"));
    }
    let filter = random.pick(&["box", "box", "tent", "gaussian", "mitchell"]);
    let size = 8 + 4 * random.below(2);
    let mut film = Node::plugin("film", "hdrfilm")
        .add(Node::value("integer", "width", size))
        .add(Node::value("integer", "height", size))
        .add(Node::value("string", "pixel_format", "rgb"))
        .add(Node::value("string", "component_format", "float32"))
        .add(Node::plugin("rfilter", filter));
    if random.chance(15) {
        for (name, value) in
            [("crop_offset_x", 2), ("crop_offset_y", 1), ("crop_width", size - 4), ("crop_height", size - 2)]
        {
            film = film.add(Node::value("integer", name, value));
        }
    }
    Node::plugin("sensor", kind)
        .add_if(kind != "orthographic", || Node::value("float", "fov", random.between(30.0, 60.0)))
        .add_if(kind == "thinlens", || Node::value("float", "aperture_radius", 0.1))
        .add_if(kind == "thinlens", || Node::value("float", "focus_distance", 4.5))
        .add_if(moves, || Node::value("float", "shutter_open", 0))
        .add_if(moves, || Node::value("float", "shutter_close", 1))
        .add(to_world.add(look))
        .add(film)
}

fn rotate(axis: &'static str, angle: f64) -> Node {
    Node::new("rotate").with(axis, "1").with("angle", angle.to_string())
}

fn scale(value: &str) -> Node {
    Node::new("scale").with("value", value)
}

/// Returns a random rotation, translation and scale, different for each axis unless `even`, and sometimes a reflection.
fn transform(random: &mut Random, even: bool) -> Node {
    let sign = if random.chance(20) { -1.0 } else { 1.0 };
    let size = random.between(0.3, 0.9);
    let (x, y, z) = match even {
        true => (sign * size, size, size),
        false => (sign * size, random.between(0.3, 0.9), random.between(0.3, 0.9)),
    };
    let axis = random.pick(&["x", "y", "z"]);
    let at = [random.between(-1.5, 1.5), random.between(0.3, 1.6), random.between(-1.5, 1.5)];
    Node::new("transform")
        .add(Node::new("scale").with("value", format!("{x},{y},{z}")))
        .add(rotate(axis, random.between(-180.0, 180.0)))
        .add(Node::new("translate").with("value", format!("{},{},{}", at[0], at[1], at[2])))
}

fn place(random: &mut Random, moves: bool) -> Node {
    let place = transform(random, false);
    if !(moves && random.chance(60)) {
        return place.named("to_world");
    }
    let mut end = place.clone();
    let step = format!("{},{},0", random.between(-0.5, 0.5), random.between(-0.2, 0.5));
    end = end.add(Node::new("translate").with("value", step));
    Node::new("animation").named("to_world").add(place.with("time", "0")).add(end.with("time", "1"))
}

/// Returns a shape without its transformation.
fn body(random: &mut Random) -> Node {
    let kind = random.pick(&["rectangle", "sphere", "disk", "cube", "cylinder", "obj"]);
    let mut shape = Node::plugin("shape", kind);
    match kind {
        "obj" => {
            shape = shape.add(Node::value("string", "filename", "octahedron.obj"));
            shape = shape.add_if(random.chance(30), || Node::value("boolean", "face_normals", "true"));
        }
        "sphere" => shape = shape.add(Node::value("float", "radius", random.between(0.3, 0.8))),
        _ => {}
    }
    shape = shape.add_if(random.chance(15), || Node::value("boolean", "flip_normals", "true"));
    let depth = random.below(4);
    shape.add(bsdf(random, depth, false))
}

fn is_even(shape: &Node) -> bool {
    matches!(shape.attribute("type"), Some("sphere" | "cylinder"))
}

fn shape(random: &mut Random, moves: bool) -> Node {
    let mut shape = body(random);
    let place = match is_even(&shape) {
        true => transform(random, true).named("to_world"),
        false => place(random, moves),
    };
    shape = shape.add(place);
    if random.chance(15) {
        shape = shape.add(Node::plugin("emitter", "area").add(color(random, "radiance", 0.0, 2.0)));
    }
    shape
}

/// Returns an area emitter above the scene.
fn lamp(random: &mut Random) -> Node {
    let kind = random.pick(&["rectangle", "disk", "obj", "sphere", "cube"]);
    let (turned, size) = (random.between(60.0, 120.0), random.between(0.4, 0.9));
    let at =
        format!("{},{},{}", random.between(-1.0, 1.0), random.between(2.6, 3.4), random.between(0.0, 2.0));
    Node::plugin("shape", kind)
        .add_if(kind == "obj", || Node::value("string", "filename", "octahedron.obj"))
        .add(
            Node::new("transform")
                .named("to_world")
                .add(scale(&size.to_string()))
                .add(rotate("x", turned))
                .add(Node::new("translate").with("value", at)),
        )
        .add(Node::plugin("emitter", "area").add(color(random, "radiance", 1.0, 6.0)))
        .add_if(random.chance(20), || {
            let depth = random.below(3);
            bsdf(random, depth, false)
        })
}

/// Returns an emitter without a shape.
fn light(random: &mut Random) -> Node {
    let at =
        format!("{},{},{}", random.between(-2.0, 2.0), random.between(2.0, 3.0), random.between(0.0, 3.0));
    let rgb = |random: &mut Random, name: &str, high: f64| Node::value("rgb", name, random.rgb(0.2, high));
    match random.below(5) {
        0 => Node::plugin("emitter", "point").add(Node::value("point", "position", at)).add(rgb(
            random,
            "intensity",
            8.0,
        )),
        1 => {
            Node::plugin("emitter", "spot")
                .add(Node::new("transform").named("to_world").add(
                    Node::new("lookat").with("origin", at).with("target", "0,0.5,0").with("up", "0,1,0.1"),
                ))
                .add(Node::value("float", "cutoff_angle", random.between(10.0, 60.0)))
                .add(rgb(random, "intensity", 20.0))
        }
        2 => Node::plugin("emitter", "directional")
            .add(Node::value("vector", "direction", "0.3,-1,-0.2"))
            .add(rgb(random, "irradiance", 3.0)),
        3 => Node::plugin("emitter", "constant").add(rgb(random, "radiance", 0.8)),
        _ => Node::plugin("emitter", "envmap")
            .add(Node::value("string", "filename", "sky.png"))
            .add(Node::value("float", "scale", random.between(0.2, 1.5)))
            .add_if(random.chance(50), || {
                Node::new("transform").named("to_world").add(rotate("y", random.between(0.0, 360.0)))
            }),
    }
}

/// Returns a colour: a constant or a texture.
fn color(random: &mut Random, name: &str, low: f64, high: f64) -> Node {
    let scaled = |random: &mut Random, node: Node| {
        node.add(
            Node::new("transform")
                .named("to_uv")
                .add(Node::new("scale").with("x", random.between(1.0, 6.0).to_string()).with("y", "3")),
        )
    };
    match random.below(4) {
        0 => {
            let texture = Node::plugin("texture", "checkerboard")
                .named(name)
                .add(Node::value("rgb", "color0", random.rgb(low, high)))
                .add(Node::value("rgb", "color1", random.rgb(low, high)));
            scaled(random, texture)
        }
        1 if high <= 1.0 => {
            let texture = Node::plugin("texture", "bitmap")
                .named(name)
                .add(Node::value("string", "filename", "sky.png"));
            scaled(random, texture)
        }
        _ => Node::value("rgb", name, random.rgb(low, high)),
    }
}

/// Returns a number in [0, 1], or a texture.
fn share(random: &mut Random, name: &str) -> Node {
    if random.chance(30) {
        Node::plugin("texture", "checkerboard")
            .named(name)
            .add(Node::value("float", "color0", random.between(0.0, 1.0)))
            .add(Node::value("float", "color1", random.between(0.0, 1.0)))
    } else {
        Node::value("float", name, random.pick(&[0.0, 0.1, 0.5, 0.9, 1.0]))
    }
}

fn ior(random: &mut Random, node: Node) -> Node {
    if !random.smooth && random.chance(15) {
        node.add(Node::value("float", "int_ior", 1.3)).add(Node::value("float", "ext_ior", 1.3))
    } else {
        node.add(Node::value("float", "int_ior", random.pick(&[1.2, 1.5, 2.0])))
    }
}

/// Returns a material inside at most `depth` others. An `opaque` one transmits no light, as a two-sided one requires.
fn bsdf(random: &mut Random, depth: usize, opaque: bool) -> Node {
    if depth == 0 {
        return leaf(random, opaque);
    }
    let kind = random.below(7);
    match if opaque && kind < 3 { 3 } else { kind } {
        0 | 1 => {
            let both = random.chance(40);
            let twosided = Node::plugin("bsdf", "twosided").add(bsdf(random, depth - 1, true));
            twosided.add_if(both, || bsdf(random, depth - 1, true))
        }
        2 => Node::plugin("bsdf", "mask").add(share(random, "opacity")).add(bsdf(random, depth - 1, opaque)),
        3 => Node::plugin("bsdf", "blendbsdf")
            .add(share(random, "weight"))
            .add(bsdf(random, depth - 1, opaque))
            .add(bsdf(random, depth - 1, opaque)),
        // The reflection by a coating is a Dirac delta.
        6 if !random.smooth => Node::plugin("bsdf", "coating")
            .add(Node::value("float", "thickness", random.between(0.1, 1.0)))
            .add(color(random, "sigma_a", 0.0, 1.0))
            .add(bsdf(random, depth - 1, true)),
        4 => {
            let heights = Node::plugin("texture", "bitmap")
                .named("bump")
                .add(Node::value("string", "filename", "sky.png"))
                .add(Node::value("boolean", "raw", "true"));
            Node::plugin("bsdf", "bumpmap")
                .add(heights)
                .add(Node::value("float", "scale", random.between(0.05, 0.4)))
                .add(bsdf(random, depth - 1, opaque))
        }
        _ => {
            let normals = Node::plugin("texture", "checkerboard")
                .named("normalmap")
                .add(Node::value("rgb", "color0", random.rgb(0.3, 0.7).replace(',', " ")))
                .add(Node::value(
                    "rgb",
                    "color1",
                    format!("{} 0.5 {}", random.between(0.1, 0.9), random.between(0.7, 1.0)),
                ));
            Node::plugin("bsdf", "normalmap")
                .add(normals)
                .add_if(random.chance(30), || Node::value("boolean", "flip_invalid_normals", "false"))
                .add(bsdf(random, depth - 1, opaque))
        }
    }
}

fn leaf(random: &mut Random, opaque: bool) -> Node {
    let opaque_ones = [
        "diffuse",
        "diffuse",
        "diffuse",
        "roughconductor",
        "roughplastic",
        "principled",
        "phong",
        "ward",
        "roughdiffuse",
    ];
    let smooth_ones = ["roughdielectric", "null", "difftrans"];
    let deltas = ["conductor", "plastic"];
    let clear = ["dielectric", "thindielectric", "principledthin"];
    let mut all = opaque_ones.to_vec();
    if !opaque {
        all.extend(smooth_ones);
    }
    if !random.smooth {
        all.extend(deltas);
        all.extend(clear.iter().filter(|_| !opaque));
    }
    let kind = random.pick(&all);
    let node = Node::plugin("bsdf", kind);
    let rough = |random: &mut Random, node: Node| {
        let node = node
            .add_if(random.chance(50), || Node::value("string", "distribution", "ggx"))
            .add_if(random.chance(20), || Node::value("boolean", "sample_visible", "false"));
        if random.chance(25) && kind != "roughplastic" {
            node.add(Node::value("float", "alpha_u", random.between(0.2, 0.7))).add(Node::value(
                "float",
                "alpha_v",
                random.between(0.2, 0.7),
            ))
        } else {
            node.add(Node::value("float", "alpha", random.between(0.2, 0.7)))
        }
    };
    match kind {
        "diffuse" => node.add(color(random, "reflectance", 0.1, 0.9)),
        "roughconductor" => rough(random, node),
        "dielectric" | "thindielectric" => ior(random, node),
        "roughdielectric" => {
            let node = rough(random, node);
            ior(random, node)
        }
        "roughdiffuse" => node.add(color(random, "reflectance", 0.1, 0.9)),
        "difftrans" => node.add(color(random, "transmittance", 0.1, 0.9)),
        "phong" => node.add(color(random, "diffuse_reflectance", 0.1, 0.6)).add(Node::value(
            "float",
            "exponent",
            random.between(1.0, 50.0),
        )),
        "ward" => node
            .add(color(random, "diffuse_reflectance", 0.1, 0.6))
            .add(Node::value("float", "alpha_u", random.between(0.2, 0.7)))
            .add(Node::value("float", "alpha_v", random.between(0.2, 0.7))),
        "plastic" => node.add(color(random, "diffuse_reflectance", 0.1, 0.9)),
        "roughplastic" => rough(random, node).add(color(random, "diffuse_reflectance", 0.1, 0.9)),
        "principled" | "principledthin" => {
            let mut node = node.add(color(random, "base_color", 0.1, 0.9)).add(Node::value(
                "float",
                "roughness",
                random.between(0.3, 1.0),
            ));
            let thin = kind == "principledthin";
            node = node.add_if(!opaque && random.chance(30), || {
                Node::value("float", "spec_trans", random.between(0.0, 0.8))
            });
            for (name, most) in [("anisotropic", 0.8), ("sheen", 0.8), ("flatness", 0.8)] {
                node =
                    node.add_if(random.chance(30), || Node::value("float", name, random.between(0.0, most)));
            }
            node = node.add_if(thin && random.chance(30), || Node::value("float", "diff_trans", 1.2));
            for name in ["metallic", "clearcoat"] {
                node = node.add_if(!thin && random.chance(30), || {
                    Node::value("float", name, random.between(0.0, 0.9))
                });
            }
            node
        }
        _ => node,
    }
}

/// Returns the depth settings and whether emitters are visible to the camera.
pub fn settings(random: &mut Random) -> Vec<Node> {
    let depth = random.pick(&[2, 3, 3, 5, 8]);
    let depth = Node::value("integer", "max_depth", depth);
    if random.chance(15) { vec![depth, Node::value("boolean", "hide_emitters", "true")] } else { vec![depth] }
}
