//! Every command line of the documentation runs, with small stand-ins for the scenes and images that it names.
//!
//! A block of the language `sh` is run line by line in a folder of its own. Sizes, samples and times are reduced.

use crate::support::cli::{Folder, program};
use crate::support::docs::{Block, pages, root};
use crate::support::gltf::Model;
use buffon::cli::Cli;
use clap::Parser;
use clap::error::ErrorKind;
use rayon::prelude::*;
use serde_json::json;
use std::path::Path;
use std::process::Command;

/// A scene that renders in a moment, with layers, light from everywhere, and a parameter `max_depth`.
const SCENE: &str = r#"<scene version="3.0.0">
  <default name="max_depth" value="3"/>
  <default name="frame" value="0"/>
  <integrator type="path"><integer name="max_depth" value="$max_depth"/></integrator>
  <sensor type="perspective">
    <transform name="to_world"><lookat origin="$frame,1,4" target="0,0,0" up="0,1,0"/></transform>
    <sampler type="sobol"><integer name="sample_count" value="2"/></sampler>
    <film type="hdrfilm">
      <integer name="width" value="8"/><integer name="height" value="8"/>
      <string name="component_format" value="float32"/><rfilter type="box"/>
    </film>
  </sensor>
  <shape type="sphere"><bsdf type="plastic"/></shape>
  <emitter type="constant"><rgb name="radiance" value="0.5"/></emitter>
</scene>
"#;
/// A mesh of one triangle.
const MESH: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
/// What numbers of samples are divided by.
const SAMPLES_DIVISOR: u64 = 64;
/// What stands for something in a template, and what stands for it here.
const PLACEHOLDERS: [(&str, &str); 3] = [("N", "1"), ("S", "1"), ("SCENE", "scene.xml")];
/// Options whose value is a file that the program writes.
const WRITES: [&str; 8] =
    ["-o", "--stats", "--junit", "--table", "--checkpoint", "--cache", "--dir", "--output"];
/// The commands of Buffon that are parsed and not run, with the reason.
const ONLY_PARSED: [(&str, &str); 1] =
    [("lab", "experiments take minutes without optimisation; tests/lab.rs runs them")];
/// All other programs in the documents, with the reason why they are not run.
const NOT_RUN: [(&str, &str); 8] = [
    ("make", "its targets must exist"),
    ("cargo", "its examples and benches must exist"),
    ("sh", "it is a script that another line of the block writes"),
    ("ssh", "it needs another machine"),
    ("apt-get", "it needs root and a package"),
    ("python3", "it needs the wheel"),
    ("env/bin/pip", "it needs the wheel"),
    ("podman", "it needs a service"),
];

/// Where a package installs the scenes of the repository.
const INSTALLED: &str = "/usr/share/buffon/";

/// The folders of the packages.
const PACKAGES: [&str; 3] = ["", "sys/embree", "sys/oiio"];

/// Returns the words of a command line of a shell: quotes, `#` comments, and `|`.
fn words(line: &str) -> Vec<String> {
    let (mut words, mut word, mut quote) = (Vec::new(), String::new(), None);
    for c in line.chars() {
        match (quote, c) {
            (None, '\'' | '"') => quote = Some(c),
            (Some(q), c) if q == c => quote = None,
            (None, '#') if word.is_empty() => break,
            (None, c) if c.is_whitespace() => {
                words.extend(Some(std::mem::take(&mut word)).filter(|w| !w.is_empty()))
            }
            (_, c) => word.push(c),
        }
    }
    words.extend(Some(word).filter(|word| !word.is_empty()));
    words
}

/// Returns a number of samples that takes little time.
fn fewer(number: &str) -> String {
    number.parse::<u64>().map_or(number.to_owned(), |n| (n / SAMPLES_DIVISOR).max(1).to_string())
}

/// Returns the value of an option that takes little time.
fn cheap_value(option: &str, value: &str) -> String {
    match option {
        "--spp" | "--update-spp" => fewer(value),
        "--sample-range" => {
            let ends =
                value.split_once("..").map(|(a, b)| [a, b].map(|n| n.parse::<u64>().expect("a number")));
            ends.map_or(value.to_owned(), |ends| {
                let [a, b] = ends.map(|n| n / SAMPLES_DIVISOR);
                format!("{a}..{b}")
            })
        }
        "--time" => "0.1s".to_owned(),
        "--target-error" => "10".to_owned(),
        "--size" => "8x8".to_owned(),
        "--frames" => "1..=2".to_owned(),
        "--budgets" => "1,2".to_owned(),
        _ => value.to_owned(),
    }
}

/// Returns the arguments of a command of Buffon that takes little time.
fn cheap(arguments: &[String]) -> Vec<String> {
    let mut cheap: Vec<String> = Vec::new();
    for argument in arguments {
        let option = cheap.last().cloned().unwrap_or_default();
        cheap.push(cheap_value(&option, argument));
    }
    let command = arguments.first().map_or("", String::as_str);
    let given = |option: &str| arguments.iter().any(|argument| argument.starts_with(option));
    let renders = command == "render" || command.ends_with(".xml");
    if renders && !["--spp", "--time", "--target-error"].iter().any(|option| given(option)) {
        cheap.extend(["--spp", "1"].map(str::to_owned));
    }
    if (renders || command == "bench") && !given("--size") {
        cheap.extend(["--size", "8x8"].map(str::to_owned));
    }
    if command == "bench" {
        cheap.extend(["--runs", "2", "--reference-time", "0.1s"].map(str::to_owned));
    }
    if command == "regress" && !given("--update") {
        cheap.extend(["--spp", "16"].map(str::to_owned));
    }
    cheap
}

/// Runs the program in a folder; returns its message if it fails.
fn run(folder: &Path, arguments: &[String]) -> Result<(), String> {
    let output = Command::new(program())
        .args(arguments)
        .current_dir(folder)
        .env("XDG_CACHE_HOME", folder.join("cache"))
        .output()
        .expect("the program starts");
    match output.status.code() {
        Some(0) => Ok(()),
        code => Err(format!(
            "exit code {code:?} of buffon {}\n{}{}",
            arguments.join(" "),
            String::from_utf8_lossy(&output.stdout),
            String::from_utf8_lossy(&output.stderr)
        )),
    }
}

/// The files that stand for those which a document does not make.
struct StandIns(Folder);

impl StandIns {
    fn new() -> Self {
        let folder = Folder::with(SCENE);
        let make = |line: &str| {
            let arguments: Vec<String> = line.split(' ').map(str::to_owned).collect();
            run(folder.path(".").as_path(), &arguments).expect("the stand-ins can be made");
        };
        for name in ["scene.xml", "shot.xml"] {
            folder.write(name, SCENE.as_bytes());
        }
        folder.write("bunny.obj", MESH.as_bytes());
        let mut model = Model::new(json!([{ "mesh": 0 }]));
        let square = model.square();
        model.mesh(square);
        folder.write("model.glb", &model.binary());
        for name in ["scenes", "scenes/lights"] {
            std::fs::create_dir(folder.path(name)).expect("a folder");
        }
        folder.write("scenes/lights/lamp.xml", SCENE.as_bytes());
        make("regress scenes --update -q");
        make("render scene.xml -q --spp 4 --aov albedo,variance -o picture.exr");
        make("convert picture.exr picture.png");
        for (i, part) in ["a", "b"].into_iter().enumerate() {
            let range = format!("{}..{}", 2 * i, 2 * i + 2);
            make(&format!(
                "render scene.xml -q --spp 4 --sample-range {range} --checkpoint {part}.sums --no-image"
            ));
        }
        for (from, to) in
            [("picture.exr", "reference.exr"), ("picture.exr", "a.exr"), ("picture.exr", "b.exr")]
        {
            folder.write(to, &folder.read(from));
        }
        folder.write("reference.png", &folder.read("picture.png"));
        StandIns(folder)
    }

    /// Provides what a command reads and no earlier one of the block has written, and returns its arguments.
    fn provide(&self, folder: &Folder, arguments: &[String]) -> Vec<String> {
        let mut provided = Vec::new();
        for (i, argument) in arguments.iter().enumerate() {
            let is_written = i > 0 && WRITES.contains(&arguments[i - 1].as_str());
            let argument = argument.strip_prefix(INSTALLED).unwrap_or(argument);
            let in_repository = root().join(argument);
            let placeholder = PLACEHOLDERS.iter().find(|(name, _)| *name == argument);
            let mut argument = placeholder.map_or(argument, |(_, stand_in)| stand_in);
            if argument.starts_with("scenes/") && in_repository.is_dir() {
                argument = "scenes";
            }
            if argument.starts_with("scenes/") && in_repository.is_file() {
                provided.push(in_repository.display().to_string());
                continue;
            }
            let (from, to) = (self.0.path(argument), folder.path(argument));
            if !is_written && from.exists() && !to.exists() {
                if from.is_dir() {
                    for name in ["scenes/lights", "scenes/lights/refs"] {
                        std::fs::create_dir_all(folder.path(name)).expect("a folder");
                    }
                    for name in ["scenes/lights/lamp.xml", "scenes/lights/refs/lamp.exr"] {
                        folder.write(name, &self.0.read(name));
                    }
                } else {
                    folder.write(argument, &self.0.read(argument));
                }
            }
            provided.push(argument.to_owned());
        }
        provided
    }
}

/// Returns what is wrong with a line that is not run.
fn check_other(words: &[String], targets: &[String]) -> Result<(), String> {
    let program = words[0].as_str();
    if !NOT_RUN.iter().any(|(name, _)| *name == program) {
        return Err(format!("{program} is not in the list of programs that are not run"));
    }
    if program == "make" {
        let named = words[1..].iter().filter(|word| !word.starts_with('-') && !word.contains('='));
        let unknown = named.filter(|word| !targets.contains(word)).cloned().collect::<Vec<_>>();
        if !unknown.is_empty() && words[1] != "-C" {
            return Err(format!("the Makefile has no target {}", unknown.join(", ")));
        }
    }
    for pair in words.windows(2).filter(|_| program == "cargo") {
        let folder = match pair[0].as_str() {
            "--example" => "examples",
            "--bench" => "benches",
            _ => continue,
        };
        let path = |package: &str| root().join(package).join(folder).join(&pair[1]);
        let is_there =
            |package: &&str| path(package).is_dir() || path(package).with_extension("rs").is_file();
        if !PACKAGES.iter().any(is_there) {
            return Err(format!("there is no {folder}/{}", pair[1]));
        }
    }
    Ok(())
}

fn is_upper(name: &str) -> bool {
    name.chars().all(|c| c.is_ascii_uppercase() || c == '_')
}

/// Returns the targets of the Makefile.
fn targets() -> Vec<String> {
    let makefile = std::fs::read_to_string(root().join("Makefile")).expect("the Makefile");
    let rules = makefile.lines().filter(|line| line.starts_with(|c: char| c.is_ascii_lowercase()));
    rules.filter_map(|line| line.split_once(':')).map(|(name, _)| name.to_owned()).collect()
}

/// Returns the command lines of a block with their line numbers. A line that ends with `\` continues.
fn lines(block: &Block) -> Vec<(usize, String)> {
    let mut lines: Vec<(usize, String)> = Vec::new();
    let mut continues = false;
    for (i, line) in block.lines.iter().enumerate() {
        let part = line.trim_end_matches('\\').trim();
        match lines.last_mut().filter(|_| continues) {
            Some((_, last)) => *last = format!("{last} {part}"),
            None => lines.push((block.line + i, part.to_owned())),
        }
        continues = line.ends_with('\\');
    }
    lines
}

/// Returns the commands of a block with their line numbers: lines of a shell, or steps of continuous integration.
fn commands(block: &Block) -> Vec<(usize, Vec<String>)> {
    let lines = lines(block);
    let step = |line: &str| match block.language.as_str() {
        "sh" => Some(line.to_owned()),
        _ => line
            .trim_start_matches("- ")
            .trim_start_matches("run: ")
            .split_once("buffon ")
            .and_then(|(before, rest)| before.is_empty().then(|| format!("buffon {rest}"))),
    };
    let commands = lines.iter().filter_map(|(line, text)| Some((*line, words(&step(text)?))));
    commands.filter(|(_, words)| !words.is_empty()).collect()
}

/// Runs the commands of a block; returns their number and what is wrong with them.
fn run_block(page: &str, block: &Block, stand_ins: &StandIns, targets: &[String]) -> (usize, Vec<String>) {
    let (mut count, mut wrong) = (0, Vec::new());
    if !["sh", "yaml"].contains(&block.language.as_str()) {
        return (count, wrong);
    }
    let folder = Folder::with(SCENE);
    for (line, words) in commands(block) {
        for part in words.split(|word| word == "|") {
            // Variables before a command.
            let is_variable = |word: &String| word.split_once('=').is_some_and(|(name, _)| is_upper(name));
            let part = &part[part.iter().take_while(|word| is_variable(word)).count()..];
            count += 1;
            let checked = match part[0].as_str() {
                "buffon" if ONLY_PARSED.iter().any(|(name, _)| *name == part[1]) => {
                    Cli::try_parse_from(part).map(drop).map_err(|error| error.to_string())
                }
                "buffon" => run(&folder.path("."), &cheap(&stand_ins.provide(&folder, &part[1..]))),
                _ => check_other(part, targets),
            };
            wrong.extend(checked.err().map(|error| format!("{page}:{line}: {error}")));
        }
    }
    (count, wrong)
}

#[test]
fn every_command_line_of_the_documentation_runs() {
    let (stand_ins, targets, pages) = (StandIns::new(), targets(), pages());
    let blocks: Vec<(&str, &Block)> =
        pages.iter().flat_map(|page| page.blocks.iter().map(|block| (page.name.as_str(), block))).collect();
    for (page, block) in &blocks {
        assert!(
            !block.language.is_empty(),
            "{page}:{}: a block has a language: sh, text, xml, ...",
            block.line
        );
    }
    // Each block has a folder of its own, so blocks run at the same time.
    let results: Vec<(usize, Vec<String>)> =
        blocks.par_iter().map(|(page, block)| run_block(page, block, &stand_ins, &targets)).collect();
    let count: usize = results.iter().map(|(count, _)| count).sum();
    let wrong: Vec<String> = results.into_iter().flat_map(|(_, wrong)| wrong).collect();
    assert!(count > 60, "{count} commands");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Inline commands are fragments: their options must exist, and arguments may be missing.
#[test]
fn every_inline_command_of_the_documentation_has_known_options() {
    let targets = targets();
    let (mut wrong, mut count) = (Vec::new(), 0);
    for page in pages() {
        for (line, code) in page.inline() {
            let words = words(code);
            let checked = match words.first().map(String::as_str) {
                Some("buffon") if words.len() > 1 => match Cli::try_parse_from(&words) {
                    Err(error) => match error.kind() {
                        ErrorKind::MissingRequiredArgument
                        | ErrorKind::DisplayHelp
                        | ErrorKind::DisplayVersion
                        | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand
                        | ErrorKind::TooFewValues => Ok(()),
                        _ if words.last().is_some_and(|word| word == "COMMAND") => Ok(()),
                        // The fragment ends with an option that takes a value.
                        ErrorKind::InvalidValue if error.to_string().contains("none was supplied") => Ok(()),
                        _ => Err(error.to_string()),
                    },
                    Ok(_) => Ok(()),
                },
                Some("make" | "cargo") if words.len() > 1 => check_other(&words, &targets),
                _ => continue,
            };
            count += 1;
            wrong.extend(checked.err().map(|error| format!("{}:{line}: {code}: {error}", page.name)));
        }
    }
    assert!(count > 60, "{count} commands");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
