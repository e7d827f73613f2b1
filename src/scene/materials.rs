//! The materials of a compiled scene, which convert a material and a surface point to a BSDF.

use crate::bsdf::fresnel::ConductorFresnel;
use crate::bsdf::microfacet::Microfacets;
use crate::bsdf::two_sided::mirrored;
use crate::bsdf::{
    Blend, Bsdf, Conductor, Dielectric, Diffuse, Lobes, Plastic, Principled, PrincipledThin, RoughConductor,
    RoughDielectric, RoughPlastic, RoughTransmittance, ThinDielectric, Tilted, TwoSided,
};
use crate::color::Rgb;
use crate::error::{Error, Result};
use crate::ids::{MaterialId, TextureId};
use crate::material::{Bending, Input, Material, Metal, Roughness};
use crate::math::{Frame, Vec2, Vec3};
use crate::texture::{Texture, TexturePoint};
use bumpalo::Bump;
use std::sync::Arc;

/// The least roughness. Squares of smaller values underflow in `f32`.
const MIN_ALPHA: f32 = 1e-4;

/// A material of the compiled scene.
#[derive(Clone)]
pub struct SceneMaterial {
    /// The scene's material, without an outer [`Material::TwoSided`] if both sides are equal.
    material: Material,
    coat: Coat,
    /// The BSDF, if it is constant over the surface.
    pub constant: Option<Bsdf<'static>>,
    /// Whether the back scatters as the front does. Surface interactions then flip their frame to the ray's side.
    pub two_sided: bool,
    /// Whether the BSDF depends on the tangents of the local frame.
    pub tangents: bool,
    /// Whether rays may pass as if there were no surface.
    pub holes: bool,
    /// The lobes, without holes: see [`lobes_of`](Self::lobes_of).
    lobes: Lobes,
    /// Whether sampling chooses among lobes.
    lobe_choice: bool,
}

/// Precomputed transmittance of a dielectric coat.
#[derive(Clone, Default)]
struct Coat {
    /// The fraction of diffuse light that a smooth coat reflects back inside.
    fdr_int: f32,
    /// The transmittance of a rough coat.
    rough: Option<Arc<RoughTransmittance>>,
}

impl Coat {
    fn of(material: &Material) -> Self {
        match material {
            Material::Plastic(interface, _) => Coat {
                fdr_int: Plastic::new(Rgb::WHITE, Rgb::WHITE, interface.eta(), false).fdr_int,
                rough: None,
            },
            Material::RoughPlastic { interface, distribution, alpha, .. } => {
                let rough = RoughTransmittance::new(*distribution, alpha.max(MIN_ALPHA), interface.eta());
                Coat { fdr_int: 0.0, rough: Some(Arc::new(rough)) }
            }
            _ => Coat::default(),
        }
    }
}

/// The materials and textures of a scene.
pub struct Materials {
    list: Vec<SceneMaterial>,
    textures: Vec<Arc<Texture>>,
}

/// A surface point as input of material evaluation.
#[derive(Clone, Copy, Debug)]
pub struct MaterialPoint<'a> {
    /// The input of textures.
    pub texture: TexturePoint<'a>,
    /// The shading frame.
    pub frame: Frame,
    /// Geometric normal.
    pub ng: Vec3,
    /// Derivatives of the position with respect to the texture coordinates.
    pub dp_duv: [Vec3; 2],
    /// The direction to the viewer in the shading frame; `None` if light is scattered towards unknown viewers.
    pub wo: Option<Vec3>,
}

impl MaterialPoint<'_> {
    /// Returns the point for the material of the back side, whose local frame is mirrored at the surface.
    fn on_back(&self) -> Self {
        MaterialPoint { wo: self.wo.map(mirrored), ..*self }
    }
}

/// The BSDF at a point and the opacity.
#[derive(Clone, Copy, Debug)]
pub struct Scattering<'a> {
    /// The BSDF of the surface where it exists.
    pub bsdf: Bsdf<'a>,
    /// The opacity, in [0, 1]; the remaining fraction of the light passes.
    pub opacity: f32,
}

impl Materials {
    /// Validates and prepares materials.
    ///
    /// # Errors
    /// If an index is out of range, a material contains itself, or a two-sided material contains one that transmits
    /// light.
    pub fn new(materials: Vec<Material>, textures: Vec<Arc<Texture>>) -> Result<Self> {
        check_references(&materials, textures.len())?;
        let mut list: Vec<SceneMaterial> = Vec::with_capacity(materials.len());
        for material in &materials {
            let is = |material, f: fn(&Material) -> bool| is_made_of(&materials, material, f);
            if let Material::TwoSided(sides) = material {
                for side in sides.map(|side| &materials[side.index()]) {
                    if is(side, |m| matches!(m, Material::TwoSided(_))) {
                        return Err(Error::scene("expected a one-sided material inside a twosided one"));
                    }
                    if is(side, Material::transmits) {
                        return Err(Error::scene("a material that transmits light cannot be made twosided"));
                    }
                }
            }
            let (outer, two_sided) = match material {
                Material::TwoSided([front, back]) if front == back => (&materials[front.index()], true),
                other => (other, false),
            };
            list.push(SceneMaterial {
                material: outer.clone(),
                coat: Coat::of(outer),
                constant: None,
                two_sided,
                tangents: is(outer, has_tangents),
                holes: is(outer, has_holes),
                lobes: Lobes::default(),
                lobe_choice: false,
            });
        }
        let mut all = Materials { list, textures };
        for i in 0..all.list.len() {
            let entry = &all.list[i];
            let (lobes, lobe_choice) = all.sampling(entry);
            let constant = all.constant(&entry.material, &entry.coat);
            all.list[i] = SceneMaterial { constant, lobes, lobe_choice, ..all.list[i].clone() };
        }
        Ok(all)
    }

    /// Returns the lobes of a material and whether sampling chooses among them. Textures do not change the lobes of a
    /// BSDF.
    fn sampling(&self, entry: &SceneMaterial) -> (Lobes, bool) {
        let inner = entry.material.inner();
        let inner = inner.iter().map(|id| self.sampling(self.get(*id)));
        let all_at_once = matches!(entry.material, Material::Blend { .. });
        let both = |(a, b): (Lobes, bool), (c, d): (Lobes, bool)| {
            (if all_at_once { a.and(c) } else { a.or(c) }, b || d)
        };
        let (lobes, choice) = inner.fold((Lobes::default(), false), both);
        match &entry.material {
            // A null material scatters nothing. On an emitter it is a hole.
            Material::Null => (Lobes::default(), false),
            Material::Mask { .. } | Material::Blend { .. } => (lobes, true),
            Material::TwoSided(_) => (lobes, choice),
            // Scattering of light considers both normals.
            Material::BumpMap { bending, .. } | Material::NormalMap { bending, .. } => {
                (lobes, choice || bending.flip_invalid)
            }
            simple => {
                let bsdf = self.simple(simple, &entry.coat, &TexturePoint::at(Vec2::ZERO));
                (bsdf.lobes(), bsdf.chooses_lobe())
            }
        }
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

    /// Iterates over all materials.
    pub fn iter(&self) -> impl Iterator<Item = &SceneMaterial> {
        self.list.iter()
    }

    /// Returns the textures.
    pub fn textures(&self) -> &[Arc<Texture>] {
        &self.textures
    }

    /// Returns the opacity of the surface at a point.
    pub fn opacity(&self, id: MaterialId, point: &TexturePoint<'_>) -> f32 {
        self.opacity_of(&self.get(id).material, point)
    }

    fn opacity_of(&self, material: &Material, point: &TexturePoint<'_>) -> f32 {
        match material {
            Material::Null => 0.0,
            Material::Mask { opacity, inner } => {
                self.unit_value(opacity, point) * self.opacity(*inner, point)
            }
            Material::Blend { weight, inner: [a, b] } => {
                let w = self.unit_value(weight, point);
                (1.0 - w) * self.opacity(*a, point) + w * self.opacity(*b, point)
            }
            Material::BumpMap { inner, .. } | Material::NormalMap { inner, .. } => {
                self.opacity(*inner, point)
            }
            _ => 1.0,
        }
    }

    /// Evaluates the material at a point. Nested BSDFs are allocated in the arena.
    pub fn scattering<'a>(
        &'a self,
        id: MaterialId,
        at: &MaterialPoint<'a>,
        arena: &'a Bump,
    ) -> Scattering<'a> {
        let entry = self.get(id);
        if let Some(bsdf) = entry.constant {
            return Scattering { bsdf, opacity: 1.0 };
        }
        let point = &at.texture;
        match &entry.material {
            Material::Null => Scattering { bsdf: Bsdf::Null, opacity: 0.0 },
            Material::Mask { opacity, inner } => {
                let inner = self.inner(*inner, at, arena);
                Scattering { opacity: inner.opacity * self.unit_value(opacity, point), ..inner }
            }
            Material::Blend { weight, inner } => {
                let w = self.unit_value(weight, point);
                let [a, b] = inner.map(|id| self.inner(id, at, arena));
                let (share_a, share_b) = ((1.0 - w) * a.opacity, w * b.opacity);
                let opacity = share_a + share_b;
                let bsdf = if share_b == 0.0 {
                    a.bsdf
                } else if share_a == 0.0 {
                    b.bsdf
                } else {
                    let bsdfs = [a, b].map(|s| &*arena.alloc(s.bsdf));
                    Bsdf::Blend(Blend { weight: share_b / opacity, bsdfs })
                };
                Scattering { bsdf, opacity }
            }
            Material::BumpMap { height, scale, bending, inner } => {
                let gradient = self.texture(*height).gradient(point) * *scale;
                self.tilted(at, bumped_normal(at, gradient), *bending, *inner, arena)
            }
            Material::NormalMap { normals, bending, inner } => {
                let n = self.texture(*normals).eval(point);
                let n = Vec3::new(n.r, n.g, n.b) * 2.0 - Vec3::ONE;
                self.tilted(at, n, *bending, *inner, arena)
            }
            Material::TwoSided(sides) => {
                let bsdf =
                    self.both_sides(at, arena, |side, at| self.scattering(sides[side], at, arena).bsdf);
                Scattering { bsdf, opacity: 1.0 }
            }
            simple => Scattering { bsdf: self.simple(simple, &entry.coat, point), opacity: 1.0 },
        }
    }

    /// Evaluates a nested material, or a material for light scattered towards unknown viewers. Only the frame of the
    /// outermost material is flipped to the ray's side, so a two-sided material is evaluated for both sides here.
    pub fn inner<'a>(&'a self, id: MaterialId, at: &MaterialPoint<'a>, arena: &'a Bump) -> Scattering<'a> {
        if !self.get(id).two_sided {
            return self.scattering(id, at, arena);
        }
        let bsdf = self.both_sides(at, arena, |_, at| self.scattering(id, at, arena).bsdf);
        Scattering { bsdf, opacity: 1.0 }
    }

    /// Creates a BSDF from those for the front (0) and the back (1), each evaluated at the point as seen from that
    /// side. If the viewer is known, only the BSDF of the visible side is created.
    fn both_sides<'a>(
        &'a self,
        at: &MaterialPoint<'a>,
        arena: &'a Bump,
        make: impl Fn(usize, &MaterialPoint<'a>) -> Bsdf<'a>,
    ) -> Bsdf<'a> {
        let side = |side: usize| -> &'a Bsdf<'a> {
            let at = if side == 0 { *at } else { at.on_back() };
            arena.alloc(make(side, &at))
        };
        let sides = match at.wo {
            Some(wo) => [side(usize::from(wo.z < 0.0)); 2],
            None => [side(0), side(1)],
        };
        Bsdf::TwoSided(TwoSided { sides })
    }

    /// Evaluates the nested material around the local normal `n`, which need not be of unit length.
    fn tilted<'a>(
        &'a self,
        at: &MaterialPoint<'a>,
        n: Vec3,
        bending: Bending,
        inner: MaterialId,
        arena: &'a Bump,
    ) -> Scattering<'a> {
        let turned = Vec3::new(-n.x, -n.y, n.z);
        let tilt = |n: Vec3, turned: Option<&'a Tilted<'a>>| {
            let frame = Frame::from_normal_tangent(n.try_normalize().unwrap_or(Vec3::Z), Vec3::X);
            let world = Frame {
                s: at.frame.to_world(frame.s),
                t: at.frame.to_world(frame.t),
                n: at.frame.to_world(frame.n),
            };
            let wo = at.wo.map(|wo| frame.to_local(wo));
            let Scattering { bsdf, opacity } =
                self.inner(inner, &MaterialPoint { frame: world, wo, ..*at }, arena);
            (Tilted { frame, soften: bending.soften, inner: arena.alloc(bsdf), turned }, opacity)
        };
        let (tilted, opacity) = match at.wo {
            _ if !bending.flip_invalid => tilt(n, None),
            Some(wo) if wo.z * wo.dot(n) <= 0.0 => tilt(turned, None),
            Some(_) => tilt(n, None),
            None => {
                let (turned, _) = tilt(turned, None);
                tilt(n, Some(arena.alloc(turned)))
            }
        };
        Scattering { bsdf: Bsdf::Tilted(tilted), opacity }
    }

    /// Evaluates a material without nested materials.
    fn simple<'a>(&'a self, material: &'a Material, coat: &'a Coat, point: &TexturePoint<'_>) -> Bsdf<'a> {
        match material {
            Material::Diffuse { reflectance } => {
                Bsdf::Diffuse(Diffuse { reflectance: self.color(reflectance, point) })
            }
            Material::Conductor(metal) => Bsdf::Conductor(Conductor {
                fresnel: self.fresnel(metal, point),
                specular_reflectance: self.color(&metal.specular_reflectance, point),
            }),
            Material::RoughConductor(metal, roughness) => Bsdf::RoughConductor(RoughConductor {
                microfacets: self.microfacets(roughness, point),
                fresnel: self.fresnel(metal, point),
                specular_reflectance: self.color(&metal.specular_reflectance, point),
            }),
            Material::Dielectric(interface, transmittance) => Bsdf::Dielectric(Dielectric {
                eta: interface.eta(),
                specular_reflectance: self.color(&interface.specular_reflectance, point),
                specular_transmittance: self.color(transmittance, point),
            }),
            Material::ThinDielectric(interface, transmittance) => Bsdf::ThinDielectric(ThinDielectric {
                eta: interface.eta(),
                specular_reflectance: self.color(&interface.specular_reflectance, point),
                specular_transmittance: self.color(transmittance, point),
            }),
            Material::RoughDielectric(interface, transmittance, roughness) => {
                Bsdf::RoughDielectric(RoughDielectric {
                    microfacets: self.microfacets(roughness, point),
                    eta: interface.eta(),
                    specular_reflectance: self.color(&interface.specular_reflectance, point),
                    specular_transmittance: self.color(transmittance, point),
                })
            }
            Material::Plastic(interface, base) => Bsdf::Plastic(Plastic {
                diffuse_reflectance: self.color(&base.diffuse_reflectance, point),
                specular_reflectance: self.color(&interface.specular_reflectance, point),
                eta: interface.eta(),
                nonlinear: base.nonlinear,
                fdr_int: coat.fdr_int,
            }),
            Material::Principled(p) => Bsdf::Principled(Principled {
                base_color: self.color(&p.base_color, point),
                roughness: self.unit_value(&p.roughness, point),
                anisotropy: self.unit_value(&p.anisotropic, point),
                metallic: self.unit_value(&p.metallic, point),
                spec_trans: self.unit_value(&p.spec_trans, point),
                eta: p.eta,
                spec_tint: self.unit_value(&p.spec_tint, point),
                sheen: self.unit_value(&p.sheen, point),
                sheen_tint: self.unit_value(&p.sheen_tint, point),
                flatness: self.unit_value(&p.flatness, point),
                clearcoat: self.unit_value(&p.clearcoat, point),
                clearcoat_gloss: self.unit_value(&p.clearcoat_gloss, point),
            }),
            Material::PrincipledThin(p) => Bsdf::PrincipledThin(PrincipledThin {
                base_color: self.color(&p.base_color, point),
                roughness: self.unit_value(&p.roughness, point),
                anisotropy: self.unit_value(&p.anisotropic, point),
                spec_trans: self.unit_value(&p.spec_trans, point),
                eta: self.number(&p.eta, point),
                spec_tint: self.unit_value(&p.spec_tint, point),
                sheen: self.unit_value(&p.sheen, point),
                sheen_tint: self.unit_value(&p.sheen_tint, point),
                flatness: self.unit_value(&p.flatness, point),
                diff_trans: self.number(&p.diff_trans, point).clamp(0.0, 2.0),
            }),
            Material::RoughPlastic { interface, base, distribution, alpha, sample_visible } => {
                let Some(transmittance) = &coat.rough else { return Bsdf::Null };
                let alpha = alpha.max(MIN_ALPHA);
                Bsdf::RoughPlastic(RoughPlastic {
                    microfacets: Microfacets {
                        distribution: *distribution,
                        alpha_x: alpha,
                        alpha_y: alpha,
                        sample_visible: *sample_visible,
                    },
                    diffuse_reflectance: self.color(&base.diffuse_reflectance, point),
                    specular_reflectance: self.color(&interface.specular_reflectance, point),
                    eta: interface.eta(),
                    nonlinear: base.nonlinear,
                    transmittance,
                })
            }
            Material::Mask { .. }
            | Material::Blend { .. }
            | Material::BumpMap { .. }
            | Material::NormalMap { .. }
            | Material::TwoSided(_)
            | Material::Null => Bsdf::Null,
        }
    }

    fn fresnel(&self, metal: &Metal, point: &TexturePoint<'_>) -> ConductorFresnel {
        ConductorFresnel { eta: self.color(&metal.eta, point), k: self.color(&metal.k, point) }
    }

    fn microfacets(&self, roughness: &Roughness, point: &TexturePoint<'_>) -> Microfacets {
        let [alpha_x, alpha_y] = [0, 1].map(|i| self.number(&roughness.alpha[i], point).max(MIN_ALPHA));
        Microfacets {
            distribution: roughness.distribution,
            alpha_x,
            alpha_y,
            sample_visible: roughness.sample_visible,
        }
    }

    /// Returns the BSDF of a material without nested materials, if all its inputs are constant.
    fn constant(&self, material: &Material, coat: &Coat) -> Option<Bsdf<'static>> {
        if !material.inner().is_empty() || inputs_vary(material) {
            return None;
        }
        // BSDFs that refer to other data are created at each point.
        match self.simple(material, coat, &TexturePoint::at(Vec2::ZERO)) {
            Bsdf::Diffuse(b) => Some(Bsdf::Diffuse(b)),
            Bsdf::Conductor(b) => Some(Bsdf::Conductor(b)),
            Bsdf::RoughConductor(b) => Some(Bsdf::RoughConductor(b)),
            Bsdf::Dielectric(b) => Some(Bsdf::Dielectric(b)),
            Bsdf::ThinDielectric(b) => Some(Bsdf::ThinDielectric(b)),
            Bsdf::RoughDielectric(b) => Some(Bsdf::RoughDielectric(b)),
            Bsdf::Plastic(b) => Some(Bsdf::Plastic(b)),
            Bsdf::Principled(b) => Some(Bsdf::Principled(b)),
            Bsdf::PrincipledThin(b) => Some(Bsdf::PrincipledThin(b)),
            Bsdf::Null
            | Bsdf::RoughPlastic(_)
            | Bsdf::Blend(_)
            | Bsdf::Mask(_)
            | Bsdf::Tilted(_)
            | Bsdf::TwoSided(_) => None,
        }
    }

    fn texture(&self, id: TextureId) -> &Texture {
        &self.textures[id.index()]
    }

    fn color(&self, input: &Input<Rgb>, point: &TexturePoint<'_>) -> Rgb {
        match input {
            Input::Constant(value) => *value,
            Input::Texture(id) => self.texture(*id).eval(point),
        }
    }

    fn number(&self, input: &Input<f32>, point: &TexturePoint<'_>) -> f32 {
        match input {
            Input::Constant(value) => *value,
            Input::Texture(id) => self.texture(*id).eval_scalar(point),
        }
    }

    /// Evaluates an input and clamps it to [0, 1], because textures may exceed the range.
    fn unit_value(&self, input: &Input<f32>, point: &TexturePoint<'_>) -> f32 {
        self.number(input, point).clamp(0.0, 1.0)
    }
}

impl SceneMaterial {
    /// Returns the lobes on a surface that emits or does not emit light. On emitting surfaces, holes are Dirac
    /// deltas, because rays hit the whole surface. On other surfaces, rays do not hit the holes.
    pub fn lobes_of(&self, emits: bool) -> Lobes {
        if emits && self.holes { self.lobes.and(Lobes::deltas(1)) } else { self.lobes }
    }

    /// Returns whether sampling chooses among lobes on a surface that emits or does not emit light.
    pub fn chooses_lobe(&self, emits: bool) -> bool {
        self.lobe_choice || (emits && self.holes)
    }

    /// Returns whether the material is null, so that the surface does not exist.
    pub fn is_absent(&self) -> bool {
        matches!(self.material, Material::Null)
    }

    /// Returns the name of the material's type in the scene language.
    pub fn kind(&self) -> &'static str {
        self.material.kind()
    }
}

/// Returns the local normal of a surface displaced by a height with the given derivatives with respect to the texture
/// coordinates. [Blinn 1978, without the derivative of the surface's own normal]
fn bumped_normal(at: &MaterialPoint<'_>, gradient: Vec2) -> Vec3 {
    let n = at.frame.n;
    let [du, dv] = [0, 1].map(|i| {
        let d = at.dp_duv[i];
        d + n * (gradient[i] - n.dot(d))
    });
    let bent = du.cross(dv);
    let bent = if bent.dot(at.ng) < 0.0 { -bent } else { bent };
    at.frame.to_local(bent)
}

fn inputs_vary(material: &Material) -> bool {
    material.textures().next().is_some()
}

/// Returns whether a predicate holds for a material or one nested in it.
fn is_made_of(all: &[Material], material: &Material, f: fn(&Material) -> bool) -> bool {
    f(material) || material.inner().iter().any(|id| is_made_of(all, &all[id.index()], f))
}

/// Returns whether the material depends on the tangents: anisotropic lobes or perturbed normals.
fn has_tangents(material: &Material) -> bool {
    match material {
        Material::RoughConductor(_, roughness) | Material::RoughDielectric(_, _, roughness) => {
            roughness.alpha[0] != roughness.alpha[1]
        }
        Material::Principled(p) => p.anisotropic != Input::Constant(0.0),
        Material::PrincipledThin(p) => p.anisotropic != Input::Constant(0.0),
        Material::BumpMap { .. } | Material::NormalMap { .. } => true,
        _ => false,
    }
}

fn has_holes(material: &Material) -> bool {
    match material {
        Material::Null => true,
        Material::Mask { opacity, .. } => opacity.constant().is_none_or(|o| o < 1.0),
        _ => false,
    }
}

/// Rejects indices out of range and materials that contain themselves.
fn check_references(materials: &[Material], textures: usize) -> Result<()> {
    // The depth of a material is known once the depths of its nested materials are.
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
            if let Some(id) = material.textures().find(|id| id.index() >= textures) {
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
