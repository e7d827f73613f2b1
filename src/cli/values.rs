//! Values of options: durations, sizes, rectangles, definitions.

use crate::film::PixelRect;
use crate::integrator::bdpt::CONNECTIONS;
use crate::integrator::settings::WhenPays;
use crate::memory::Limit;
use crate::util;
use std::ops::Range;
use std::time::Duration;

/// Parses `90`, `90s`, `1.5m` or `2h`.
pub fn duration(text: &str) -> Result<Duration, String> {
    let (number, factor) = match text.strip_suffix(['s', 'm', 'h']) {
        Some(number) if text.ends_with('m') => (number, 60.0),
        Some(number) if text.ends_with('h') => (number, 3600.0),
        Some(number) => (number, 1.0),
        None => (text, 1.0),
    };
    match number.parse::<f64>() {
        Ok(n) if n > 0.0 && n * factor < 1e9 => Ok(Duration::from_secs_f64(n * factor)),
        _ => Err("expected a positive time such as 90s, 1.5m or 2h".into()),
    }
}

/// Parses a number of samples.
pub fn samples<const LEAST: u64>(text: &str) -> Result<u64, String> {
    match text.parse() {
        Ok(n) if n >= LEAST => Ok(n),
        _ => Err(format!("expected a whole number of at least {LEAST}")),
    }
}

/// Parses an exposure in stops.
pub fn exposure(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(stops) if stops.abs() <= 100.0 => Ok(stops),
        _ => Err("expected a number of stops from -100 to 100".into()),
    }
}

/// Parses `name=value`.
pub fn definition(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.is_empty() => Ok((name.to_string(), value.to_string())),
        _ => Err("expected name=value".into()),
    }
}

/// Parses a number of bytes: `4G`, `512M`, `1.5GiB`, `65536`; units are powers of 1024.
pub fn memory(text: &str) -> Result<Limit, String> {
    let upper = text.to_ascii_uppercase();
    let number = upper.trim_end_matches("IB").trim_end_matches('B');
    let (number, factor) = match number.strip_suffix(['K', 'M', 'G', 'T']) {
        Some(rest) => (rest, 1u64 << (10 * (1 + "KMGT".find(&number[rest.len()..]).unwrap_or(0)))),
        None => (number, 1),
    };
    match number.trim_end().parse::<f64>() {
        Ok(n) if n > 0.0 && n * (factor as f64) < 1e18 => Ok(Limit::Bytes((n * factor as f64) as u64)),
        _ => Err("expected an amount of memory such as 4G, 512M or 1.5G".into()),
    }
}

/// Parses `WIDTHxHEIGHT`.
pub fn size(text: &str) -> Result<(u32, u32), String> {
    let parsed = text.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    match parsed {
        Some((w, h)) if (1..=MAX_SIDE).contains(&w) && (1..=MAX_SIDE).contains(&h) => Ok((w, h)),
        _ => Err(format!("expected WIDTHxHEIGHT in pixels, each from 1 to {MAX_SIDE}")),
    }
}

/// Largest side of an image.
const MAX_SIDE: u32 = 65_535;

/// Parses `X,Y,WIDTH,HEIGHT`.
pub fn rect(text: &str) -> Result<PixelRect, String> {
    let numbers: Option<Vec<u32>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, width, height]) if width > 0 && height > 0 => Ok(PixelRect { x, y, width, height }),
        _ => Err("expected X,Y,WIDTH,HEIGHT in pixels from the top left corner".into()),
    }
}

/// Parses `A..B`, from A up to but not including B.
pub fn range(text: &str) -> Result<Range<u64>, String> {
    let parsed =
        text.split_once("..").and_then(|(a, b)| Some(a.trim().parse().ok()?..b.trim().parse().ok()?));
    parsed.filter(|range: &Range<u64>| !range.is_empty()).ok_or_else(|| {
        "expected A..B, two whole numbers of which the first is less: 0..64 are the first 64 samples".into()
    })
}

/// Parses the numbers of frames: `A..B` without B, or `A..=B` with it.
pub fn frames(text: &str) -> Result<Range<u64>, String> {
    let parsed = text.split_once("..").and_then(|(a, b)| {
        let end = match b.strip_prefix('=') {
            Some(last) => last.trim().parse::<u64>().ok()?.checked_add(1)?,
            None => b.trim().parse().ok()?,
        };
        Some(a.trim().parse().ok()?..end)
    });
    parsed.filter(|range: &Range<u64>| !range.is_empty()).ok_or_else(|| {
        "expected A..B or A..=B, whole numbers: 1..5 and 1..=4 are the frames 1, 2, 3 and 4".into()
    })
}

/// Parses a positive number.
pub fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if v > 0.0 && v.is_finite() => Ok(v),
        _ => Err("expected a positive number".into()),
    }
}

/// Parses the choice of connections of `bdpt`.
pub fn connections(text: &str) -> Result<WhenPays, String> {
    util::named(&CONNECTIONS, text)
        .ok_or_else(|| "expected auto or always; without connections, bdpt is path or volpath".into())
}

/// Parses a number between 0 and 1.
pub fn fraction(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if v > 0.0 && v < 1.0 => Ok(v),
        _ => Err("expected a number between 0 and 1, such as 0.01 for 1 %".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_have_units() {
        assert_eq!(duration("90"), Ok(Duration::from_secs(90)));
        assert_eq!(duration("90s"), Ok(Duration::from_secs(90)));
        assert_eq!(duration("1.5m"), Ok(Duration::from_secs(90)));
        assert_eq!(duration("2h"), Ok(Duration::from_secs(7200)));
        for bad in ["", "s", "-1", "0", "nan", "inf", "1d", "1mm", "1e30h"] {
            assert!(duration(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn amounts_of_memory_have_units() {
        for (text, bytes) in
            [("65536", 65536), ("4G", 4 << 30), ("1.5GiB", 3 << 29), ("512MB", 512 << 20), ("2k", 2048)]
        {
            assert_eq!(memory(text), Ok(Limit::Bytes(bytes)), "{text}");
        }
        for bad in ["", "G", "0", "-1M", "nan", "4X", "inf", "1e9T"] {
            assert!(memory(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn ranges_hold_something() {
        assert_eq!(range("64..128"), Ok(64..128));
        for bad in ["", "..", "5", "4..4", "5..4", "-1..4", "0..=4", "1...4"] {
            assert!(range(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn frames_may_include_the_last() {
        assert_eq!((frames("1..5"), frames("1..=4"), frames("0..=0")), (Ok(1..5), Ok(1..5), Ok(0..1)));
        for bad in ["", "4", "4..4", "4..=3", "-1..4", "1...4", "0..=18446744073709551615"] {
            assert!(frames(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn sizes_and_rectangles_are_checked() {
        assert_eq!(size("400x300"), Ok((400, 300)));
        assert!(size("0x3").is_err() && size("400").is_err() && size("70000x1").is_err());
        assert_eq!(rect("1,2,3,4"), Ok(PixelRect { x: 1, y: 2, width: 3, height: 4 }));
        assert!(rect("1,2,3").is_err() && rect("1,2,0,4").is_err() && rect("-1,2,3,4").is_err());
    }
}
