//! What a point sees of the hemisphere above it, in strata: irradiance, its gradients, and how near surfaces are.
//!
//! The hemisphere is divided into `m` rings of elevation and `n` sectors of azimuth, so that every cell receives the same
//! share of a uniform light: the ring j is between sin²θ = j/m and (j+1)/m. [Ward and Heckbert 1992]

use crate::color::Rgb;
use crate::math::{Frame, Vec3};
use crate::sampling::hash::{pcg3d, to_unit};
use std::f32::consts::{PI, TAU};

/// How a hemisphere is divided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Strata {
    /// Rings of elevation.
    pub rings: usize,
    /// Sectors of azimuth.
    pub sectors: usize,
}

/// The derivatives of a colour along the three axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gradient {
    /// Along x, y and z.
    pub along: [Rgb; 3],
}

impl Gradient {
    /// Adds a change of the colour in the direction `v`.
    fn add(&mut self, v: Vec3, change: Rgb) {
        for (sum, v) in self.along.iter_mut().zip(v.to_array()) {
            *sum += change * v;
        }
    }

    /// The change of the colour over the vector `v`.
    pub fn dot(&self, v: Vec3) -> Rgb {
        self.along[0] * v.x + self.along[1] * v.y + self.along[2] * v.z
    }

    /// The gradient of the colour's luminance.
    pub fn luminance(&self) -> Vec3 {
        Vec3::from_array(self.along.map(|colour| colour.luminance()))
    }

    /// A multiple of it.
    pub fn scaled(&self, factor: f32) -> Gradient {
        Gradient { along: self.along.map(|colour| colour * factor) }
    }
}

impl Strata {
    /// About as many sectors as make cells square: π for each ring. [Ward and Heckbert 1992]
    pub fn new(rings: u32) -> Self {
        Strata { rings: rings as usize, sectors: (rings as f32 * PI).round() as usize }
    }

    /// Cells.
    pub fn cells(&self) -> usize {
        self.rings * self.sectors
    }

    /// A direction in each cell, ring by ring, in the local frame of the surface; `scramble` decides where in the cell.
    pub fn directions(&self, scramble: u32) -> impl Iterator<Item = Vec3> + use<> {
        let Strata { rings, sectors } = *self;
        (0..rings * sectors).map(move |cell| {
            let [x, y, _] = pcg3d(scramble, cell as u32, 0x6972_7261);
            let sin2 = ((cell / sectors) as f32 + to_unit(x)) / rings as f32;
            let phi = ((cell % sectors) as f32 + to_unit(y)) * (TAU / sectors as f32);
            let (sin_phi, cos_phi) = phi.sin_cos();
            let sin = sin2.sqrt();
            Vec3::new(sin * cos_phi, sin * sin_phi, (1.0 - sin2).max(0.0).sqrt())
        })
    }
}

/// The light of a hemisphere, one sample in each cell.
#[derive(Clone, Debug)]
pub struct Hemisphere<'a> {
    /// Its cells.
    pub strata: Strata,
    /// The surface's frame.
    pub frame: Frame,
    /// Radiance from each cell.
    pub radiance: &'a [Rgb],
    /// Distance of what is seen in each cell, infinite where there is nothing.
    pub distance: &'a [f32],
}

impl Hemisphere<'_> {
    fn at(&self, ring: usize, sector: usize) -> (Rgb, f32) {
        let cell = ring * self.strata.sectors + sector;
        (self.radiance[cell], self.distance[cell])
    }

    /// The tangent at azimuth `sectors` (in sectors, from the frame's first axis).
    fn tangent(&self, sectors: f32) -> Vec3 {
        let (sin, cos) = (sectors * (TAU / self.strata.sectors as f32)).sin_cos();
        self.frame.s * cos + self.frame.t * sin
    }

    /// Irradiance, W·m⁻².
    pub fn irradiance(&self) -> Rgb {
        let sum = self.radiance.iter().fold([0.0f64; 3], |sum, l| {
            [sum[0] + f64::from(l.r), sum[1] + f64::from(l.g), sum[2] + f64::from(l.b)]
        });
        let scale = f64::from(PI) / self.strata.cells() as f64;
        let [r, g, b] = sum.map(|s| (s * scale) as f32);
        Rgb::new(r, g, b)
    }

    /// The mean of the distances of what is seen, harmonic, so that near surfaces count most: infinite under an empty sky.
    pub fn harmonic_mean_distance(&self) -> f32 {
        let sum: f64 = self.distance.iter().map(|d| 1.0 / f64::from(*d)).sum();
        (self.strata.cells() as f64 / sum) as f32
    }

    /// The change of the irradiance with the surface's normal: the normal n′ sees about `gradient·(n × n′)` more.
    /// [Ward and Heckbert 1992]
    pub fn rotation_gradient(&self) -> Gradient {
        let Strata { rings, sectors } = self.strata;
        // The integral of tan θ over sin²θ from 0 to `sin2`: in the lowest ring it is half as large again as in its middle.
        let tangents = |sin2: f32| sin2.sqrt().min(1.0).asin() - (sin2 * (1.0 - sin2)).max(0.0).sqrt();
        let mut gradient = Gradient::default();
        for k in 0..sectors {
            let mut sum = Rgb::BLACK;
            for j in 0..rings {
                sum += self.at(j, k).0
                    * (tangents((j + 1) as f32 / rings as f32) - tangents(j as f32 / rings as f32));
            }
            gradient.add(self.tangent(k as f32 + 0.5 + 0.25 * sectors as f32), sum);
        }
        gradient.scaled(PI / sectors as f32)
    }

    /// The change of the irradiance along the surface: what moves in front of what, as the nearer of two neighbouring cells
    /// covers the farther one. [Ward and Heckbert 1992; Křivánek 2005]
    pub fn translation_gradient(&self) -> Gradient {
        let Strata { rings, sectors } = self.strata;
        let sin2 = |ring: usize| ring as f32 / rings as f32;
        let mut gradient = Gradient::default();
        for k in 0..sectors {
            let mut outwards = Rgb::BLACK;
            for j in 1..rings {
                let ((l, r), (l_in, r_in)) = (self.at(j, k), self.at(j - 1, k));
                let wall = sin2(j).sqrt() * (1.0 - sin2(j)) / r.min(r_in);
                outwards += (l - l_in) * wall;
            }
            gradient.add(self.tangent(k as f32 + 0.5), outwards * (TAU / sectors as f32));
            let before = (k + sectors - 1) % sectors;
            let mut around = Rgb::BLACK;
            for j in 0..rings {
                let ((l, r), (l_before, r_before)) = (self.at(j, k), self.at(j, before));
                let wall = (sin2(j + 1).sqrt() - sin2(j).sqrt()) / r.min(r_before);
                around += (l - l_before) * wall;
            }
            gradient.add(self.tangent(k as f32 + 0.25 * sectors as f32), around);
        }
        gradient
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is seen along a ray from `o` in the direction `d`: radiance and distance.
    type View = fn(Vec3, Vec3) -> (f32, f32);

    /// A white wall x = 0 of height 1 under a black sky, which ends nowhere.
    fn wall(o: Vec3, d: Vec3) -> (f32, f32) {
        let t = -o.x / d.x;
        let seen = t > 0.0 && o.z + t * d.z < 1.0;
        if seen { (1.0, t) } else { (0.0, f32::INFINITY) }
    }

    /// A black roof z = 1 over x < 0 under a white sky.
    fn roof(o: Vec3, d: Vec3) -> (f32, f32) {
        let t = (1.0 - o.z) / d.z;
        let seen = t > 0.0 && o.x + t * d.x < 0.0;
        if seen { (0.0, t) } else { (1.0, f32::INFINITY) }
    }

    fn hemisphere<T>(view: View, o: Vec3, n: Vec3, scramble: u32, f: impl FnOnce(&Hemisphere<'_>) -> T) -> T {
        let strata = Strata::new(64);
        let frame = Frame::from_normal(n);
        let seen = strata.directions(scramble).map(|d| view(o, frame.to_world(d)));
        let (radiance, distance): (Vec<_>, Vec<_>) = seen.map(|(l, t)| (Rgb::splat(l), t)).unzip();
        f(&Hemisphere { strata, frame, radiance: &radiance, distance: &distance })
    }

    /// The mean over many scrambles.
    fn mean(view: View, o: Vec3, n: Vec3, f: impl Fn(&Hemisphere<'_>) -> f32) -> f32 {
        (0..64).map(|i| hemisphere(view, o, n, i, &f)).sum::<f32>() / 64.0
    }

    /// [an infinite strip seen from the floor, and a half-plane above it: Howell, configuration factors B-71 and A-3]
    #[test]
    fn irradiance_and_gradients_of_a_wall_and_under_a_roof_are_those_of_the_closed_forms() {
        for (view, sign) in [(wall as View, 1.0), (roof as View, -1.0)] {
            for x in [0.3, 0.7, 1.5] {
                let o = Vec3::new(x, 0.0, 0.0);
                let root = (1.0 + x * x).sqrt();
                let wanted = 0.5 * PI * (1.0 - sign * x / root);
                let e = mean(view, o, Vec3::Z, |h| h.irradiance().r);
                assert!((e - wanted).abs() < 5e-3 * wanted, "at {x}: {e} instead of {wanted}");
                let slope = -sign * 0.5 * PI / root.powi(3);
                let g = mean(view, o, Vec3::Z, |h| h.translation_gradient().along[0].r);
                assert!((g - slope).abs() < 0.06 * slope.abs(), "gradient at {x}: {g} instead of {slope}");
                for axis in 1..3 {
                    let g = mean(view, o, Vec3::Z, |h| h.translation_gradient().along[axis].r);
                    assert!(g.abs() < 0.02, "gradient along {axis}: {g}");
                }
            }
        }
    }

    /// The rotation gradient against the difference of two hemispheres that lean a little.
    #[test]
    fn rotation_gradients_are_finite_differences() {
        let o = Vec3::new(0.5, 0.0, 0.0);
        for axis in [Vec3::X, Vec3::Y] {
            let lean = |angle: f32| (Vec3::Z + axis * angle).normalize();
            // Both see the wall above the floor only.
            let e = |n: Vec3| mean(wall, o, n, |h| h.irradiance().r);
            let difference = (e(lean(0.05)) - e(lean(-0.05))) / 0.1;
            let foretold = mean(wall, o, Vec3::Z, |h| {
                let change = |n: Vec3| h.rotation_gradient().dot(Vec3::Z.cross(n)).r;
                (change(lean(0.05)) - change(lean(-0.05))) / 0.1
            });
            assert!((difference - foretold).abs() < 0.03, "{axis}: {foretold} instead of {difference}");
        }
    }

    #[test]
    fn a_uniform_sky_gives_pi_and_no_gradients() {
        hemisphere(
            |_, _| (1.0, f32::INFINITY),
            Vec3::ZERO,
            Vec3::Y,
            3,
            |h| {
                assert!((h.irradiance().r - PI).abs() < 1e-5);
                let largest = |g: Gradient| g.along.iter().fold(0f32, |m, v| m.max(v.r.abs()));
                assert_eq!(largest(h.translation_gradient()), 0.0);
                assert!(largest(h.rotation_gradient()) < 1e-4);
                assert_eq!(h.harmonic_mean_distance(), f32::INFINITY);
            },
        );
    }
}
