//! Materials from the entries of MTL files. [Wavefront MTL] `docs/usage.md` has the table of keywords.

use super::Builder;
use super::mtl::Entry;
use super::textures::Plane;
use crate::color::Rgb;
use crate::error::{Error, Result};
use crate::ids::MaterialId;
use crate::material::{
    Bending, BumpMap, Coated, Conductor, Dielectric, Diffuse, Distribution, Input, Interface, Mask, Metal,
    NormalMap, RoughConductor, RoughPlastic, Roughness, TwoSided,
};

/// The index of refraction of a material without `Ni`, or with an `Ni` outside (1, 10].
const DEFAULT_IOR: f32 = 1.5;
/// The diffuse reflectance of a material without `Kd` and `map_Kd`.
const DEFAULT_REFLECTANCE: f32 = 0.5;
/// Keywords that `tobj` does not know and this module reads.
const KNOWN: [&str; 4] = ["Tf", "Tr", "map_Ke", "norm"];

/// The material and the emission of a shape.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    /// The material that scatters light.
    pub material: MaterialId,
    /// The radiance of the front; `None` without emission.
    pub emission: Option<Input<Rgb>>,
}

impl Builder<'_> {
    /// Creates the surface of an MTL material.
    ///
    /// # Errors
    /// If an image exists but cannot be read.
    pub fn make(&mut self, entry: &Entry) -> Result<Surface> {
        let m = &entry.material;
        self.note_ignored(entry);
        let emission = self.emission(entry)?;
        if matches!(m.illumination_model, Some(6 | 7)) {
            return Ok(Surface { material: self.glass(entry), emission });
        }
        let diffuse = self.diffuse(entry)?;
        let specular =
            m.specular.map_or(Rgb::splat(if m.specular_texture.is_some() { 1.0 } else { 0.0 }), Rgb::from);
        let specular = self.reflectance(entry, "Ks", m.specular_texture.as_deref(), specular)?;
        let is_black = |input: &Input<Rgb>| input.constant().is_some_and(Rgb::is_black);
        let base = if is_black(&specular) {
            self.loaded.description.add_material(Diffuse { reflectance: diffuse })
        } else if is_black(&diffuse) {
            let metal =
                Metal { eta: Rgb::BLACK.into(), k: Rgb::WHITE.into(), specular_reflectance: specular };
            match m.illumination_model {
                Some(3 | 5) => self.loaded.description.add_material(Conductor { metal }),
                _ => {
                    let alpha = [Input::Constant(alpha(m)); 2];
                    let roughness =
                        Roughness { distribution: Distribution::Beckmann, alpha, sample_visible: true };
                    self.loaded.description.add_material(RoughConductor { metal, roughness })
                }
            }
        } else {
            self.loaded.description.add_material(RoughPlastic {
                interface: Interface { int_ior: ior(m), ext_ior: 1.0, specular_reflectance: specular },
                base: Coated { diffuse_reflectance: diffuse, nonlinear: false },
                distribution: Distribution::Beckmann,
                alpha: alpha(m),
                sample_visible: true,
            })
        };
        let bent = self.bent(entry, base)?;
        let opaque = self.loaded.description.add_material(TwoSided::same(bent));
        Ok(Surface { material: self.mask(entry, opaque)?, emission })
    }

    /// Adds a warning about a material.
    pub fn warn(&mut self, entry: &Entry, message: impl Into<String>) {
        let thing = format!("newmtl {}", entry.material.name);
        self.loaded.warnings.push(Error::scene(message).about(thing).in_file(&entry.file));
    }

    /// Adds a note that lists the keywords of a material that are ignored.
    fn note_ignored(&mut self, entry: &Entry) {
        let m = &entry.material;
        let known = [("map_Ka", m.ambient_texture.is_some()), ("map_Ns", m.shininess_texture.is_some())];
        let known = known.iter().filter(|(_, is)| *is).map(|(keyword, _)| *keyword);
        let unknown = m.unknown_param.keys().map(String::as_str).filter(|k| !KNOWN.contains(k));
        let mut ignored: Vec<&str> = known.chain(unknown).collect();
        if ignored.is_empty() {
            return;
        }
        ignored.sort_unstable();
        let (file, name) = (entry.file.display(), &m.name);
        self.loaded.approximations.push(format!("{file}: newmtl {name}: ignored: {}", ignored.join(", ")));
    }

    /// Returns the diffuse reflectance. A black `Kd` beside a texture counts as white, because some programs write it.
    fn diffuse(&mut self, entry: &Entry) -> Result<Input<Rgb>> {
        let m = &entry.material;
        let map = m.diffuse_texture.as_deref();
        let factor = match (m.diffuse.map(Rgb::from), map) {
            (Some(factor), Some(_)) if factor.is_black() => Rgb::WHITE,
            (Some(factor), _) => factor,
            (None, Some(_)) => Rgb::WHITE,
            (None, None) => Rgb::splat(DEFAULT_REFLECTANCE),
        };
        self.reflectance(entry, "Kd", map, factor)
    }

    /// Returns a colour times a texture. Adds a warning if the colour must be clamped to [0, 1].
    fn reflectance(
        &mut self,
        entry: &Entry,
        keyword: &str,
        map: Option<&str>,
        factor: Rgb,
    ) -> Result<Input<Rgb>> {
        let limited = factor.map(clamped);
        if limited != factor {
            self.warn(entry, format!("expected a {keyword} in [0, 1]: it is limited to that"));
        }
        self.product(entry, map, Plane::Color, limited)
    }

    /// Creates smooth glass with the transmittance `Tf`. `d` is ignored, because glass is transparent already.
    fn glass(&mut self, entry: &Entry) -> MaterialId {
        let m = &entry.material;
        let filter = m.unknown_param.get("Tf").and_then(|text| {
            let numbers: Vec<f32> = text.split_whitespace().map_while(|word| word.parse().ok()).collect();
            numbers.first_chunk::<3>().map(|numbers| Rgb::from(*numbers).map(clamped))
        });
        self.loaded.description.add_material(Dielectric {
            interface: Interface { int_ior: ior(m), ext_ior: 1.0, specular_reflectance: Rgb::WHITE.into() },
            specular_transmittance: filter.unwrap_or(Rgb::WHITE).into(),
        })
    }

    /// Returns the material with perturbed normals, or `inner` if no texture perturbs them. `norm` is a normal map.
    /// `map_Bump` is a normal map if its image has colours, and a height map if it is grey.
    fn bent(&mut self, entry: &Entry, inner: MaterialId) -> Result<MaterialId> {
        let m = &entry.material;
        let bending = Bending { flip_invalid: true, soften: true };
        let norm = m.unknown_param.get("norm");
        let Some(map) = norm.or(m.normal_texture.as_ref()) else { return Ok(inner) };
        let Some((texture, image)) = self.bitmap(entry, map, Plane::Vector)? else { return Ok(inner) };
        if norm.is_some() || !image.is_grey {
            let normals = self.loaded.description.add_texture(texture);
            return Ok(self.loaded.description.add_material(NormalMap { normals, bending, inner }));
        }
        let Some(scale) = image.bump else {
            let note = "a grey map_Bump without -bm is ignored: -bm is its height in units of the scene";
            let (file, name) = (entry.file.display(), &m.name);
            self.loaded.approximations.push(format!("{file}: newmtl {name}: {note}"));
            return Ok(inner);
        };
        let height = self.loaded.description.add_texture(texture);
        Ok(self.loaded.description.add_material(BumpMap { height, scale, bending, inner }))
    }

    /// Returns the material with the opacity `d` times `map_d`. Without `d`, 1 − `Tr` takes its place.
    fn mask(&mut self, entry: &Entry, inner: MaterialId) -> Result<MaterialId> {
        let m = &entry.material;
        let transparency = || m.unknown_param.get("Tr").and_then(|text| text.parse::<f32>().ok());
        let d = m.dissolve.or_else(|| transparency().map(|t| 1.0 - t)).map_or(1.0, clamped);
        let opacity =
            match self.product(entry, m.dissolve_texture.as_deref(), Plane::Opacity, Rgb::splat(d))? {
                Input::Constant(_) if d == 1.0 => return Ok(inner),
                Input::Constant(_) => Input::Constant(d),
                Input::Texture(id) => Input::Texture(id),
            };
        Ok(self.loaded.description.add_material(Mask { opacity, inner }))
    }

    /// Returns the radiance of the front, `Ke` times `map_Ke`; `None` without emission.
    fn emission(&mut self, entry: &Entry) -> Result<Option<Input<Rgb>>> {
        let m = &entry.material;
        let map = m.unknown_param.get("map_Ke").map(String::as_str);
        let factor = m.emissive.map_or(if map.is_some() { Rgb::WHITE } else { Rgb::BLACK }, Rgb::from);
        if !factor.is_valid() {
            self.warn(entry, "expected a Ke that is finite and not negative: there is no emission");
            return Ok(None);
        }
        if factor.is_black() {
            return Ok(None);
        }
        Ok(Some(self.product(entry, map, Plane::Color, factor)?))
    }
}

/// Returns the roughness of Beckmann microfacets whose lobe is about as wide as a cosine lobe of exponent `Ns`.
/// [Walter 2007, Sec. 5.2, which relates the exponent of Phong's distribution to Beckmann's roughness]
fn alpha(m: &tobj::Material) -> f32 {
    let exponent = m.shininess.filter(|n| n.is_finite()).map_or(0.0, |n| n.max(0.0));
    (2.0 / (exponent + 2.0)).sqrt()
}

/// Returns the index of refraction `Ni`, or the default if it is missing or outside (1, 10].
fn ior(m: &tobj::Material) -> f32 {
    m.optical_density.filter(|n| *n > 1.0 && *n <= 10.0).unwrap_or(DEFAULT_IOR)
}

/// Returns a number clamped to [0, 1]; 0 for NaN.
fn clamped(value: f32) -> f32 {
    if value.is_nan() { 0.0 } else { value.clamp(0.0, 1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponents_become_roughness() {
        let alpha = |ns| alpha(&tobj::Material { shininess: ns, ..Default::default() });
        assert_eq!([None, Some(0.0), Some(-3.0), Some(f32::NAN)].map(alpha), [1.0; 4]);
        assert_eq!(alpha(Some(6.0)), 0.5);
        assert_eq!(alpha(Some(198.0)), 0.1);
    }
}
