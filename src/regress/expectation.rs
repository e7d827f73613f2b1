//! The values that a scene must show and that are known without a reference: `NAME.toml` beside the scene.

use crate::error::{Error, Place, Result};
use crate::film::PixelRect;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use toml::{Spanned, Value};

/// The names of traversals that [`Known::accels`] may contain.
pub const TRAVERSALS: [&str; 3] = ["embree", "obvhs", "list"];

/// The cases of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Expectations {
    /// The subject of the cases, for the heading of a table.
    pub about: String,
    /// The cases, in the order of the file.
    pub cases: Vec<Case>,
}

/// A variant of a scene, and its expected value.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// The case's name, which is unique within the scene.
    pub name: String,
    /// The derivation of the expected value, with the formula.
    pub why: String,
    /// Values for the scene's `<default>`s.
    pub defines: Vec<(String, String)>,
    /// The integrators that claim the case; if empty, the scene's own.
    pub integrators: Vec<String>,
    /// Samples per pixel; `None` for the scene's own number.
    pub samples: Option<u64>,
    /// The part of the image whose mean is measured; `None` for the whole image.
    pub pixels: Option<PixelRect>,
    /// The claim about that mean.
    pub claim: Claim,
    /// The largest accepted relative difference of any pixel from the expected value, including noise.
    pub pixels_within: Option<f64>,
    /// The known failures.
    pub known: Vec<Known>,
}

/// A claim about the mean of a part of the image.
#[derive(Clone, Debug, PartialEq)]
pub enum Claim {
    /// The mean is a value, within a relative error.
    Value {
        /// The value of each channel.
        expected: [f64; 3],
        /// The largest relative error.
        within: f64,
    },
    /// The mean is between bounds.
    Between {
        /// The lower bounds.
        low: [f64; 3],
        /// The upper bounds.
        high: [f64; 3],
    },
    /// The scene is refused with a message that contains this text.
    Refused(String),
    /// The image is that of another variant of the scene.
    SameAs {
        /// Values for the `<default>`s of that variant.
        defines: Vec<(String, String)>,
        /// The largest detectable gain with which the comparison is accepted.
        within: f64,
    },
}

/// A known failure and its cause.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Known {
    /// The traversals on which it occurs; if empty, all.
    pub accels: Vec<String>,
    /// The integrators with which it occurs; if empty, all.
    pub integrators: Vec<String>,
    /// The cause and the effect.
    pub why: String,
}

impl Known {
    /// Returns whether the failure applies to an integrator.
    pub fn is_about(&self, integrator: &str) -> bool {
        self.integrators.is_empty() || self.integrators.iter().any(|i| i == integrator)
    }

    /// Returns whether the failure applies to a traversal.
    pub fn is_on(&self, accel: &str) -> bool {
        self.accels.is_empty() || accel.split('+').any(|part| self.accels.iter().any(|a| a == part))
    }
}

/// Returns the path of a scene's cases: `NAME.toml` beside it.
pub fn expectations_path(scene: &Path) -> PathBuf {
    scene.with_extension("toml")
}

impl Expectations {
    /// Reads the cases of a scene; returns `None` if there are none.
    ///
    /// # Errors
    /// If the file exists but cannot be read, or has an error.
    pub fn read(scene: &Path) -> Result<Option<Expectations>> {
        let path = expectations_path(scene);
        if !path.exists() {
            return Ok(None);
        }
        let text = fs::read_to_string(&path)
            .map_err(|e| Error::scene(format!("cannot be read: {e}")).in_file(&path))?;
        Self::parse(&text, &path).map(Some)
    }

    fn parse(text: &str, path: &Path) -> Result<Expectations> {
        let file: FileText = toml::from_str(text).map_err(|e| {
            let error = Error::scene(e.message());
            match e.span() {
                Some(span) => error.at(place(text, path, span.start)),
                None => error.in_file(path),
            }
        })?;
        let mut cases: Vec<Case> = Vec::new();
        for spanned in &file.case {
            let start = spanned.span().start;
            let fault =
                |message: String| Error::scene(message).about("[[case]]").at(place(text, path, start));
            let case = case(&file, spanned.get_ref()).map_err(fault)?;
            if cases.iter().any(|other| other.name == case.name) {
                return Err(fault(format!(
                    "name: expected another than any before, found \"{}\"",
                    case.name
                )));
            }
            cases.push(case);
        }
        if cases.is_empty() {
            return Err(Error::scene("expected a [[case]], found none").in_file(path));
        }
        Ok(Expectations { about: file.about, cases })
    }
}

/// The contents of the file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FileText {
    about: String,
    #[serde(default)]
    integrators: Vec<String>,
    within: Option<f64>,
    spp: Option<u64>,
    #[serde(default)]
    case: Vec<Spanned<CaseText>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CaseText {
    name: String,
    why: String,
    #[serde(default)]
    define: BTreeMap<String, Value>,
    integrators: Option<Vec<String>>,
    spp: Option<u64>,
    pixels: Option<[u32; 4]>,
    expect: Option<Colour>,
    between: Option<[Colour; 2]>,
    same_as: Option<BTreeMap<String, Value>>,
    refused: Option<String>,
    within: Option<f64>,
    pixels_within: Option<f64>,
    #[serde(default)]
    known: Vec<KnownText>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct KnownText {
    #[serde(default)]
    accels: Vec<String>,
    #[serde(default)]
    integrators: Vec<String>,
    why: String,
}

/// One number for all channels, or one for each.
#[derive(Clone, Copy, Deserialize)]
#[serde(untagged)]
enum Colour {
    Grey(f64),
    Rgb([f64; 3]),
}

impl Colour {
    fn channels(self) -> [f64; 3] {
        match self {
            Colour::Grey(v) => [v; 3],
            Colour::Rgb(v) => v,
        }
    }
}

/// Checks a case, together with the settings of the file that apply to all cases.
fn case(file: &FileText, text: &CaseText) -> Result<Case, String> {
    for (key, value) in [("name", &text.name), ("why", &text.why)] {
        if value.trim().is_empty() {
            return Err(format!("{key}: expected a text, found \"{value}\""));
        }
    }
    let samples = text.spp.or(file.spp);
    if let Some(n) = samples.filter(|n| *n < 2) {
        return Err(format!("spp: expected at least 2, found {n}"));
    }
    let pixels = text.pixels.map(|[x, y, width, height]| PixelRect { x, y, width, height });
    if let Some(rect) = pixels.filter(|r| r.width == 0 || r.height == 0) {
        return Err(format!(
            "pixels: expected [x, y, width, height], found {}x{} pixels",
            rect.width, rect.height
        ));
    }
    let known = text.known.iter().map(|known| {
        let unknown = known.accels.iter().find(|name| !TRAVERSALS.contains(&name.as_str()));
        match unknown {
            Some(name) => {
                Err(format!("known: expected of accels {}, found \"{name}\"", TRAVERSALS.join(", ")))
            }
            None => Ok(Known {
                accels: known.accels.clone(),
                integrators: known.integrators.clone(),
                why: known.why.clone(),
            }),
        }
    });
    let claim = claim(file, text)?;
    let pixels_within = text.pixels_within.map(|v| positive("pixels_within", v)).transpose()?;
    if pixels_within.is_some() && !matches!(claim, Claim::Value { .. }) {
        return Err("pixels_within: expected `expect` beside it, which it is relative to".into());
    }
    Ok(Case {
        name: text.name.clone(),
        why: text.why.clone(),
        defines: definitions(&text.define)?,
        integrators: text.integrators.clone().unwrap_or_else(|| file.integrators.clone()),
        samples,
        pixels,
        claim,
        pixels_within,
        known: known.collect::<Result<_, _>>()?,
    })
}

/// Returns the claim of a case, which must be exactly one of four.
fn claim(file: &FileText, text: &CaseText) -> Result<Claim, String> {
    let within = || match text.within.or(file.within) {
        Some(within) => positive("within", within),
        None => Err("expected `within`, the largest relative error, in the case or at the top".to_owned()),
    };
    let finite = |key: &str, v: [f64; 3]| match v.iter().find(|v| !v.is_finite()) {
        Some(v) => Err(format!("{key}: expected a finite number, found {v}")),
        None => Ok(v),
    };
    match (text.expect, text.between, &text.same_as, &text.refused) {
        (Some(value), None, None, None) => {
            Ok(Claim::Value { expected: finite("expect", value.channels())?, within: within()? })
        }
        (None, Some(bounds), None, None) => {
            let [low, high] = bounds.map(Colour::channels);
            let (low, high) = (finite("between", low)?, finite("between", high)?);
            if low.iter().zip(&high).any(|(low, high)| low > high) {
                return Err("between: expected the lower bound first".into());
            }
            Ok(Claim::Between { low, high })
        }
        (None, None, Some(defines), None) => {
            Ok(Claim::SameAs { defines: definitions(defines)?, within: within()? })
        }
        (None, None, None, Some(sentence)) => Ok(Claim::Refused(sentence.clone())),
        _ => Err("expected one of `expect`, `between`, `same_as` and `refused`".into()),
    }
}

fn positive(key: &str, value: f64) -> Result<f64, String> {
    if value > 0.0 && value.is_finite() {
        Ok(value)
    } else {
        Err(format!("{key}: expected a positive number, found {value}"))
    }
}

/// Returns definitions in the form of the command line.
fn definitions(table: &BTreeMap<String, Value>) -> Result<Vec<(String, String)>, String> {
    let text = |(name, value): (&String, &Value)| match value {
        Value::String(text) => Ok((name.clone(), text.clone())),
        Value::Integer(n) => Ok((name.clone(), n.to_string())),
        Value::Float(v) => Ok((name.clone(), v.to_string())),
        Value::Boolean(v) => Ok((name.clone(), v.to_string())),
        other => {
            Err(format!("{name}: expected a number, a text or a truth value, found {}", other.type_str()))
        }
    };
    table.iter().map(text).collect()
}

/// Returns the position of a byte of a text, as a place in the file.
fn place(text: &str, path: &Path, at: usize) -> Place {
    let before = text.get(..at).unwrap_or(text);
    let start = before.rfind('\n').map_or(0, |i| i + 1);
    Place {
        file: path.to_path_buf(),
        line: before.matches('\n').count() as u32 + 1,
        column: before[start..].chars().count() as u32 + 1,
        text: text[start..].lines().next().unwrap_or_default().to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Expectations> {
        Expectations::parse(text, Path::new("s.toml"))
    }

    #[test]
    fn cases_have_what_they_say_and_what_the_file_says_for_all() {
        let text = "about = 'Furnace'\nintegrators = ['path', 'direct']\nwithin = 0.01\nspp = 32\n\
            [[case]]\nname = 'a'\nwhy = 'L = E/(1 - r)'\nexpect = 1\n\
            [[case]]\nname = 'b'\nwhy = 'x'\nbetween = [0, [0.1, 0.2, 0.3]]\nspp = 8\npixels = [1, 2, 3, 4]\n\
            integrators = ['path']\ndefine = { x = 1e-6, n = 3, s = 'text', on = true }\n\
            known = [{ accels = ['embree'], why = 'rounding' }]\n\
            [[case]]\nname = 'c'\nwhy = 'x'\nsame_as = { x = 0.5 }\nwithin = 0.1\n";
        let found = parse(text).unwrap();
        let [a, b, c] = <[Case; 3]>::try_from(found.cases).unwrap();
        assert_eq!(a.claim, Claim::Value { expected: [1.0; 3], within: 0.01 });
        assert_eq!((a.samples, a.integrators.len(), a.pixels), (Some(32), 2, None));
        assert_eq!(b.claim, Claim::Between { low: [0.0; 3], high: [0.1, 0.2, 0.3] });
        assert_eq!((b.samples, b.integrators.len()), (Some(8), 1));
        let defines: Vec<_> = b.defines.iter().map(|(n, v)| (n.as_str(), v.as_str())).collect();
        assert_eq!(defines, [("n", "3"), ("on", "true"), ("s", "text"), ("x", "0.000001")]);
        assert!(b.known[0].is_on("embree") && !b.known[0].is_on("list") && b.known[0].is_about("path"));
        let defines = vec![("x".to_owned(), "0.5".to_owned())];
        assert_eq!(c.claim, Claim::SameAs { defines, within: 0.1 });
    }

    #[test]
    fn mistakes_are_said_where_they_are() {
        let case = |more: &str| format!("about = ''\n[[case]]\nname = 'a'\nwhy = 'x'\n{more}\n");
        let says = |text: &str| parse(text).unwrap_err().to_string();
        assert_eq!(says("about = ''"), "s.toml: expected a [[case]], found none");
        let at = "s.toml:2:1: [[case]]: ";
        for (more, sentence) in [
            ("", "expected one of `expect`, `between`, `same_as` and `refused`"),
            ("expect = 1", "expected `within`, the largest relative error, in the case or at the top"),
            ("expect = nan\nwithin = 1", "expect: expected a finite number, found NaN"),
            ("expect = 1\nwithin = 0", "within: expected a positive number, found 0"),
            ("between = [1, 0]", "between: expected the lower bound first"),
            ("between = [0, 1]\nspp = 1", "spp: expected at least 2, found 1"),
            (
                "between = [0, 1]\npixels_within = 1",
                "pixels_within: expected `expect` beside it, which it is relative to",
            ),
            (
                "between = [0, 1]\nknown = [{ accels = ['bvh'], why = '' }]",
                "known: expected of accels embree, obvhs, list, found \"bvh\"",
            ),
            (
                "between = [0, 1]\ndefine = { x = [1] }",
                "x: expected a number, a text or a truth value, found array",
            ),
            ("between = [0, 1]\n[[case]]\nname = 'a'\nwhy = 'x'\nbetween = [0, 1]", ""),
        ] {
            let said = says(&case(more));
            if sentence.is_empty() {
                assert!(
                    said.starts_with("s.toml:6:1: [[case]]: name: expected another than any before"),
                    "{said}"
                );
            } else {
                assert_eq!(said.lines().next(), Some(format!("{at}{sentence}").as_str()));
            }
        }
        let said = says("about = 'x'\nwithn = 3\n");
        assert!(said.starts_with("s.toml:2:1: unknown field `withn`"), "{said}");
        assert!(says("about = 'x\n").starts_with("s.toml:1:"), "{}", says("about = 'x\n"));
    }
}
