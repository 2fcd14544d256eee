//! What the numbers in a file of shaded Gaussians mean, and the way from there to what is computed with.
//!
//! Files are GaussianShader's, whatever trained them: the diffuse colour is `σ(f_dc − ln 3)`, and a normal that had to be
//! turned to the viewer is −v + Δn₂. The paper's form is σ(diffuse) and −(v + Δn₂), so numbers are shifted and Δn₂
//! changes its sign on the way. What cannot be converted is said in words beside them: which equation puts the terms
//! together, which axis is the normal's base, how light is filtered.

use crate::{args::ProfileName, failure::Failure};
use serde_json::{Map, Value};
use specula_core::{
    executor::RenderRules,
    normal::AxisRule,
    plan::{Channels, Needs, Plan},
    prefilter::{Levels, PrefilterScheme},
    scene::{DIFFUSE, Gaussians, Layout, NORMAL_RESIDUAL_2},
    shade::{ShadingForm, ShadingRules},
};
use specula_io::model_folder::Model;

/// What a comment in a PLY file begins with, when it says how the file is to be read.
const COMMENT: &str = "specula";

/// How attributes become colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Reading {
    pub(crate) shading: ShadingRules,
    pub(crate) scheme: PrefilterScheme,
}

impl Reading {
    /// The paper's equations, light filtered exactly.
    pub(crate) const PAPER: Self = Self { shading: ShadingRules::PAPER, scheme: PrefilterScheme::Exact };
    /// The same, light looked up pixel by pixel.
    pub(crate) const DEFERRED: Self = Self { shading: ShadingRules::DEFERRED, ..Self::PAPER };
    /// What the authors' code does.
    pub(crate) const OFFICIAL: Self = Self { shading: ShadingRules::OFFICIAL, scheme: PrefilterScheme::Official };

    /// How Gaussians of this layout are rendered so that pictures have these channels: the one place where it is decided
    /// what they can do without.
    pub(crate) fn plan(self, layout: Layout, needs: &Needs, levels: Option<&Levels>, channels: Channels) -> Plan {
        let full = RenderRules::full(self.shading, self.scheme, channels);
        Plan::new(layout, needs, levels, &RenderRules { sh_degree: layout.sh_degree, ..full })
    }

    /// That of a model: what it says itself; else that of the authors' code, whose layout it has.
    pub(crate) fn of_model(model: &Model) -> Self {
        let from_info = model.info.as_ref().and_then(|info| {
            let word = |key: &str| info.rest.get(key).and_then(Value::as_str);
            Self::from_words(&info.shading, word("axis"), word("prefilter"))
        });
        let from_comments = || model.comments.iter().find_map(|comment| Self::from_comment(comment));
        from_info.or_else(from_comments).unwrap_or(Self::OFFICIAL)
    }

    /// That of a model, or the one that was asked for instead.
    pub(crate) fn chosen(model: &Model, profile: Option<ProfileName>) -> Result<Self, Failure> {
        match profile {
            None => Ok(Self::of_model(model)),
            Some(ProfileName::Official) => Ok(Self::OFFICIAL),
            Some(ProfileName::Specula) => Ok(Self::DEFERRED),
            Some(ProfileName::Paper) => Ok(Self::PAPER),
            Some(ProfileName::Plain) if !model.gaussians.layout.is_shaded() => Ok(Self::PAPER),
            Some(ProfileName::Plain) => Err(Failure::Input(
                "the scene has shading attributes and cannot be read as plain Gaussian splatting; use --profile \
                 specula, paper or official"
                    .into(),
            )),
        }
    }

    fn from_words(shading: &str, axis: Option<&str>, prefilter: Option<&str>) -> Option<Self> {
        let mut reading = match shading {
            "paper" => Self::PAPER,
            "deferred" => Self::DEFERRED,
            "official" => Self::OFFICIAL,
            _ => return None,
        };
        reading.shading.axis = match axis {
            Some("shortest") => AxisRule::Shortest,
            Some("sorted-row") => AxisRule::SortedRow,
            Some("none") => AxisRule::None,
            _ => reading.shading.axis,
        };
        reading.scheme = match prefilter {
            Some("exact") => PrefilterScheme::Exact,
            Some("official") => PrefilterScheme::Official,
            _ => reading.scheme,
        };
        Some(reading)
    }

    fn from_comment(comment: &str) -> Option<Self> {
        let mut words = comment.split_whitespace();
        if words.next() != Some(COMMENT) {
            return None;
        }
        let pairs: Map<String, Value> =
            words.filter_map(|word| word.split_once('=')).map(|(key, word)| (key.to_owned(), word.into())).collect();
        let word = |key: &str| pairs.get(key).and_then(Value::as_str);
        Self::from_words(word("shading")?, word("axis"), word("prefilter"))
    }

    /// The comment that [`Reading::of_model`] understands.
    pub(crate) fn comment(self) -> String {
        let [shading, axis, prefilter] = self.words();
        format!("{COMMENT} shading={shading} axis={axis} prefilter={prefilter}")
    }

    /// Names of the equation, the axis and the prefilter.
    pub(crate) fn words(self) -> [&'static str; 3] {
        [
            match self.shading.form {
                ShadingForm::Paper => "paper",
                ShadingForm::Deferred => "deferred",
                ShadingForm::Official => "official",
            },
            match self.shading.axis {
                AxisRule::Shortest => "shortest",
                AxisRule::SortedRow => "sorted-row",
                AxisRule::None => "none",
            },
            match self.scheme {
                PrefilterScheme::Exact => "exact",
                PrefilterScheme::Official => "official",
            },
        ]
    }
}

/// From what is computed with to what files hold.
pub(crate) fn to_file(gaussians: &mut Gaussians<Vec<f32>>, shading: ShadingRules) {
    convert(gaussians, shading, 1.0);
}

/// From what files hold to what is computed with.
pub(crate) fn from_file(gaussians: &mut Gaussians<Vec<f32>>, shading: ShadingRules) {
    convert(gaussians, shading, -1.0);
}

fn convert(gaussians: &mut Gaussians<Vec<f32>>, shading: ShadingRules, sign: f32) {
    if !gaussians.layout.is_shaded() {
        return;
    }
    let shift = sign * (ShadingRules::OFFICIAL.diffuse_shift() - shading.diffuse_shift());
    let turns = shading.negate_second_residual != ShadingRules::OFFICIAL.negate_second_residual;
    for index in 0..gaussians.count {
        let diffuse = gaussians.get::<3>(index, DIFFUSE);
        gaussians.set(index, DIFFUSE, diffuse.map(|x| x + shift));
        if turns {
            let residual = gaussians.get::<3>(index, NORMAL_RESIDUAL_2);
            gaussians.set(index, NORMAL_RESIDUAL_2, residual.map(|x| -x));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::{activation::sigmoid, scene::len_of_values};

    fn one(diffuse: f32, residual: f32) -> Gaussians<Vec<f32>> {
        let layout = Layout::shaded(None);
        let mut gaussians = Gaussians { count: 1, layout, values: vec![0.0; len_of_values(1, layout)] };
        gaussians.set(0, DIFFUSE, [diffuse; 3]);
        gaussians.set(0, NORMAL_RESIDUAL_2, [residual; 3]);
        gaussians
    }

    #[test]
    fn the_papers_numbers_mean_the_same_to_the_authors() {
        let mut gaussians = one(0.25, 0.5);
        to_file(&mut gaussians, ShadingRules::PAPER);
        let [in_file] = gaussians.get::<1>(0, DIFFUSE);
        assert!((sigmoid(in_file - ShadingRules::OFFICIAL.diffuse_shift()) - sigmoid(0.25)).abs() < 1e-6);
        assert_eq!(gaussians.get::<1>(0, NORMAL_RESIDUAL_2), [-0.5]);
    }

    #[test]
    fn the_authors_numbers_stay_as_they_are() {
        let mut gaussians = one(0.25, 0.5);
        to_file(&mut gaussians, ShadingRules::OFFICIAL);
        assert_eq!(gaussians, one(0.25, 0.5));
    }

    #[test]
    fn a_file_is_read_back_as_it_was_written() {
        let mut gaussians = one(0.25, 0.5);
        to_file(&mut gaussians, ShadingRules::PAPER);
        from_file(&mut gaussians, ShadingRules::PAPER);
        assert!((gaussians.get::<1>(0, DIFFUSE)[0] - 0.25).abs() < 1e-6);
        assert_eq!(gaussians.get::<1>(0, NORMAL_RESIDUAL_2), [0.5]);
    }

    #[test]
    fn comments_say_how_to_read_a_file() {
        let free_normals = ShadingRules { axis: AxisRule::None, ..ShadingRules::PAPER };
        let free = Reading { shading: free_normals, ..Reading::PAPER };
        for reading in [Reading::PAPER, Reading::DEFERRED, Reading::OFFICIAL, free] {
            assert_eq!(Reading::from_comment(&reading.comment()), Some(reading));
        }
        assert_eq!(Reading::from_comment("made with love"), None);
    }
}
