//! Scenes that say themselves what they must show, through `buffon regress`.

use crate::support::cli::{Folder, Run};
use roxmltree::Document;

/// A furnace of radiance `emission` / (1 − 1/2).
const SCENE: &str = r#"<scene version="3.0.0">
  <default name="emission" value="0.5"/>
  <integrator type="path"/>
  <sensor type="perspective">
    <sampler type="independent"><integer name="sample_count" value="64"/></sampler>
    <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/><rfilter type="box"/></film>
  </sensor>
  <shape type="sphere"><boolean name="flip_normals" value="true"/>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf>
    <emitter type="area"><rgb name="radiance" value="$emission"/></emitter></shape>
</scene>
"#;

fn folder(cases: &str) -> Folder {
    let folder = Folder::with(SCENE);
    folder.write("s.toml", format!("about = 'A furnace'\nwithin = 0.05\n{cases}").as_bytes());
    folder
}

fn case(name: &str, more: &str) -> String {
    format!("[[case]]\nname = '{name}'\nwhy = 'L = E / (1 - r)'\n{more}\n")
}

/// The verdicts and the names of the cases.
fn verdicts(run: &Run) -> Vec<String> {
    let known = ["PASS", "FAIL", "KNOWN", "ERROR"];
    let lines = run.stdout.lines().filter(|line| known.iter().any(|word| line.starts_with(word)));
    lines.map(|line| line.split_whitespace().take(2).collect::<Vec<_>>().join(" ")).collect()
}

#[test]
fn cases_hold_fail_or_are_known_to_fail() {
    let folder = folder(
        &[
            case("right", "expect = 1\nintegrators = ['path', 'ptracer']\nwithin = 0.3\nspp = 256"),
            case("twice", "define = { emission = 1 }\nexpect = 2\npixels_within = 0.9"),
            case("bounds", "between = [0.9, 1.1]"),
            case("alike", "define = { emission = 0.5 }\nsame_as = { emission = 0.5 }\nwithin = 0.2"),
            case("known", "expect = 2\nknown = [{ why = 'it is 1' }]"),
        ]
        .concat(),
    );
    let run = folder.run("regress . --table t.md --table t.json --junit j.xml");
    let expected = ["PASS right", "PASS right", "PASS twice", "PASS bounds", "PASS alike", "KNOWN known"];
    assert_eq!((run.code, verdicts(&run)), (0, expected.map(String::from).to_vec()), "{run:?}");
    assert!(run.stdout.contains("6 cases: 5 passed, 1 known to fail in "), "{run:?}");
    assert!(run.stdout.contains("       it is 1; "), "{run:?}");
    let table = String::from_utf8(folder.read("t.md")).unwrap();
    assert!(table.starts_with("### `s.xml`\n\nA furnace\n\n| case | integrator | expected | "), "{table}");
    assert!(table.contains("\n| twice | path | 2 ± 5 % | ") && table.contains(" | **KNOWN** |\n"), "{table}");
    assert!(table.contains("\n- **KNOWN** known, path: it is 1; "), "{table}");
    let json: serde_json::Value = serde_json::from_slice(&folder.read("t.json")).unwrap();
    let row = &json["rows"][2];
    assert_eq!((&row["name"], &row["define"]["emission"]), (&"s.xml: twice, path".into(), &"1".into()));
    let mean = row["measured"][0]["mean"][0].as_f64().unwrap();
    assert!((mean - 2.0).abs() < 0.1 && row["claim"]["expected"][1] == 2.0, "{row}");
    let junit = String::from_utf8(folder.read("j.xml")).unwrap();
    let document = Document::parse(&junit).expect("well-formed");
    let count = |tag: &str| document.descendants().filter(|n| n.has_tag_name(tag)).count();
    assert_eq!((count("testcase"), count("skipped"), count("failure")), (6, 1, 0));
}

#[test]
fn what_does_not_hold_fails() {
    let folder = folder(
        &[
            case("off", "expect = 1.2"),
            case("noisy", "expect = 1\nwithin = 1e-6"),
            case("unlike", "same_as = { emission = 0.6 }"),
            case("pixel", "expect = 1\npixels_within = 1e-6"),
            case("holds", "expect = 1\nknown = [{ why = 'it was 2' }]"),
            case("refused", "refused = 'no such thing'"),
        ]
        .concat(),
    );
    let run = folder.run("regress .");
    assert_eq!(run.code, 1);
    assert!(verdicts(&run).iter().all(|v| v.starts_with("FAIL")), "{run:?}");
    for sentence in [
        "the mean is off by -16",
        "only, of at most ± 0.0001 %: more samples would tell",
        "% off (p ",
        ", expected 1 ± 0.0001 %",
        "holds, though it is known to fail (it was 2)",
        "the scene was expected to be refused: \"no such thing\"",
    ] {
        assert!(run.stdout.contains(sentence), "{sentence}: {run:?}");
    }
    let run = folder.run("regress . --quiet --integrator direct");
    assert_eq!((run.code, verdicts(&run).len()), (0, 0), "no case claims it: {run:?}");
}

#[test]
fn one_traversal_one_integrator_and_a_column_beside() {
    let folder =
        folder(&case("right", "expect = 1\nintegrators = ['path', 'ptracer']\nwithin = 0.3\nspp = 256"));
    folder.write("other.json", br#"{"s.xml: right, path": "0.99"}"#);
    let run = folder.run("regress . --accel obvhs --integrator path --table t.md --beside Other=other.json");
    assert_eq!(run.code, 0, "{run:?}");
    let table = String::from_utf8(folder.read("t.md")).unwrap();
    let lines: Vec<&str> = table.lines().skip(4).collect();
    assert_eq!(lines[0], "| case | integrator | expected | obvhs | Other | rays | verdict |");
    assert!(lines.len() == 3 && lines[2].contains(" | 0.99 | "), "{table}");
}

#[test]
fn mistakes_are_said_where_they_are() {
    let folder = folder(&case("right", "expect = 1"));
    for (arguments, sentence) in [
        ("--table t.txt", "buffon: --table: expected the extension .md or .json, found t.txt\n"),
        (
            "--table t.md --beside A=s.toml",
            "buffon: s.toml: expected a JSON object of texts, by the names of rows: ",
        ),
        ("--table t.md --beside A=none", "buffon: none: cannot be read: "),
    ] {
        let run = folder.run(&format!("regress . {arguments}"));
        assert!(run.code >= 2 && run.stderr.starts_with(sentence), "{arguments}: {run:?}");
    }
    folder.write("s.toml", b"about = 'x'\n[[case]]\nname = 'a'\nwhy = 'b'\nexpct = 3\n");
    let run = folder.run("regress .");
    assert!(run.code == 1 && run.stdout.contains("s.toml:5:1: unknown field `expct`"), "{run:?}");
    // A reference is made and tested of a scene with cases only where there is one.
    folder.write("s.toml", format!("about = 'x'\n{}", case("right", "expect = 1\nwithin = 0.05")).as_bytes());
    assert_eq!(folder.run("regress . --update").code, 0);
    assert_eq!(folder.files(), ["s.toml", "s.xml"]);
}
