//! Kernels of density estimation.

use std::fmt;
use std::str::FromStr;

/// The weight of a photon as a function of its distance from the centre of a disc. The mean over the disc is 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub enum Kernel {
    /// The same weight for all photons of the disc.
    Constant,
    /// Linear, with 0 at the rim. [Jensen 2001, 7.3, with k = 1]
    Cone,
    /// Quadratic, with 0 at the rim: the kernel with the least mean squared error. [Silverman 1986, 4.2]
    #[default]
    Epanechnikov,
}

impl Kernel {
    /// All kernels.
    pub const ALL: [Kernel; 3] = [Kernel::Constant, Kernel::Cone, Kernel::Epanechnikov];

    /// Returns the kernel's name.
    pub fn name(self) -> &'static str {
        match self {
            Kernel::Constant => "constant",
            Kernel::Cone => "cone",
            Kernel::Epanechnikov => "epanechnikov",
        }
    }

    /// Returns the weight; `t` in [0, 1] is the squared distance divided by the squared radius.
    #[inline]
    pub fn weight(self, t: f32) -> f32 {
        match self {
            Kernel::Constant => 1.0,
            Kernel::Cone => 3.0 * (1.0 - t.sqrt()),
            Kernel::Epanechnikov => 2.0 * (1.0 - t),
        }
    }

    /// Returns the distance, relative to the radius, within which the fraction `u` of the disc's weight lies.
    pub fn quantile(self, u: f32) -> f32 {
        match self {
            Kernel::Constant => u.sqrt(),
            // The solution of 3d² − 2d³ = u.
            Kernel::Cone => 0.5 - ((1.0 - 2.0 * u).asin() / 3.0).sin(),
            // The solution of 2d² − d⁴ = u.
            Kernel::Epanechnikov => (1.0 - (1.0 - u).sqrt()).sqrt(),
        }
    }
}

impl fmt::Display for Kernel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Kernel {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        Kernel::ALL.into_iter().find(|kernel| kernel.name() == s).ok_or_else(|| {
            let names = Kernel::ALL.map(Kernel::name).join(", ");
            format!("unknown kernel \"{s}\"; there are {names}")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_have_the_mean_one_and_quantiles_divide_them() {
        for kernel in Kernel::ALL {
            // Rings of equal area.
            let n = 100_000;
            let mut sum = 0.0;
            let mut shares = vec![0.0; n];
            for (i, share) in shares.iter_mut().enumerate() {
                sum += f64::from(kernel.weight((i as f32 + 0.5) / n as f32)) / n as f64;
                *share = sum;
            }
            assert!((sum - 1.0).abs() < 1e-5, "{kernel}: {sum}");
            for u in [0.0, 0.01, 0.3, 0.5, 0.9, 1.0] {
                let d = kernel.quantile(u);
                let ring = ((d * d * n as f32) as usize).min(n - 1);
                assert!((shares[ring] - f64::from(u)).abs() < 1e-3, "{kernel} {u}: {d}, {}", shares[ring]);
            }
            assert_eq!(kernel.name().parse(), Ok(kernel));
        }
        let unknown = "unknown kernel \"gauss\"; there are constant, cone, epanechnikov";
        assert_eq!("gauss".parse::<Kernel>(), Err(unknown.into()));
    }
}
