//! Relative links and anchors of the Markdown files, and the table of contents of the book.

use crate::support::docs::{Page, pages, root};
use std::path::{Component, Path, PathBuf};

/// Returns the targets of the links and pictures of a line, without those in backticks.
fn targets(line: &str) -> Vec<String> {
    let prose: String = line.split('`').step_by(2).collect::<Vec<_>>().join("x");
    let parts = prose.split("](").skip(1);
    parts.filter_map(|part| part.split_once(')').map(|(target, _)| target.to_owned())).collect()
}

/// Returns a path without `.` and `..`.
fn plain(path: &Path) -> PathBuf {
    let mut out = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => assert!(out.pop(), "{}: outside of the repository", path.display()),
            Component::CurDir => {}
            part => out.push(part),
        }
    }
    out
}

/// Returns what is wrong with a link of a page.
fn problem(page: &Page, target: &str, all: &[Page]) -> Option<String> {
    if target.starts_with("https://") || target.starts_with("http://") {
        return None;
    }
    let (file, anchor) = target.split_once('#').map_or((target, None), |(file, anchor)| (file, Some(anchor)));
    let path = match file {
        "" => PathBuf::from(&page.name),
        _ => plain(&Path::new(&page.name).parent().expect("a folder").join(file)),
    };
    if !root().join(&path).exists() {
        return Some("there is no such file".to_owned());
    }
    let anchor = anchor?;
    match all.iter().find(|other| Path::new(&other.name) == path) {
        Some(other) if other.anchors().iter().any(|known| known == anchor) => None,
        _ => Some(format!("there is no heading {anchor}")),
    }
}

#[test]
fn links_of_the_documentation_resolve() {
    let all = pages();
    let mut wrong = Vec::new();
    let mut links = 0;
    for page in &all {
        for (line, text) in &page.prose {
            for target in targets(text) {
                links += 1;
                wrong.extend(
                    problem(page, &target, &all).map(|p| format!("{}:{line}: {target}: {p}", page.name)),
                );
            }
        }
    }
    assert!(links > 300, "{links} links");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_page_is_in_the_book() {
    let all = pages();
    let summary = all.iter().find(|page| page.name == "docs/SUMMARY.md").expect("the table of contents");
    let in_book: Vec<PathBuf> = summary
        .prose
        .iter()
        .flat_map(|(_, line)| targets(line))
        .map(|target| plain(&Path::new("docs").join(target)))
        .collect();
    let missing: Vec<&str> = all
        .iter()
        .map(|page| page.name.as_str())
        .filter(|name| *name != "docs/SUMMARY.md" && !in_book.contains(&PathBuf::from(name)))
        .collect();
    assert_eq!(missing, Vec::<&str>::new(), "pages that are not in docs/SUMMARY.md");
}

#[test]
fn pictures_of_the_gallery_are_small_and_used() {
    let all = pages();
    let used: Vec<PathBuf> = all
        .iter()
        .flat_map(|page| page.prose.iter().map(move |(_, line)| (page, line)))
        .flat_map(|(page, line)| targets(line).into_iter().map(move |target| (page, target)))
        .filter(|(_, target)| target.ends_with(".jpg"))
        .map(|(page, target)| plain(&Path::new(&page.name).parent().expect("a folder").join(target)))
        .collect();
    let mut total = 0;
    for entry in std::fs::read_dir(root().join("docs/gallery")).expect("the gallery").flatten() {
        let path = entry.path();
        if path.extension().is_some_and(|extension| extension == "jpg") {
            let bytes = entry.metadata().expect("a file").len();
            assert!(bytes < 100_000, "{}: {bytes} bytes", path.display());
            total += bytes;
            let name = path.strip_prefix(root()).expect("a file of the repository");
            assert!(used.iter().any(|used| used == name), "{} is in no document", name.display());
        }
    }
    assert!((100_000..3_000_000).contains(&total), "{total} bytes");
}
