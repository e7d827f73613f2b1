//! Rounding-error bounds of floating-point arithmetic. [pbrt 6.8]

/// Half the distance from 1 to the next `f32`: the unit roundoff.
pub const UNIT_ROUNDOFF: f32 = f32::EPSILON * 0.5;

/// The bound γₙ on the relative error of `n` successive roundings. [Higham 2002, Lemma 3.1]
#[inline]
pub const fn gamma(n: u32) -> f32 {
    (n as f32 * UNIT_ROUNDOFF) / (1.0 - n as f32 * UNIT_ROUNDOFF)
}

/// The next `f32` away from `x` in the direction of `toward`'s sign; `x` where `toward` is zero.
#[inline]
pub fn nudge(x: f32, toward: f32) -> f32 {
    if toward > 0.0 {
        x.next_up()
    } else if toward < 0.0 {
        x.next_down()
    } else {
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gamma_grows_with_n_and_nudge_moves_one_ulp() {
        assert!(gamma(3) > 3.0 * UNIT_ROUNDOFF && gamma(3) < 3.01 * UNIT_ROUNDOFF);
        assert!(nudge(1.0, 1.0) > 1.0 && nudge(1.0, -1.0) < 1.0 && nudge(0.0, -1.0) < 0.0);
        assert_eq!(nudge(2.5, 0.0), 2.5);
    }
}
