//! Indices of refraction of dielectrics by name, at about 589 nm and between 0 and 20 °C.
//!
//! Names and values are Mitsuba's; most are from Hecht, "Optics", 4th edition.

const DIELECTRICS: &[(&str, f32)] = &[
    ("vacuum", 1.0),
    ("helium", 1.000036),
    ("hydrogen", 1.000132),
    ("air", 1.000277),
    ("carbon dioxide", 1.00045),
    ("water", 1.333),
    ("acetone", 1.36),
    ("ethanol", 1.361),
    ("carbon tetrachloride", 1.461),
    ("glycerol", 1.4729),
    ("benzene", 1.501),
    ("silicone oil", 1.52045),
    ("bromine", 1.661),
    ("water ice", 1.31),
    ("fused quartz", 1.458),
    ("pyrex", 1.47),
    ("acrylic glass", 1.49),
    ("polypropylene", 1.49),
    ("bk7", 1.5046),
    ("sodium chloride", 1.544),
    ("amber", 1.55),
    ("pet", 1.575),
    ("diamond", 2.419),
];

/// Returns the index of refraction of a dielectric by its name, such as `bk7`; names are not case-sensitive.
pub fn dielectric(name: &str) -> Option<f32> {
    DIELECTRICS.iter().find(|row| row.0.eq_ignore_ascii_case(name)).map(|row| row.1)
}

/// Iterates over the names accepted by [`dielectric`].
pub fn dielectric_names() -> impl Iterator<Item = &'static str> {
    DIELECTRICS.iter().map(|row| row.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_found_in_any_case() {
        // In Mitsuba, the ratio of diamond and air is 2.41833, that of BK7 and air 1.50418.
        let air = dielectric("air").unwrap();
        assert!((dielectric("Diamond").unwrap() / air - 2.41833).abs() < 1e-5);
        assert!((dielectric("bk7").unwrap() / air - 1.50418).abs() < 1e-5);
        assert_eq!(dielectric("kryptonite"), None);
        assert_eq!(dielectric_names().count(), 23);
    }
}
