//! Defaults for a file without a camera or an emitter: a camera that sees the whole scene, and a white environment.

use crate::color::Rgb;
use crate::emitter::Emitter;
use crate::film::FilmSettings;
use crate::math::{DAffine3, DMat3, DVec3, Vec3};
use crate::scene::Description;
use crate::scene::description::PlacedShape;
use crate::sensor::{FovAxis, Projection, SensorSettings};
use crate::shape::Shape;

/// The camera's field of view across the smaller side of the image, in degrees.
const FOV_DEG: f64 = 35.0;
/// The direction from the centre of the scene to the camera: y is up, z points towards the viewer.
const TO_CAMERA: DVec3 = DVec3::new(0.35, 0.45, 1.0);
/// The margin around the scene, as a factor on the camera's distance.
const MARGIN: f64 = 1.05;

/// What the camera of [`camera`] sees, as part of a sentence.
pub const VIEW: &str = "seen from the front and above (y is up, z to the viewer)";

/// Returns a constant white environment.
pub fn white_environment() -> Emitter {
    Emitter::Constant { radiance: Rgb::WHITE }
}

/// Returns a camera in front of and above the points that sees the sphere around their bounding box; `None` if the box
/// is empty, a point or infinite. Points that are not finite are left out.
pub fn camera(points: impl Iterator<Item = DVec3>) -> Option<SensorSettings> {
    let finite = points.filter(|p| p.is_finite());
    let (low, high) = finite.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
    let radius = 0.5 * (high - low).length();
    if !(radius > 0.0 && radius.is_finite()) {
        return None;
    }
    let fov = FOV_DEG.to_radians();
    let distance = MARGIN * radius / (0.5 * fov).sin();
    let direction = -TO_CAMERA.normalize();
    let left = DVec3::Y.cross(direction).normalize();
    Some(SensorSettings {
        name: String::new(),
        to_world: frame(0.5 * (low + high) - distance * direction, left, direction).into(),
        projection: Projection::Perspective {
            fov,
            fov_axis: FovAxis::Smaller,
            principal_point_offset: [0.0; 2],
        },
        lens: None,
        shutter: [0.0; 2],
        near_clip: 1e-3 * distance,
        far_clip: 1e3 * distance,
        film: FilmSettings::default(),
        medium: None,
    })
}

/// Returns a camera that sees all shapes of a scene, as [`camera`] does.
pub fn camera_for(description: &Description) -> Option<SensorSettings> {
    let groups: Vec<Vec<DVec3>> =
        description.groups.iter().map(|group| group.iter().flat_map(corners).collect()).collect();
    let instances = description.instances.iter().flat_map(|instance| {
        let to_world = instance.to_world.at(0.0);
        groups[instance.group].iter().map(move |p| to_world.transform_point3(*p))
    });
    camera(description.shapes.iter().flat_map(corners).chain(instances))
}

/// Returns the corners in world space of a shape's bounding box in its own coordinates.
fn corners(shape: &PlacedShape) -> impl Iterator<Item = DVec3> + use<> {
    let (low, high) = match &shape.shape {
        Shape::Mesh(mesh) => {
            let finite = mesh.positions.iter().filter(|p| p.is_finite()).map(|p| p.as_dvec3());
            finite.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)))
        }
        Shape::Rectangle | Shape::Disk => (DVec3::new(-1.0, -1.0, 0.0), DVec3::new(1.0, 1.0, 0.0)),
        Shape::Cube => (DVec3::NEG_ONE, DVec3::ONE),
        Shape::SdfGrid(_) => (DVec3::ZERO, DVec3::ONE),
        Shape::Sphere { center, radius } => around(*center, *radius),
        Shape::Cylinder { p0, p1, radius } => {
            let (a, b) = (around(*p0, *radius), around(*p1, *radius));
            (a.0.min(b.0), a.1.max(b.1))
        }
        Shape::Curves(curves) => {
            let boxes = curves.points().iter().map(|(p, radius)| around(*p, *radius));
            boxes
                .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), (low, high)| (l.min(low), h.max(high)))
        }
    };
    let to_world = shape.to_world.at(0.0);
    (0..8).map(move |i: u32| {
        let upper = DVec3::from([0, 1, 2].map(|axis| f64::from(i >> axis & 1))).cmpgt(DVec3::ZERO);
        to_world.transform_point3(DVec3::select(upper, high, low))
    })
}

/// Returns the bounding box of a sphere.
fn around(center: Vec3, radius: f32) -> (DVec3, DVec3) {
    let (center, half) = (center.as_dvec3(), DVec3::splat(f64::from(radius)));
    (center - half, center + half)
}

/// Returns the frame of a camera at `origin` with the unit viewing `direction` and the unit vector `left` across it.
pub fn frame(origin: DVec3, left: DVec3, direction: DVec3) -> DAffine3 {
    DAffine3 { matrix3: DMat3::from_cols(left, direction.cross(left), direction), translation: origin }
}

/// Returns an error if a transformation is not finite, or is singular relative to the lengths of its axes.
pub fn check_invertible(transform: &DAffine3) -> Result<(), String> {
    let m = transform.matrix3;
    let volume = m.x_axis.length() * m.y_axis.length() * m.z_axis.length();
    if !transform.is_finite() || !m.determinant().is_finite() || !volume.is_finite() {
        return Err("the transformation is not finite".to_owned());
    }
    // In this form, the comparison also fails for a determinant and a volume of zero.
    if m.determinant().abs() > 1e-12 * volume && transform.inverse().is_finite() {
        return Ok(());
    }
    Err("the transformation is singular: it flattens space".to_owned())
}
