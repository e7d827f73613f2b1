//! Frames of an animation: one render for each value of the scene's parameter `frame`.

use super::render::RenderArgs;
use crate::error::{Error, Result};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// The parameter of the scene that is the number of the frame.
pub const PARAMETER: &str = "frame";
/// The digits of the number in the default name of an image.
pub const DIGITS: usize = 4;

/// Returns the options of each frame, in order.
///
/// # Errors
/// If frames would overwrite each other's files.
pub fn of(args: &RenderArgs, frames: Range<u64>, default_output: &Path) -> Result<Vec<RenderArgs>> {
    let mut args = args.clone();
    args.resources.define.retain(|(name, _)| name != PARAMETER);
    if args.output.is_empty() && !args.no_image {
        args.output = vec![default_output.with_extension(format!("{{frame:0{DIGITS}}}.exr"))];
    }
    let options = [("--stats", &args.stats), ("--checkpoint", &args.checkpoint), ("--cache", &args.cache)];
    let options = options.into_iter().flat_map(|(option, file)| Some(option).zip(file.as_ref()));
    for (option, file) in args.output.iter().map(|file| ("-o", file)).chain(options) {
        if number(file, 0)? == *file {
            return Err(Error::usage(format!(
                "{option} {}: with --frames, expected {{frame}} in the name, which becomes the number of the frame",
                file.display()
            )));
        }
    }
    let of_frame = |frame: u64| {
        let mut args = args.clone();
        args.frames = Some(frame..frame + 1);
        args.resources.define.push(parameter(frame));
        for file in [&mut args.stats, &mut args.checkpoint, &mut args.cache].into_iter().flatten() {
            *file = number(file, frame)?;
        }
        for file in &mut args.output {
            *file = number(file, frame)?;
        }
        Ok(args)
    };
    frames.map(of_frame).collect()
}

/// Returns the definition of the scene's parameter for a frame.
pub fn parameter(frame: u64) -> (String, String) {
    (PARAMETER.into(), frame.to_string())
}

/// Checks that the frames of a scene differ, given the warnings of its loader.
///
/// # Errors
/// If the scene does not use the number of the frame.
pub fn check(warnings: &[Error]) -> Result<()> {
    match warnings.iter().any(|warning| warning.thing.starts_with(&format!("-D {PARAMETER}="))) {
        true => Err(Error::scene(format!(
            "--frames: the scene never uses ${PARAMETER}: its frames are all the same"
        ))),
        false => Ok(()),
    }
}

/// Returns the name with the number of a frame instead of `{frame}`, or with leading zeros instead of `{frame:04}`.
fn number(file: &Path, frame: u64) -> Result<PathBuf> {
    let name = file.to_string_lossy();
    let mut parts = name.split("{frame");
    let mut result = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let numbered = part.split_once('}').and_then(|(format, rest)| {
            let digits = match format.strip_prefix(":0") {
                Some(digits) => digits.parse::<u8>().ok()?,
                None => format.is_empty().then_some(0)?,
            };
            Some(format!("{frame:0width$}{rest}", width = usize::from(digits)))
        });
        let wrong =
            || Error::usage(format!("{name}: expected {{frame}} or, with leading zeros, {{frame:04}}"));
        result += &numbered.ok_or_else(wrong)?;
    }
    Ok(result.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_have_the_number_of_the_frame() {
        let name = |text: &str| number(Path::new(text), 7).map(|path| path.display().to_string());
        assert_eq!(name("a.exr").expect("a name"), "a.exr");
        assert_eq!(name("{frame}/a-{frame:04}.exr").expect("a name"), "7/a-0007.exr");
        for wrong in ["a{frame.exr", "a{frame:4}.exr", "a{frame:0}.exr", "a{frames}.exr", "a{frame:0x}.exr"] {
            assert!(name(wrong).is_err(), "{wrong}");
        }
    }
}
