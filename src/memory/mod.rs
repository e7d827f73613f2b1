//! Memory budgets: large allocations are checked against a limit before they are made.
//!
//! A [`Budget`] is a ledger of planned memory: films, textures, meshes, acceleration structures, photon maps. A large
//! allocation is [reserved](Budget::reserve) first. If it exceeds the limit, the result is a [`Refusal`] with an
//! error message, and the machine does not run out of memory. The ledger has planned sizes, not measurements, so the
//! result does not depend on the allocator. Small allocations are not included. There is no global budget; it is
//! passed to the code that allocates.

mod available;

use std::fmt;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// The margin for allocations that are not planned: this number of bytes, plus 1/[`MARGIN_SHARE`] of the available
/// memory.
const MARGIN: u64 = 32 << 20;
/// See [`MARGIN`].
const MARGIN_SHARE: u64 = 16;

/// The limit of the process's memory, including the program itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Limit {
    /// The memory available on the machine, in the process's control group and in its address space when the budget
    /// is opened, minus a margin.
    #[default]
    Available,
    /// The given number of bytes.
    Bytes(u64),
    /// No limit.
    None,
}

/// The source of a limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum LimitSource {
    /// An option given by the user.
    Given,
    /// The free memory of the machine.
    Machine,
    /// The process's control group.
    ControlGroup,
    /// The limit of the process's address space.
    AddressSpace,
    /// No limit.
    Nobody,
}

/// A ledger of planned memory with a limit. Clones share the ledger.
#[derive(Clone, Debug)]
pub struct Budget(Arc<Ledger>);

#[derive(Debug)]
struct Ledger {
    /// The limit in bytes.
    limit: u64,
    source: LimitSource,
    planned: AtomicU64,
    peak: AtomicU64,
}

/// Planned memory that is returned to the budget when it is dropped, except for the part that is [kept](Self::keep).
#[derive(Debug)]
#[must_use]
pub struct Reservation {
    budget: Budget,
    bytes: u64,
}

/// The rejection of a reservation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// The number of bytes requested.
    pub needed: u64,
    /// The number of bytes left.
    pub left: u64,
    /// The budget's limit in bytes.
    pub limit: u64,
    source: LimitSource,
}

/// A number of bytes as text: `512 B`, `1.5 GiB`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Amount(pub u64);

impl Default for Budget {
    /// Returns an unlimited budget.
    fn default() -> Self {
        Budget::unlimited()
    }
}

impl Budget {
    /// Opens a budget, with the memory that the program already uses as planned.
    pub fn open(limit: Limit) -> Self {
        let root = Path::new("/");
        let resident = available::resident(root).unwrap_or(0);
        match (limit, available::available(root)) {
            (Limit::Bytes(bytes), _) => Budget::new(bytes, LimitSource::Given, resident),
            (Limit::Available, Some((left, source))) => {
                let margin = MARGIN + left / MARGIN_SHARE;
                Budget::new(resident + left.saturating_sub(margin), source, resident)
            }
            (Limit::Available | Limit::None, _) => Budget::new(u64::MAX, LimitSource::Nobody, resident),
        }
    }

    /// Creates a budget that rejects nothing.
    pub fn unlimited() -> Self {
        Budget::new(u64::MAX, LimitSource::Nobody, 0)
    }

    fn new(limit: u64, source: LimitSource, planned: u64) -> Self {
        Budget(Arc::new(Ledger { limit, source, planned: planned.into(), peak: planned.into() }))
    }

    /// Returns the limit in bytes; `None` without one.
    pub fn limit(&self) -> Option<u64> {
        (self.0.source != LimitSource::Nobody).then_some(self.0.limit)
    }

    /// Returns the bytes that are planned now.
    pub fn planned(&self) -> u64 {
        self.0.planned.load(Ordering::Relaxed)
    }

    /// Returns the greatest number of bytes planned at any time.
    pub fn peak(&self) -> u64 {
        self.0.peak.load(Ordering::Relaxed)
    }

    /// Returns the bytes that are left.
    pub fn left(&self) -> u64 {
        self.0.limit.saturating_sub(self.planned())
    }

    /// Reserves memory.
    ///
    /// # Errors
    /// If fewer bytes are left.
    pub fn reserve(&self, bytes: u64) -> Result<Reservation, Refusal> {
        self.charge(bytes)?;
        Ok(Reservation { budget: self.clone(), bytes })
    }

    /// Returns an empty reservation, which can grow.
    pub fn nothing(&self) -> Reservation {
        Reservation { budget: self.clone(), bytes: 0 }
    }

    /// Adds to the planned memory.
    ///
    /// # Errors
    /// If fewer bytes are left; nothing is added then.
    pub fn charge(&self, bytes: u64) -> Result<(), Refusal> {
        let Ledger { limit, source, planned, peak } = &*self.0;
        let within = |now: u64| now.checked_add(bytes).filter(|sum| bytes == 0 || sum <= limit);
        match planned.fetch_update(Ordering::Relaxed, Ordering::Relaxed, within) {
            Ok(before) => {
                peak.fetch_max(before + bytes, Ordering::Relaxed);
                Ok(())
            }
            Err(now) => {
                let left = limit.saturating_sub(now);
                Err(Refusal { needed: bytes, left, limit: *limit, source: *source })
            }
        }
    }

    /// Adds memory that has already been allocated, regardless of the limit.
    pub fn record(&self, bytes: u64) {
        let before = self.0.planned.fetch_add(bytes, Ordering::Relaxed);
        self.0.peak.fetch_max(before.saturating_add(bytes), Ordering::Relaxed);
    }

    /// Subtracts from the planned memory.
    pub fn refund(&self, bytes: u64) {
        let less = |now: u64| Some(now.saturating_sub(bytes));
        let _ = self.0.planned.fetch_update(Ordering::Relaxed, Ordering::Relaxed, less);
    }
}

impl Reservation {
    /// Returns the budget of the reservation.
    pub fn budget(&self) -> &Budget {
        &self.budget
    }

    /// Returns the reserved bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Reserves more.
    ///
    /// # Errors
    /// If fewer bytes are left; the reservation is unchanged then.
    pub fn grow(&mut self, more: u64) -> Result<(), Refusal> {
        self.budget.charge(more)?;
        self.bytes += more;
        Ok(())
    }

    /// Increases the reservation to `bytes`, if it is smaller.
    ///
    /// # Errors
    /// As [`grow`](Self::grow); the refusal states all `bytes` as needed.
    pub fn grow_to(&mut self, bytes: u64) -> Result<(), Refusal> {
        let before = self.bytes;
        self.grow(bytes.saturating_sub(before)).map_err(|refusal| Refusal {
            needed: bytes,
            left: refusal.left + before,
            ..refusal
        })
    }

    /// Sets the reservation to `bytes`: returns the surplus, or records a deficit, which has already been allocated.
    pub fn settle(&mut self, bytes: u64) {
        self.budget.record(bytes.saturating_sub(self.bytes));
        self.budget.refund(self.bytes.saturating_sub(bytes));
        self.bytes = bytes;
    }

    /// Leaves `bytes` planned as long as the budget lives, and returns the rest.
    pub fn keep(mut self, bytes: u64) {
        self.budget.record(bytes.saturating_sub(self.bytes));
        self.bytes = self.bytes.saturating_sub(bytes);
    }
}

impl Drop for Reservation {
    fn drop(&mut self) {
        self.budget.refund(self.bytes);
    }
}

impl Refusal {
    /// Returns an error message: `what` does not fit, and `change` would help.
    pub fn sentence(&self, what: &str, change: &str) -> String {
        let (whose, or) = match self.source {
            LimitSource::Given => ("--memory-limit", "give a larger --memory-limit"),
            LimitSource::Machine => ("the free memory of this machine", "go beyond that with --memory-limit"),
            LimitSource::ControlGroup => ("the limit of the process's control group", "raise that limit"),
            LimitSource::AddressSpace => ("the limit of ulimit -v", "raise that limit"),
            LimitSource::Nobody => ("the largest number of bytes", "split the work"),
        };
        let [needed, left, limit] = [self.needed, self.left, self.limit].map(Amount);
        format!(
            "{what} would take {needed} of memory, but {left} of {limit} are left ({whose}): {change}, or {or}"
        )
    }
}

impl fmt::Display for Amount {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const UNITS: [&str; 5] = ["KiB", "MiB", "GiB", "TiB", "PiB"];
        if self.0 < 1024 {
            return write!(f, "{} B", self.0);
        }
        let power = (self.0.ilog2() / 10).min(UNITS.len() as u32);
        let value = self.0 as f64 / f64::from(1u32 << 10).powi(power as i32);
        write!(f, "{value:.1} {}", UNITS[power as usize - 1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn amounts_are_in_words() {
        let words = |bytes: u64| Amount(bytes).to_string();
        assert_eq!([words(0), words(1023), words(1536)], ["0 B", "1023 B", "1.5 KiB"]);
        assert_eq!([words(5 << 30), words(u64::MAX)], ["5.0 GiB", "16384.0 PiB"]);
    }

    #[test]
    fn what_is_reserved_goes_back_but_for_what_is_kept() {
        let budget = Budget::new(100, LimitSource::Given, 10);
        let mut first = budget.reserve(50).unwrap();
        first.grow_to(40).unwrap();
        first.grow(20).unwrap();
        assert_eq!((first.bytes(), budget.planned(), budget.left()), (70, 80, 20));
        drop(budget.reserve(20).unwrap());
        first.keep(30);
        assert_eq!((budget.planned(), budget.peak()), (40, 100));
        // An allocation larger than its reservation is recorded in full.
        budget.reserve(5).unwrap().keep(8);
        assert_eq!(budget.planned(), 48);
    }

    #[test]
    fn a_refusal_is_a_sentence_and_changes_nothing() {
        let budget = Budget::new(4 << 30, LimitSource::Given, 1 << 30);
        let refusal = budget.reserve(5 << 30).unwrap_err();
        assert_eq!(
            refusal.sentence("its 60000x60000 pixels", "use a smaller image"),
            "its 60000x60000 pixels would take 5.0 GiB of memory, but 3.0 GiB of 4.0 GiB are left (--memory-limit): use a \
             smaller image, or give a larger --memory-limit"
        );
        let mut part = budget.reserve(2 << 30).unwrap();
        let refusal = part.grow_to(6 << 30).unwrap_err();
        assert_eq!((refusal.needed, refusal.left), (6 << 30, 3 << 30));
        assert!(budget.reserve(u64::MAX).is_err());
        assert_eq!((budget.planned(), budget.peak()), (3 << 30, 3 << 30));
    }

    #[test]
    fn a_limit_below_the_program_leaves_nothing_and_allows_nothing_more() {
        let budget = Budget::new(100, LimitSource::Given, 200);
        assert_eq!(budget.left(), 0);
        assert!(budget.reserve(0).is_ok());
        assert_eq!(budget.reserve(1).unwrap_err().left, 0);
    }

    #[test]
    fn without_a_limit_everything_passes() {
        let budget = Budget::unlimited();
        assert!(budget.reserve(1 << 62).is_ok() && budget.limit().is_none());
        assert!(Budget::open(Limit::Bytes(7)).limit() == Some(7));
    }
}
