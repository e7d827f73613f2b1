//! Texts of a file in error sentences: quoted, and with the nearest known name to an unknown one.

/// A text in quotes, cut where it is long.
pub fn quoted(text: &str) -> String {
    match text.char_indices().nth(60) {
        Some((end, _)) => format!("\"{}…\"", &text[..end]),
        None => format!("\"{text}\""),
    }
}

/// ` (did you mean "roughconductor"?)` where a known name is near enough to what was written, else nothing.
pub fn did_you_mean<'a>(found: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    match nearest(found, known) {
        Some(name) => format!(" (did you mean \"{name}\"?)"),
        None => String::new(),
    }
}

/// The known name with the fewest typing errors to the one found, if they are few for its length.
fn nearest<'a>(found: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let found = found.to_lowercase();
    if found.len() > 100 {
        return None;
    }
    let distance = |name: &str| strsim::damerau_levenshtein(&found, &name.to_lowercase());
    let (best, name) = known.into_iter().map(|name| (distance(name), name)).min()?;
    (best <= 1 + name.len().min(found.len()) / 4).then_some(name)
}

/// Returns a number as a percentage: `0.40 %`.
pub fn percent(x: f64) -> String {
    let percent = 100.0 * x;
    if percent >= 0.01 { format!("{percent:.2} %") } else { format!("{percent:.1e} %") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_names_are_proposed_and_far_ones_are_not() {
        let known = ["diffuse", "conductor", "roughconductor"];
        assert_eq!(did_you_mean("difuse", known), " (did you mean \"diffuse\"?)");
        assert_eq!(did_you_mean("RoughConducter", known), " (did you mean \"roughconductor\"?)");
        assert_eq!(did_you_mean("hair", known), "");
        assert_eq!(did_you_mean(&"x".repeat(1000), known), "");
    }
}
