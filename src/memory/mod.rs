//! How much memory a scene may take, asked before much of it is allocated.
//!
//! A [`Budget`] is a ledger of what is planned: films, textures, meshes, acceleration structures, photon maps.
//! Whoever is about to allocate much [reserves](Budget::reserve) it first, and what does not fit is refused with a
//! [`Refusal`], from which comes a sentence, instead of bringing down the machine. The ledger holds plans and not
//! measurements, so what it refuses does not depend on what the allocator keeps. Small things are not in it. There is
//! no global budget: it travels with what it pays for.

mod available;

use std::fmt;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Of what is available, what is left for everything that is not planned: this, and [`MARGIN_SHARE`] of it.
const MARGIN: u64 = 32 << 20;
/// See [`MARGIN`].
const MARGIN_SHARE: u64 = 16;

/// The most memory that a process may take, the program itself included.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Limit {
    /// What the machine, the process's control group and its address space have left when the budget is opened, but
    /// for a margin.
    #[default]
    Available,
    /// So many bytes.
    Bytes(u64),
    /// No limit.
    None,
}

/// Who sets a limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Source {
    /// The user.
    Given,
    /// What was free on the machine.
    Machine,
    /// The control group that the process is in.
    ControlGroup,
    /// The limit of the process's address space.
    AddressSpace,
    /// Nobody.
    Nobody,
}

/// A ledger of planned memory with a limit. Clones share the ledger.
#[derive(Clone, Debug)]
pub struct Budget(Arc<Ledger>);

#[derive(Debug)]
struct Ledger {
    /// Bytes.
    limit: u64,
    source: Source,
    planned: AtomicU64,
    peak: AtomicU64,
}

/// Planned memory that goes back to the budget when it is dropped, but for what is [kept](Self::keep).
#[derive(Debug)]
#[must_use]
pub struct Reservation {
    budget: Budget,
    bytes: u64,
}

/// Why memory cannot be had.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// Bytes that were asked for.
    pub needed: u64,
    /// Bytes that are left.
    pub left: u64,
    /// The budget's limit in bytes.
    pub limit: u64,
    source: Source,
}

/// A number of bytes in words: `512 B`, `1.5 GiB`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Amount(pub u64);

impl Default for Budget {
    /// Without a limit.
    fn default() -> Self {
        Budget::unlimited()
    }
}

impl Budget {
    /// A budget in which is planned already what the program has taken so far.
    pub fn open(limit: Limit) -> Self {
        let root = Path::new("/");
        let resident = available::resident(root).unwrap_or(0);
        match (limit, available::available(root)) {
            (Limit::Bytes(bytes), _) => Budget::new(bytes, Source::Given, resident),
            (Limit::Available, Some((left, source))) => {
                let margin = MARGIN + left / MARGIN_SHARE;
                Budget::new(resident + left.saturating_sub(margin), source, resident)
            }
            (Limit::Available | Limit::None, _) => Budget::new(u64::MAX, Source::Nobody, resident),
        }
    }

    /// A budget that refuses nothing.
    pub fn unlimited() -> Self {
        Budget::new(u64::MAX, Source::Nobody, 0)
    }

    fn new(limit: u64, source: Source, planned: u64) -> Self {
        Budget(Arc::new(Ledger { limit, source, planned: planned.into(), peak: planned.into() }))
    }

    /// The limit in bytes; `None` without one.
    pub fn limit(&self) -> Option<u64> {
        (self.0.source != Source::Nobody).then_some(self.0.limit)
    }

    /// Bytes that are planned now.
    pub fn planned(&self) -> u64 {
        self.0.planned.load(Ordering::Relaxed)
    }

    /// The most bytes that were planned at any time.
    pub fn peak(&self) -> u64 {
        self.0.peak.load(Ordering::Relaxed)
    }

    /// Bytes that are left.
    pub fn left(&self) -> u64 {
        self.0.limit.saturating_sub(self.planned())
    }

    /// Reserves memory.
    ///
    /// # Errors
    /// If so much is not left.
    pub fn reserve(&self, bytes: u64) -> Result<Reservation, Refusal> {
        self.charge(bytes)?;
        Ok(Reservation { budget: self.clone(), bytes })
    }

    /// A reservation of nothing, to be grown.
    pub fn nothing(&self) -> Reservation {
        Reservation { budget: self.clone(), bytes: 0 }
    }

    /// Adds to what is planned.
    ///
    /// # Errors
    /// If so much is not left; then nothing is added.
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

    /// Adds what has been allocated already, whatever the limit.
    pub fn record(&self, bytes: u64) {
        let before = self.0.planned.fetch_add(bytes, Ordering::Relaxed);
        self.0.peak.fetch_max(before.saturating_add(bytes), Ordering::Relaxed);
    }

    /// Takes from what is planned.
    pub fn refund(&self, bytes: u64) {
        let less = |now: u64| Some(now.saturating_sub(bytes));
        let _ = self.0.planned.fetch_update(Ordering::Relaxed, Ordering::Relaxed, less);
    }
}

impl Reservation {
    /// Of what it is a part.
    pub fn budget(&self) -> &Budget {
        &self.budget
    }

    /// Bytes that are reserved.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Reserves more.
    ///
    /// # Errors
    /// If so much is not left; then the reservation stays as it is.
    pub fn grow(&mut self, more: u64) -> Result<(), Refusal> {
        self.budget.charge(more)?;
        self.bytes += more;
        Ok(())
    }

    /// Reserves as much as is missing to `bytes`, if anything is.
    ///
    /// # Errors
    /// As [`grow`](Self::grow); the refusal speaks of all the `bytes`.
    pub fn grow_to(&mut self, bytes: u64) -> Result<(), Refusal> {
        let before = self.bytes;
        self.grow(bytes.saturating_sub(before)).map_err(|refusal| Refusal {
            needed: bytes,
            left: refusal.left + before,
            ..refusal
        })
    }

    /// Gives back what is reserved beyond `bytes`, and plans what is missing, which has been allocated already.
    pub fn settle(&mut self, bytes: u64) {
        self.budget.record(bytes.saturating_sub(self.bytes));
        self.budget.refund(self.bytes.saturating_sub(bytes));
        self.bytes = bytes;
    }

    /// Leaves `bytes` planned for as long as the budget lives, and gives the rest back.
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
    /// A sentence: `what` cannot be had, and `change` would help.
    pub fn sentence(&self, what: &str, change: &str) -> String {
        let (whose, or) = match self.source {
            Source::Given => ("--memory-limit", "give a larger --memory-limit"),
            Source::Machine => ("what was free on this machine", "go beyond that with --memory-limit"),
            Source::ControlGroup => ("what its control group leaves this process", "raise that limit"),
            Source::AddressSpace => ("what ulimit -v leaves this process", "raise that limit"),
            Source::Nobody => ("what can be counted", "split the work"),
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
        let budget = Budget::new(100, Source::Given, 10);
        let mut first = budget.reserve(50).unwrap();
        first.grow_to(40).unwrap();
        first.grow(20).unwrap();
        assert_eq!((first.bytes(), budget.planned(), budget.left()), (70, 80, 20));
        drop(budget.reserve(20).unwrap());
        first.keep(30);
        assert_eq!((budget.planned(), budget.peak()), (40, 100));
        // What turns out to be larger is in the ledger all the same.
        budget.reserve(5).unwrap().keep(8);
        assert_eq!(budget.planned(), 48);
    }

    #[test]
    fn a_refusal_is_a_sentence_and_changes_nothing() {
        let budget = Budget::new(4 << 30, Source::Given, 1 << 30);
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
        let budget = Budget::new(100, Source::Given, 200);
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
