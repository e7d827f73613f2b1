//! BSDFs: the plugins of [`material`](crate::material) read their parameters from objects of the file.

use super::{Builder, ObjectSource, unknown_plugin};
use crate::bsdf::Measured;
use crate::color::Rgb;
use crate::color::spectrum::Quantity;
use crate::error::Result;
use crate::ids::{MaterialId, TextureId};
use crate::loader::measurement;
use crate::loader::mitsuba::graph::{ObjectId, Value};
use crate::loader::mitsuba::props::Props;
use crate::material::source::{NumberOrName, Source};
use crate::material::{Diffuse, Input, Interface, Material, ThinDielectric};
use crate::texture::{Product, Texture};
use crate::util::wording::quoted;
use std::ops::RangeInclusive;
use std::sync::Arc;

const MITSUBA: [&str; 5] = ["hk", "irawan", "measured_polarized", "neuralbsdf", "openpbr"];
/// Filters that change the polarisation of light, each with the part of unpolarised light that passes.
pub const POLARISATION_FILTERS: [(&str, f32); 3] = [("circular", 0.5), ("polarizer", 0.5), ("retarder", 1.0)];

impl Builder<'_> {
    /// Returns the material of a BSDF. Each is instantiated once. The stand-in is grey and diffuse.
    ///
    /// # Errors
    /// As for [`instantiate`](super::instantiate).
    pub fn material(&mut self, object: ObjectId) -> Result<MaterialId> {
        if let Some(id) = self.materials.get(&object) {
            return Ok(*id);
        }
        let added = self.add_material(object);
        let id =
            self.or_stand_in(added, "rendered as grey diffuse", |builder| builder.default_material(false))?;
        self.loaded.description.name_material(id, &self.graph.objects[object].id);
        self.materials.insert(object, id);
        Ok(id)
    }

    fn add_material(&mut self, object: ObjectId) -> Result<MaterialId> {
        let props = Props::new(self.graph, object);
        if let Some((name, share)) =
            POLARISATION_FILTERS.iter().find(|(name, _)| *name == props.object.plugin)
        {
            self.approximate(format!("{name}: light is not polarised, so the filter dims it evenly"));
            let material = self.polarisation_filter(&props, *share)?;
            self.finish(props);
            return Ok(self.loaded.description.add_material(material));
        }
        let read = Material::read(&props.object.plugin, &mut ObjectSource { builder: self, props: &props })?;
        let Some(material) = read else {
            return Err(unknown_plugin(props.object, Material::NAMES, &MITSUBA));
        };
        self.finish(props);
        Ok(self.loaded.description.add_material(material))
    }

    /// Returns a sheet that passes a part of the light in a straight line.
    fn polarisation_filter(&mut self, props: &Props, share: f32) -> Result<ThinDielectric> {
        let transmittance = self.color_input(props, "transmittance", Quantity::Reflectance, 1.0)?;
        self.ignore(props, &["theta", "delta", "left_handed", "polarizing"], "light is not polarised");
        let specular_transmittance = match transmittance {
            Input::Constant(value) => Input::Constant(value * share),
            Input::Texture(id) => {
                let inner = self.loaded.description.textures[id.index()].clone();
                let share = Arc::new(Texture::Constant(Rgb::splat(share)));
                let product = Texture::Product(Product([inner, share]));
                Input::Texture(self.loaded.description.add_texture(Arc::new(product)))
            }
        };
        let interface = Interface { int_ior: 1.0, ext_ior: 1.0, specular_reflectance: Rgb::WHITE.into() };
        Ok(ThinDielectric { interface, specular_transmittance, passed: false })
    }

    /// Returns the material of shapes that name none, as in Mitsuba: diffuse with reflectance 0.5, and black if they
    /// emit.
    pub fn default_material(&mut self, emits: bool) -> MaterialId {
        let index = usize::from(emits);
        if let Some(id) = self.default_materials[index] {
            return id;
        }
        let reflectance = Rgb::splat(if emits { 0.0 } else { 0.5 });
        let id = self.loaded.description.add_material(Diffuse { reflectance: reflectance.into() });
        self.default_materials[index] = Some(id);
        id
    }
}

impl Source for ObjectSource<'_, '_> {
    fn number_or_name(&mut self, name: &'static str) -> Result<Option<NumberOrName>> {
        let Some(property) = self.props.find(name) else { return Ok(None) };
        match &property.value {
            Value::Float(_) | Value::Integer(_) => Ok(Some(NumberOrName::Number)),
            Value::Text(text) => Ok(Some(NumberOrName::Name(text.clone()))),
            _ => Err(property.error(format!("expected a number or a name, found a {}", property.tag))),
        }
    }

    fn color(&mut self, name: &'static str, quantity: Quantity, default: f32) -> Result<Input<Rgb>> {
        self.builder.color_input(self.props, name, quantity, default)
    }

    fn number(&mut self, name: &'static str, default: f32, range: RangeInclusive<f32>) -> Result<Input<f32>> {
        self.builder.number_input(self.props, name, default, range)
    }

    fn measurement(&mut self, name: &'static str) -> Result<Arc<Measured>> {
        let Some(text) = self.props.text(name)? else {
            return Err(self.props.object.error(format!("the property {name} is missing")));
        };
        match self.builder.folders.find(self.props.object.spot.file(), text) {
            Some(path) => Ok(Arc::new(measurement::load(&path, self.builder.memory)?)),
            None => Err(self.props.error(name, &format!("there is no file {}", quoted(text)))),
        }
    }

    fn texture(&mut self) -> Result<TextureId> {
        match self.props.child("texture")? {
            Some(texture) => self.builder.texture(texture),
            None => Err(self.props.object.error("expected a texture inside it")),
        }
    }

    fn inner(&mut self, least: usize, most: usize) -> Result<Vec<MaterialId>> {
        let children = self.props.children("bsdf");
        if !(least..=most).contains(&children.len()) {
            let (object, found) = (self.props.object, children.len());
            let expected = match (least, most) {
                (1, 1) => "a bsdf".to_owned(),
                (1, 2) if found > 2 => {
                    let error = object.error("expected one or two bsdfs inside it, found more");
                    return Err(error.at(children[2].spot.place()));
                }
                (1, 2) => "a bsdf".to_owned(),
                _ => format!("{least} bsdfs"),
            };
            let error = object.error(format!("expected {expected} inside it, found {found}"));
            return Err(match children.get(most) {
                Some(extra) => error.at(extra.spot.place()),
                None => error,
            });
        }
        children.into_iter().map(|child| self.builder.material(child.object)).collect()
    }

    fn texture_mean(&self, texture: TextureId) -> f32 {
        self.builder.loaded.description.textures[texture.index()].mean().mean()
    }

    fn constant_texture(&mut self, value: Rgb) -> TextureId {
        self.builder.loaded.description.add_texture(Arc::new(Texture::Constant(value)))
    }

    fn approximate(&mut self, text: &str) {
        let thing = self.props.object.thing();
        self.builder.approximate(format!("{thing}: {text}"));
    }

    fn materials(&self) -> &[Material] {
        &self.builder.loaded.description.materials
    }
}
