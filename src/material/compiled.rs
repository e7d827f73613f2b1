//! Materials of a compiled scene: from a material and a surface point to a BSDF.

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
    /// What the scene says of it; without the outermost [`Material::TwoSided`] of a single material.
    material: Material,
    prepared: Prepared,
    /// Its BSDF, where that is the same everywhere.
    pub constant: Option<Bsdf<'static>>,
    /// Whether the back scatters as the front does: surface points turn their frames to the ray then.
    pub two_sided: bool,
    /// Whether the tangents of the local frame matter.
    pub tangents: bool,
    /// Whether light may pass as if there were no surface.
    pub holes: bool,
    /// How it is sampled. Holes are no lobes: see [`lobes_of`](Self::lobes_of).
    sampling: Sampling,
}

/// How directions are drawn.
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

/// A surface point as materials see it.
#[derive(Clone, Copy, Debug)]
pub struct MaterialPoint<'a> {
    /// For textures.
    pub texture: TexturePoint<'a>,
    /// The shading frame.
    pub frame: Frame,
    /// Geometric normal.
    pub ng: Vec3,
    /// Derivatives of the position by the texture coordinates.
    pub dp_duv: [Vec3; 2],
    /// Where the viewer is, in the shading frame; `None` where light is scattered to viewers yet unknown.
    pub wo: Option<Vec3>,
}

impl MaterialPoint<'_> {
    /// The point as the back's material sees it: the local frame is mirrored in the surface.
    fn behind(&self) -> Self {
        MaterialPoint { wo: self.wo.map(mirrored), ..*self }
    }
}

/// What scatters at a point, and the share of the surface that is there.
#[derive(Clone, Copy, Debug)]
pub struct Scattering<'a> {
    /// The BSDF of what is there.
    pub bsdf: Bsdf<'a>,
    /// The share, in [0, 1]; the rest lets light pass.
    pub opacity: f32,
}

impl Materials {
    /// Checks materials and prepares them.
    ///
    /// # Errors
    /// If an index is out of range, a material contains itself, or one inside a two-sided one transmits light.
    pub fn new(materials: Vec<Material>, textures: Vec<Arc<Texture>>) -> Result<Self> {
        check_references(&materials, textures.len())?;
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
            list.push(SceneMaterial {
                material: outer.clone(),
                prepared: outer.prepare(),
                constant: None,
                two_sided,
                tangents: is(outer, Material::has_tangents),
                holes: is(outer, Material::has_holes),
                sampling: Sampling::default(),
            });
        }
        let mut all = Materials { list, textures };
        for i in 0..all.list.len() {
            let sampling = all.sampling(MaterialId::from(i));
            let constant = all.constant(&all.list[i]);
            all.list[i] = SceneMaterial { constant, sampling, ..all.list[i].clone() };
        }
        Ok(all)
    }

    /// How a material is sampled.
    pub(super) fn sampling(&self, id: MaterialId) -> Sampling {
        let entry = self.get(id);
        entry.material.sampling(&entry.prepared, self)
    }

    /// The BSDF of a material that is not made of others, if its inputs are all constant and it refers to nothing.
    fn constant(&self, entry: &SceneMaterial) -> Option<Bsdf<'static>> {
        let SceneMaterial { material, prepared, .. } = entry;
        if !material.inner().is_empty() || !material.textures().is_empty() {
            return None;
        }
        material.bsdf(prepared, &self.inputs(&TexturePoint::at(Vec2::ZERO))).owned()
    }

    /// A material.
    #[inline]
    pub fn get(&self, id: MaterialId) -> &SceneMaterial {
        &self.list[id.index()]
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// All of them.
    pub fn iter(&self) -> impl Iterator<Item = &SceneMaterial> {
        self.list.iter()
    }

    /// The textures.
    pub fn textures(&self) -> &[Arc<Texture>] {
        &self.textures
    }

    /// A texture.
    pub(super) fn texture(&self, id: TextureId) -> &Texture {
        &self.textures[id.index()]
    }

    /// The values of parameters at a point.
    pub(super) fn inputs<'a>(&'a self, point: &'a TexturePoint<'a>) -> Inputs<'a> {
        Inputs { textures: &self.textures, point }
    }

    /// The share of the surface that is there.
    pub fn opacity(&self, id: MaterialId, point: &TexturePoint<'_>) -> f32 {
        self.get(id).material.opacity(self, point)
    }

    /// What scatters at a point. What it is made of lives in the arena.
    pub fn scattering<'a>(
        &'a self,
        id: MaterialId,
        at: &MaterialPoint<'a>,
        arena: &'a Bump,
    ) -> Scattering<'a> {
        Context { materials: self, at: *at, arena }.scattering(id)
    }

    /// As [`Context::inner`], at a point.
    pub fn inner<'a>(&'a self, id: MaterialId, at: &MaterialPoint<'a>, arena: &'a Bump) -> Scattering<'a> {
        Context { materials: self, at: *at, arena }.inner(id)
    }
}

/// A surface point, and the materials from which a BSDF is put together there.
#[derive(Clone, Copy)]
pub struct Context<'a> {
    /// All materials.
    pub materials: &'a Materials,
    /// The point.
    pub at: MaterialPoint<'a>,
    /// Where BSDFs live that others refer to.
    pub arena: &'a Bump,
}

impl<'a> Context<'a> {
    /// The values of parameters here.
    pub fn inputs(&self) -> Inputs<'_> {
        self.materials.inputs(&self.at.texture)
    }

    /// What scatters of a material.
    pub fn scattering(&self, id: MaterialId) -> Scattering<'a> {
        let entry = self.materials.get(id);
        match entry.constant {
            Some(bsdf) if !entry.holes => Scattering { bsdf, opacity: 1.0 },
            _ => entry.material.scattering(&entry.prepared, self),
        }
    }

    /// What scatters of a material inside another, or of light that goes to any viewer. Frames are turned to the ray
    /// for the outermost material only, so one that is two-sided gets both of its sides here.
    pub fn inner(&self, id: MaterialId) -> Scattering<'a> {
        if !self.materials.get(id).two_sided {
            return self.scattering(id);
        }
        self.both_sides(|_, context| context.scattering(id).bsdf)
    }

    /// What is made for the front (0) and for the back (1), each from the point as that side sees it. Of a viewer who
    /// is known only the side is made that he sees.
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

/// The values of parameters at a surface point.
#[derive(Clone, Copy)]
pub struct Inputs<'a> {
    textures: &'a [Arc<Texture>],
    point: &'a TexturePoint<'a>,
}

impl Inputs<'_> {
    /// The value of a colour.
    pub fn color(&self, input: &Input<Rgb>) -> Rgb {
        match input {
            Input::Constant(value) => *value,
            Input::Texture(id) => self.textures[id.index()].eval(self.point),
        }
    }

    /// The value of a number.
    pub fn number(&self, input: &Input<f32>) -> f32 {
        match input {
            Input::Constant(value) => *value,
            Input::Texture(id) => self.textures[id.index()].eval_scalar(self.point),
        }
    }

    /// The value of a number in [0, 1]: textures may overshoot.
    pub fn share(&self, input: &Input<f32>) -> f32 {
        self.number(input).clamp(0.0, 1.0)
    }
}

impl SceneMaterial {
    /// Its lobes on a surface that emits light or does not. Holes in what emits are deltas, for rays
    /// meet all of it; holes elsewhere are not met.
    pub fn lobes_of(&self, emits: bool) -> Lobes {
        if emits && self.holes { self.sampling.lobes.and(Lobes::deltas(1)) } else { self.sampling.lobes }
    }

    /// Whether sampling chooses among lobes on a surface that emits light or does not.
    pub fn chooses_lobe(&self, emits: bool) -> bool {
        self.sampling.chooses_lobe || (emits && self.holes)
    }

    /// Whether there is nothing anywhere.
    pub fn is_absent(&self) -> bool {
        matches!(self.material, Material::Null(_))
    }

    /// The name of its kind in the scene language.
    pub fn kind(&self) -> &'static str {
        self.material.kind()
    }
}

/// Whether something holds for a material or one that it is made of.
fn is_made_of(all: &[Material], material: &Material, f: fn(&Material) -> bool) -> bool {
    f(material) || material.inner().iter().any(|id| is_made_of(all, &all[id.index()], f))
}

/// Refuses indices that do not exist, and materials that contain themselves.
fn check_references(materials: &[Material], textures: usize) -> Result<()> {
    // A material's depth is known once that of those inside it is.
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
