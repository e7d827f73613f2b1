//! The Markdown files of the repository.

use std::path::{Path, PathBuf};

/// A fenced block of a page.
pub struct Block {
    /// The language behind the fence.
    pub language: String,
    /// The number of its first line.
    pub line: usize,
    /// Its lines.
    pub lines: Vec<String>,
}

/// A Markdown file.
pub struct Page {
    /// Its path relative to the repository.
    pub name: String,
    /// The lines outside of fenced blocks, with their numbers.
    pub prose: Vec<(usize, String)>,
    /// The fenced blocks.
    pub blocks: Vec<Block>,
}

/// Returns the root of the repository.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

impl Page {
    fn read(path: &Path) -> Self {
        let name = path.strip_prefix(root()).expect("a file of the repository").display().to_string();
        let text = std::fs::read_to_string(path).expect("UTF-8");
        let mut page = Page { name, prose: Vec::new(), blocks: Vec::new() };
        let mut inside = false;
        for (i, line) in text.lines().enumerate() {
            let number = i + 1;
            match line.trim_start().strip_prefix("```") {
                Some(language) if !inside => {
                    let language = language.to_owned();
                    page.blocks.push(Block { language, line: number + 1, lines: Vec::new() });
                    inside = true;
                }
                Some(_) => inside = false,
                None if inside => page.blocks.last_mut().expect("a block").lines.push(line.to_owned()),
                None => page.prose.push((number, line.to_owned())),
            }
        }
        assert!(!inside, "{}: a block ends", page.name);
        page
    }

    /// Returns the text in backticks on each line of the prose.
    pub fn inline(&self) -> Vec<(usize, &str)> {
        let mut all = Vec::new();
        for (line, text) in &self.prose {
            all.extend(text.split('`').skip(1).step_by(2).map(|code| (*line, code)));
        }
        all
    }

    /// Returns the anchors of the headings, as code hosts and mdBook make them.
    pub fn anchors(&self) -> Vec<String> {
        let mut anchors: Vec<String> = Vec::new();
        for (_, line) in &self.prose {
            let heading = line.trim_start_matches('#');
            if heading.len() == line.len() || !heading.starts_with(' ') {
                continue;
            }
            let kept = heading.trim().chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
            let anchor: String = kept.flat_map(char::to_lowercase).collect::<String>().replace(' ', "-");
            let before = anchors.iter().filter(|other| **other == anchor).count();
            anchors.push(if before > 0 { format!("{anchor}-{before}") } else { anchor });
        }
        anchors
    }
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a folder").flatten() {
        let path = entry.path();
        if path.is_dir() {
            collect(&path, files);
        } else if path.extension().is_some_and(|extension| extension == "md") {
            files.push(path);
        }
    }
}

/// Reads the pages: those in the root of the repository, in `docs` and in `scenes`.
pub fn pages() -> Vec<Page> {
    let mut files = Vec::new();
    for folder in ["docs", "scenes"] {
        collect(&root().join(folder), &mut files);
    }
    for name in ["README.md", "CONTRIBUTING.md", "ARCHITECTURE.md", "CHANGELOG.md"] {
        files.push(root().join(name));
    }
    files.sort();
    files.iter().map(|path| Page::read(path)).collect()
}
