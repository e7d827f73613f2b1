//! `hair`: a fibre with an absorbing interior.

use super::parts::read_ior;
use super::{Input, Inputs, Plugin, Prepared, Source};
use crate::bsdf::Bsdf;
use crate::bsdf::hair::{Fibre, Hair as Lobes};
use crate::color::Rgb;
use crate::color::spectrum::Quantity;
use crate::error::Result;
use crate::ids::TextureId;
use std::ops::RangeInclusive;

/// Absorption of a unit concentration of eumelanin, per radius. [d'Eon 2011, Sec. 6.1]
const EUMELANIN: Rgb = Rgb::new(0.419, 0.697, 1.37);
/// Absorption of a unit concentration of pheomelanin, per radius. [d'Eon 2011, Sec. 6.1]
const PHEOMELANIN: Rgb = Rgb::new(0.187, 0.4, 1.05);
/// The minimum roughness. At 0 the lobes would be Dirac deltas.
const LEAST_ROUGHNESS: f32 = 1e-3;

/// A fibre with an absorbing interior.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Hair {
    /// Absorption per radius, before `scale`.
    pub sigma_a: Input<Rgb>,
    /// A factor on `sigma_a`.
    pub scale: f32,
    /// Index of refraction relative to that outside.
    pub eta: f32,
    /// Roughness along and around the fibre, in (0, 1].
    pub roughness: [f32; 2],
    /// Tilt of the scales in degrees.
    pub scale_tilt: f32,
}

/// Reads a number in a range, if it is given.
fn float(source: &mut dyn Source, name: &'static str, range: RangeInclusive<f64>) -> Result<Option<f32>> {
    match source.float(name)? {
        Some(value) if !range.contains(&value) => {
            let end = if *range.end() == f64::MAX { "infinity".to_owned() } else { range.end().to_string() };
            Err(source.refusal(name, &format!("expected a number from {} to {end}", range.start())))
        }
        value => Ok(value.map(|v| v as f32)),
    }
}

impl Plugin for Hair {
    const NAME: &'static str = "hair";

    fn read(source: &mut dyn Source) -> Result<Self> {
        let eumelanin = float(source, "eumelanin", 0.0..=f64::MAX)?;
        let pheomelanin = float(source, "pheomelanin", 0.0..=f64::MAX)?;
        let absorbs = source.has("sigma_a");
        let sigma_a = source.color("sigma_a", Quantity::Unbounded, 0.0)?;
        let scale = float(source, "scale", 0.0..=f64::MAX)?.unwrap_or(1.0);
        let pigments = eumelanin.is_some() || pheomelanin.is_some();
        if absorbs && pigments {
            let message = "expected either sigma_a or concentrations of pigments, found both";
            return Err(source.error("sigma_a", message));
        }
        let (sigma_a, scale) = match absorbs {
            true => (sigma_a, scale),
            // The factor does not apply to pigments.
            false => (
                (EUMELANIN * eumelanin.unwrap_or(1.3) + PHEOMELANIN * pheomelanin.unwrap_or(0.2)).into(),
                1.0,
            ),
        };
        let eta = read_ior(source, "int_ior", "amber")? / read_ior(source, "ext_ior", "air")?;
        if eta == 1.0 {
            return Err(source.object_error("expected different indices of refraction inside and outside"));
        }
        let roughness = ["longitudinal_roughness", "azimuthal_roughness"]
            .map(|name| float(source, name, 0.0..=1.0).map(|r| r.unwrap_or(0.3)));
        let [along, around] = roughness;
        let scale_tilt = float(source, "scale_tilt", -90.0..=90.0)?.unwrap_or(2.0);
        Ok(Hair { sigma_a, scale, eta, roughness: [along?, around?], scale_tilt })
    }

    fn textures(&self) -> Vec<TextureId> {
        self.sigma_a.texture().into_iter().collect()
    }

    fn transmits(&self) -> bool {
        true
    }

    fn has_tangents(&self) -> bool {
        true
    }

    fn bsdf<'a>(&'a self, _: &'a Prepared, inputs: &Inputs<'_>) -> Bsdf<'a> {
        let roughness = self.roughness.map(|r| r.max(LEAST_ROUGHNESS));
        Bsdf::Hair(Lobes {
            sigma_a: inputs.color(&self.sigma_a) * self.scale,
            eta: self.eta,
            fibre: Fibre::new(roughness, self.scale_tilt.to_radians()),
        })
    }
}
