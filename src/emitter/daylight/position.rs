//! The position of the sun at a date and a place. [Blanco-Muriel 2001]

use std::f64::consts::TAU;

/// The mean radius of the Earth divided by its mean distance from the sun.
const PARALLAX: f64 = 6371.01 / 149_597_890.0;

/// A date and a place on the Earth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DateAndPlace {
    /// The year of the Gregorian calendar.
    pub year: i64,
    /// The month, 1 to 12.
    pub month: i64,
    /// The day of the month, from 1.
    pub day: i64,
    /// The local time since midnight in hours.
    pub hours: f64,
    /// Degrees north of the equator.
    pub latitude: f64,
    /// Degrees east of Greenwich.
    pub longitude: f64,
    /// The local time less universal time, in hours.
    pub timezone: f64,
}

/// The position of the sun in the sky, in radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SunPosition {
    /// The angle to the zenith.
    pub zenith: f64,
    /// The azimuth from the north towards the east, in [0, 2π).
    pub azimuth: f64,
}

impl DateAndPlace {
    /// Returns the position of the sun without refraction, accurate to 0.5 arc minutes from 1999 to 2015.
    /// [Blanco-Muriel 2001]
    pub fn sun_position(&self) -> SunPosition {
        let hours = self.hours - self.timezone;
        let days = self.days_since_2000(hours);
        // The sun's ecliptic longitude and the obliquity of the ecliptic.
        let omega = 2.1429 - 0.001_039_459_4 * days;
        let mean_longitude = 4.895_063_0 + 0.017_202_791_698 * days;
        let anomaly = 6.240_060_0 + 0.017_201_969_9 * days;
        let longitude = mean_longitude + 0.033_416_07 * anomaly.sin() + 0.000_348_94 * (2.0 * anomaly).sin()
            - 0.000_113_4
            - 0.000_020_3 * omega.sin();
        let obliquity = 0.409_092_8 - 6.2140e-9 * days + 0.000_039_6 * omega.cos();
        // Right ascension and declination.
        let right_ascension = (obliquity.cos() * longitude.sin()).atan2(longitude.cos());
        let declination = (obliquity.sin() * longitude.sin()).asin();
        // The local hour angle.
        let greenwich = 6.697_424_324_2 + 0.065_709_828_3 * days + hours;
        let hour_angle = (15.0 * greenwich + self.longitude).to_radians() - right_ascension;
        let (sin_latitude, cos_latitude) = self.latitude.to_radians().sin_cos();
        let cos_zenith =
            cos_latitude * hour_angle.cos() * declination.cos() + declination.sin() * sin_latitude;
        let zenith = cos_zenith.clamp(-1.0, 1.0).acos();
        let north = declination.tan() * cos_latitude - sin_latitude * hour_angle.cos();
        let azimuth = (-hour_angle.sin()).atan2(north).rem_euclid(TAU);
        SunPosition { zenith: zenith + PARALLAX * zenith.sin(), azimuth }
    }

    /// Returns the days since noon of 1 January 2000, universal time, at an hour of universal time of the day.
    fn days_since_2000(&self, hours: f64) -> f64 {
        // January and February count as months of the year before. [Fliegel 1968]
        let before = (self.month - 14) / 12;
        let day = 1461 * (self.year + 4800 + before) / 4 + 367 * (self.month - 2 - 12 * before) / 12
            - 3 * ((self.year + 4900 + before) / 100) / 4
            + self.day
            - 32075;
        (day - 2_451_545) as f64 - 0.5 + hours / 24.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn position(date: [i64; 3], hours: f64, place: [f64; 3]) -> [f64; 2] {
        let ([year, month, day], [latitude, longitude, timezone]) = (date, place);
        let at = DateAndPlace { year, month, day, hours, latitude, longitude, timezone };
        let SunPosition { zenith, azimuth } = at.sun_position();
        [zenith.to_degrees(), azimuth.to_degrees()]
    }

    /// The worked example of [Reda 2004, table A5.1]: Golden, Colorado, on 17 October 2003 at 12:30:30. Its zenith
    /// angle includes a refraction of 0.0163° at its elevation.
    #[test]
    fn the_position_is_that_of_a_published_example() {
        let hours = 12.0 + 30.5 / 60.0;
        let [zenith, azimuth] = position([2003, 10, 17], hours, [39.742476, -105.1786, -7.0]);
        assert!((zenith - (50.11162 + 0.0163)).abs() < 0.5 / 60.0, "{zenith}");
        assert!((azimuth - 194.34024).abs() < 1.0 / 60.0, "{azimuth}");
    }

    /// At the published times of equinoxes and solstices, the elevation at the north pole is 0° and the obliquity of
    /// the ecliptic, ±23.438°. [Astronomical Almanac 2010]
    #[test]
    fn seasons_begin_when_the_almanac_says() {
        for (month, day, hours, elevation) in [
            (3, 20, 17.0 + 32.0 / 60.0, 0.0),
            (6, 21, 11.0 + 28.0 / 60.0, 23.438),
            (9, 23, 3.0 + 9.0 / 60.0, 0.0),
            (12, 21, 23.0 + 38.0 / 60.0, -23.438),
        ] {
            let [zenith, _] = position([2010, month, day], hours, [90.0, 0.0, 0.0]);
            assert!((90.0 - zenith - elevation).abs() < 0.012, "{month}: {zenith}");
        }
    }

    /// The sun is in the east in the morning, in the south at noon and in the west in the evening, and at noon in the
    /// north on the other hemisphere. A time zone only renames the hours.
    #[test]
    fn the_sun_goes_from_east_to_west() {
        for (hours, latitude, expected) in
            [(6.0, 0.1, 90.0), (12.0, 45.0, 180.0), (18.0, 0.1, 270.0), (12.0, -45.0, 0.0)]
        {
            let [_, azimuth] = position([2010, 3, 20], hours, [latitude, 0.0, 0.0]);
            let off = (azimuth - expected + 180.0).rem_euclid(360.0) - 180.0;
            assert!(off.abs() < 5.0, "{hours}: {azimuth}");
            let [_, shifted] = position([2010, 3, 20], hours + 9.0, [latitude, 0.0, 9.0]);
            assert!((shifted - azimuth).abs() < 1e-6);
        }
    }
}
