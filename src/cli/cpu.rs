//! Check for the CPU features that the program was compiled for.

/// Returns a sentence about the missing features; `None` if the program can run.
///
/// For features that the program is compiled with, the compiler folds the standard library's detection to a constant.
/// The CPU is therefore queried directly.
#[cfg(target_arch = "x86_64")]
#[inline(never)]
pub fn missing_feature() -> Option<&'static str> {
    use std::arch::x86_64::{__cpuid, __cpuid_count};
    if !cfg!(target_feature = "avx2") {
        return None;
    }
    let has = |word: u32, bit: u32| word >> bit & 1 == 1;
    let highest = __cpuid(0).eax;
    let basic = __cpuid(1).ecx;
    let extended = if highest >= 7 { __cpuid_count(7, 0).ebx } else { 0 };
    // FMA, OSXSAVE, AVX, F16C; BMI1, AVX2, BMI2
    let complete = [12, 27, 28, 29].into_iter().all(|bit| has(basic, bit))
        && [3, 5, 8].into_iter().all(|bit| has(extended, bit));
    (!complete).then_some(
        "this CPU has no AVX2, which this program was built for; run \"make\" on it to build the baseline",
    )
}

/// Other architectures require nothing.
#[cfg(not(target_arch = "x86_64"))]
pub fn missing_feature() -> Option<&'static str> {
    None
}
