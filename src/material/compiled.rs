//! Materials of a compiled scene, which turn a surface point into a BSDF.

use super::{Input, Material, Prepared};
use crate::bsdf::two_sided::mirrored;
use crate::bsdf::{self, Bsdf, Lobes};
use crate::color::Rgb;
use crate::error::{Error, Result};
use crate::ids::{MaterialId, TextureId};
use crate::math::{Frame, Vec2, Vec3};
use crate::texture::{Texture, TexturePoint};
use bumpalo::Bump;
use std::sync::Arc;

/// A material of the compiled scene.
#[derive(Clone)]
pub struct SceneMaterial {
    /// The material of the description, without the outermost [`Material::TwoSided`] of a single material.
    material: Material,
    prepared: Prepared,
    /// The index of the kind of material among those of the scene.
    pub kind: usize,
    /// The BSDF, if it is constant over the surface and borrows nothing.
    pub constant: Option<Bsdf<'static>>,
    /// Whether the BSDF is constant over the surface.
    pub uniform: bool,
    /// Whether the BSDF depends on nothing but textures.
    pub plain: bool,
    /// Whether the back scatters as the front does. If so, surface points turn their frames to the ray.
    pub two_sided: bool,
    /// Whether the tangents of the local frame matter.
    pub tangents: bool,
    /// Whether light may pass through the surface without scattering.
    pub holes: bool,
    /// Whether light may pass through the surface, at some of its points at least.
    pub transmits: bool,
    /// The sampling of directions. Holes are not lobes here: see [`lobes_of`](Self::lobes_of).
    sampling: Sampling,
}

/// Properties of the sampling of directions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sampling {
    /// The lobes.
    pub lobes: Lobes,
    /// Whether sampling chooses among lobes.
    pub chooses_lobe: bool,
}

/// The materials and textures of a scene.
pub struct Materials {
    list: Vec<SceneMaterial>,
    textures: Vec<Arc<Texture>>,
}

/// A surface point as the input of a material.
#[derive(Clone, Copy, Debug)]
pub struct MaterialPoint<'a> {
    /// The point at which textures are evaluated.
    pub texture: TexturePoint<'a>,
    /// The shading frame.
    pub frame: Frame,
    /// Geometric normal.
    pub ng: Vec3,
    /// Derivatives of the position with respect to the texture coordinates.
    pub dp_duv: [Vec3; 2],
    /// Direction to the viewer in the shading frame; `None` if it is not known yet, as for light paths.
    pub wo: Option<Vec3>,
}

impl MaterialPoint<'_> {
    /// Returns the point for the material of the back, with the local frame mirrored in the surface.
    fn behind(&self) -> Self {
        MaterialPoint { wo: self.wo.map(mirrored), ..*self }
    }
}

/// The BSDF and the opacity at a point.
#[derive(Clone, Copy, Debug)]
pub struct Scattering<'a> {
    /// The BSDF of the surface outside its holes.
    pub bsdf: Bsdf<'a>,
    /// Probability that a ray hits the surface, in [0, 1]. Other rays pass through.
    pub opacity: f32,
}

impl Materials {
    /// Checks and prepares materials.
    ///
    /// # Errors
    /// If an index is out of range, a material contains itself, or a material inside a two-sided one transmits light.
    pub fn new(materials: Vec<Material>, textures: Vec<Arc<Texture>>) -> Result<Self> {
        check_references(&materials, textures.len())?;
        let mut kinds = Vec::new();
        let mut list: Vec<SceneMaterial> = Vec::with_capacity(materials.len());
        for material in &materials {
            let is = |material, f: fn(&Material) -> bool| is_made_of(&materials, material, f);
            if let Material::TwoSided(outer) = material {
                for side in outer.sides.map(|side| &materials[side.index()]) {
                    if is(side, |m| matches!(m, Material::TwoSided(_))) {
                        return Err(Error::scene("expected a one-sided material inside a twosided one"));
                    }
                    if is(side, Material::transmits) {
                        return Err(Error::scene("a material that transmits light cannot be made twosided"));
                    }
                }
            }
            let (outer, two_sided) = match material {
                Material::TwoSided(outer) if outer.sides[0] == outer.sides[1] => {
                    (&materials[outer.sides[0].index()], true)
                }
                other => (other, false),
            };
            let kind =
                kinds.iter().position(|&kind| kind == std::mem::discriminant(outer)).unwrap_or_else(|| {
                    kinds.push(std::mem::discriminant(outer));
                    kinds.len() - 1
                });
            list.push(SceneMaterial {
                kind,
                material: outer.clone(),
                prepared: outer.prepare(),
                constant: None,
                uniform: outer.inner().is_empty() && outer.textures().is_empty(),
                plain: outer.inner().is_empty() && !is(outer, Material::has_holes),
                two_sided,
                tangents: is(outer, Material::has_tangents),
                holes: is(outer, Material::has_holes),
                transmits: is(outer, Material::transmits),
                sampling: Sampling::default(),
            });
        }
        let mut all = Materials { list, textures };
        for i in 0..all.list.len() {
            let sampling = all.sampling(MaterialId::from(i));
            let constant = all.uniform(&all.list[i]).and_then(Bsdf::owned);
            all.list[i] = SceneMaterial { constant, sampling, ..all.list[i].clone() };
        }
        Ok(all)
    }

    /// Returns how a material is sampled.
    pub(super) fn sampling(&self, id: MaterialId) -> Sampling {
        let entry = self.get(id);
        entry.material.sampling(&entry.prepared, self)
    }

    /// Returns the BSDF of a material that is the same at all points of a surface, as it is without textures and inner
    /// materials.
    #[inline]
    pub fn uniform<'a>(&'a self, entry: &'a SceneMaterial) -> Option<Bsdf<'a>> {
        let point = TexturePoint::at(Vec2::ZERO);
        entry.uniform.then(|| entry.material.bsdf(&entry.prepared, &self.inputs(&point)))
    }

    /// Returns the BSDF at a point of a material that depends on nothing but its own textures; `None` if it has holes,
    /// inner materials or a BSDF for each side.
    #[inline]
    pub fn textured<'a>(&'a self, entry: &'a SceneMaterial, point: &TexturePoint<'_>) -> Option<Bsdf<'a>> {
        entry.plain.then(|| entry.material.bsdf(&entry.prepared, &self.inputs(point)))
    }

    /// Calls `found` for the name of each mesh attribute that a material, or one that it is made of, reads.
    pub fn attributes(&self, id: MaterialId, found: &mut dyn FnMut(&str)) {
        let material = &self.get(id).material;
        for texture in material.textures() {
            self.textures()[texture.index()].attributes(&mut |attribute| found(&attribute.name));
        }
        material.inner().iter().for_each(|inner| self.attributes(*inner, found));
    }

    /// Returns a material.
    #[inline]
    pub fn get(&self, id: MaterialId) -> &SceneMaterial {
        &self.list[id.index()]
    }

    /// Returns the number of materials.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// Returns whether there are no materials.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Returns all materials.
    pub fn iter(&self) -> impl Iterator<Item = &SceneMaterial> {
        self.list.iter()
    }

    /// Returns the textures.
    pub fn textures(&self) -> &[Arc<Texture>] {
        &self.textures
    }

    /// Returns a texture.
    pub(super) fn texture(&self, id: TextureId) -> &Texture {
        &self.textures[id.index()]
    }

    /// Returns an evaluator of parameters at a point.
    #[inline]
    pub(super) fn inputs<'a>(&'a self, point: &'a TexturePoint<'a>) -> Inputs<'a> {
        Inputs { textures: &self.textures, point }
    }

    /// Returns the opacity of a material at a point, for a ray that makes an angle with the given cosine, in [0, 1],
    /// with the shading normal.
    pub fn opacity(&self, id: MaterialId, point: &TexturePoint<'_>, cosine: f32) -> f32 {
        self.get(id).material.opacity(self, point, cosine)
    }

    /// Returns the BSDF and opacity at a point. The arena holds inner BSDFs.
    pub fn scattering<'a>(
        &'a self,
        id: MaterialId,
        at: &MaterialPoint<'a>,
        arena: &'a Bump,
    ) -> Scattering<'a> {
        Context { materials: self, at: *at, arena }.scattering(id)
    }

    /// Calls [`Context::inner`] for a point.
    pub fn inner<'a>(&'a self, id: MaterialId, at: &MaterialPoint<'a>, arena: &'a Bump) -> Scattering<'a> {
        Context { materials: self, at: *at, arena }.inner(id)
    }
}

/// A surface point and the materials from which its BSDF is made.
#[derive(Clone, Copy)]
pub struct Context<'a> {
    /// All materials.
    pub materials: &'a Materials,
    /// The point.
    pub at: MaterialPoint<'a>,
    /// The arena of inner BSDFs.
    pub arena: &'a Bump,
}

impl<'a> Context<'a> {
    /// Returns an evaluator of parameters at this point.
    pub fn inputs(&self) -> Inputs<'_> {
        self.materials.inputs(&self.at.texture)
    }

    /// Returns the BSDF and opacity of a material.
    pub fn scattering(&self, id: MaterialId) -> Scattering<'a> {
        let entry = self.materials.get(id);
        match entry.constant {
            Some(bsdf) if !entry.holes => Scattering { bsdf, opacity: 1.0 },
            _ => entry.material.scattering(&entry.prepared, self),
        }
    }

    /// Returns the BSDF and opacity of a material inside another one, or for an unknown viewer. Only the outermost
    /// material has its frame turned to the ray, so a two-sided material has both of its sides here.
    pub fn inner(&self, id: MaterialId) -> Scattering<'a> {
        if !self.materials.get(id).two_sided {
            return self.scattering(id);
        }
        self.both_sides(|_, context| context.scattering(id).bsdf)
    }

    /// Makes the BSDFs of the front (0) and the back (1), each with the point in the local frame of that side. If the
    /// viewer is known, only the visible side is made.
    pub(super) fn both_sides(&self, make: impl Fn(usize, &Self) -> Bsdf<'a>) -> Scattering<'a> {
        let side = |side: usize| -> &'a Bsdf<'a> {
            let at = if side == 0 { self.at } else { self.at.behind() };
            self.arena.alloc(make(side, &Context { at, ..*self }))
        };
        let sides = match self.at.wo {
            Some(wo) => [side(usize::from(wo.z < 0.0)); 2],
            None => [side(0), side(1)],
        };
        Scattering { bsdf: Bsdf::TwoSided(bsdf::TwoSided { sides }), opacity: 1.0 }
    }
}

/// An evaluator of parameters at a surface point.
#[derive(Clone, Copy)]
pub struct Inputs<'a> {
    textures: &'a [Arc<Texture>],
    point: &'a TexturePoint<'a>,
}

impl Inputs<'_> {
    /// Returns the value of a colour.
    pub fn color(&self, input: &Input<Rgb>) -> Rgb {
        match input {
            Input::Constant(value) => *value,
            Input::Texture(id) => self.textures[id.index()].eval(self.point),
        }
    }

    /// Returns the value of a number.
    pub fn number(&self, input: &Input<f32>) -> f32 {
        match input {
            Input::Constant(value) => *value,
            Input::Texture(id) => self.textures[id.index()].eval_scalar(self.point),
        }
    }

    /// Returns the value of a number in [0, 1], clamped because texture values may lie outside.
    pub fn share(&self, input: &Input<f32>) -> f32 {
        self.number(input).clamp(0.0, 1.0)
    }
}

impl SceneMaterial {
    /// Returns the lobes on a surface that emits light or does not. A hole in an emitter is a Dirac delta, because rays
    /// hit the whole surface of an emitter. Rays do not hit a hole in another surface.
    pub fn lobes_of(&self, emits: bool) -> Lobes {
        if emits && self.holes { self.sampling.lobes.and(Lobes::deltas(1)) } else { self.sampling.lobes }
    }

    /// Returns whether sampling chooses among lobes on a surface that emits light or does not.
    pub fn chooses_lobe(&self, emits: bool) -> bool {
        self.sampling.chooses_lobe || (emits && self.holes)
    }

    /// Returns whether [`Bsdf::gloss`] may find a lobe.
    pub fn may_be_glossy(&self) -> bool {
        match self.constant {
            Some(bsdf) => [Vec3::Z, -Vec3::Z].into_iter().any(|wo| bsdf.gloss(wo).is_some()),
            None => !matches!(self.material, Material::Diffuse(_)),
        }
    }

    /// Returns whether the material is [`Material::Null`].
    pub fn is_absent(&self) -> bool {
        matches!(self.material, Material::Null(_))
    }

    /// Returns whether the surface is a pane that rays may pass, with a probability that depends on their direction.
    pub fn is_pane(&self) -> bool {
        matches!(&self.material, Material::ThinDielectric(sheet) if sheet.passed)
    }

    /// Returns the name of the plugin in the scene language.
    pub fn kind(&self) -> &'static str {
        self.material.kind()
    }
}

/// Returns whether `f` is true for a material or one of its inner materials.
fn is_made_of(all: &[Material], material: &Material, f: fn(&Material) -> bool) -> bool {
    f(material) || material.inner().iter().any(|id| is_made_of(all, &all[id.index()], f))
}

/// Checks that all indices exist and that no material contains itself.
fn check_references(materials: &[Material], textures: usize) -> Result<()> {
    // The depth of a material is known if the depths of its inner materials are.
    let mut known = vec![false; materials.len()];
    loop {
        let mut progress = false;
        for (i, material) in materials.iter().enumerate() {
            if known[i] {
                continue;
            }
            if let Some(id) = material.inner().iter().find(|id| id.index() >= materials.len()) {
                return Err(Error::internal(format!("there is no material {}", id.0)));
            }
            if let Some(id) = material.textures().iter().find(|id| id.index() >= textures) {
                return Err(Error::internal(format!("there is no texture {}", id.0)));
            }
            if material.inner().iter().all(|id| known[id.index()]) {
                known[i] = true;
                progress = true;
            }
        }
        if !progress {
            break;
        }
    }
    match known.iter().all(|k| *k) {
        true => Ok(()),
        false => Err(Error::scene("a material contains itself")),
    }
}
