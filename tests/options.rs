//! Every option of every subcommand is reached by a test, and some that no other test reaches.

use crate::support::cli::{Folder, SCENE};
use buffon::cli::Cli;
use clap::CommandFactory;
use std::path::Path;

/// Options that need no test, with the reason.
const EXCEPTIONS: [(&str, &str); 1] =
    [("help", "clap's own, which prints what the options are declared with")];

/// The text of all files of tests.
fn texts(folder: &Path) -> String {
    let mut text = String::new();
    for entry in std::fs::read_dir(folder).expect("a folder").flatten() {
        let path = entry.path();
        if path.is_dir() {
            text += &texts(&path);
        } else if path.extension().is_some_and(|e| e == "rs") {
            text += &std::fs::read_to_string(&path).expect("UTF-8");
        }
    }
    text
}

#[test]
fn every_option_is_in_a_test() {
    let text = texts(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests"));
    let is_used = |option: &str| {
        let ends = |(i, _): (usize, &str)| {
            !text[i + option.len()..].starts_with(|c: char| c == '-' || c.is_ascii_alphanumeric())
        };
        text.match_indices(option).any(ends)
    };
    let mut missing = Vec::new();
    let mut options = 0;
    for command in Cli::command().get_subcommands() {
        for argument in command.get_arguments() {
            for name in argument.get_long_and_visible_aliases().unwrap_or_default() {
                options += 1;
                if !is_used(&format!("--{name}")) && EXCEPTIONS.iter().all(|(other, _)| *other != name) {
                    missing.push(format!("buffon {} --{name}", command.get_name()));
                }
            }
        }
    }
    assert!(options > 80, "{options} options");
    assert_eq!(missing, Vec::<String>::new(), "options that no test uses");
}

#[test]
fn outputs_and_threads_have_the_names_of_other_renderers() {
    let folder = Folder::new();
    folder.render("s.xml -q --spp 1 --output a.pfm --threads 1");
    let run = folder.render("s.xml --spp 1 --outfile b.pfm --nthreads 2 --verbose");
    assert!(run.stderr.contains("buffon: note: loading ") && run.stderr.contains(" s, total "), "{run:?}");
    assert!(folder.read("a.pfm") == folder.read("b.pfm"));
}

#[test]
fn the_default_output_is_in_the_current_directory() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("scenes")).expect("a folder");
    folder.write("scenes/x.xml", SCENE.as_bytes());
    folder.render("scenes/x.xml -q --spp 1");
    folder.render("scenes/x.xml -q --spp 2 --sample-range 0..1");
    assert_eq!(folder.files(), ["s.xml", "scenes", "x.0-1.exr", "x.exr"]);
}

#[test]
fn files_are_found_in_search_paths() {
    let mesh = "<shape type=\"obj\"><string name=\"filename\" value=\"square.obj\"/></shape></scene>";
    let folder = Folder::with(&SCENE.replace("</scene>", mesh));
    std::fs::create_dir(folder.path("parts")).expect("a folder");
    folder.write("parts/square.obj", b"v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nf 1 2 3\nf 1 3 4\n");
    for (arguments, code) in [("info s.xml", 0), ("render s.xml -q --spp 1", 3)] {
        let run = folder.run(arguments);
        assert!(run.code == code && (run.stdout + &run.stderr).contains("square.obj"), "{arguments}");
        let run = folder.run("render s.xml -q --spp 1 --search-path parts --stats parts/square.obj");
        assert!(
            run.code == 2 && run.stderr.contains("parts/square.obj: it is a file of the scene"),
            "{run:?}"
        );
        let run = folder.run(&format!("{arguments} --search-path none;parts"));
        assert!(run.code == 0 && !(run.stdout + &run.stderr).contains("square.obj"), "{arguments}");
    }
}

/// What the help lists is what there is.
#[test]
fn the_help_lists_names_from_the_tables() {
    let folder = Folder::new();
    for command in ["render", "regress", "bench"] {
        let help = folder.run(&format!("{command} --help")).stdout;
        let words: String = help.split_whitespace().collect::<Vec<_>>().join(" ");
        for list in [
            "path, volpath, direct, ptracer, photonmapper, sppm, whitted, distribution, irrcache, ao, depth, aov, bdpt, vcm or pssmlt",
            "independent, stratified, multijitter, halton, sobol, zsobol or fixed",
        ] {
            assert!(words.contains(list), "{command}: {help}");
        }
    }
    let help = folder.run("render --help").stdout;
    assert!(help.contains("block_variance"), "{help}");
}
