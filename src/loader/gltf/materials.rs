//! Materials: metallic-roughness materials become principled BSDFs. [glTF 2.0, 3.9]

use super::Builder;
use super::meshes::{ALPHA, COLOR};
use super::textures::{Plane, TextureUse};
use crate::color::Rgb;
use crate::error::Result;
use crate::ids::{MaterialId, MediumId};
use crate::material::{Bending, Input, Mask, NormalMap, Principled, TwoSided};
use crate::medium::{Homogeneous, Medium, MediumBoundary, Phase};
use crate::texture::{Adjusted, MeshAttribute, Texture};
use gltf::material::AlphaMode;
use std::sync::Arc;

/// The index of refraction of a material that does not specify one. [KHR_materials_ior]
const DEFAULT_IOR: f32 = 1.5;
/// The alpha cutoff of a masked material that does not specify one. [glTF 2.0, 3.9.4]
const DEFAULT_CUTOFF: f32 = 0.5;

/// The properties of a primitive's surface that its material determines.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    /// The BSDF.
    pub material: MaterialId,
    /// The emitted radiance.
    pub emission: Option<Input<Rgb>>,
    /// The set of texture coordinates that the textures use.
    pub uv_set: u32,
    /// The medium behind it.
    pub boundary: MediumBoundary,
}

/// The vertex colours of a primitive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct VertexColors {
    /// Whether the primitive has vertex colours.
    pub color: bool,
    /// Whether the vertex colours have an alpha.
    pub alpha: bool,
}

impl Builder<'_> {
    /// Returns the surface of a material on a primitive with such vertex colours. Each surface is created once.
    ///
    /// # Errors
    /// If an image cannot be read.
    pub fn surface(&mut self, material: &gltf::Material<'_>, vertex: VertexColors) -> Result<Surface> {
        let key = (material.index(), vertex);
        if let Some(surface) = self.surfaces.get(&key) {
            return Ok(*surface);
        }
        let thing = match material.index() {
            Some(i) => format!("materials[{i}]"),
            None => "the default material".to_owned(),
        };
        if material.unlit() {
            self.warn(&thing, "it is lit, although KHR_materials_unlit asks for the contrary");
        }
        let uv_set = self.uv_set(material, &thing);
        let emission = self.emission(material, &thing)?;
        let principled = self.principled(material, vertex, &thing)?;
        let transmits = principled.spec_trans != Input::Constant(0.0);
        let boundary = if transmits { self.volume(material, &thing) } else { MediumBoundary::default() };
        let mut id = self.loaded.description.add_material(Box::new(principled));
        if let Some(normals) = material.normal_texture() {
            id = self.normal_map(&normals, id)?;
        }
        if material.double_sided() && !transmits {
            id = self.loaded.description.add_material(TwoSided::same(id));
        }
        if material.double_sided() && emission.is_some() {
            self.approximate("light comes from the front of double-sided materials only");
        }
        let name = material.name().unwrap_or_default();
        let material = self.mask(material, vertex, id)?;
        self.loaded.description.name_material(material, name);
        let surface = Surface { material, emission, uv_set, boundary };
        self.surfaces.insert(key, surface);
        Ok(surface)
    }

    /// Returns the set of texture coordinates that is used for all textures of a material.
    fn uv_set(&mut self, material: &gltf::Material<'_>, thing: &str) -> u32 {
        let pbr = material.pbr_metallic_roughness();
        let infos = [
            pbr.base_color_texture(),
            pbr.metallic_roughness_texture(),
            material.emissive_texture(),
            material.transmission().and_then(|t| t.transmission_texture()),
        ];
        let normals = material.normal_texture().map(|normals| TextureUse::of_normals(&normals).set);
        let mut sets = infos.iter().flatten().map(|info| TextureUse::new(info).set).chain(normals);
        let Some(first) = sets.next() else { return 0 };
        if sets.any(|set| set != first) {
            let message = format!(
                "its textures use several sets of texture coordinates: TEXCOORD_{first} is taken for all"
            );
            self.warn(thing, &message);
        }
        first
    }

    fn principled(
        &mut self,
        material: &gltf::Material<'_>,
        vertex: VertexColors,
        thing: &str,
    ) -> Result<Principled> {
        let pbr = material.pbr_metallic_roughness();
        let [r, g, b, _] = pbr.base_color_factor().map(share);
        let mut colors = Vec::new();
        if let Some(info) = pbr.base_color_texture() {
            colors.push(self.bitmap(&TextureUse::new(&info), Plane::Color)?);
        }
        if vertex.color {
            colors.push(attribute(COLOR));
        }
        let (mut roughness, mut metallic) = (Vec::new(), Vec::new());
        if let Some(info) = pbr.metallic_roughness_texture() {
            let used = TextureUse::new(&info);
            roughness.push(self.bitmap(&used, Plane::Channel(1))?);
            metallic.push(self.bitmap(&used, Plane::Channel(2))?);
        }
        let (mut transmission, mut factor) = (Vec::new(), 0.0);
        if let Some(extension) = material.transmission() {
            factor = share(extension.transmission_factor());
            if let Some(info) = extension.transmission_texture().filter(|_| factor > 0.0) {
                transmission.push(self.bitmap(&TextureUse::new(&info), Plane::Channel(0))?);
            }
        }
        if factor > 0.0 && !is_solid(material) {
            self.approximate(
                "light that is transmitted is refracted, as by solid bodies: walls are not taken as thin",
            );
        }
        let zero = Input::Constant(0.0);
        Ok(Principled {
            base_color: self.product(colors, Rgb::new(r, g, b)),
            roughness: self.number(roughness, share(pbr.roughness_factor())),
            anisotropic: zero,
            metallic: self.number(metallic, share(pbr.metallic_factor())),
            spec_trans: self.number(transmission, factor),
            eta: self.eta(material, thing),
            spec_tint: zero,
            sheen: zero,
            sheen_tint: zero,
            flatness: zero,
            clearcoat: zero,
            clearcoat_gloss: zero,
        })
    }

    /// Returns the medium behind a surface that transmits light: it absorbs. [KHR_materials_volume]
    fn volume(&mut self, material: &gltf::Material<'_>, thing: &str) -> MediumBoundary {
        let Some(volume) = material.volume().filter(|_| is_solid(material)) else {
            return MediumBoundary::default();
        };
        let (color, distance) = (Rgb::from(volume.attenuation_color()), volume.attenuation_distance());
        if !color.is_valid() || color.max_component() > 1.0 || distance.is_nan() || distance <= 0.0 {
            let expected = "expected an attenuation colour from 0 to 1 and a distance greater than 0";
            self.warn(thing, &format!("{expected}: nothing is absorbed"));
            return MediumBoundary::default();
        }
        // The colour is the transmittance of the distance. Coefficients are finite.
        let sigma_t = color.map(|c| (-c.max(f32::MIN_POSITIVE).ln() / distance).min(f32::MAX));
        if sigma_t.is_black() {
            return MediumBoundary::default();
        }
        let media = &mut self.loaded.description.media;
        let medium = Homogeneous { sigma_t, sigma_s: Rgb::BLACK, phase: Phase::Isotropic };
        media.push(Medium::Homogeneous(medium));
        MediumBoundary { interior: Some(MediumId::from(media.len() - 1)), exterior: None }
    }

    /// Returns the index of refraction.
    fn eta(&mut self, material: &gltf::Material<'_>, thing: &str) -> f32 {
        let ior = material.ior().unwrap_or(DEFAULT_IOR);
        if ior >= 1.0 && ior.is_finite() {
            return ior;
        }
        self.warn(
            thing,
            &format!("expected an index of refraction of at least 1, found {ior}: {DEFAULT_IOR} is taken"),
        );
        DEFAULT_IOR
    }

    /// Returns the material with perturbed normals.
    fn normal_map(
        &mut self,
        normals: &gltf::material::NormalTexture<'_>,
        inner: MaterialId,
    ) -> Result<MaterialId> {
        let mut texture = self.bitmap(&TextureUse::of_normals(normals), Plane::Vector)?;
        if matches!(*texture, Texture::Constant(_)) {
            return Ok(inner);
        }
        let scale = normals.scale();
        if scale != 1.0 && scale.is_finite() {
            // Colours are (n + 1) / 2; the scale applies to x and y of n.
            let offset = 0.5 - 0.5 * scale;
            texture = Arc::new(Texture::Adjusted(Adjusted {
                offset: Rgb::new(offset, offset, 0.0),
                ..Adjusted::scaled(texture, Rgb::new(scale, scale, 1.0))
            }));
        }
        let normals = self.loaded.description.add_texture(texture);
        let bending = Bending { flip_invalid: true, soften: true };
        Ok(self.loaded.description.add_material(NormalMap { normals, bending, inner }))
    }

    /// Returns the material with the opacity that alpha specifies.
    fn mask(
        &mut self,
        material: &gltf::Material<'_>,
        vertex: VertexColors,
        inner: MaterialId,
    ) -> Result<MaterialId> {
        let threshold = match material.alpha_mode() {
            AlphaMode::Opaque => return Ok(inner),
            AlphaMode::Blend => None,
            AlphaMode::Mask => Some(material.alpha_cutoff().unwrap_or(DEFAULT_CUTOFF)),
        };
        let pbr = material.pbr_metallic_roughness();
        let mut textures = Vec::new();
        if let Some(info) = pbr.base_color_texture() {
            textures.push(self.bitmap(&TextureUse::new(&info), Plane::Alpha)?);
        }
        if vertex.alpha {
            textures.push(attribute(ALPHA));
        }
        textures.retain(|texture| !matches!(**texture, Texture::Constant(_)));
        let factor = share(pbr.base_color_factor()[3]);
        let cut = |alpha: f32, threshold| f32::from(u8::from(alpha >= threshold));
        let opacity = match (self.number(textures, factor), threshold) {
            (opacity, None) => opacity,
            (Input::Constant(alpha), Some(threshold)) => Input::Constant(cut(alpha, threshold)),
            (Input::Texture(id), Some(threshold)) => {
                let texture = self.loaded.description.textures[id.index()].clone();
                let cut = Adjusted { threshold: Some(threshold), ..Adjusted::scaled(texture, Rgb::WHITE) };
                Input::Texture(self.loaded.description.add_texture(Arc::new(Texture::Adjusted(cut))))
            }
        };
        if opacity == Input::Constant(1.0) {
            return Ok(inner);
        }
        Ok(self.loaded.description.add_material(Mask { opacity, inner }))
    }

    /// Returns the radiance of the front; `None` if there is none.
    fn emission(&mut self, material: &gltf::Material<'_>, thing: &str) -> Result<Option<Input<Rgb>>> {
        let strength = material.emissive_strength().unwrap_or(1.0);
        let factor = Rgb::from(material.emissive_factor()) * strength;
        if factor.is_black() {
            return Ok(None);
        }
        if !factor.is_valid() {
            self.warn(thing, "expected an emission that is finite and not negative: there is none");
            return Ok(None);
        }
        let mut textures = Vec::new();
        if let Some(info) = material.emissive_texture() {
            textures.push(self.bitmap(&TextureUse::new(&info), Plane::Color)?);
        }
        self.note("emission, in nits, is taken as radiance in W/(m² sr), number for number");
        Ok(Some(self.product(textures, factor)))
    }
}

/// Returns whether the material is that of solid bodies, not that of thin walls. [KHR_materials_volume]
fn is_solid(material: &gltf::Material<'_>) -> bool {
    material.volume().is_some_and(|volume| volume.thickness_factor() > 0.0)
}

/// Clamps a number to [0, 1].
fn share(value: f32) -> f32 {
    value.clamp(0.0, 1.0)
}

/// Returns the texture of a vertex attribute.
fn attribute(name: &str) -> Arc<Texture> {
    Arc::new(Texture::MeshAttribute(MeshAttribute { name: name.to_owned(), scale: 1.0 }))
}
