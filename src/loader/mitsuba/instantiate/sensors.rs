//! Sensors.

use super::{Builder, unknown_plugin};
use crate::error::Result;
use crate::film::Filter;
use crate::loader::mitsuba::graph::ObjectId;
use crate::loader::mitsuba::props::Props;
use crate::math::{DAffine3, DMat3, DVec3, Motion};
use crate::sensor::{FovAxis, Projection, SensorSettings, ThinLens};

pub const SUPPORTED: [&str; 7] =
    ["distant", "irradiancemeter", "orthographic", "perspective", "radiancemeter", "spherical", "thinlens"];
const MITSUBA: [&str; 5] = ["batch", "fluencemeter", "measured", "perspective_rdist", "telecentric"];
/// The distance beyond which a camera sees nothing, and in which a thin lens is in focus.
const FAR_CLIP: f32 = 1e4;
/// The focal length, in mm, of a camera without a focal length or a field of view.
const DEFAULT_FOCAL_LENGTH: f64 = 50.0;
/// The diagonal, in mm, of the 36 mm x 24 mm frame of 35 mm film, which focal lengths refer to.
const FRAME_DIAGONAL: f64 = 43.266_615_305_567_87;
/// The greatest difference of the lengths of a camera's axes from 1.
const SCALE_TOLERANCE: f64 = 1e-2;

impl Builder<'_> {
    /// Adds a sensor, which may be that of a shape. The first sensor's sampler is the scene's.
    ///
    /// # Errors
    /// As for [`instantiate`](super::instantiate).
    pub fn sensor(&mut self, object: ObjectId, shape: Option<usize>) -> Result<()> {
        let props = Props::new(self.graph, object);
        let plugin = props.object.plugin.as_str();
        if !SUPPORTED.contains(&plugin) {
            return Err(unknown_plugin(props.object, &SUPPORTED, &MITSUBA));
        }
        if (plugin == "irradiancemeter") != shape.is_some() {
            return Err(props.object.error(match shape {
                Some(_) => "expected an irradiancemeter: no other sensor can be inside a shape",
                None => "expected the irradiancemeter inside the shape whose irradiance it measures",
            }));
        }
        let to_world = match plugin {
            // It is placed once, around the scene.
            "distant" if !props.has("direction") => Motion::from(props.to_world()?),
            "distant" | "radiancemeter" => axis(&props)?,
            "irradiancemeter" => Motion::default(),
            _ => props.motion()?,
        };
        if plugin != "orthographic" {
            check_rigid(&props, &to_world)?;
        }
        let projection = match (plugin, shape) {
            (_, Some(shape)) => Projection::Surface { shape },
            ("orthographic", _) => Projection::Orthographic,
            ("radiancemeter", _) => Projection::Axis,
            ("spherical", _) => Projection::Spherical,
            ("distant", _) => {
                if let Some(shape) = props.child("shape")? {
                    return Err(super::unsupported(&self.graph.objects[shape]));
                }
                Projection::Distant { target: props.point("target")?.map(|p| p.to_array()) }
            }
            _ => {
                let (fov, fov_axis) = field_of_view(&props)?;
                let names = ["principal_point_offset_x", "principal_point_offset_y"];
                let offset = [props.float(names[0])?, props.float(names[1])?];
                let principal_point_offset = offset.map(|v| v.unwrap_or(0.0));
                Projection::Perspective { fov, fov_axis, principal_point_offset }
            }
        };
        let lens = if plugin == "thinlens" { thin_lens(&props)? } else { None };
        if lens.is_none() {
            self.ignore(&props, &["focus_distance"], "everything is in focus");
        }
        let near_clip = f64::from(props.positive("near_clip", 1e-2)?);
        let far_clip = f64::from(props.positive("far_clip", FAR_CLIP)?);
        if near_clip >= far_clip {
            let name = if props.find("near_clip").is_some() { "near_clip" } else { "far_clip" };
            return Err(props.refusal(name, "expected near_clip to be less than far_clip"));
        }
        let shutter = [props.float("shutter_open")?, props.float("shutter_close")?].map(|t| t.unwrap_or(0.0));
        if !(shutter[0] <= shutter[1] && shutter.iter().all(|t| t.is_finite())) {
            return Err(props.refusal("shutter_close", "expected the shutter to close after it opens"));
        }
        self.ignore(&props, &["srf"], "images are RGB");
        let mut film = self.film(&props)?;
        if shape.is_some() {
            // Each sample counts for the part of the surface in which it is.
            film.filter = Filter::Box { radius: 0.5 };
        }
        if let Some(sampler) = props.child("sampler")? {
            let read = match self.sampler(sampler, self.loaded.description.sensors.is_empty()) {
                Err(error) if self.replaces_sampler => {
                    self.note(format!("the sampler of the scene is not used: {}", error.message));
                    Ok(())
                }
                read => read,
            };
            self.or_stand_in(read, "replaced by the default", |_| ())?;
        }
        let settings = SensorSettings {
            name: props.object.id.clone(),
            to_world,
            projection,
            lens,
            near_clip,
            far_clip,
            shutter,
            film,
            medium: self.medium_around(&props)?,
        };
        self.finish(props);
        self.loaded.description.sensors.push(settings);
        Ok(())
    }
}

/// Returns the transform of a sensor that sees along an axis: `to_world`, or one from the point `origin` in the
/// direction `direction`.
fn axis(props: &Props) -> Result<Motion> {
    let (origin, direction) = (props.point("origin")?, props.point("direction")?);
    let Some(direction) = direction else {
        return match origin {
            Some(_) => Err(props.object.error("expected an origin and a direction, or to_world")),
            None => props.motion(),
        };
    };
    if props.has("to_world") {
        return Err(props.error("direction", "expected either a direction or to_world, found both"));
    }
    let z = direction.normalize_or_zero();
    if z == DVec3::ZERO {
        return Err(props.refusal("direction", "expected a direction"));
    }
    let x = z.any_orthonormal_vector();
    let axes = DMat3::from_cols(x, z.cross(x), z);
    Ok(DAffine3::from_mat3_translation(axes, origin.unwrap_or_default()).into())
}

/// Returns an error if `to_world` has a scale or a shear: lengths and angles would differ from those of the world.
fn check_rigid(props: &Props, to_world: &Motion) -> Result<()> {
    for transform in to_world.keys() {
        let m = transform.matrix3;
        let off = (m.transpose() * m - DMat3::IDENTITY).to_cols_array();
        if off.iter().any(|v| v.abs() > 2.0 * SCALE_TOLERANCE) {
            return Err(props.error("to_world", "a camera cannot be scaled"));
        }
    }
    Ok(())
}

/// Returns the lens of a `thinlens`; `None` for an aperture of radius 0, which is a pinhole.
fn thin_lens(props: &Props) -> Result<Option<ThinLens>> {
    let Some(aperture_radius) = props.float("aperture_radius")? else {
        return Err(props.object.error("the property aperture_radius is missing"));
    };
    if !(aperture_radius >= 0.0 && aperture_radius.is_finite()) {
        return Err(props.refusal("aperture_radius", "expected a number of at least 0"));
    }
    if aperture_radius == 0.0 {
        return Ok(None);
    }
    let focus_distance = f64::from(props.positive("focus_distance", props.positive("far_clip", FAR_CLIP)?)?);
    Ok(Some(ThinLens { aperture_radius, focus_distance }))
}

/// Returns the field of view in radians and the axis that it spans, from `fov` or `focal_length`.
pub fn field_of_view(props: &Props) -> Result<(f64, FovAxis)> {
    let axes = [
        ("x", FovAxis::X),
        ("y", FovAxis::Y),
        ("diagonal", FovAxis::Diagonal),
        ("smaller", FovAxis::Smaller),
        ("larger", FovAxis::Larger),
    ];
    let axis = props.choice("fov_axis", &axes, FovAxis::X)?;
    let fov = props.float("fov")?;
    let focal = props.text("focal_length")?;
    match (fov, focal) {
        (Some(_), Some(_)) => {
            Err(props.error("focal_length", "expected either fov or focal_length, found both"))
        }
        (Some(degrees), None) if degrees > 0.0 && degrees < 180.0 => Ok((degrees.to_radians(), axis)),
        (Some(_), None) => Err(props.refusal("fov", "expected degrees between 0 and 180")),
        (None, focal) => {
            let length = match focal {
                Some(text) => text.trim().trim_end_matches("mm").trim_end().parse().unwrap_or(f64::NAN),
                None => DEFAULT_FOCAL_LENGTH,
            };
            if !(length > 0.0 && length.is_finite()) {
                return Err(props.refusal("focal_length", "expected a length such as 50mm"));
            }
            Ok((2.0 * (0.5 * FRAME_DIAGONAL / length).atan(), FovAxis::Diagonal))
        }
    }
}
