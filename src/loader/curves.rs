//! Files of curves: control points of Mitsuba 3's `linearcurve` and `bsplinecurve`, and hair of Mitsuba 0.6.

use crate::error::{Error, Place, Result, counted};
use crate::math::Vec3;
use crate::memory::{Budget, Refusal};
use crate::shape::{CurvePoint, Curves};
use std::path::Path;

/// The first bytes of a binary file of hair.
const BINARY: &[u8] = b"BINARY_HAIR";
/// The bytes of a point or segment, with its tangent.
const BYTES_PER_POINT: u64 = 32;

/// How the points of a file are connected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CurveFormat {
    /// Lines of a position and a radius, connected by straight segments.
    Linear,
    /// Lines of a position and a radius, which are control points of cubic B-splines.
    BSpline,
    /// Positions, connected by straight segments of this radius.
    Hair {
        /// The radius of all hairs.
        radius: f32,
    },
}

impl CurveFormat {
    /// Returns the least number of points of a curve.
    fn least_points(self) -> usize {
        match self {
            CurveFormat::Linear => 2,
            CurveFormat::BSpline => 4,
            // A hair of one point is invisible and valid.
            CurveFormat::Hair { .. } => 1,
        }
    }
}

/// The points of all curves, one curve after the other.
#[derive(Default)]
struct Points {
    points: Vec<CurvePoint>,
    /// The index of the first point of each curve.
    starts: Vec<usize>,
    /// Whether the next point continues the last curve.
    connected: bool,
}

impl Points {
    fn push(&mut self, point: CurvePoint) {
        if !self.connected {
            self.starts.push(self.points.len());
            self.connected = true;
        }
        self.points.push(point);
    }

    /// Ends the current curve. Returns an error message if it has too few points.
    fn end_curve(&mut self, format: CurveFormat) -> Result<(), String> {
        let count = self.starts.last().map_or(0, |start| self.points.len() - start);
        if std::mem::take(&mut self.connected) && count < format.least_points() {
            let least = format.least_points();
            return Err(format!("expected at least {least} control points of a curve, found {count}"));
        }
        Ok(())
    }

    fn curves(&self) -> impl Iterator<Item = &[CurvePoint]> + Clone {
        let ends = self.starts.iter().skip(1).copied().chain([self.points.len()]);
        self.starts.iter().copied().zip(ends).map(|(start, end)| &self.points[start..end])
    }
}

/// Reads a file of curves.
///
/// # Errors
/// If the file cannot be read, is malformed, or needs more memory than is left.
pub fn load(path: &Path, format: CurveFormat, memory: &Budget) -> Result<Curves> {
    let (bytes, _reserved) = super::read_bytes(path, memory)?;
    let large = |r: Refusal| Error::scene(r.sentence("its curves", "use fewer curves")).in_file(path);
    let mut planned = memory.nothing();
    let points = match (format, bytes.strip_prefix(BINARY)) {
        (CurveFormat::Hair { radius }, Some(data)) => {
            planned.grow(data.len() as u64 / 12 * BYTES_PER_POINT).map_err(large)?;
            binary_hair(data, radius).map_err(|message| Error::scene(message).in_file(path))?
        }
        _ => {
            let lines = 1 + bytes.iter().filter(|b| **b == b'\n').count();
            planned.grow(lines as u64 * BYTES_PER_POINT).map_err(large)?;
            text(&bytes, format).map_err(|(line, text, message)| {
                Error::scene(message).at(Place { line, column: 1, text, ..Place::file(path) })
            })?
        }
    };
    if points.points.is_empty() {
        return Err(Error::scene("the file has no control points").in_file(path));
    }
    let segments = match format {
        CurveFormat::BSpline => Curves::b_spline_segments(points.curves()),
        CurveFormat::Linear | CurveFormat::Hair { .. } => points.points.len(),
    };
    if u32::try_from(segments + points.starts.len()).is_err() {
        let segments = counted(segments as u64, "segment", "segments");
        return Err(
            Error::scene(format!("expected fewer than 2^32 segments, found {segments}")).in_file(path)
        );
    }
    planned.grow((segments + points.starts.len()) as u64 * BYTES_PER_POINT).map_err(large)?;
    let curves = match format {
        CurveFormat::BSpline => Curves::b_splines(points.curves()),
        CurveFormat::Linear | CurveFormat::Hair { .. } => Curves::linear(points.curves()),
    };
    planned.keep(curves.segment_count() as u64 * BYTES_PER_POINT);
    Ok(curves)
}

/// Reads lines of numbers. An empty line ends a curve. An error is the number of a line, the line and a message.
fn text(bytes: &[u8], format: CurveFormat) -> Result<Points, (u32, String, String)> {
    let mut points = Points::default();
    let mut number = 0u32;
    for line in bytes.split(|b| *b == b'\n') {
        number = number.saturating_add(1);
        let line = String::from_utf8_lossy(line);
        let line = line.trim();
        let wrong = |message: String| (number, line.to_owned(), message);
        if line.is_empty() {
            points.end_curve(format).map_err(wrong)?;
        } else if !line.starts_with('#') {
            points.push(point(line, format).map_err(wrong)?);
        }
    }
    points.end_curve(format).map_err(|message| (number, String::new(), message))?;
    Ok(points)
}

/// Reads the point of a line. Further numbers are ignored, as in Mitsuba.
fn point(line: &str, format: CurveFormat) -> Result<CurvePoint, String> {
    let expected = match format {
        CurveFormat::Hair { .. } => 3,
        CurveFormat::Linear | CurveFormat::BSpline => 4,
    };
    let numbers: Vec<f32> =
        line.split_ascii_whitespace().take(expected).map_while(|word| word.parse().ok()).collect();
    let (position, radius) = match (&numbers[..], format) {
        (&[x, y, z], CurveFormat::Hair { radius }) => (Vec3::new(x, y, z), radius),
        (&[x, y, z, radius], _) => (Vec3::new(x, y, z), radius),
        _ if expected == 3 => return Err("expected three numbers: x, y, z".into()),
        _ => return Err("expected four numbers: x, y, z and the radius".into()),
    };
    if !(position.is_finite() && radius.is_finite() && radius >= 0.0) {
        return Err("expected a finite position and a radius of at least 0".into());
    }
    Ok((position, radius))
}

/// Reads the data after the first bytes of a binary file: the number of points, then coordinates as little-endian
/// floats. An infinite value ends a hair.
fn binary_hair(data: &[u8], radius: f32) -> Result<Points, String> {
    let early = || "malformed binary hair: the file ends early".to_owned();
    let (count, data) = data.split_first_chunk().ok_or_else(early)?;
    let count = u32::from_le_bytes(*count) as usize;
    let mut values = data.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes));
    let format = CurveFormat::Hair { radius };
    let mut points = Points::default();
    while points.points.len() < count {
        let x = values.next().ok_or_else(early)?;
        if x == f32::INFINITY {
            points.end_curve(format)?;
            continue;
        }
        let p = Vec3::new(x, values.next().ok_or_else(early)?, values.next().ok_or_else(early)?);
        if !p.is_finite() {
            return Err(format!("point {} of the hair is not finite", points.points.len()));
        }
        points.push((p, radius));
    }
    Ok(points)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curves_of(points: &Points) -> Vec<usize> {
        points.curves().map(<[_]>::len).collect()
    }

    #[test]
    fn empty_lines_end_curves() {
        let read =
            text(b"\n0 0 0 1\r\n1 0 0 1\n\n \n# next\n0 1 0 .5 9\n1 1 0 .5\n2 1 0 0", CurveFormat::Linear);
        let points = read.expect("curves");
        assert_eq!(curves_of(&points), [2, 3]);
        assert_eq!(points.points[2], (Vec3::Y, 0.5));
    }

    #[test]
    fn wrong_lines_are_named() {
        let hair = CurveFormat::Hair { radius: 0.1 };
        for (bytes, format, line, words) in [
            (&b"0 0 0 1\n\n"[..], CurveFormat::Linear, 2, "at least 2 control points of a curve, found 1"),
            (b"0 0 0 1\n1 0 0 1\n2 0 0 1", CurveFormat::BSpline, 3, "at least 4 control points"),
            (b"0 0 0 1\n1 0 x 1", CurveFormat::Linear, 2, "expected four numbers"),
            (b"0 0", hair, 1, "expected three numbers"),
            (b"0 0 0 -1\n", CurveFormat::Linear, 1, "a radius of at least 0"),
            (b"0 nan 0 1\n", CurveFormat::Linear, 1, "a finite position"),
        ] {
            let Err((at, _, message)) = text(bytes, format) else { panic!("{words}") };
            assert!(at == line && message.contains(words), "{at}: {message}");
        }
    }

    #[test]
    fn binary_hair_has_the_same_points() {
        let mut bytes = 3u32.to_le_bytes().to_vec();
        let inf = f32::INFINITY;
        for v in [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, inf, 6.0, 7.0, 8.0f32] {
            bytes.extend(v.to_le_bytes());
        }
        let points = binary_hair(&bytes, 0.5).expect("hair");
        assert_eq!((curves_of(&points), points.points[2]), (vec![2, 1], (Vec3::new(6.0, 7.0, 8.0), 0.5)));
        assert!(binary_hair(&bytes[..bytes.len() - 4], 0.5).is_err_and(|m| m.contains("ends early")));
        bytes[8..12].copy_from_slice(&f32::NAN.to_le_bytes());
        assert!(binary_hair(&bytes, 0.5).is_err_and(|m| m.contains("point 0")));
    }
}
