//! The radii of the passes.

/// Returns the radius of pass `index`, counted from 0, where pass 0 has the radius `first`: `r²ᵢ₊₁ = r²ᵢ (i + α)/(i +
/// 1)` for i ≥ 1. [Knaus and Zwicker 2011, Eq. 15]
pub fn of_pass(first: f32, alpha: f32, index: u64) -> f32 {
    // Computes the product for small indices; beyond, its asymptote, whose relative error is below 1/(12·i).
    const SHORT: u64 = 1 << 12;
    let factor = |i: u64| (i as f64 + f64::from(alpha)) / (i as f64 + 1.0);
    let product: f64 = (1..=index.min(SHORT)).map(factor).product();
    let rest = (index.max(SHORT) as f64 / SHORT as f64).powf(f64::from(alpha) - 1.0);
    (f64::from(first).powi(2) * product * rest).sqrt() as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn radii_shrink_as_the_recurrence_says() {
        let mut squared = 4.0f64;
        for i in 1..=20_000u64 {
            let radius = f64::from(of_pass(2.0, 0.7, i - 1));
            assert!((radius * radius / squared - 1.0).abs() < 1e-4, "pass {i}: {radius}, not {squared}");
            squared *= (i as f64 + f64::from(0.7f32)) / (i as f64 + 1.0);
        }
        assert_eq!(of_pass(2.0, 1.0, 77), 2.0);
    }
}
