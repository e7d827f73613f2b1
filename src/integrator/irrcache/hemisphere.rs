//! The stratified sampling of the hemisphere above a point: irradiance, its gradients, and the distances of surfaces.
//!
//! The hemisphere is divided into `m` rings of elevation and `n` sectors of azimuth. Every cell has the same
//! projected solid angle: ring j is between sin²θ = j/m and (j+1)/m. [Ward and Heckbert 1992]

use crate::color::Rgb;
use crate::math::{Frame, Vec3};
use crate::sampling::hash::{pcg3d, to_unit};
use std::f32::consts::{PI, TAU};

/// The division of a hemisphere into cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Strata {
    /// Number of rings of elevation.
    pub rings: usize,
    /// Number of sectors of azimuth.
    pub sectors: usize,
}

/// The derivatives of a colour along the three axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gradient {
    /// Along x, y and z.
    pub along: [Rgb; 3],
}

impl Gradient {
    /// Adds a derivative of the colour along the direction `v`.
    fn add(&mut self, v: Vec3, change: Rgb) {
        for (sum, v) in self.along.iter_mut().zip(v.to_array()) {
            *sum += change * v;
        }
    }

    /// Returns the change of the colour along the vector `v`.
    pub fn dot(&self, v: Vec3) -> Rgb {
        self.along[0] * v.x + self.along[1] * v.y + self.along[2] * v.z
    }

    /// Returns the gradient of the colour's luminance.
    pub fn luminance(&self) -> Vec3 {
        Vec3::from_array(self.along.map(|colour| colour.luminance()))
    }

    /// Returns the gradient times `factor`.
    pub fn scaled(&self, factor: f32) -> Gradient {
        Gradient { along: self.along.map(|colour| colour * factor) }
    }
}

impl Strata {
    /// Chooses the number of sectors such that cells are about square: π for each ring. [Ward and Heckbert 1992]
    pub fn new(rings: u32) -> Self {
        Strata { rings: rings as usize, sectors: (rings as f32 * PI).round() as usize }
    }

    /// Returns the number of cells.
    pub fn cells(&self) -> usize {
        self.rings * self.sectors
    }

    /// Samples a direction in each cell, ring by ring, in the local frame of the surface; `scramble` seeds the
    /// position in the cell.
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

/// The radiance samples of a hemisphere, one in each cell.
#[derive(Clone, Debug)]
pub struct Hemisphere<'a> {
    /// The cells.
    pub strata: Strata,
    /// The surface's frame.
    pub frame: Frame,
    /// The direction in each cell, in the surface's frame.
    pub directions: &'a [Vec3],
    /// The radiance from each cell.
    pub radiance: &'a [Rgb],
    /// The distance of the surface hit in each cell; infinite if there is none.
    pub distance: &'a [f32],
}

impl Hemisphere<'_> {
    fn at(&self, ring: usize, sector: usize) -> (Rgb, f32) {
        let cell = ring * self.strata.sectors + sector;
        (self.radiance[cell], self.distance[cell])
    }

    /// Returns the tangent vector at the azimuth `sectors`, in sectors from the frame's first axis.
    fn tangent(&self, sectors: f32) -> Vec3 {
        let (sin, cos) = (sectors * (TAU / self.strata.sectors as f32)).sin_cos();
        self.frame.s * cos + self.frame.t * sin
    }

    /// Returns the irradiance, W·m⁻².
    pub fn irradiance(&self) -> Rgb {
        let sum = self.radiance.iter().fold([0.0f64; 3], |sum, l| {
            [sum[0] + f64::from(l.r), sum[1] + f64::from(l.g), sum[2] + f64::from(l.b)]
        });
        let scale = f64::from(PI) / self.strata.cells() as f64;
        let [r, g, b] = sum.map(|s| (s * scale) as f32);
        Rgb::new(r, g, b)
    }

    /// Returns the harmonic mean of the distances, in which near surfaces have the largest weight; infinite if
    /// nothing is hit.
    pub fn harmonic_mean_distance(&self) -> f32 {
        let sum: f64 = self.distance.iter().map(|d| 1.0 / f64::from(*d)).sum();
        (self.strata.cells() as f64 / sum) as f32
    }

    /// Returns the gradient of the irradiance with respect to the normal: for the normal n′ the irradiance changes by
    /// about `gradient·(n × n′)`. [Ward and Heckbert 1992]
    pub fn rotation_gradient(&self) -> Gradient {
        let Strata { rings, sectors } = self.strata;
        // The integral of tan θ over sin²θ from 0 to `sin2`. In the lowest ring it is 1.5 times the value from the
        // ring's middle.
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

    /// Returns the gradient of the irradiance with respect to a translation along the surface. It is due to parallax:
    /// the nearer of two neighbouring cells occludes the farther one. [Ward and Heckbert 1992; Křivánek 2005]
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

    /// A test scene: returns radiance and distance along a ray from `o` in the direction `d`.
    type TestScene = fn(Vec3, Vec3) -> (f32, f32);

    /// A white wall x = 0 of height 1 and infinite length, under a black sky.
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

    fn hemisphere<T>(
        view: TestScene,
        o: Vec3,
        n: Vec3,
        scramble: u32,
        f: impl FnOnce(&Hemisphere<'_>) -> T,
    ) -> T {
        let strata = Strata::new(64);
        let frame = Frame::from_normal(n);
        let directions: Vec<Vec3> = strata.directions(scramble).collect();
        let seen = directions.iter().map(|d| view(o, frame.to_world(*d)));
        let (radiance, distance): (Vec<_>, Vec<_>) = seen.map(|(l, t)| (Rgb::splat(l), t)).unzip();
        f(&Hemisphere { strata, frame, directions: &directions, radiance: &radiance, distance: &distance })
    }

    /// The mean over many scrambles.
    fn mean(view: TestScene, o: Vec3, n: Vec3, f: impl Fn(&Hemisphere<'_>) -> f32) -> f32 {
        (0..64).map(|i| hemisphere(view, o, n, i, &f)).sum::<f32>() / 64.0
    }

    /// Closed forms: an infinite strip seen from the floor and a half-plane above it [Howell, configuration factors
    /// B-71 and A-3].
    #[test]
    fn irradiance_and_gradients_of_a_wall_and_under_a_roof_are_those_of_the_closed_forms() {
        for (view, sign) in [(wall as TestScene, 1.0), (roof as TestScene, -1.0)] {
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

    /// Compares the rotation gradient with the difference of two hemispheres with slightly tilted normals.
    #[test]
    fn rotation_gradients_are_finite_differences() {
        let o = Vec3::new(0.5, 0.0, 0.0);
        for axis in [Vec3::X, Vec3::Y] {
            let lean = |angle: f32| (Vec3::Z + axis * angle).normalize();
            // Both normals see only the wall above the floor.
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
