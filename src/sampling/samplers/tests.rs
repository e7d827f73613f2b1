use super::*;
use crate::sampling::Domain;

fn keys(seed: u64, n: u64) -> Vec<SampleKey> {
    (0..n).map(|i| SampleKey::new(seed, 3, 5, 2 * i)).collect()
}

fn pairs(sampler: Sampler, keys: &[SampleKey], d: Dimension) -> Vec<[f32; 2]> {
    let (mut x, mut y) = (vec![0.0; keys.len()], vec![0.0; keys.len()]);
    sampler.fill_2d(d, keys, &mut x, &mut y);
    x.into_iter().zip(y).map(|(x, y)| [x, y]).collect()
}

/// Every elementary interval of area 1/n has exactly one of the first n points: a (0, m, 2)-net.
#[test]
fn sobol_pairs_are_nets_for_every_power_of_two_and_every_block() {
    for dimension in [0, 17, 8 * 999] {
        let points = pairs(Sampler::new(SamplerKind::Sobol, None), &keys(1, 4096), Dimension(dimension));
        for m in 0..=8u32 {
            let n = 1usize << m;
            for block in points.chunks(n).take(8) {
                for k in 0..=m {
                    let (nx, ny) = (1u32 << k, 1u32 << (m - k));
                    let mut seen = vec![false; n];
                    for p in block {
                        let cell = (p[0] * nx as f32) as u32 * ny + (p[1] * ny as f32) as u32;
                        assert!(!std::mem::replace(&mut seen[cell as usize], true), "m {m} k {k}");
                    }
                }
            }
        }
    }
}

#[test]
fn sobol_numbers_are_stratified_and_past_65536_nothing_repeats() {
    let keys: Vec<_> = (0..1u64 << 18).map(|i| SampleKey::new(9, 0, 0, 2 * i)).collect();
    let mut u = vec![0.0; keys.len()];
    Sampler::new(SamplerKind::Sobol, None).fill_1d(Dimension::roulette(3), &keys, &mut u);
    let mut cells = vec![0u8; keys.len()];
    u.iter().for_each(|u| cells[(u * keys.len() as f32) as usize] += 1);
    assert!(cells.iter().all(|&c| c == 1));
}

#[test]
fn stratified_pairs_fill_every_cell_of_every_block() {
    for side in [1u32, 3, 8] {
        let sampler = Sampler::new(SamplerKind::Stratified, Some(2 * u64::from(side * side)));
        let n = (side * side) as usize;
        let points = pairs(sampler, &keys(4, 3 * n as u64), Dimension::emitter_point(1));
        for block in points.chunks(n) {
            let mut seen = vec![false; n];
            for p in block {
                let cell = (p[1] * side as f32) as usize * side as usize + (p[0] * side as f32) as usize;
                assert!(!std::mem::replace(&mut seen[cell], true));
            }
        }
        let mut u = vec![0.0; 3 * n];
        sampler.fill_1d(Dimension::roulette(0), &keys(4, 3 * n as u64), &mut u);
        for block in u.chunks(n) {
            let mut cells: Vec<_> = block.iter().map(|u| (u * n as f32) as usize).collect();
            cells.sort_unstable();
            assert!(cells.into_iter().eq(0..n));
        }
    }
}

/// The means over many independently scrambled short sequences are within five standard errors of 1/2, and different
/// dimensions, pixels and halves are uncorrelated.
#[test]
fn samplers_are_unbiased_and_their_dimensions_uncorrelated() {
    for sampler in [
        Sampler::new(SamplerKind::Independent, None),
        Sampler::new(SamplerKind::Stratified, Some(8)),
        Sampler::new(SamplerKind::Sobol, None),
    ] {
        let n = 40_000u32;
        let keys: Vec<_> = (0..n).map(|i| SampleKey::new(2, i % 200, i / 200, u64::from(i % 8))).collect();
        let a = pairs(sampler, &keys, Dimension::emitter_point(0));
        let b = pairs(sampler, &keys, Dimension::bsdf_direction(0));
        let centred = |v: f32| f64::from(v) - 0.5;
        let bound = 5.0 / f64::from(n).sqrt();
        let mean = a.iter().map(|p| centred(p[0])).sum::<f64>() / f64::from(n);
        assert!(mean.abs() < bound * 0.289, "{sampler:?} mean {mean}");
        for (what, c) in [
            ("x y", a.iter().map(|p| centred(p[0]) * centred(p[1])).sum::<f64>()),
            ("dimensions", a.iter().zip(&b).map(|(p, q)| centred(p[0]) * centred(q[0])).sum()),
            ("neighbours", a.windows(2).map(|w| centred(w[0][1]) * centred(w[1][1])).sum()),
        ] {
            let correlation = c / f64::from(n) * 12.0;
            assert!(correlation.abs() < bound, "{sampler:?} {what}: {correlation}");
        }
    }
}

#[test]
fn sample_indices_past_two_to_the_33_start_new_sequences() {
    let near = SampleKey::new(1, 2, 3, 0);
    let far = SampleKey::new(1, 2, 3, 1 << 33);
    assert_eq!(near.index, far.index);
    assert_ne!(near.scramble, far.scramble);
}

#[test]
fn names_round_trip_and_unknown_ones_are_refused() {
    for kind in SamplerKind::ALL {
        assert_eq!(kind.name().parse(), Ok(kind));
    }
    assert_eq!(
        "halten".parse::<SamplerKind>(),
        Err("unknown sampler \"halten\"; there are independent, stratified, multijitter, halton, sobol, zsobol, fixed".into())
    );
}

/// Dimensions of fixed domains are constant; the others are unchanged.
#[test]
fn held_domains_stand_still_and_nothing_else_does() {
    let keys = keys(3, 100);
    let fixed = DomainSet::EMPTY.with(Domain::Lens).with(Domain::Light);
    for kind in SamplerKind::ALL {
        let free = Sampler::new(kind, Some(64));
        let with_fixed = free.with_fixed(fixed);
        assert_eq!(with_fixed.kind(), kind);
        for d in [Dimension::LENS, Dimension::emitter_point(0), Dimension::emitter_point(7).repeat(300)] {
            assert!(pairs(with_fixed, &keys, d).iter().all(|p| *p == [0.5, 0.5]), "{kind} {d}");
        }
        for d in [Dimension::PIXEL, Dimension::bsdf_direction(0), Dimension::roulette(2)] {
            assert_eq!(pairs(with_fixed, &keys, d), pairs(free, &keys, d), "{kind} {d}");
        }
        let mut u = vec![0.0; keys.len()];
        with_fixed.fill_1d(Dimension::LIGHT, &keys, &mut u);
        assert!(u.iter().all(|&u| u == 0.5));
    }
}

#[test]
fn advice_names_the_nearest_numbers_that_fit() {
    let advice = |kind: SamplerKind, spp| kind.advice(spp).unwrap_or_default();
    for kind in [SamplerKind::Independent, SamplerKind::Halton, SamplerKind::Sobol, SamplerKind::Fixed] {
        assert_eq!([None, Some(1), Some(63), Some(1 << 40)].map(|spp| advice(kind, spp)), [""; 4]);
    }
    for kind in [SamplerKind::Stratified, SamplerKind::Multijitter] {
        assert_eq!([1, 2, 4, 12, 64, 72, 128, 1 << 20].map(|spp| advice(kind, Some(spp))), [""; 8]);
    }
    assert_eq!([1, 2, 64, 1 << 17].map(|spp| advice(SamplerKind::Zsobol, Some(spp))), [""; 4]);
    assert_eq!(
        advice(SamplerKind::Multijitter, Some(62)),
        "the sampler multijitter fills all strata only for certain numbers of samples: use 60 or 64 samples per pixel instead of 62"
    );
    assert_eq!(
        advice(SamplerKind::Zsobol, Some(100)),
        "the sampler zsobol has the best error distribution for powers of two: use 64 or 128 samples per pixel instead of 100"
    );
    assert_eq!(
        advice(SamplerKind::Zsobol, None),
        "the sampler zsobol assumes 128 samples per pixel without --spp, and starts a new sequence after that"
    );
    assert_eq!(
        advice(SamplerKind::Stratified, Some(u64::MAX)),
        "the sampler stratified starts a new sequence after 2097152 samples per pixel"
    );
}
