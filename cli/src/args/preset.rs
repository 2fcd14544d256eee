//! Presets: settings of a training for a kind of data set.

use clap::ValueEnum;

/// Kind of data set with settings of its training.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Preset {
    /// NeRF Synthetic as published: white, 800 × 800, 30000 iterations.
    NerfSynthetic,
    /// Shiny Blender (Ref-NeRF): white, 800 × 800, 30000 iterations.
    ShinyBlender,
    /// Glossy Synthetic (NeRO), converted by scripts/glossy-synthetic.py: white, 800 × 800,
    /// 30000 iterations.
    GlossySynthetic,
    /// Tanks and Temples as published: photographs, black, full size, 30000 iterations; with
    /// --eval every 8th held out.
    TanksAndTemples,
    /// Photographs, for a quick result: black, at most 1100 pixels along an edge, 5000 background
    /// points, 7000 iterations; with --eval every 8th held out.
    Photos,
}

/// Settings of synthetic data sets in published tables.
const SYNTHETIC: [(&str, &str); 4] =
    [("profile", "specula"), ("iterations", "30000"), ("resolution", "1"), ("background", "white")];

impl Preset {
    /// Options and their values, as on the command line.
    pub(crate) fn settings(self) -> &'static [(&'static str, &'static str)] {
        match self {
            Self::NerfSynthetic | Self::ShinyBlender | Self::GlossySynthetic => &SYNTHETIC,
            Self::TanksAndTemples => &[
                ("profile", "specula"),
                ("iterations", "30000"),
                ("resolution", "1"),
                ("background", "black"),
                ("test-every", "8"),
            ],
            Self::Photos => &[
                ("profile", "specula"),
                ("iterations", "7000"),
                ("resolution", "auto"),
                ("background", "black"),
                ("test-every", "8"),
                ("background-points", "5000"),
            ],
        }
    }
}
