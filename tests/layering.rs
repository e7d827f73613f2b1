//! Layers of modules: a module uses only modules of rows above its own, and `unsafe` is allowed only in some places.

use std::fs;
use std::path::{Path, PathBuf};

/// The rows. A module may use the modules of every row above.
const ROWS: [&[&str]; 12] = [
    &["math", "error", "ids", "memory", "util"],
    &["color", "sampling", "estimate", "image", "embree"],
    &["accel", "texture", "compare"],
    &["shape", "bsdf", "film", "medium"],
    &["material", "emitter", "sensor"],
    &["scene"],
    &["integrator"],
    &["render"],
    &["loader", "report"],
    &["session"],
    &["bench", "regress", "lab", "farm"],
    &["cli", "main"],
];

/// Allowed uses within a row, each with its reason.
const WITHIN_A_ROW: [(&str, &str, &str); 2] = [
    ("util", "error", "a file that cannot be written is an error like any other"),
    ("main", "cli", "the program is nothing but its command line"),
];

/// Modules in rows above that an integrator must not use, because it uses the interface of the scene.
const NOT_FOR_INTEGRATORS: [&str; 4] = ["accel", "embree", "loader", "texture"];
/// The exceptions: plain data of the scene's interface.
const PLAIN_DATA: [&str; 2] = ["accel::Hit", "accel::Coherence"];

/// The places in which `unsafe` is allowed.
const UNSAFE_PLACES: [&str; 4] = ["sys/", "src/embree/", "src/image/oiio.rs", "tests/support/cli.rs"];

fn row(module: &str) -> Option<usize> {
    ROWS.iter().position(|row| row.contains(&module))
}

/// Returns the reason why `module` must not use `path` (from the crate's root), if there is one.
fn violation(module: &str, path: &str) -> Option<String> {
    let used = path.split("::").next().unwrap_or_default();
    let (Some(from), Some(to)) = (row(module), row(used)) else {
        return Some(format!("{module} or {used} is in no row"));
    };
    if module == "integrator" && NOT_FOR_INTEGRATORS.contains(&used) && !PLAIN_DATA.contains(&path) {
        return Some(format!("an integrator asks the scene, not {path}"));
    }
    let allowed =
        used == module || to < from || WITHIN_A_ROW.iter().any(|&(m, u, _)| m == module && u == used);
    (!allowed).then(|| format!("{module} (row {}) uses {path} (row {})", from + 1, to + 1))
}

/// Returns the code without comments. A `//` in a string also ends the line, but no path follows it.
fn without_comments(text: &str) -> String {
    text.lines().map(|line| line.split("//").next().unwrap_or_default()).collect::<Vec<_>>().join("\n")
}

/// Returns the words of a text: sequences of letters, digits and underscores.
fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !c.is_alphanumeric() && c != '_').filter(|w| !w.is_empty())
}

/// Returns every path that begins with `root`, relative to the crate's root. Groups are expanded.
fn paths(code: &str, root: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (at, _) in code.match_indices(root) {
        let inside_a_word =
            code[..at].chars().next_back().is_some_and(|c| c.is_alphanumeric() || c == '_' || c == '$');
        if !inside_a_word {
            expand(&code[at + root.len()..], "", &mut found);
        }
    }
    found
}

/// Adds the paths of the use tree at the beginning of `text`, and returns the length of the tree.
fn expand(text: &str, prefix: &str, found: &mut Vec<String>) -> usize {
    let start = text.len() - text.trim_start().len();
    let body = &text[start..];
    if let Some(group) = body.strip_prefix('{') {
        let mut at = 0;
        while at < group.len() && !group[at..].starts_with('}') {
            let taken = expand(&group[at..], prefix, found);
            at += taken.max(1);
            let gap = |c: char| c == ',' || c.is_whitespace();
            at += group[at..].len() - group[at..].trim_start_matches(gap).len();
        }
        return start + 1 + at + 1;
    }
    let end = body.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(body.len());
    let path =
        if prefix.is_empty() { body[..end].to_string() } else { format!("{prefix}::{}", &body[..end]) };
    if let Some(rest) = body[end..].strip_prefix("::") {
        let rest_is_generic = rest.starts_with('<');
        if !rest_is_generic {
            return start + end + 2 + expand(rest, &path, found);
        }
    }
    found.push(path.trim_end_matches("::").to_string());
    // A renaming is part of the tree.
    let renamed =
        body[end..].find([',', '}', ';', '\n']).filter(|_| body[end..].trim_start().starts_with("as "));
    start + end + renamed.unwrap_or(0)
}

/// Returns the first line with a chain of `super` out of the module; `depth` modules are between file and root.
fn escapes(code: &str, depth: usize) -> Option<String> {
    let mut inline = 0;
    for line in code.lines() {
        let declaration = line.trim_start().trim_start_matches("pub ");
        if declaration.starts_with("mod ") && declaration.ends_with('{') {
            inline += 1;
        }
        let mut chain = 0;
        for word in line.split("::").flat_map(words) {
            chain = if word == "super" { chain + 1 } else { 0 };
            if chain >= depth + inline && chain > 0 {
                return Some(line.trim().to_string());
            }
        }
    }
    None
}

/// Returns all Rust files below a folder, sorted.
fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    let mut entries: Vec<PathBuf> =
        fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            files.extend(rust_files(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
    files
}

/// Returns the package's files below a folder: paths relative to its root, and code.
fn code_below(folder: &str) -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let files = rust_files(&root.join(folder));
    assert!(!files.is_empty(), "{folder} holds Rust files");
    let name = |path: &Path| path.strip_prefix(root).expect("below the root").to_string_lossy().into_owned();
    files.iter().map(|p| (name(p), without_comments(&fs::read_to_string(p).expect("a text")))).collect()
}

/// Returns the modules between the crate's root and a file in `src`.
fn modules_of(file: &str) -> Vec<&str> {
    let path = file.trim_start_matches("src/").trim_end_matches(".rs");
    path.split('/').filter(|&part| part != "mod" && part != "lib").collect()
}

#[test]
fn modules_use_only_the_rows_above_their_own() {
    let mut wrong = Vec::new();
    let mut uses = 0;
    for (file, code) in code_below("src") {
        let modules = modules_of(&file);
        let Some(&module) = modules.first() else { continue };
        let root = if module == "main" { "buffon::" } else { "crate::" };
        for path in paths(&code, root) {
            uses += 1;
            wrong.extend(violation(module, &path).map(|why| format!("{file}: {why}")));
        }
        wrong.extend(
            escapes(&code, modules.len()).map(|line| format!("{file}: \"{line}\" leaves its module")),
        );
    }
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
    assert!(uses > 300, "only {uses} uses were found: the reader is blind");
}

#[test]
fn unsafe_stays_in_its_places() {
    for folder in ["src", "tests", "benches"] {
        for (file, code) in code_below(folder) {
            if !UNSAFE_PLACES.iter().any(|place| file.starts_with(place)) {
                assert!(!words(&code).any(|w| w == ["un", "safe"].concat()), "{file} is no place for it");
            }
        }
    }
}

/// Comment lines have at most 120 characters. rustfmt limits lines of code, except for long strings.
#[test]
fn comments_are_short_lines() {
    for folder in ["src", "sys", "tests", "benches", "examples"] {
        for path in rust_files(&Path::new(env!("CARGO_MANIFEST_DIR")).join(folder)) {
            let text = fs::read_to_string(&path).expect("a text");
            let mut lines = text.lines().enumerate();
            let long =
                lines.find(|(_, line)| line.chars().count() > 120 && line.trim_start().starts_with("//"));
            assert_eq!(long, None, "{}, lines counted from 0", path.display());
        }
    }
}

#[test]
fn the_reader_finds_made_up_violations() {
    let code = without_comments(
        "use crate::{bsdf::{Bsdf, self as b}, math};\npub use crate::accel::Hit; // crate::cli\n\
         let x = crate::scene::Scene::new(crate::color::Rgb::BLACK);\nuse $crate::render::Job;",
    );
    let found = paths(&code, "crate::");
    assert_eq!(
        found,
        ["bsdf::Bsdf", "bsdf::self", "math", "accel::Hit", "scene::Scene::new", "color::Rgb::BLACK"]
    );
    for (module, path, allowed) in [
        ("math", "error::Error", false),
        ("math", "math::Ray", true),
        ("compare", "estimate::metrics", true),
        ("image", "estimate::metrics", false),
        ("util", "error::Error", true),
        ("estimate", "image::Image", false),
        ("scene", "integrator::Worker", false),
        ("integrator", "accel::Hit", true),
        ("integrator", "accel::Accel", false),
        ("render", "accel::Accel", true),
        ("cli", "loader::load", true),
        ("loader", "cli", false),
        ("unheard_of", "math", false),
    ] {
        assert_eq!(violation(module, path).is_none(), allowed, "{module} uses {path}");
    }
    assert!(escapes("use super::accel;", 1).is_some());
    assert!(escapes("use super::accel;", 2).is_none());
    assert!(escapes("use super::super::accel;", 2).is_some());
    assert!(escapes("mod tests {\n    use super::*;\n}", 1).is_none());
    assert!(words("unsafe_code un-safe").all(|w| w != ["un", "safe"].concat()));
}

/// A file of tests without a `mod` declaration would never run.
#[test]
fn every_file_of_tests_is_one_of_the_modules() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests");
    let list = std::fs::read_to_string(folder.join("tests.rs")).expect("the list of modules");
    for entry in std::fs::read_dir(&folder).expect("the folder of tests") {
        let path = entry.expect("an entry").path();
        let name = path.file_stem().expect("a name").to_string_lossy().into_owned();
        let named = list.lines().any(|line| line == format!("mod {name};"));
        assert!(named || name == "tests", "tests/tests.rs lacks `mod {name};`");
    }
}
