//! Presets: settings of a training by the name of what it is trained on.

use clap::ValueEnum;

/// A bundle of settings for a kind of data set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Preset {
    /// NeRF Synthetic as published: white, 800 × 800, 30000 iterations.
    NerfSynthetic,
    /// Shiny Blender (Ref-NeRF): white, 800 × 800, 30000 iterations.
    ShinyBlender,
    /// Glossy Synthetic (NeRO), converted by scripts/glossy-synthetic.py: white, 800 × 800, 30000 iterations.
    GlossySynthetic,
    /// Photographs with cameras by COLMAP as published: black, full size, every 8th held out, 30000 iterations.
    TanksAndTemples,
    /// Photographs of one's own, to see something soon: black, a quarter of their size, every 8th held out, 5000 points
    /// in the background, 7000 iterations.
    Photos,
}

/// A transparent data set over white, as tables of the field have them.
const SYNTHETIC: [(&str, &str); 4] =
    [("profile", "specula"), ("iterations", "30000"), ("resolution", "1"), ("background", "white")];

impl Preset {
    /// Options and their values, as they are typed.
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
                ("resolution", "4"),
                ("background", "black"),
                ("test-every", "8"),
                ("background-points", "5000"),
            ],
        }
    }
}
