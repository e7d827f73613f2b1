//! Checks the links of the built book: every file that a page names exists, and every anchor is an `id` of its page.
//!
//! `cargo run --example check_book -- out/book`. The page for printing repeats all others and is left out, as is that
//! for missing pages, whose links depend on the server.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};
use std::process::ExitCode;

/// The pages that are not checked.
const LEFT_OUT: [&str; 3] = ["print.html", "404.html", "toc.html"];

/// The links and anchors of a page.
struct Page {
    links: BTreeSet<String>,
    anchors: BTreeSet<String>,
}

/// Returns the values of an attribute of the elements of a page.
fn attributes(html: &str, name: &str) -> BTreeSet<String> {
    let start = format!(" {name}=\"");
    let parts = html.split(&start).skip(1);
    let values = parts.filter_map(|part| part.split_once('"').map(|(value, _)| value.replace("&amp;", "&")));
    values.filter(|value| !value.is_empty()).collect()
}

/// Returns a path without `.` and `..`.
fn plain(path: &Path) -> PathBuf {
    let mut out = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => _ = out.pop(),
            Component::CurDir => {}
            part => out.push(part),
        }
    }
    out
}

/// Returns the text of a link without its percent signs.
fn decoded(link: &str) -> String {
    let mut bytes = Vec::new();
    let mut rest = link.as_bytes();
    while let [first, tail @ ..] = rest {
        let code = tail.get(..2).and_then(|code| std::str::from_utf8(code).ok());
        match code.filter(|_| *first == b'%').and_then(|code| u8::from_str_radix(code, 16).ok()) {
            Some(byte) => {
                bytes.push(byte);
                rest = &tail[2..];
            }
            None => {
                bytes.push(*first);
                rest = tail;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

fn read(folder: &Path, pages: &mut BTreeMap<PathBuf, Page>) -> std::io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            read(&path, pages)?;
        } else if path.extension().is_some_and(|extension| extension == "html") {
            let html = std::fs::read_to_string(&path)?;
            let mut links = attributes(&html, "href");
            links.extend(attributes(&html, "src"));
            pages.insert(path, Page { links, anchors: attributes(&html, "id") });
        }
    }
    Ok(())
}

/// Returns what is wrong with a link of a page.
fn problem(page: &Path, link: &str, pages: &BTreeMap<PathBuf, Page>) -> Option<&'static str> {
    let is_elsewhere =
        ["http://", "https://", "mailto:", "data:", "javascript:"].iter().any(|s| link.starts_with(s));
    if is_elsewhere || link == "#" {
        return None;
    }
    let link = decoded(link);
    let (file, anchor) =
        link.split_once('#').map_or((link.as_str(), None), |(file, anchor)| (file, Some(anchor)));
    let target = match file {
        "" => page.to_path_buf(),
        _ => plain(&page.parent().expect("a folder").join(file)),
    };
    match (target.is_file(), anchor, pages.get(&target)) {
        (false, ..) => Some("there is no such file"),
        (true, Some(anchor), Some(page)) if !page.anchors.contains(anchor) => Some("there is no such anchor"),
        _ => None,
    }
}

fn main() -> ExitCode {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| "out/book".to_owned()));
    let mut pages = BTreeMap::new();
    if let Err(error) = read(&folder, &mut pages) {
        eprintln!("{}: {error}", folder.display());
        return ExitCode::FAILURE;
    }
    let (mut links, mut wrong) = (0, 0);
    for (path, page) in &pages {
        if LEFT_OUT.iter().any(|name| path.ends_with(name)) {
            continue;
        }
        for link in &page.links {
            links += 1;
            if let Some(problem) = problem(path, link, &pages) {
                println!("{}: {link}: {problem}", path.display());
                wrong += 1;
            }
        }
    }
    println!("{} pages, {links} links, {wrong} wrong", pages.len());
    if wrong > 0 || links == 0 { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}
