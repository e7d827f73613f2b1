//! Bounds on the rounding errors of floating-point arithmetic. [pbrt 6.8]

/// Half the distance from 1 to the next `f32`: the unit roundoff.
pub const UNIT_ROUNDOFF: f32 = f32::EPSILON * 0.5;

/// Returns the bound γₙ on the relative error of `n` successive roundings. [Higham 2002, Lemma 3.1]
#[inline]
pub const fn gamma(n: u32) -> f32 {
    (n as f32 * UNIT_ROUNDOFF) / (1.0 - n as f32 * UNIT_ROUNDOFF)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gamma_grows_with_n() {
        assert!(gamma(3) > 3.0 * UNIT_ROUNDOFF && gamma(3) < 3.01 * UNIT_ROUNDOFF);
    }
}
