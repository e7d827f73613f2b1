//! Adaptive quadrature in `f64`.

/// Points and weights of the Gauss-Legendre rule with five points on [−1, 1].
const GAUSS: [(f64, f64); 5] = [
    (-0.906_179_845_938_664, 0.236_926_885_056_189_08),
    (-0.538_469_310_105_683, 0.478_628_670_499_366_47),
    (0.0, 0.568_888_888_888_888_9),
    (0.538_469_310_105_683, 0.478_628_670_499_366_47),
    (0.906_179_845_938_664, 0.236_926_885_056_189_08),
];
/// The tolerance of a square, relative to the integral.
const TOLERANCE: f64 = 1e-9;
/// The greatest number of divisions of a square.
const MOST_DIVISIONS: u32 = 60;

/// Returns the integral of `f` over the unit square, with a relative error of about 10⁻⁷.
pub fn over_square(f: impl Fn([f64; 2]) -> f64) -> f64 {
    // The absolute tolerance is estimated in steps.
    let about = integrate(&f, [0.0; 2], 1.0, 0, 0.0).abs();
    let about = integrate(&f, [0.0; 2], 1.0, MOST_DIVISIONS, 1e-3 * about).abs();
    integrate(&f, [0.0; 2], 1.0, MOST_DIVISIONS, TOLERANCE * about)
}

fn integrate(
    f: &impl Fn([f64; 2]) -> f64,
    corner: [f64; 2],
    side: f64,
    divisions: u32,
    tolerance: f64,
) -> f64 {
    let quarters = || {
        let half = 0.5 * side;
        [[0.0, 0.0], [half, 0.0], [0.0, half], [half, half]].map(|[x, y]| [corner[0] + x, corner[1] + y])
    };
    let whole = gauss(f, corner, side);
    if divisions == 0 {
        return whole;
    }
    let parts: f64 = quarters().map(|corner| gauss(f, corner, 0.5 * side)).iter().sum();
    let first = divisions + 3 > MOST_DIVISIONS;
    if (parts - whole).abs() <= tolerance && !first {
        return parts;
    }
    quarters().map(|corner| integrate(f, corner, 0.5 * side, divisions - 1, tolerance)).iter().sum()
}

fn gauss(f: &impl Fn([f64; 2]) -> f64, corner: [f64; 2], side: f64) -> f64 {
    let mut sum = 0.0;
    for (x, weight_x) in GAUSS {
        for (y, weight_y) in GAUSS {
            let at = |low: f64, t: f64| low + side * 0.5 * (t + 1.0);
            sum += weight_x * weight_y * f([at(corner[0], x), at(corner[1], y)]);
        }
    }
    sum * 0.25 * side * side
}

#[test]
fn narrow_peaks_and_steps_are_integrated() {
    let smooth = over_square(|[x, y]| (x + y * y).exp());
    assert!((smooth / (1f64.exp_m1() * 1.462_651_745_907_181_6) - 1.0).abs() < 1e-9, "{smooth}");
    // z / 2π r³ has the integral 1 over the plane.
    for z in [1e-2f64, 1e-4, 1e-6] {
        let peak = over_square(|[x, y]| {
            let r2 = (x - 0.4).powi(2) + (y - 0.5).powi(2) + z * z;
            z / (std::f64::consts::TAU * r2 * r2.sqrt())
        });
        assert!((peak - 1.0).abs() < 2.0 * z, "{z}: {peak}");
    }
    let step = over_square(|[x, y]| if x < 0.5 + 0.1 * y { 1.0 } else { 0.0 });
    assert!((step - 0.55).abs() < 1e-6, "{step}");
}
