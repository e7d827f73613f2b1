//! What each traversal has and lacks, in words: a rate without them says little.

use super::Traversal;
use crate::accel::AccelKind;
use crate::report::machine;

/// The SIMD that this program is compiled for; Embree chooses its own when it runs.
const COMPILED_FOR: &str = if cfg!(target_feature = "avx512f") {
    "AVX-512"
} else if cfg!(target_feature = "avx2") {
    "AVX2"
} else {
    "the baseline of the architecture"
};

/// A paragraph about a traversal, as this program uses it on this machine.
pub(super) fn of(accel: AccelKind, threads: usize) -> String {
    let detected = machine::simd();
    match accel {
        #[cfg(feature = "embree")]
        AccelKind::Embree => format!(
            "embree: Embree 3 as Debian builds it, with code for the widest SIMD of the processor ({detected}) chosen at run \
             time; scene flag ROBUST (12 to 14 % slower than without); waves of rays in packets of 16 \
             (rtcIntersect16, rtcOccluded16), camera rays as coherent ones; {threads} threads."
        ),
        AccelKind::Obvhs => format!(
            "obvhs: an eight-wide compressed BVH built by the crate obvhs, traversed by Buffon in Rust compiled for \
             {COMPILED_FOR} (the processor has {detected}); watertight triangle test, conservative boxes; one ray at a time, \
             no packets; {threads} threads."
        ),
    }
}

/// How long a structure took and how much it holds.
pub(super) fn cost(traversal: &Traversal) -> String {
    let Traversal { accel, build_seconds, memory_bytes } = traversal;
    format!("{accel}: built in {build_seconds:.3} s, {:.1} MB", *memory_bytes as f64 * 1e-6)
}
