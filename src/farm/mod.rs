//! Renders as many tasks for engines that run jobs on many machines.
//!
//! An image is split into ranges of samples, and into regions if it is asked for. A task renders one range of a region
//! to a checkpoint, and goes on from it if it is started again. A merge adds the checkpoints of an image. Both are
//! command lines of `buffon`; an engine decides where and when they run. The merged image has the same bits as that of
//! one render.

mod engine;

pub use engine::Engine;

use crate::error::{Error, Result};
use crate::film::PixelRect;
use crate::util::{relative, replace};
use std::borrow::Cow;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// An image that is rendered as several tasks.
#[derive(Clone, Debug)]
pub struct SplitImage {
    /// The name of its files, without extension.
    pub name: String,
    /// The arguments of `buffon render`: the scene and the options that determine the image, with the samples.
    pub arguments: Vec<String>,
    /// The hash of the scene and the view.
    pub hash: String,
    /// The number of samples per pixel.
    pub samples: u64,
    /// The regions of the image; empty if it is not divided.
    pub regions: Vec<PixelRect>,
}

/// Images and the folder of their tasks, as seen from the current directory.
#[derive(Clone, Debug)]
pub struct Farm {
    /// The folder.
    pub folder: PathBuf,
    /// The images.
    pub images: Vec<SplitImage>,
    /// The greatest number of tasks of an image.
    pub tasks: u64,
}

/// A command, as a line of a shell script.
struct Line {
    /// The file that exists when the command has succeeded.
    done: PathBuf,
    /// The command without the name of the program, with quotes where a shell needs them.
    text: String,
}

impl Farm {
    /// The file with the command of each task, and the one with the merges.
    const TASKS: &str = "tasks.txt";
    const MERGES: &str = "merges.txt";

    /// Writes the files of an engine to the folder, which must not exist or be empty. Returns the command that starts
    /// it.
    ///
    /// # Errors
    /// If the folder is not empty, a file cannot be written, or two images have the same name.
    pub fn write(&self, engine: Engine) -> Result<String> {
        let failed = |e: std::io::Error| Error::output(e.to_string()).in_file(&self.folder);
        for (i, image) in self.images.iter().enumerate() {
            if self.images[..i].iter().any(|earlier| earlier.name == image.name) {
                return Err(Error::usage(format!(
                    "two images would be called {}: plan them in different folders",
                    image.name
                )));
            }
        }
        for image in &self.images {
            std::fs::create_dir_all(self.parts(image)).map_err(failed)?;
        }
        std::fs::create_dir_all(self.folder.join("images")).map_err(failed)?;
        let text = |lines: &[Line]| lines.iter().map(|line| format!("{PROGRAM} {}\n", line.text)).collect();
        let lists: [(&str, String); 2] =
            [(Self::TASKS, text(&self.task_lines()?)), (Self::MERGES, text(&self.merge_lines()?))];
        let scripts = engine.scripts(self)?;
        for (name, text) in lists.into_iter().chain(scripts) {
            replace(&self.folder.join(name), text.as_bytes())?;
        }
        Ok(engine.start(&quoted(&self.folder)?))
    }

    /// Checks that the folder can be used.
    ///
    /// # Errors
    /// If there is something in it already.
    pub fn check_folder(folder: &Path) -> Result<()> {
        let is_empty = match std::fs::read_dir(folder) {
            Ok(mut entries) => entries.next().is_none(),
            Err(e) => e.kind() == std::io::ErrorKind::NotFound,
        };
        match is_empty {
            true => Ok(()),
            false => Err(Error::usage(format!(
                "--dir {}: expected a new or empty folder, so that tasks of different plans are not mixed",
                folder.display()
            ))),
        }
    }

    /// Returns the number of tasks of all images.
    pub fn task_count(&self) -> usize {
        self.images.iter().map(|image| self.pieces(image).len()).sum()
    }

    /// Returns what the tasks of an image render: a region, or the whole image, and a range of samples.
    fn pieces(&self, image: &SplitImage) -> Vec<(Option<PixelRect>, Range<u64>)> {
        let ranges = ranges(image.samples, self.tasks.div_ceil(image.regions.len().max(1) as u64));
        let of = |region: Option<PixelRect>| ranges.iter().map(move |range| (region, range.clone()));
        match image.regions.is_empty() {
            true => of(None).collect(),
            false => image.regions.iter().flat_map(|region| of(Some(*region))).collect(),
        }
    }

    /// Returns the current directory as seen from the folder.
    fn back(&self) -> Result<String> {
        quoted(&relative(Path::new("."), &self.folder))
    }

    /// Returns the folder of the checkpoints of an image.
    fn parts(&self, image: &SplitImage) -> PathBuf {
        self.folder.join("parts").join(&image.name)
    }

    /// Returns the tasks of all images.
    fn task_lines(&self) -> Result<Vec<Line>> {
        let mut lines = Vec::new();
        for image in &self.images {
            for (i, (region, range)) in self.pieces(image).into_iter().enumerate() {
                let checkpoint = self.parts(image).join(format!("{i:05}.sums"));
                let mut words: Vec<Cow<'_, str>> = vec!["render".into()];
                words.extend(image.arguments.iter().map(|argument| argument.as_str().into()));
                if let Some(region) = region {
                    words.extend(["--crop".into(), region.to_string().into()]);
                }
                words.extend(["--sample-range".into(), format!("{}..{}", range.start, range.end).into()]);
                words.extend(["--scene-hash".into(), image.hash.as_str().into(), "--no-image".into()]);
                words.extend(["--resume".into(), "--checkpoint".into(), checkpoint.to_string_lossy()]);
                lines.push(Line { text: joined(&words)?, done: checkpoint.with_extension("done") });
            }
        }
        Ok(lines)
    }

    /// Returns the merges of all images, each of all checkpoints in a folder.
    fn merge_lines(&self) -> Result<Vec<Line>> {
        let line = |image: &SplitImage| {
            let parts = quoted(&self.parts(image))?;
            let output = self.folder.join("images").join(format!("{}.exr", image.name));
            let text = format!("merge --strict -o {} {parts}", quoted(&output)?);
            Ok(Line { text, done: output })
        };
        self.images.iter().map(line).collect()
    }
}

/// The program in scripts: the one that the environment names, or the first `buffon` on the path.
const PROGRAM: &str = "\"${BUFFON:-buffon}\"";

/// Divides samples into at most `tasks` ranges. All but the last have an even length, so that both halves of the
/// samples are equal, from which the error is estimated.
fn ranges(samples: u64, tasks: u64) -> Vec<Range<u64>> {
    let pairs = samples.div_ceil(2);
    let tasks = tasks.min(pairs);
    let wide = u128::from;
    let end = |i: u64| (wide(pairs) * wide(i) / wide(tasks) * 2).min(wide(samples)) as u64;
    (0..tasks).map(|i| end(i)..end(i + 1)).collect()
}

/// Returns words as part of a shell command.
fn joined<'a>(words: impl IntoIterator<Item = &'a Cow<'a, str>>) -> Result<String> {
    shlex::try_join(words.into_iter().map(|word| &**word))
        .map_err(|_| Error::usage("a NUL cannot be part of a command"))
}

/// Returns a path as part of a shell command.
fn quoted(path: &Path) -> Result<String> {
    joined(&[path.to_string_lossy()])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_cover_all_samples_in_even_steps() {
        assert_eq!(ranges(64, 4), [0..16, 16..32, 32..48, 48..64]);
        assert_eq!(ranges(7, 3), [0..2, 2..4, 4..7]);
        assert_eq!(ranges(3, 100), [0..2, 2..3]);
        assert!(ranges(1, 1).into_iter().eq(std::iter::once(0..1)));
        for (samples, tasks) in [(1000, 7), (u64::MAX, 3), (1 << 40, 1000), (5, 5)] {
            let all = ranges(samples, tasks);
            assert!(all.len() as u64 <= tasks && all[0].start == 0 && all[all.len() - 1].end == samples);
            for pair in all.windows(2) {
                assert!(pair[0].end == pair[1].start && pair[0].end % 2 == 0 && !pair[0].is_empty());
            }
        }
    }

    #[test]
    fn a_shell_gets_words_as_they_are() {
        let words = ["a b", "$HOME", "it's", "--size=4x4", "*"].map(Cow::from);
        assert_eq!(shlex::split(&joined(&words).expect("words")).expect("words"), words);
        assert!(joined(&[Cow::from("a\0b")]).is_err());
    }
}
