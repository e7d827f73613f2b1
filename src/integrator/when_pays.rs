//! The choice whether something that costs time is done to reduce noise.

use crate::util;
use std::str::FromStr;

/// Whether something that costs time is done to reduce noise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum WhenPays {
    /// If a pilot finds that it reduces error × cost.
    #[default]
    Auto,
    /// Always, where it is possible.
    Always,
    /// Never.
    Never,
}

impl WhenPays {
    /// The names in the scene language and on the command line.
    pub const NAMES: [(&str, WhenPays); 3] =
        [("auto", WhenPays::Auto), ("always", WhenPays::Always), ("never", WhenPays::Never)];
}

impl FromStr for WhenPays {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        util::named(&WhenPays::NAMES, name).ok_or_else(|| "expected auto, always or never".into())
    }
}
