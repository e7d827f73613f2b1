//! `buffon bench` from outside: its table, files, references and sentences.

use crate::support::cli::{Folder, Run, program};
use buffon::image::{Image, WriteOptions, write};
use serde_json::Value as Json;

/// Runs the program in the folder, with a cache in it.
fn run(folder: &Folder, arguments: &str) -> Run {
    let output = assert_cmd::Command::new(program())
        .args(arguments.split_whitespace())
        .env("XDG_CACHE_HOME", folder.path("cache"))
        .current_dir(folder.path("."))
        .output()
        .expect("the program starts");
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("the program speaks UTF-8");
    let code = output.status.code().unwrap_or(-1);
    Run { code, stdout: text(output.stdout), stderr: text(output.stderr) }
}

/// A bench that must succeed.
fn bench(folder: &Folder, arguments: &str) -> Run {
    let run = run(folder, &format!("bench {arguments}"));
    assert_eq!(run.code, 0, "{arguments}: {run:?}");
    run
}

fn json(folder: &Folder, name: &str) -> Json {
    serde_json::from_slice(&folder.read(name)).expect("JSON")
}

/// The renders take a few milliseconds each.
const QUICK: &str = "--runs 2 --budgets 2,4,8 --reference-time 0.3s -t 2";

#[test]
fn a_bench_writes_table_csv_json_and_a_page() {
    let folder = Folder::new();
    let scene = "a&b<i>.xml";
    std::fs::rename(folder.path("s.xml"), folder.path(scene)).expect("the file can be renamed");
    let Run { stdout, .. } = bench(
        &folder,
        &format!("{scene} {QUICK} --integrators path,depth --samplers sobol,independent --accels obvhs"),
    );
    assert!(stdout.starts_with("a&b<i> (40x30): the reference is rendered by path with sobol"), "{stdout}");
    let header = "integrator  sampler      accel  budget  spp  seconds";
    assert!(stdout.lines().nth(1).is_some_and(|line| line.starts_with(header)), "{stdout}");
    assert!(stdout.contains("its picture is distances: no light, and no error of light"), "{stdout}");

    let table = String::from_utf8(folder.read("bench/bench.csv")).expect("UTF-8");
    let lines: Vec<Vec<&str>> = table.lines().map(|l| l.split(',').collect()).collect();
    assert_eq!(
        lines[0].join(","),
        "scene,integrator,sampler,accel,budget,run,seed,seconds,spp,relmse,trimmed_relmse,mse,flip,reference_relmse,\
         relmse_estimate,efficiency,mrays_per_second,closest_rays,occlusion_rays,closest_thread_seconds,\
         occlusion_thread_seconds,invalid_samples,failure"
    );
    // Two samplers, three budgets, two runs; and two failures, whose sentence holds a colon and a comma.
    assert_eq!(lines.len(), 1 + 2 * 3 * 2 + 2);
    assert_eq!(lines[1][..7].join(","), "a&b<i>,path,sobol,obvhs,2 spp,0,0");
    for line in lines[1..].iter().filter(|l| l[1] == "path") {
        assert!(line[7..12].iter().all(|v| v.parse::<f64>().is_ok_and(|v| v > 0.0)), "{line:?}");
    }

    let report = json(&folder, "bench/bench.json");
    assert_eq!(report["budgets"], serde_json::json!(["2 spp", "4 spp", "8 spp"]));
    for fact in ["processor", "system", "buffon", "command", "date"] {
        assert!(report["circumstances"][fact].is_string(), "{fact}");
    }
    let scene = &report["scenes"][0];
    assert_eq!((&scene["width"], &scene["height"]), (&40.into(), &30.into()));
    let rows = scene["rows"].as_array().expect("rows");
    assert_eq!(rows.len(), 4);
    let path = &rows[0];
    assert_eq!(
        (&path["integrator"], &path["accel"], &path["failure"]),
        (&"path".into(), &"obvhs".into(), &Json::Null)
    );
    assert!(path["budgets"][2]["median"]["efficiency"].as_f64().is_some_and(|v| v > 0.0));
    assert_eq!(path["budgets"][2]["runs"].as_array().map(Vec::len), Some(2));
    assert_eq!(path["budgets"][2]["runs"][1]["spp"], 8);
    assert!(rows[2]["failure"].is_string());

    let page = String::from_utf8(folder.read("bench/index.html")).expect("UTF-8");
    for outside in ["http://", "https://", "src=\"//", "<link", "@import", "url(", "b<i>"] {
        assert!(!page.contains(outside), "{outside}");
    }
    assert!(page.contains("<h2>a&amp;b&lt;i&gt;</h2>"));
    assert!(page.contains("<p>../a&amp;b&lt;i&gt;.xml: 40 × 30 pixels, "), "a path from the page's folder");
    // Neither the program's folder nor that of the test.
    for absolute in [folder.path(""), std::path::Path::new(program()).parent().expect("a folder").into()] {
        assert!(!page.contains(&*absolute.to_string_lossy()), "{}", absolute.display());
    }
    assert!(page.contains("<dd>buffon bench &#39;a&amp;b&lt;i&gt;.xml&#39; "));
    let (table, container) = ("<table>", "<div class=\"table\" tabindex=\"0\" role=\"region\"");
    assert!(
        page.matches(table).count() == page.matches(container).count()
            && page.contains(".table { overflow-x: auto;")
    );
    for row in rows.iter().filter(|row| row["failure"].is_null()) {
        let known = row["slope"].is_object();
        assert_eq!(known, row["slope_unknown"].is_null(), "{row}");
        let width = row["slope"]["high"].as_f64().zip(row["slope"]["low"].as_f64()).map(|(b, a)| b - a);
        assert!(width.is_none_or(|width| width <= 1.0), "{row}");
    }
    let measured = rows.iter().filter(|row| row["failure"].is_null());
    let unknown = measured.filter(|row| row["slope_unknown"].is_string()).count();
    assert_eq!(page.matches("<td class=\"number\">not known</td>").count(), unknown);
    assert_eq!(page.matches(" is not known: ").count(), unknown);
    assert_eq!(page.matches("class=\"pixels\"").count(), 3);
}

#[test]
fn the_errors_are_those_of_diff() {
    let folder = Folder::new();
    folder.render("s.xml -o r.exr --spp 64 --seed 9 -q");
    folder.render("s.xml -o x.exr --spp 8 --accel obvhs --sampler sobol -q");
    bench(&folder, "s.xml --runs 1 --budgets 8 --accels obvhs --samplers sobol --reference r.exr -q");
    let bench = json(&folder, "bench/bench.json");
    let diff: Json = serde_json::from_str(&run(&folder, "diff x.exr r.exr --json").stdout).expect("JSON");
    let (here, there) = (&bench["scenes"][0]["rows"][0]["budgets"][0]["runs"][0], &diff["layers"][0]);
    let flip: Json =
        serde_json::from_str(&run(&folder, "diff x.exr r.exr --metric flip --json").stdout).expect("JSON");
    let seen = flip["layers"][0]["flip"].as_f64().expect("a number");
    assert!(
        seen > 0.0 && (here["flip"].as_f64().expect("a number") / seen - 1.0).abs() < 1e-6,
        "{here} {seen}"
    );
    for (name, there_name) in [("relmse", "relmse"), ("trimmed_relmse", "trimmed"), ("mse", "mse")] {
        let [a, b] =
            [&here[name], &there[there_name]].map(|v| v.as_f64().unwrap_or_else(|| panic!("{name}: {diff}")));
        assert!((a / b - 1.0).abs() < 1e-9, "{name}: {a} {b}");
    }
    let floor = bench["scenes"][0]["reference"]["relmse"].as_f64().expect("the reference says its error");
    assert!(floor > 0.0 && floor < 1.0, "{floor}");
}

#[test]
fn a_rendered_reference_is_kept_until_the_scene_changes() {
    let folder = Folder::new();
    let arguments = "s.xml --runs 1 --budgets 2 --accels obvhs";
    let rendered = |stderr: &str| stderr.contains("rendering a reference by path: 64 samples per pixel");
    let kept = |stderr: &str| stderr.contains("the reference is ") && stderr.contains("/cache/buffon/s-");
    let first = bench(&folder, arguments);
    assert!(rendered(&first.stderr), "{}", first.stderr);
    let second = bench(&folder, arguments);
    assert!(kept(&second.stderr) && !rendered(&second.stderr), "{}", second.stderr);
    // More effort than the kept one had, another size, another definition, another scene.
    let more = bench(&folder, "s.xml --runs 1 --budgets 4 --accels obvhs");
    assert!(more.stderr.contains("128 samples per pixel") && !kept(&more.stderr), "{}", more.stderr);
    assert!(kept(&bench(&folder, arguments).stderr), "one of more effort serves");
    assert!(rendered(&bench(&folder, &format!("{arguments} --size 20x15")).stderr));
    // What is kept can be anything after a while.
    let cache = folder.path("cache/buffon");
    for file in std::fs::read_dir(&cache).expect("the cache").flatten() {
        std::fs::write(file.path(), b"no image").expect("the file can be written");
    }
    assert!(rendered(&bench(&folder, arguments).stderr));
    let scene = String::from_utf8(folder.read("s.xml")).expect("UTF-8").replace("5", "6");
    folder.write("s.xml", scene.as_bytes());
    assert!(rendered(&bench(&folder, arguments).stderr));
}

#[test]
fn a_reference_beside_the_scene_is_found_if_it_fits() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("refs")).expect("a folder");
    folder.render("s.xml -o refs/s.exr --spp 32 --seed 9 -q");
    let arguments = "s.xml --runs 1 --budgets 2 --accels obvhs --reference-time 0.1s";
    let run = bench(&folder, arguments);
    assert!(run.stdout.contains("the reference is refs/s.exr, 32 samples per pixel by path;"), "{run:?}");
    let run = bench(&folder, &format!("{arguments} --size 20x15"));
    let note = "refs/s.exr is no reference here: expected 20x15 pixels as the scene has, found 40x30";
    assert!(run.stderr.contains(note) && run.stdout.contains("rendered by path"), "{run:?}");
}

#[test]
fn what_means_nothing_is_refused_with_a_sentence() {
    let folder = Folder::new();
    let small = Image::new(10, 5, &["R", "G", "B"]);
    write(&folder.path("small.exr"), &small, &WriteOptions::default()).expect("an image");
    folder.write("broken.exr", b"no image");
    for (arguments, code, sentence) in [
        (
            "s.xml --integrators path,pth",
            2,
            "buffon: --integrators: there is no integrator \"pth\" (did you mean \"path\"?); there are ",
        ),
        (
            "s.xml --budgets 1s,",
            2,
            "buffon: --budgets: expected times (1s, 500ms, 2m) or samples per pixel (64), separated by commas; found nothing",
        ),
        (
            "s.xml --reference small.exr",
            2,
            "buffon: small.exr: --reference: expected 40x30 pixels as the scene has, found 10x5",
        ),
        ("s.xml --reference none.exr", 4, "buffon: none.exr: no such file"),
        ("s.xml --reference broken.exr", 4, "buffon: broken.exr: "),
        (
            "s.xml s.xml --reference small.exr",
            2,
            "buffon: --reference: expected one scene, found 2: a reference is of one picture",
        ),
        ("none.xml", 3, "buffon: none.xml: cannot be read: no such file or directory"),
        ("s.xml -o s.xml", 4, "buffon: s.xml: cannot be made: "),
    ] {
        let Run { code: found, stdout, stderr } = run(&folder, &format!("bench {arguments}"));
        assert!(stderr.starts_with(sentence), "{arguments}: {stderr}");
        assert_eq!((found, stdout.as_str()), (code, ""), "{arguments}");
    }
    for arguments in
        ["bench", "bench s.xml --samplers nope", "bench s.xml --accels nope", "bench s.xml --runs 0"]
    {
        assert_eq!(run(&folder, arguments).code, 2, "{arguments}");
    }
}

#[test]
fn a_calibration_is_a_file_for_the_automatic_choice() {
    let folder = Folder::new();
    let options = "s.xml --calibrate costs.json --budgets 2 --runs 1 -q";
    let stdout = bench(&folder, options).stdout;
    assert!(stdout.starts_with("s: ") && stdout.contains("relative to that: path 1.00, bdpt "), "{stdout}");
    let costs = json(&folder, "costs.json");
    assert_eq!((&costs["surfaces"]["path"], &costs["media"]["volpath"]), (&1.0.into(), &1.0.into()));
    for name in ["bdpt", "sppm", "vcm", "irrcache", "photonmapper"] {
        assert!(costs["surfaces"][name].as_f64().is_some_and(|cost| cost > 0.0), "{name}: {costs}");
    }
    folder.render("s.xml --integrator auto --auto-costs costs.json -q -o a.exr");
    let both = "s.xml --integrators path,auto --allow-bias 0.01 --auto-costs costs.json --accels auto";
    let text = bench(&folder, &format!("{both} --budgets 2 --runs 1 --reference-time 0.3s -q")).stdout;
    assert!(text.contains("auto"), "{text}");
    for (options, sentence) in [
        ("s.xml --calibrate s.xml", "--calibrate s.xml: it is a file of a scene"),
        ("s.xml none.xml --calibrate a.json", "none.xml"),
        ("s.xml --integrators path --allow-bias 0.1", "--allow-bias: only the integrator auto uses it"),
        (
            "s.xml --integrators path --auto-costs costs.json",
            "--auto-costs: only the integrator auto uses it",
        ),
    ] {
        let run = run(&folder, &format!("bench {options} -q"));
        assert!(run.code != 0 && run.stderr.contains(sentence), "{options}: {run:?}");
    }
}
