//! The expected values are those of Mitsuba 3.9.1 (scalar_rgb) for the same spectra.

use super::*;

/// The white paint of the Cornell box: reflectance from 400 to 700 nm in steps of 4 nm.
#[rustfmt::skip]
const WHITE: [f64; 76] = [
    0.343, 0.445, 0.551, 0.624, 0.665, 0.687, 0.708, 0.723, 0.715, 0.71, 0.745, 0.758, 0.739, 0.767,
    0.777, 0.765, 0.751, 0.745, 0.748, 0.729, 0.745, 0.757, 0.753, 0.75, 0.746, 0.747, 0.735, 0.732,
    0.739, 0.734, 0.725, 0.721, 0.733, 0.725, 0.732, 0.743, 0.744, 0.748, 0.728, 0.716, 0.733, 0.726,
    0.713, 0.74, 0.754, 0.764, 0.752, 0.736, 0.734, 0.741, 0.74, 0.732, 0.745, 0.755, 0.751, 0.744,
    0.731, 0.733, 0.744, 0.731, 0.712, 0.708, 0.729, 0.73, 0.727, 0.707, 0.703, 0.729, 0.75, 0.76,
    0.751, 0.739, 0.724, 0.73, 0.74, 0.737,
];

/// The green paint of the Cornell box: reflectance from 400 to 700 nm in steps of 4 nm.
#[rustfmt::skip]
const GREEN: [f64; 76] = [
    0.092, 0.096, 0.098, 0.097, 0.098, 0.095, 0.095, 0.097, 0.095, 0.094, 0.097, 0.098, 0.096, 0.101,
    0.103, 0.104, 0.107, 0.109, 0.112, 0.115, 0.125, 0.14, 0.16, 0.187, 0.229, 0.285, 0.343, 0.39,
    0.435, 0.464, 0.472, 0.476, 0.481, 0.462, 0.447, 0.441, 0.426, 0.406, 0.373, 0.347, 0.337, 0.314,
    0.285, 0.277, 0.266, 0.25, 0.23, 0.207, 0.186, 0.171, 0.16, 0.148, 0.141, 0.136, 0.13, 0.126,
    0.123, 0.121, 0.122, 0.119, 0.114, 0.115, 0.117, 0.117, 0.118, 0.12, 0.122, 0.128, 0.132, 0.139,
    0.144, 0.146, 0.15, 0.152, 0.157, 0.159,
];

/// The red paint of the Cornell box: reflectance from 400 to 700 nm in steps of 4 nm.
#[rustfmt::skip]
const RED: [f64; 76] = [
    0.04, 0.046, 0.048, 0.053, 0.049, 0.05, 0.053, 0.055, 0.057, 0.056, 0.059, 0.057, 0.061, 0.061,
    0.06, 0.062, 0.062, 0.062, 0.061, 0.062, 0.06, 0.059, 0.057, 0.058, 0.058, 0.058, 0.056, 0.055,
    0.056, 0.059, 0.057, 0.055, 0.059, 0.059, 0.058, 0.059, 0.061, 0.061, 0.063, 0.063, 0.067, 0.068,
    0.072, 0.08, 0.09, 0.099, 0.124, 0.154, 0.192, 0.255, 0.287, 0.349, 0.402, 0.443, 0.487, 0.513,
    0.558, 0.584, 0.62, 0.606, 0.609, 0.651, 0.612, 0.61, 0.65, 0.638, 0.627, 0.62, 0.63, 0.628,
    0.642, 0.639, 0.657, 0.639, 0.635, 0.642,
];

fn samples(text: &str) -> Spectrum {
    let pair = |p: &str| {
        let (nm, value) = p.split_once(':').unwrap();
        (nm.parse().unwrap(), value.parse().unwrap())
    };
    Spectrum::from_samples(text.split(',').map(pair).collect()).unwrap()
}

fn paint(values: &[f64]) -> Spectrum {
    Spectrum::from_samples(values.iter().enumerate().map(|(i, v)| (400.0 + 4.0 * i as f64, *v)).collect())
        .unwrap()
}

#[track_caller]
fn assert_rgb(spectrum: &Spectrum, quantity: Quantity, expected: [f32; 3]) {
    let rgb = spectrum.to_rgb(quantity).rgb;
    for (found, expected) in rgb.to_array().into_iter().zip(expected) {
        assert!((found - expected).abs() <= 1e-4 * expected.max(1.0), "{rgb:?}, expected {expected:?}");
    }
}

#[test]
fn the_cornell_box_has_the_colours_that_mitsuba_gives_it() {
    assert_rgb(&paint(&WHITE), Quantity::Reflectance, [0.735013, 0.735625, 0.736264]);
    assert_rgb(&paint(&GREEN), Quantity::Reflectance, [0.0682825, 0.39776, 0.0862909]);
    assert_rgb(&paint(&RED), Quantity::Reflectance, [0.49132, 0.0492281, 0.0509219]);
    assert_rgb(&samples("400:0,500:8,600:15.6,700:18.4"), Quantity::Emission, [20.7108, 10.8546, 2.77115]);
    assert_rgb(&paint(&WHITE), Quantity::Emission, [0.885305, 0.699008, 0.666026]);
}

#[test]
fn each_quantity_is_reduced_its_own_way() {
    let ramp = samples("400:0.1,700:0.9");
    assert_rgb(&ramp, Quantity::Reflectance, [0.742853, 0.48114, 0.208325]);
    assert_rgb(&ramp, Quantity::Emission, [0.872215, 0.458728, 0.181301]);
    assert_rgb(&samples("400:0.3,700:0.5"), Quantity::Unbounded, [0.459432, 0.395218, 0.325681]);
    assert_rgb(&samples("300:1,900:1"), Quantity::Emission, [1.20488, 0.948228, 0.909267]);
}

#[test]
fn a_constant_is_neutral_except_as_light() {
    assert_rgb(&Spectrum::Constant(0.4), Quantity::Reflectance, [0.4; 3]);
    assert_rgb(&Spectrum::Constant(1.5), Quantity::Unbounded, [1.5; 3]);
    assert_rgb(&Spectrum::Constant(1.0), Quantity::Emission, [1.20479, 0.948291, 0.908916]);
}

#[test]
fn colours_out_of_gamut_are_clamped_and_told() {
    let narrow = samples("500:1,600:0.5,700:0.2");
    assert_rgb(&narrow, Quantity::Reflectance, [0.370116, 0.787465, 0.0]);
    assert!(narrow.to_rgb(Quantity::Reflectance).out_of_gamut.is_some_and(|raw| raw.b < 0.0));
    assert_rgb(&samples("400:2,700:3"), Quantity::Reflectance, [1.0; 3]);
    assert_eq!(paint(&WHITE).to_rgb(Quantity::Reflectance).out_of_gamut, None);
}

#[test]
fn bad_samples_are_refused() {
    let refused = |samples: &[(f64, f64)]| Spectrum::from_samples(samples.to_vec()).unwrap_err();
    assert_eq!(refused(&[(400.0, 1.0)]), "expected at least two wavelength:value pairs, found 1");
    assert_eq!(
        refused(&[(700.0, 0.1), (400.0, 0.3)]),
        "expected increasing wavelengths, found 400 after 700"
    );
    assert_eq!(
        refused(&[(400.0, f64::NAN), (500.0, 0.3)]),
        "expected positive wavelengths and finite values, found 400:NaN"
    );
}
