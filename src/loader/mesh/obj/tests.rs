use super::*;
use crate::memory::Budget;

/// Reads a text with `tobj` and on the fast path, and checks that both agree. Returns the mesh and the warnings.
fn read(text: &str) -> (Result<Mesh>, Vec<String>) {
    let path = Path::new("m.obj");
    let through = through_tobj(text.as_bytes(), &mut Budget::unlimited().nothing());
    let fast = fast::read(text.as_bytes(), fast::USUAL, &mut Budget::unlimited().nothing());
    let mut warnings = Vec::new();
    match (&through, &fast) {
        (Ok((mesh, survey)), Ok(fast)) => assert_eq!((mesh, survey), (&fast.0, &fast.1), "{text}"),
        (_, Err(Stop::Unusual)) => {}
        (through, fast) => panic!("{text}: {through:?}, {fast:?}"),
    }
    let read = through.map_err(|stop| stop.error(path)).map(|(mesh, survey)| {
        report(&survey, path, &mut warnings);
        mesh
    });
    (read, warnings.iter().map(Error::to_string).collect())
}

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

#[test]
fn groups_do_not_split_a_mesh_and_polygons_become_fans() {
    let text = format!("mtllib x.mtl\no a\n{SQUARE}g b\nf 1 2 3\nusemtl c d\ng d\nf 1 3 4\nf -4 -3 -2 -1\n");
    let (mesh, warnings) = read(&text);
    let mesh = mesh.unwrap();
    assert_eq!(mesh.positions.len(), 4);
    assert_eq!(mesh.indices, [[0, 1, 2], [0, 2, 3], [0, 1, 2], [0, 2, 3]]);
    assert!(warnings.is_empty(), "{warnings:?}");
    let (_, survey) = through_tobj(text.as_bytes(), &mut Budget::unlimited().nothing()).unwrap();
    assert_eq!(survey.libraries, [Named { line: 1, name: "x.mtl".into() }]);
    assert_eq!(survey.materials, [(1, Named { line: 9, name: "c d".into() })]);
}

#[test]
fn vertices_are_shared_where_all_their_indices_are() {
    let (mesh, _) =
        read(&format!("{SQUARE}vt 0 0.25\nvt 1 1\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\nf 1/2/1 3/1/1 4/1/1\r\n"));
    let mesh = mesh.unwrap();
    assert_eq!(mesh.indices, [[0, 1, 2], [3, 2, 4]]);
    assert_eq!(mesh.uvs[3], Vec2::ONE);
    assert_eq!(mesh.normals, [Vec3::Z; 5]);
}

#[test]
fn vertices_that_differ_in_what_is_not_used_are_shared() {
    // The file has no texture coordinates, and the last corner has no normal.
    let (mesh, _) = read(&format!("{SQUARE}vn 0 0 1\nvn 1 0 0\nf 4/1/1 2/2/1 3/1/1\nf 4/2/2 3/2/2 1\n"));
    let mesh = mesh.unwrap();
    assert_eq!((mesh.uvs.len(), mesh.normals.len()), (0, 0));
    assert_eq!(mesh.indices, [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(mesh.positions, [Vec3::Y, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::ZERO]);
}

#[test]
fn incomplete_corners_and_skipped_lines_are_told() {
    let (mesh, warnings) =
        read(&format!("{SQUARE}vt 0 0\nvn 0 0 1\nf 1/1 2//1 3\nf 1 2\nl 1 2\np 1\ncurv 1 2\n"));
    let mesh = mesh.unwrap();
    assert_eq!((mesh.uvs.len(), mesh.normals.len(), mesh.indices.len()), (0, 0, 1));
    assert_eq!(
        warnings,
        [
            "m.obj: 3 points, lines or faces of fewer than three vertices ignored",
            "m.obj: some corners of faces have no texture coordinates, so none are used",
            "m.obj: some corners of faces have no normals, so all are computed",
            "m.obj:11:1: lines that start with \"curv\" are ignored",
        ]
    );
}

#[test]
fn errors_have_their_line() {
    let message = |text: &str| read(text).0.unwrap_err().to_string().lines().next().unwrap().to_owned();
    let numbers = "expected 3 numbers (4 with a weight, 6 with a colour), found";
    assert_eq!(message("v 0 0 0\nv 1 0 x\n"), format!("m.obj:2:1: {numbers} \"1 0 x\""));
    assert_eq!(message("v 0 0\n"), format!("m.obj:1:1: {numbers} \"0 0\""));
    let corners = "expected corners such as 1, 1/1, 1//1 or 1/1/1, found";
    for (text, expected) in [
        ("f 1 2 9\n", "5:1: there is no vertex 9; the file has 4".to_owned()),
        ("f 1 2 0\n", "5:1: there is no vertex 0; 4 come before this line".to_owned()),
        ("f 1 2 -5\n", "5:1: there is no vertex -5; 4 come before this line".to_owned()),
        ("f 1 2 4294967295\n", "5:1: there is no vertex 4294967295; the file has 4".to_owned()),
        ("f 1 2 99999999999\n", "5:1: there is no vertex 99999999999; 4 come before this line".to_owned()),
        (
            "f 1 2 -9223372036854775808\n",
            "5:1: there is no vertex -9223372036854775808; 4 come before this line".to_owned(),
        ),
        ("vt 0 0\nf 1/1 2/1 3/2\n", "6:1: there is no texture coordinate 2; the file has 1".to_owned()),
        (
            "vt 0 0\nf 1/1 2/0 3/1\n",
            "6:1: there is no texture coordinate 0; 1 come before this line".to_owned(),
        ),
        (
            "vt 0 0\nf 1/1 2/-2 3/1\n",
            "6:1: there is no texture coordinate -2; 1 come before this line".to_owned(),
        ),
        ("vn 0 0 1\nf 1//1 2//1 3//4\n", "6:1: there is no normal 4; the file has 1".to_owned()),
        (
            "vn 0 0 1\nf 1//1 2//1 3//9223372036854775807\n",
            "6:1: there is no normal 9223372036854775807; 1 come before this line".to_owned(),
        ),
        ("f 1 2 c\n", format!("5:1: {corners} \"1 2 c\"")),
        ("f 1 2 -\n", format!("5:1: {corners} \"1 2 -\"")),
        ("f 1/1/1/1 2 3\n", format!("5:1: {corners} \"1/1/1/1 2 3\"")),
        ("f 1 2 99999999999999999999\n", format!("5:1: {corners} \"1 2 99999999999999999999\"")),
        ("f 1 2 /1\n", "5:1: expected a corner such as 1, 1/1, 1//1 or 1/1/1, found \"/1\"".to_owned()),
        ("v 0 0 0 0\n", "5:1: the weight of the vertex is 0".to_owned()),
        ("v 0 0 0 1 1\n", format!("5:1: {numbers} \"0 0 0 1 1\"")),
        ("v\n", format!("5:1: {numbers} \"\"")),
        ("vt 0 # 1\n", "5:1: expected 2 numbers, found \"0 # 1\"".to_owned()),
        ("\n\nvn 1 1 north\n", "7:1: expected 3 numbers, found \"1 1 north\"".to_owned()),
    ] {
        assert_eq!(message(&format!("{SQUARE}{text}")), format!("m.obj:{expected}"));
    }
    // Indices of texture coordinates are ignored if the file has no texture coordinates.
    assert!(read(&format!("{SQUARE}f 1/1 2/1 3/1\n")).0.unwrap().uvs.is_empty());
}

#[test]
fn a_file_means_the_same_however_it_is_cut() {
    let text = format!(
        "# c\n{SQUARE}vt 0 0\nvt 1 1 # c\nvn 0 0 1\n#curv\nusemtl a\nf 1/1/1 2/2/1 3/1/1 4/2/-1\nl 1 2\nv 5 5 5 0.5\n\
         vt 0.5 1\nusemtl b # c\nf -1/-1/1\t-2/-2/1 -3/1/1 \r\nf 7/1/1 1/1/1 6/1/1 # c\n\n  f 7/1/1 6/1/1 1/1/1\n\
         mtllib é.mtl\nv 1 2 3\nv 3 2 1 0 0 0\np 1"
    );
    let mut planned = Budget::unlimited().nothing();
    let (mesh, survey) = through_tobj(text.as_bytes(), &mut planned).unwrap();
    assert_eq!(mesh.indices, [[0, 1, 2], [0, 2, 3], [4, 3, 2], [5, 0, 6], [5, 6, 0]]);
    assert_eq!(mesh.positions[4], Vec3::splat(10.0));
    assert_eq!((survey.skipped, survey.materials.len(), survey.materials[1].0), (2, 2, 2));
    for block in 1..text.len() {
        for piece in [1, 7, 30] {
            let fast = fast::read(text.as_bytes(), [block, piece], &mut planned).unwrap();
            assert_eq!((&fast.0, &fast.1), (&mesh, &survey), "{block} {piece}");
        }
    }
}

/// Tests random meshes with every kind of corner and with numbers that are hard to round.
#[test]
fn both_ways_give_the_same_mesh_to_the_last_bit() {
    let mut state = 1u64;
    let mut random = move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        state >> 33
    };
    for case in 0..40 {
        let mut text = String::new();
        for _ in 0..200 {
            let mut number = || match random() % 4 {
                0 => format!("{}", f32::from_bits((random() as u32) & 0x7eff_ffff)),
                1 => format!("-{}.{:09}", random() % 1000, random() % 1_000_000_000),
                2 => format!("{}e-{}", random(), random() % 50),
                _ => format!("0.{}{}", random(), random()),
            };
            text += &format!("v {} {} {}", number(), number(), number());
            if case % 3 == 1 {
                text += &format!(" {}", 1 + case);
            }
            text += &format!("\nvt {} {}\nvn {} {} {}\n", number(), number(), number(), number(), number());
            if random() % 10 == 0 {
                text += &format!("usemtl m{}\n", random() % 3);
            }
        }
        for _ in 0..300 {
            text += "f";
            for _ in 0..3 + random() % 4 {
                let mut index = || match random() % 2 {
                    0 => format!("{}", 1 + random() % 200),
                    _ => format!("-{}", 1 + random() % 200),
                };
                text += &match case % 4 {
                    0 => format!(" {}", index()),
                    1 => format!(" {}/{}", index(), index()),
                    2 => format!(" {}//{}", index(), index()),
                    _ => format!(" {}/{}/{}", index(), index(), index()),
                };
            }
            text += "\n";
        }
        let mut planned = Budget::unlimited().nothing();
        let (mesh, survey) = through_tobj(text.as_bytes(), &mut planned).unwrap();
        let fast = fast::read(text.as_bytes(), [4096, 256], &mut planned).unwrap();
        assert_eq!((&fast.0.indices, &fast.1), (&mesh.indices, &survey));
        let bits = |mesh: &Mesh| -> Vec<u32> {
            let vectors = mesh.positions.iter().chain(&mesh.normals).flat_map(|v| v.to_array());
            vectors.chain(mesh.uvs.iter().flat_map(|v| v.to_array())).map(f32::to_bits).collect()
        };
        assert!(bits(&fast.0) == bits(&mesh), "case {case}");
    }
}

#[test]
fn memory_is_planned_before_tobj_takes_it() {
    let text = "vt 0 0\nvn 0 0 1\nv 0 0 0\nf -1/1/1 -1/1/1 -1/1/1\n".repeat(10_000);
    let budget = Budget::open(crate::memory::Limit::Bytes(0));
    assert!(matches!(through_tobj(text.as_bytes(), &mut budget.nothing()), Err(Stop::Memory(_))));
    let endless = " ".repeat(4 << 20);
    assert!(matches!(through_tobj(endless.as_bytes(), &mut budget.nothing()), Err(Stop::Memory(_))));
}

/// Tests damaged texts: if the fast path reads one, `tobj` reads the same mesh from it.
#[test]
fn the_fast_path_reads_nothing_that_tobj_reads_otherwise() {
    const TEXT: &str = "v 0 0 0\nv 1 0 0\r\nv 1 1 0 2\nv 0 1 0.5 1 0 1\nvt 0 0\nvt 1 0\nvn 0 0 1\nusemtl b\n# c\n\
                        f 1/1/1 2/2/1 3/2/1\nf -4/1/1 -2/2/1 -1/2/1 # the rest\nf 1//1 2//1 3//1 4//1\nl 1 2\n";
    const BITS: [&str; 20] = [
        "-1",
        "0",
        "+3",
        "nan",
        "inf",
        "1e9",
        "#",
        " #",
        "/",
        "//",
        "\n",
        "\r",
        " ",
        "f ",
        "vt",
        "\\",
        "\u{a0}",
        "\u{b}",
        "\u{c}",
        "4294967296",
    ];
    let mut state = 7u64;
    let mut random = move |n: usize| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as usize % n
    };
    let mut planned = Budget::unlimited().nothing();
    let mut both = 0;
    for _ in 0..20_000 {
        let mut text = TEXT.as_bytes().to_vec();
        for _ in 0..=random(2) {
            let at = random(text.len());
            let end = (at + random(4)).min(text.len());
            text.splice(at..end, BITS[random(BITS.len())].bytes());
        }
        let Ok(fast) = fast::read(&text[..], fast::USUAL, &mut planned) else { continue };
        let shown = String::from_utf8_lossy(&text);
        let (mesh, survey) =
            through_tobj(&text[..], &mut planned).unwrap_or_else(|e| panic!("{shown}: {e:?}"));
        // As text, two NaN are equal.
        assert_eq!(format!("{fast:?}"), format!("{:?}", (mesh, survey)), "{shown}");
        both += 1;
    }
    assert!(both > 3_000, "only {both} texts could be read");
}
