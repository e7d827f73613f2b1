//! BSDFs: `diffuse`, `conductor`, `roughconductor`, `dielectric`, `twosided`.

use super::{Builder, unknown_plugin};
use crate::color::Rgb;
use crate::color::conductors::{self, ComplexIor};
use crate::color::ior;
use crate::color::spectrum::Quantity;
use crate::error::Result;
use crate::ids::MaterialId;
use crate::loader::graph::{ObjectId, Value};
use crate::loader::names;
use crate::loader::props::Props;
use crate::loader::values::quoted;
use crate::material::{Distribution, Material};

const SUPPORTED: [&str; 5] = ["diffuse", "conductor", "roughconductor", "dielectric", "twosided"];
const MITSUBA: [&str; 18] = [
    "blendbsdf",
    "bumpmap",
    "circular",
    "hair",
    "mask",
    "measured",
    "measured_polarized",
    "normalmap",
    "null",
    "plastic",
    "polarizer",
    "pplastic",
    "principled",
    "principledthin",
    "retarder",
    "roughdielectric",
    "roughplastic",
    "thindielectric",
];
/// What a conductor is made of when nothing is said: a perfect mirror.
const DEFAULT_CONDUCTOR: &str = "none";

impl Builder<'_> {
    /// The material of a BSDF, instantiated once.
    ///
    /// # Errors
    /// As for [`instantiate`](super::instantiate).
    pub fn material(&mut self, object: ObjectId) -> Result<MaterialId> {
        if let Some(id) = self.materials.get(&object) {
            return Ok(*id);
        }
        let props = Props::new(self.graph, object);
        let material = match props.object.plugin.as_str() {
            "diffuse" => Material::Diffuse {
                reflectance: self.colour(&props, "reflectance", Quantity::Reflectance, 0.5)?,
            },
            "conductor" => {
                let ComplexIor { eta, k } = self.complex_ior(&props)?;
                Material::Conductor {
                    eta,
                    k,
                    specular_reflectance: self.specular(&props, "specular_reflectance")?,
                }
            }
            "roughconductor" => self.rough_conductor(&props)?,
            "dielectric" => Material::Dielectric {
                int_ior: dielectric_ior(&props, "int_ior", "bk7")?,
                ext_ior: dielectric_ior(&props, "ext_ior", "air")?,
                specular_reflectance: self.specular(&props, "specular_reflectance")?,
                specular_transmittance: self.specular(&props, "specular_transmittance")?,
            },
            "twosided" => self.two_sided(&props)?,
            _ => return Err(unknown_plugin(props.object, &SUPPORTED, &MITSUBA)),
        };
        self.finish(props);
        let id = self.add_material(material);
        self.materials.insert(object, id);
        Ok(id)
    }

    /// The material of shapes that name none: diffuse with reflectance 0.5, as in Mitsuba.
    pub fn default_material(&mut self) -> MaterialId {
        if let Some(id) = self.default_material {
            return id;
        }
        let id = self.add_material(Material::Diffuse { reflectance: Rgb::splat(0.5) });
        self.default_material = Some(id);
        id
    }

    fn specular(&mut self, props: &Props, name: &'static str) -> Result<Rgb> {
        self.colour(props, name, Quantity::Reflectance, 1.0)
    }

    /// `material` by name, or `eta` and `k`.
    fn complex_ior(&mut self, props: &Props) -> Result<ComplexIor> {
        let name = props.text("material")?;
        let eta = self.colour(props, "eta", Quantity::Unbounded, 0.0)?;
        let k = self.colour(props, "k", Quantity::Unbounded, 1.0)?;
        let given = props.find("eta").or(props.find("k"));
        match (name, given) {
            (Some(_), Some(property)) => {
                Err(property.error("expected either material or eta and k, found both"))
            }
            (None, Some(_)) => Ok(ComplexIor { eta, k }),
            (name, None) => {
                let name = name.unwrap_or(DEFAULT_CONDUCTOR);
                conductors::conductor(name).ok_or_else(|| {
                    let near = names::did_you_mean(name, conductors::conductor_names());
                    props.refusal("material", &format!("expected the name of a conductor{near}"))
                })
            }
        }
    }

    fn rough_conductor(&mut self, props: &Props) -> Result<Material> {
        let words = [("beckmann", Distribution::Beckmann), ("ggx", Distribution::Ggx)];
        let distribution = props.choice("distribution", &words, Distribution::Beckmann)?;
        let ComplexIor { eta, k } = self.complex_ior(props)?;
        Ok(Material::RoughConductor {
            distribution,
            alpha: alpha(props)?,
            sample_visible: props.boolean("sample_visible", true)?,
            eta,
            k,
            specular_reflectance: self.specular(props, "specular_reflectance")?,
        })
    }

    /// The same material on both sides.
    fn two_sided(&mut self, props: &Props) -> Result<Material> {
        let inner = match props.children("bsdf")[..] {
            [] => return Err(props.object.error("expected a bsdf inside it")),
            [one] => one,
            [_, second, ..] => {
                let error = props.object.error("different materials on the two sides are not supported");
                return Err(error.at(second.spot.place()));
            }
        };
        let id = self.material(inner.object)?;
        match &self.loaded.description.materials[id.index()] {
            Material::Dielectric { .. } => {
                Err(props.object.error("a material that transmits light cannot be made two-sided"))
            }
            Material::TwoSided(innermost) => Ok(Material::TwoSided(*innermost)),
            _ => Ok(Material::TwoSided(id)),
        }
    }
}

/// `alpha`, or `alpha_u` and `alpha_v`.
fn alpha(props: &Props) -> Result<[f32; 2]> {
    for name in ["alpha", "alpha_u", "alpha_v"] {
        if let Some(object) = props.named_child(name) {
            return Err(super::unsupported(object));
        }
    }
    let both = [props.find("alpha_u"), props.find("alpha_v")];
    match (props.find("alpha"), both) {
        (_, [None, None]) => Ok([props.positive("alpha", 0.1)?; 2]),
        (None, [Some(_), Some(_)]) => Ok([props.positive("alpha_u", 0.1)?, props.positive("alpha_v", 0.1)?]),
        _ => Err(props.object.error("expected either alpha or both alpha_u and alpha_v")),
    }
}

/// An index of refraction: a number or the name of a dielectric.
fn dielectric_ior(props: &Props, name: &'static str, default: &str) -> Result<f32> {
    let Some(property) = props.find(name) else {
        return ior::dielectric(default)
            .ok_or_else(|| props.object.error(format!("unknown dielectric {}", quoted(default))));
    };
    match &property.value {
        Value::Float(_) | Value::Integer(_) => props.positive(name, 1.0),
        Value::Text(text) => ior::dielectric(text).ok_or_else(|| {
            let near = names::did_you_mean(text, ior::dielectric_names());
            props.refusal(name, &format!("expected a number or the name of a dielectric{near}"))
        }),
        _ => Err(property.error(format!("expected a number or a name, found a {}", property.tag))),
    }
}
