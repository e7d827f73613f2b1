//! Daylight: `sunsky`, and `sun`, `sky` and `sunsky` of Mitsuba 0.6.
//!
//! In Mitsuba 3, +z of the object space is the zenith, +x the south and +y the west. In Mitsuba 0.6, +y is the zenith,
//! −z the north and +x the east. A plugin of a file older than version 2, and `sun` and `sky` in any file, follow
//! Mitsuba 0.6.

use super::Builder;
use crate::color::Rgb;
use crate::color::spectrum::Quantity;
use crate::emitter::daylight::{self, DateAndPlace, Sky, SkySettings, SunPosition, one_minus_cos};
use crate::emitter::{Emitter, environment_map};
use crate::error::Result;
use crate::loader::mitsuba::props::Props;
use crate::math::{DMat3, DVec3, Vec3};
use std::f64::consts::TAU;
use std::ops::RangeInclusive;
use std::sync::Arc;

/// The properties from which the position of the sun follows if there is no `sun_direction`.
const DATE_AND_PLACE: [&str; 9] =
    ["year", "month", "day", "hour", "minute", "second", "latitude", "longitude", "timezone"];

impl Builder<'_> {
    /// Adds the emitters of `sunsky`, `sun` or `sky`.
    pub(super) fn daylight(&mut self, props: &Props) -> Result<()> {
        let plugin = props.object.plugin.as_str();
        let old = props.object.old || plugin != "sunsky";
        let [least, most] = daylight::TURBIDITY;
        let turbidity = number(props, "turbidity", 3.0, least..=most)?;
        let scale = if old { scale_of(props, "scale", 1.0)? } else { 1.0 };
        let [sun_scale, sky_scale] = match plugin {
            "sun" => [scale, 0.0],
            "sky" => [0.0, scale],
            _ => [scale_of(props, "sun_scale", scale)?, scale_of(props, "sky_scale", scale)?],
        };
        let default_albedo = if old { 0.2 } else { 0.3 };
        let albedo = match plugin {
            "sun" => Rgb::splat(default_albedo),
            _ => self.colour(props, "albedo", Quantity::Reflectance, default_albedo)?,
        };
        let half_aperture = if plugin == "sky" { None } else { Some(half_aperture(props, old)?) };
        let extends = old && props.boolean("extend", false)?;
        if old {
            self.ignore(props, &["resolution"], "the sun and the sky are not images");
            if props.float("stretch")?.is_some_and(|stretch| stretch != 1.0) {
                return Err(props.refusal("stretch", "expected 1, because the sky cannot be stretched"));
            }
        } else if props.boolean("complex_sun", false)? {
            self.approximate(format!("{}: the disc of the sun is uniform", props.object.thing()));
        }
        let rotation = environment_map::rotation(&props.to_world()?);
        let rotation = rotation.map_err(|error| props.error("to_world", &error.message))?;
        let up = (rotation * if old { DVec3::Y } else { DVec3::Z }).normalize();
        let sun = sun_direction(props, old, &rotation)?;
        let elevation = sun.dot(up).atan2(sun.cross(up).length());
        if elevation < 0.0 {
            self.loaded.warnings.push(props.object.error("the sun is below the horizon and emits no light"));
            return Ok(());
        }
        let (up, sun) = (up.as_vec3(), sun.as_vec3());
        if sky_scale > 0.0 {
            self.check_only_environment(props)?;
            self.sky(props, &SkySettings { turbidity, albedo, up, sun, scale: sky_scale, extends })?;
        }
        if let Some(half_angle) = half_aperture.filter(|_| sun_scale > 0.0) {
            self.sun(props, turbidity, elevation, [sun, up], half_angle, sun_scale)?;
        }
        Ok(())
    }

    fn sky(&mut self, props: &Props, settings: &SkySettings) -> Result<()> {
        let reserved = self
            .memory
            .reserve(Sky::BYTES)
            .map_err(|refusal| props.object.error(refusal.sentence("a sky", "use a constant emitter")))?;
        let sky = Sky::new(settings).map_err(|error| props.object.error(error.message))?;
        reserved.keep(sky.map().memory_bytes() as u64);
        self.add_emitter(Emitter::Sky(Arc::new(sky)));
        Ok(())
    }

    fn sun(
        &mut self,
        props: &Props,
        turbidity: f64,
        elevation: f64,
        [direction, up]: [Vec3; 2],
        half_angle: f64,
        scale: f32,
    ) -> Result<()> {
        if self.loaded.description.emitters.iter().any(Emitter::is_sun) {
            return Err(props.object.error("a scene has room for one sun"));
        }
        let radiance = daylight::sun_radiance(turbidity, elevation) * scale;
        // The irradiance is the same for every aperture.
        let size = one_minus_cos(daylight::SUN_HALF_APERTURE.to_radians());
        self.add_emitter(match half_angle > 0.0 {
            true => {
                let radiance = radiance * (size / one_minus_cos(half_angle)) as f32;
                Emitter::Sun { direction, half_angle, up, radiance }
            }
            false => {
                Emitter::Directional { direction: -direction, irradiance: radiance * (TAU * size) as f32 }
            }
        });
        Ok(())
    }
}

/// Returns half of the sun's aperture in radians; 0 for parallel light.
fn half_aperture(props: &Props, old: bool) -> Result<f64> {
    if old {
        let most = 90.0 / daylight::SUN_HALF_APERTURE;
        let scale = props.float("sun_radius_scale")?.unwrap_or(1.0);
        return match (0.0..most).contains(&scale) {
            true => Ok((scale * daylight::SUN_HALF_APERTURE).to_radians()),
            false => Err(props.refusal(
                "sun_radius_scale",
                &format!("expected a number of at least 0 and below {most:.1}"),
            )),
        };
    }
    let aperture = props.float("sun_aperture")?.unwrap_or(2.0 * daylight::SUN_HALF_APERTURE);
    match aperture > 0.0 && aperture < 180.0 {
        true => Ok((0.5 * aperture).to_radians()),
        false => Err(props.refusal("sun_aperture", "expected degrees above 0 and below 180")),
    }
}

/// Returns the unit direction to the sun in world space.
fn sun_direction(props: &Props, old: bool, rotation: &DMat3) -> Result<DVec3> {
    if let Some(direction) = props.point("sun_direction")? {
        let both = DATE_AND_PLACE.into_iter().find_map(|name| props.find(name));
        if let Some(property) = both {
            return Err(property.error("expected either sun_direction or a date and a place, found both"));
        }
        return direction
            .try_normalize()
            .ok_or_else(|| props.refusal("sun_direction", "expected a direction"));
    }
    let finite = |name, default| number(props, name, default, f64::MIN..=f64::MAX);
    let whole = |name, default, range| Ok(props.integer(name, range)?.unwrap_or(default));
    let at = DateAndPlace {
        year: whole("year", 2010, 1..=9999)?,
        month: whole("month", 7, 1..=12)?,
        day: whole("day", 10, 1..=31)?,
        hours: finite("hour", 15.0)? + finite("minute", 0.0)? / 60.0 + finite("second", 0.0)? / 3600.0,
        latitude: number(props, "latitude", 35.6894, -90.0..=90.0)?,
        longitude: finite("longitude", 139.6917)?,
        timezone: finite("timezone", 9.0)?,
    };
    let SunPosition { zenith, azimuth } = at.sun_position();
    let (sin, cos) = zenith.sin_cos();
    let (east, north) = (azimuth.sin() * sin, azimuth.cos() * sin);
    Ok(*rotation * if old { DVec3::new(east, cos, -north) } else { DVec3::new(-north, -east, cos) })
}

/// Returns a factor that is finite and not negative.
fn scale_of(props: &Props, name: &'static str, default: f32) -> Result<f32> {
    let scale = props.float(name)?.map_or(default, |v| v as f32);
    match scale >= 0.0 && scale.is_finite() {
        true => Ok(scale),
        false => Err(props.refusal(name, "expected a number of at least 0")),
    }
}

/// Returns a number in a range.
fn number(props: &Props, name: &'static str, default: f64, range: RangeInclusive<f64>) -> Result<f64> {
    let value = props.float(name)?.unwrap_or(default);
    if range.contains(&value) {
        return Ok(value);
    }
    let expected = match range.start() == &f64::MIN {
        true => "expected a finite number".to_owned(),
        false => format!("expected a number from {} to {}", range.start(), range.end()),
    };
    Err(props.refusal(name, &expected))
}
