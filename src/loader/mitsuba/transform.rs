//! Transformations: the elements inside `<transform>`, each applied after the previous ones.

use super::values;
use super::xml::Element;
use crate::error::Result;
use crate::loader::framing::{check_invertible, frame};
use crate::math::{DAffine3, DMat3, DVec3};

/// Names of the elements inside a transformation.
pub const TAGS: [&str; 5] = ["translate", "rotate", "scale", "matrix", "lookat"];

/// Returns the transformation of one element inside `<transform>`; `tag` is its name in the current scene language.
///
/// # Errors
/// If attributes are missing, unknown or malformed, a rotation has no axis, a matrix is not affine, a `lookat` has no
/// direction or a parallel `up`, or the transformation is singular or not finite.
pub fn step(tag: &str, element: &Element) -> Result<DAffine3> {
    let fail = |message: String| element.error(message);
    let (required, optional): (&[&str], &[&str]) = match tag {
        "rotate" => (&["angle"], &["x", "y", "z", "value"]),
        "matrix" => (&["value"], &[]),
        "lookat" => (&["origin", "target"], &["up"]),
        _ => (&[], &["x", "y", "z", "value"]),
    };
    super::resolve::check_attributes(element, required, optional)?;
    let matrix = match tag {
        "translate" => DAffine3::from_translation(xyz(element, 0.0).map_err(fail)?),
        "scale" => DAffine3::from_scale(xyz(element, 1.0).map_err(fail)?),
        "rotate" => rotation(element).map_err(fail)?,
        "matrix" => matrix(element).map_err(fail)?,
        _ => look_at(element).map_err(fail)?,
    };
    check_invertible(&matrix).map_err(fail)?;
    Ok(matrix)
}

/// Reads `x`, `y`, `z` or `value` (one number for all three, or three).
fn xyz(element: &Element, default: f64) -> Result<DVec3, String> {
    let axes = ["x", "y", "z"].map(|name| element.attribute(name));
    if let Some(value) = element.attribute("value") {
        if axes.iter().any(Option::is_some) {
            return Err("expected either value or x, y and z, found both".to_owned());
        }
        return values::triple(value).map(DVec3::from);
    }
    let mut v = DVec3::splat(default);
    for (i, text) in axes.into_iter().enumerate() {
        if let Some(text) = text {
            v[i] = values::float(text)?;
        }
    }
    Ok(v)
}

/// Reads a rotation about an axis of any length. (Mitsuba 3.9.1 gives the same rotation only if the length is 1.)
fn rotation(element: &Element) -> Result<DAffine3, String> {
    let angle = values::float(element.attribute("angle").unwrap_or_default())?;
    let axis = xyz(element, 0.0)?;
    if angle == 0.0 {
        return Ok(DAffine3::IDENTITY);
    }
    let axis = axis.try_normalize().ok_or("expected an axis that is not zero")?;
    Ok(DAffine3::from_axis_angle(axis, angle.to_radians()))
}

/// Reads a matrix of nine or sixteen numbers, row by row.
fn matrix(element: &Element) -> Result<DAffine3, String> {
    let v = values::floats(element.attribute("value").unwrap_or_default())?;
    let n = match v.len() {
        9 => 3,
        16 => 4,
        other => return Err(format!("expected 9 or 16 numbers, found {other}")),
    };
    if n == 4 && v[12..] != [0.0, 0.0, 0.0, 1.0] {
        return Err("expected 0 0 0 1 in the last row".to_owned());
    }
    let column = |j: usize| DVec3::new(v[j], v[n + j], v[2 * n + j]);
    let translation = if n == 4 { column(3) } else { DVec3::ZERO };
    Ok(DAffine3 { matrix3: DMat3::from_cols(column(0), column(1), column(2)), translation })
}

/// Returns the frame at `origin` with the z axis towards `target`, the y axis as near to `up` as possible, and x to the
/// left.
fn look_at(element: &Element) -> Result<DAffine3, String> {
    let read = |name: &str| values::vector(element.attribute(name).unwrap_or_default());
    let (origin, target) = (read("origin")?, read("target")?);
    let direction = (target - origin).try_normalize().ok_or("expected a target away from the origin")?;
    let up = if element.attribute("up").is_some() { read("up")? } else { DVec3::ZERO };
    let up = if up == DVec3::ZERO { direction.any_orthonormal_pair().0 } else { up };
    let left = up
        .cross(direction)
        .try_normalize()
        .ok_or("expected an up that is not parallel to the viewing direction")?;
    Ok(frame(origin, left, direction))
}
