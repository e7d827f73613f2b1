//! BSDFs.

use super::{Builder, unknown_plugin};
use crate::color::Rgb;
use crate::color::conductors::{self, ComplexIor};
use crate::color::ior;
use crate::color::spectrum::Quantity;
use crate::error::Result;
use crate::ids::MaterialId;
use crate::loader::mitsuba::graph::{Child, ObjectId, Value};
use crate::loader::mitsuba::props::Props;
use crate::loader::wording;
use crate::loader::wording::quoted;
use crate::material::{
    Bending, Coated, Distribution, Input, Interface, Material, Metal, Principled, PrincipledThin, Roughness,
};

const SUPPORTED: [&str; 16] = [
    "blendbsdf",
    "bumpmap",
    "conductor",
    "dielectric",
    "diffuse",
    "mask",
    "normalmap",
    "null",
    "plastic",
    "principled",
    "principledthin",
    "roughconductor",
    "roughdielectric",
    "roughplastic",
    "thindielectric",
    "twosided",
];
const MITSUBA: [&str; 9] = [
    "circular",
    "hair",
    "measured",
    "measured_polarized",
    "neuralbsdf",
    "openpbr",
    "polarizer",
    "pplastic",
    "retarder",
];
/// What a conductor is made of when nothing is said: a perfect mirror.
const DEFAULT_CONDUCTOR: &str = "none";
/// Sampling rates of Mitsuba's principled models.
const SAMPLING_RATES: [&str; 5] = [
    "diffuse_reflectance_sampling_rate",
    "main_specular_sampling_rate",
    "clearcoat_sampling_rate",
    "diff_refl_sampling_rate",
    "diff_trans_sampling_rate",
];

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
            "diffuse" => Material::Diffuse { reflectance: self.reflectance(&props, "reflectance", 0.5)? },
            "conductor" => Material::Conductor(self.metal(&props)?),
            "roughconductor" => {
                let roughness = self.roughness(&props)?;
                Material::RoughConductor(self.metal(&props)?, roughness)
            }
            "dielectric" => Material::Dielectric(self.interface(&props, "bk7")?, self.transmittance(&props)?),
            "thindielectric" => {
                Material::ThinDielectric(self.interface(&props, "bk7")?, self.transmittance(&props)?)
            }
            "roughdielectric" => {
                let (interface, transmittance) =
                    (self.interface(&props, "bk7")?, self.transmittance(&props)?);
                Material::RoughDielectric(interface, transmittance, self.roughness(&props)?)
            }
            "plastic" => Material::Plastic(self.interface(&props, "polypropylene")?, self.coated(&props)?),
            "roughplastic" => Material::RoughPlastic {
                interface: self.interface(&props, "polypropylene")?,
                base: self.coated(&props)?,
                distribution: distribution(&props)?,
                alpha: props.positive("alpha", 0.1)?,
                sample_visible: props.boolean("sample_visible", true)?,
            },
            "principled" => Material::Principled(Box::new(self.principled(&props)?)),
            "principledthin" => Material::PrincipledThin(Box::new(self.principled_thin(&props)?)),
            "mask" => {
                let inner = self.only_child(&props)?;
                Material::Mask { opacity: self.share(&props, "opacity", 0.5)?, inner }
            }
            "blendbsdf" => self.blend(&props)?,
            "bumpmap" => self.bump_map(&props)?,
            "normalmap" => self.normal_map(&props)?,
            "twosided" => self.two_sided(&props)?,
            "null" => Material::Null,
            _ => return Err(unknown_plugin(props.object, &SUPPORTED, &MITSUBA)),
        };
        self.finish(props);
        let id = self.add_material(material);
        self.materials.insert(object, id);
        Ok(id)
    }

    /// The material of shapes that name none, as in Mitsuba: diffuse with reflectance 0.5, and black where they emit.
    pub fn default_material(&mut self, emits: bool) -> MaterialId {
        let index = usize::from(emits);
        if let Some(id) = self.default_materials[index] {
            return id;
        }
        let reflectance = Rgb::splat(if emits { 0.0 } else { 0.5 });
        let id = self.add_material(Material::Diffuse { reflectance: reflectance.into() });
        self.default_materials[index] = Some(id);
        id
    }

    /// A share of light by colour, in [0, 1], or a texture.
    fn reflectance(&mut self, props: &Props, name: &'static str, default: f32) -> Result<Input<Rgb>> {
        self.color_input(props, name, Quantity::Reflectance, default)
    }

    /// A number in [0, 1], or a texture.
    fn share(&mut self, props: &Props, name: &'static str, default: f32) -> Result<Input<f32>> {
        self.number_input(props, name, default, 0.0..=1.0)
    }

    fn transmittance(&mut self, props: &Props) -> Result<Input<Rgb>> {
        self.reflectance(props, "specular_transmittance", 1.0)
    }

    fn interface(&mut self, props: &Props, inside: &str) -> Result<Interface> {
        Ok(Interface {
            int_ior: dielectric_ior(props, "int_ior", inside)?,
            ext_ior: dielectric_ior(props, "ext_ior", "air")?,
            specular_reflectance: self.reflectance(props, "specular_reflectance", 1.0)?,
        })
    }

    fn coated(&mut self, props: &Props) -> Result<Coated> {
        Ok(Coated {
            diffuse_reflectance: self.reflectance(props, "diffuse_reflectance", 0.5)?,
            nonlinear: props.boolean("nonlinear", false)?,
        })
    }

    /// `material` by name, or `eta` and `k`.
    fn metal(&mut self, props: &Props) -> Result<Metal> {
        let specular_reflectance = self.reflectance(props, "specular_reflectance", 1.0)?;
        let name = props.text("material")?;
        let eta = self.color_input(props, "eta", Quantity::Unbounded, 0.0)?;
        let k = self.color_input(props, "k", Quantity::Unbounded, 1.0)?;
        let given = ["eta", "k"].into_iter().find(|name| props.has(name));
        match (name, given) {
            (Some(_), Some(other)) => {
                Err(props.error(other, "expected either material or eta and k, found both"))
            }
            (None, Some(_)) => Ok(Metal { eta, k, specular_reflectance }),
            (name, None) => {
                let name = name.unwrap_or(DEFAULT_CONDUCTOR);
                let ComplexIor { eta, k } = conductors::conductor(name).ok_or_else(|| {
                    let near = wording::did_you_mean(name, conductors::conductor_names());
                    props.refusal("material", &format!("expected the name of a conductor{near}"))
                })?;
                Ok(Metal { eta: eta.into(), k: k.into(), specular_reflectance })
            }
        }
    }

    fn roughness(&mut self, props: &Props) -> Result<Roughness> {
        let alpha = match (props.has("alpha"), props.has("alpha_u"), props.has("alpha_v")) {
            (_, false, false) => [self.alpha(props, "alpha")?; 2],
            (false, true, true) => [self.alpha(props, "alpha_u")?, self.alpha(props, "alpha_v")?],
            _ => return Err(props.object.error("expected either alpha or both alpha_u and alpha_v")),
        };
        let (distribution, sample_visible) = (distribution(props)?, props.boolean("sample_visible", true)?);
        Ok(Roughness { distribution, alpha, sample_visible })
    }

    fn alpha(&mut self, props: &Props, name: &'static str) -> Result<Input<f32>> {
        self.number_input(props, name, 0.1, f32::MIN_POSITIVE..=f32::MAX)
    }

    fn principled(&mut self, props: &Props) -> Result<Principled> {
        let eta = match (props.float("eta")?, props.float("specular")?) {
            (Some(_), Some(_)) => {
                return Err(props.error("specular", "expected either eta or specular, found both"));
            }
            (Some(_), None) => props.positive("eta", 1.5)?,
            (None, specular) => {
                // Normal reflectance 0.08·specular. [Burley 2015]
                let specular = specular.unwrap_or(0.5);
                if !(0.0..=1.0).contains(&specular) {
                    return Err(props.refusal("specular", "expected a number from 0 to 1"));
                }
                (2.0 / (1.0 - (0.08 * specular).sqrt()) - 1.0) as f32
            }
        };
        let parameters = Principled {
            base_color: self.reflectance(props, "base_color", 0.5)?,
            roughness: self.share(props, "roughness", 0.5)?,
            anisotropic: self.share(props, "anisotropic", 0.0)?,
            metallic: self.share(props, "metallic", 0.0)?,
            spec_trans: self.share(props, "spec_trans", 0.0)?,
            eta,
            spec_tint: self.share(props, "spec_tint", 0.0)?,
            sheen: self.share(props, "sheen", 0.0)?,
            sheen_tint: self.share(props, "sheen_tint", 0.0)?,
            flatness: self.share(props, "flatness", 0.0)?,
            clearcoat: self.share(props, "clearcoat", 0.0)?,
            clearcoat_gloss: self.share(props, "clearcoat_gloss", 0.0)?,
        };
        self.ignore(props, &SAMPLING_RATES, "lobes are sampled by what they reflect");
        Ok(parameters)
    }

    fn principled_thin(&mut self, props: &Props) -> Result<PrincipledThin> {
        let parameters = PrincipledThin {
            base_color: self.reflectance(props, "base_color", 0.5)?,
            roughness: self.share(props, "roughness", 0.5)?,
            anisotropic: self.share(props, "anisotropic", 0.0)?,
            spec_trans: self.share(props, "spec_trans", 0.0)?,
            eta: self.number_input(props, "eta", 1.5, f32::MIN_POSITIVE..=f32::MAX)?,
            spec_tint: self.share(props, "spec_tint", 0.0)?,
            sheen: self.share(props, "sheen", 0.0)?,
            sheen_tint: self.share(props, "sheen_tint", 0.0)?,
            flatness: self.share(props, "flatness", 0.0)?,
            diff_trans: self.number_input(props, "diff_trans", 0.0, 0.0..=2.0)?,
        };
        self.ignore(props, &SAMPLING_RATES, "lobes are sampled by what they reflect");
        self.ignore(props, &["spec_reflect_sampling_rate", "spec_trans_sampling_rate"], "see there");
        Ok(parameters)
    }

    /// The materials of the BSDFs inside it.
    fn children<const N: usize>(&mut self, props: &Props) -> Result<[MaterialId; N]> {
        let children = props.children("bsdf");
        let Ok(children) = <[&Child; N]>::try_from(children.as_slice()) else {
            let expected = if N == 1 { "a bsdf".to_owned() } else { format!("{N} bsdfs") };
            let error =
                props.object.error(format!("expected {expected} inside it, found {}", children.len()));
            return Err(match children.get(N) {
                Some(extra) => error.at(extra.spot.place()),
                None => error,
            });
        };
        let mut ids = [MaterialId(0); N];
        for (id, child) in ids.iter_mut().zip(children) {
            *id = self.material(child.object)?;
        }
        Ok(ids)
    }

    fn only_child(&mut self, props: &Props) -> Result<MaterialId> {
        let [inner] = self.children(props)?;
        Ok(inner)
    }

    fn blend(&mut self, props: &Props) -> Result<Material> {
        let inner = self.children(props)?;
        if !props.has("weight") {
            return Err(props.object.error("the property weight is missing"));
        }
        Ok(Material::Blend { weight: self.share(props, "weight", 0.5)?, inner })
    }

    fn bump_map(&mut self, props: &Props) -> Result<Material> {
        let inner = self.only_child(props)?;
        let height = match props.child("texture")? {
            Some(texture) => self.texture(texture)?,
            None => return Err(props.object.error("expected a texture inside it")),
        };
        let scale = props.float("scale")?.unwrap_or(1.0) as f32;
        if !scale.is_finite() {
            return Err(props.refusal("scale", "expected a finite number"));
        }
        Ok(Material::BumpMap { height, scale, bending: bending(props)?, inner })
    }

    fn normal_map(&mut self, props: &Props) -> Result<Material> {
        let inner = self.only_child(props)?;
        let Input::Texture(normals) = self.color_input(props, "normalmap", Quantity::Unbounded, 0.5)? else {
            return Err(props.error("normalmap", "expected a texture"));
        };
        Ok(Material::NormalMap { normals, bending: bending(props)?, inner })
    }

    /// One material for both sides, or one for each.
    fn two_sided(&mut self, props: &Props) -> Result<Material> {
        let sides = match props.children("bsdf")[..] {
            [_, _] => self.children(props)?,
            [_, _, extra, ..] => {
                let error = props.object.error("expected one or two bsdfs inside it, found more");
                return Err(error.at(extra.spot.place()));
            }
            _ => [self.only_child(props)?; 2],
        };
        let materials = &self.loaded.description.materials;
        let innermost = sides.map(|side| match &materials[side.index()] {
            Material::TwoSided(inner) => inner[0],
            _ => side,
        });
        for side in innermost {
            if transmits(materials, side) {
                return Err(props.object.error("a material that transmits light cannot be made two-sided"));
            }
        }
        Ok(Material::TwoSided(innermost))
    }
}

/// Whether light may pass through a material.
fn transmits(materials: &[Material], id: MaterialId) -> bool {
    let material = &materials[id.index()];
    material.transmits() || material.inner().iter().any(|inner| transmits(materials, *inner))
}

fn bending(props: &Props) -> Result<Bending> {
    Ok(Bending {
        flip_invalid: props.boolean("flip_invalid_normals", true)?,
        soften: props.boolean("use_shadowing_function", true)?,
    })
}

fn distribution(props: &Props) -> Result<Distribution> {
    let words = [("beckmann", Distribution::Beckmann), ("ggx", Distribution::Ggx)];
    props.choice("distribution", &words, Distribution::Beckmann)
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
            let near = wording::did_you_mean(text, ior::dielectric_names());
            props.refusal(name, &format!("expected a number or the name of a dielectric{near}"))
        }),
        _ => Err(property.error(format!("expected a number or a name, found a {}", property.tag))),
    }
}
