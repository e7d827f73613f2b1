//! Measured coefficients of materials.

/// The coefficients of a material, mm⁻¹ in linear Rec.709 RGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Preset {
    /// The name, in small letters.
    pub name: &'static str,
    /// The reduced scattering coefficient. Scattering with it is isotropic.
    pub sigma_s: [f32; 3],
    /// The absorption coefficient.
    pub sigma_a: [f32; 3],
}

const fn preset(name: &'static str, sigma_s: [f32; 3], sigma_a: [f32; 3]) -> Preset {
    Preset { name, sigma_s, sigma_a }
}

/// The measured materials of [Jensen et al. 2001, Fig. 5]. The table of Mitsuba 0.6 has a tenth of the red absorption
/// of the two chickens.
pub const PRESETS: [Preset; 12] = [
    preset("apple", [2.29, 2.39, 1.97], [0.0030, 0.0034, 0.046]),
    preset("chicken1", [0.15, 0.21, 0.38], [0.015, 0.077, 0.19]),
    preset("chicken2", [0.19, 0.25, 0.32], [0.018, 0.088, 0.20]),
    preset("cream", [7.38, 5.47, 3.15], [0.0002, 0.0028, 0.0163]),
    preset("ketchup", [0.18, 0.07, 0.03], [0.061, 0.97, 1.45]),
    preset("marble", [2.19, 2.62, 3.00], [0.0021, 0.0041, 0.0071]),
    preset("potato", [0.68, 0.70, 0.55], [0.0024, 0.0090, 0.12]),
    preset("skimmilk", [0.70, 1.22, 1.90], [0.0014, 0.0025, 0.0142]),
    preset("skin1", [0.74, 0.88, 1.01], [0.032, 0.17, 0.48]),
    preset("skin2", [1.09, 1.59, 1.79], [0.013, 0.070, 0.145]),
    preset("spectralon", [11.6, 20.4, 14.9], [0.0, 0.0, 0.0]),
    preset("wholemilk", [2.55, 3.21, 3.77], [0.0011, 0.0024, 0.014]),
];
