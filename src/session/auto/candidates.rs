//! The integrators among which pilots choose.

use super::blocks::Bias;
use crate::integrator::settings::{AUTO, AutoSettings, HiddenLight, Plugin};
use crate::integrator::{Bdpt, IrradianceCache, PathIntegrator, Photonmapper, Sppm, Vcm, VolpathIntegrator};

/// An integrator that may be chosen.
pub struct Candidate {
    /// Its name.
    pub name: &'static str,
    /// The bias of its images.
    pub bias: Bias,
    /// What it finds of hidden light.
    pub hidden_light: HiddenLight,
    /// The exponent of the side of the image in the cost of the preparation.
    pub preparation: i32,
}

impl Candidate {
    const fn new<P: Plugin>(bias: Bias) -> Self {
        Candidate { name: P::NAME, bias, hidden_light: P::HIDDEN_LIGHT, preparation: 0 }
    }
}

/// The candidates. The first one is kept unless another one is clearly better. Those from [`SECOND`] on have a pilot
/// only if it is not kept so far.
const CANDIDATES: [Candidate; 4] =
    [PATH, BDPT, Candidate::new::<Sppm>(Bias::Vanishing), Candidate::new::<Vcm>(Bias::Vanishing)];
/// The index of the first candidate that has a pilot only if the first of all is not kept so far.
pub const SECOND: usize = 3;
/// The candidates for scenes with media that are rendered.
const IN_MEDIA: [Candidate; 2] = [VOLPATH, BDPT];
const PATH: Candidate = Candidate::new::<PathIntegrator>(Bias::None);
const VOLPATH: Candidate = Candidate::new::<VolpathIntegrator>(Bias::None);
const BDPT: Candidate = Candidate::new::<Bdpt>(Bias::None);
/// The candidates in addition if a bias is allowed. There are as many photons for all sizes of an image, and about as
/// many irradiance records as the side of the image has pixels.
pub const BIASED: [Candidate; 2] = [
    Candidate { preparation: 1, ..Candidate::new::<IrradianceCache>(Bias::Remaining) },
    Candidate::new::<Photonmapper>(Bias::Remaining),
];

/// What pilots decide.
#[derive(Clone, Copy, Debug)]
pub enum Question {
    /// Which integrator is the best one.
    Integrator(AutoSettings),
    /// Whether the connections of `bdpt` pay, or camera paths alone are better.
    Connections,
}

impl Question {
    /// Returns the integrator that the user named.
    pub(super) fn asked(self) -> &'static str {
        match self {
            Question::Integrator(_) => AUTO,
            Question::Connections => Bdpt::NAME,
        }
    }

    /// Returns whether it can be answered by the integrator with the given name.
    pub fn has_answer(self, name: &str) -> bool {
        let candidates = [false, true].into_iter().flat_map(|in_media| self.candidates(in_media));
        matches!(self, Question::Integrator(_))
            || candidates.into_iter().any(|candidate| candidate.name == name)
    }

    /// Returns the candidates without a bias that remains. The first one is kept unless another one is clearly better.
    pub(super) fn candidates(self, in_media: bool) -> &'static [Candidate] {
        match (self, in_media) {
            (Question::Integrator(_), false) => &CANDIDATES,
            (Question::Integrator(_), true) => &IN_MEDIA,
            (Question::Connections, false) => &[BDPT, PATH],
            (Question::Connections, true) => &[BDPT, VOLPATH],
        }
    }
}
