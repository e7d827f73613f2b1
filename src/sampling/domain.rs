//! The domains of integration of a pixel's value, and sets of them.

use std::fmt;
use std::str::FromStr;

/// A domain of integration: the dimensions that cause one effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Domain {
    /// The area of the pixel's filter: antialiasing.
    Pixel,
    /// The aperture: depth of field.
    Lens,
    /// The shutter interval: motion blur.
    Time,
    /// The emitters, at every bounce and at the start of light paths: soft shadows.
    Light,
    /// The lobes and directions of the first surface's BSDF: glossy reflection and refraction.
    Bsdf,
    /// The lobes and directions of all later surfaces, and distances in participating media: indirect light.
    Hemisphere,
    /// Russian roulette at every bounce: not a domain of the integral, but the decision to terminate.
    Roulette,
}

impl Domain {
    /// All domains.
    pub const ALL: [Domain; 7] = [
        Domain::Pixel,
        Domain::Lens,
        Domain::Time,
        Domain::Light,
        Domain::Bsdf,
        Domain::Hemisphere,
        Domain::Roulette,
    ];

    /// Returns the name.
    pub fn name(self) -> &'static str {
        match self {
            Domain::Pixel => "pixel",
            Domain::Lens => "lens",
            Domain::Time => "time",
            Domain::Light => "light",
            Domain::Bsdf => "bsdf",
            Domain::Hemisphere => "hemisphere",
            Domain::Roulette => "roulette",
        }
    }
}

impl fmt::Display for Domain {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Domain {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        Domain::ALL.into_iter().find(|domain| domain.name() == s).ok_or_else(|| {
            let names = Domain::ALL.map(Domain::name).join(", ");
            format!("unknown domain \"{s}\"; there are {names}")
        })
    }
}

/// A set of domains.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct DomainSet(u8);

impl DomainSet {
    /// No domain.
    pub const EMPTY: DomainSet = DomainSet(0);

    /// Returns whether the set is empty.
    #[inline]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Returns whether the set contains the domain.
    #[inline]
    pub const fn contains(self, domain: Domain) -> bool {
        self.0 & (1 << domain as u8) != 0
    }

    /// Returns the set with one more domain.
    #[must_use]
    pub const fn with(self, domain: Domain) -> DomainSet {
        DomainSet(self.0 | 1 << domain as u8)
    }

    /// Returns all domains of the integral except the given ones; Russian roulette is never included.
    #[must_use]
    pub fn all_but(varying: &[Domain]) -> DomainSet {
        let held = |domain: &Domain| *domain != Domain::Roulette && !varying.contains(domain);
        Domain::ALL.into_iter().filter(held).collect()
    }
}

impl FromIterator<Domain> for DomainSet {
    fn from_iter<I: IntoIterator<Item = Domain>>(domains: I) -> Self {
        domains.into_iter().fold(DomainSet::EMPTY, DomainSet::with)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_hold_what_was_put_in_and_nothing_else() {
        let set: DomainSet = [Domain::Lens, Domain::Bsdf].into_iter().collect();
        for domain in Domain::ALL {
            assert_eq!(set.contains(domain), matches!(domain, Domain::Lens | Domain::Bsdf));
            assert_eq!(domain.name().parse(), Ok(domain));
        }
        assert!(DomainSet::EMPTY.is_empty() && !set.is_empty());
        let held = DomainSet::all_but(&[Domain::Lens]);
        for domain in Domain::ALL {
            assert_eq!(held.contains(domain), !matches!(domain, Domain::Lens | Domain::Roulette), "{domain}");
        }
        assert_eq!(
            "brdf".parse::<Domain>(),
            Err("unknown domain \"brdf\"; there are pixel, lens, time, light, bsdf, hemisphere, roulette"
                .into())
        );
    }
}
