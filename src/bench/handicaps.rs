//! The capabilities and limitations of each traversal, in words. They are needed to interpret its speed.

use super::Traversal;
use crate::accel::AccelKind;
use crate::report::machine;

/// The SIMD instructions that this program is compiled for. Embree chooses its own at run time.
const COMPILED_FOR: &str = if cfg!(target_feature = "avx512f") {
    "AVX-512"
} else if cfg!(target_feature = "avx2") {
    "AVX2"
} else {
    "the baseline of the architecture"
};

/// Returns a paragraph about a traversal as this program uses it on this machine.
pub(super) fn of(accel: AccelKind, threads: usize) -> String {
    let detected = machine::simd();
    match accel {
        AccelKind::Auto => format!(
            "auto: for a scene of a few dozen surfaces a list of them, eight rays at a time in Rust compiled for \
             {COMPILED_FOR} (the processor has {detected}), watertight; in any other scene such a list of its largest \
             simple surfaces, in front of the first of those below; {threads} threads."
        ),
        #[cfg(feature = "embree")]
        AccelKind::Embree => format!(
            "embree: Embree 3 as Debian builds it, with code for the widest SIMD of the processor ({detected}) chosen \
             at run time; scene flag ROBUST (12 to 14 % slower than without); waves of rays in packets of 16 \
             (rtcIntersect16, rtcOccluded16), camera rays as coherent ones; {threads} threads."
        ),
        AccelKind::Obvhs => format!(
            "obvhs: an eight-wide compressed BVH built by the crate obvhs, traversed by Buffon in Rust compiled for \
             {COMPILED_FOR} (the processor has {detected}); watertight triangle test, conservative boxes; one ray at \
             a time, no packets; {threads} threads."
        ),
    }
}

/// Returns the build time and memory of a traversal, in words.
pub(super) fn cost(traversal: &Traversal) -> String {
    let Traversal { accel, build_seconds, memory_bytes } = traversal;
    format!("{accel}: built in {build_seconds:.3} s, {:.1} MB", *memory_bytes as f64 * 1e-6)
}
