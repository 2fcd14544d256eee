//! Shading models, and the conversion between their numbers and those of files.
//!
//! Files always follow GaussianShader's code: the diffuse colour is σ(f_dc − ln 3), and a normal
//! that was flipped towards the viewer is −v + Δn₂. In the paper's form they are σ(diffuse) and
//! −(v + Δn₂), so numbers are shifted and Δn₂ changes its sign between the two. Files also name the
//! rest of a model: the equation that combines the terms, the base axis of normals, the prefilter
//! of the light.

use crate::error::SceneError;
use serde::Deserialize;
use serde_json::{Map, Value};
use specula_core::{
    normal::AxisRule,
    plan::{Needs, Plan},
    prefilter::{Levels, PrefilterScheme},
    rules::{Channels, RenderRules},
    scene::{DIFFUSE, Gaussians, Layout, NORMAL_RESIDUAL_2},
    shade::{ShadingForm, ShadingRules},
};
use specula_io::model_folder::Model;
use specula_train::profile::{Profile, Reflections};

/// First word of a PLY comment that names a shading model.
const COMMENT: &str = "specula";

/// Colours of a scene with physical materials in addition to its view-dependent colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Shading {
    /// View-dependent colours, the best under the light of the training.
    View,
    /// Physical materials ([`specula_core::physical`]), for other lights.
    Physical,
}

impl Shading {
    /// Lower-case name, of folders and options.
    pub const fn name(self) -> &'static str {
        match self {
            Self::View => "view",
            Self::Physical => "physical",
        }
    }
}

/// Rules that turn attributes into colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShadingModel {
    /// Shading function, and the base axis of normals.
    pub shading: ShadingRules,
    /// Prefilter of the light.
    pub scheme: PrefilterScheme,
    /// Light of mirrored rays in view-dependent colours, in scenes with a near field.
    pub reflections: Reflections,
}

impl ShadingModel {
    /// Equations of the paper, with the exact prefilter.
    pub const PAPER: Self =
        Self { shading: ShadingRules::PAPER, scheme: PrefilterScheme::Exact, reflections: Reflections::Near };
    /// Equations of the paper with light looked up per pixel.
    pub const DEFERRED: Self = Self { shading: ShadingRules::DEFERRED, ..Self::PAPER };
    /// Behaviour of the authors' code.
    pub const OFFICIAL: Self =
        Self { shading: ShadingRules::OFFICIAL, scheme: PrefilterScheme::Official, ..Self::PAPER };

    /// Plan of pictures with these channels, for Gaussians of this layout: the only place that
    /// decides which stages are skipped.
    pub fn plan(self, layout: Layout, needs: &Needs, levels: Option<&Levels>, channels: Channels) -> Plan {
        let full = RenderRules::full(self.shading, self.scheme, channels);
        Plan::new(layout, needs, levels, &RenderRules { sh_degree: layout.sh_degree, ..full })
    }

    /// The same model with physical materials or with view-dependent colours.
    #[must_use]
    pub const fn shaded(self, shading: Shading) -> Self {
        let form = match (shading, self.shading.form) {
            (Shading::Physical, _) => ShadingForm::Physical,
            (Shading::View, ShadingForm::Physical) => ShadingForm::Deferred,
            (Shading::View, form) => form,
        };
        Self { shading: ShadingRules { form, ..self.shading }, ..self }
    }

    /// Colours of the model.
    pub fn shading(self) -> Shading {
        if self.shading.form == ShadingForm::Physical { Shading::Physical } else { Shading::View }
    }

    /// True if mirrored rays hit the surface of a scene with a near field.
    pub fn traces_near(self) -> bool {
        self.shading() == Shading::Physical || self.reflections == Reflections::Near
    }

    /// Shading model that a profile trains.
    pub fn of_profile(profile: &Profile) -> Self {
        let model = Self { shading: profile.shading, scheme: profile.scheme, reflections: profile.reflections };
        if profile.is_of_materials() { model.shaded(Shading::Physical) } else { model }
    }

    /// Shading model of a relightable file, else the one that a saved model names in
    /// `specula.json`, else in a comment of its PLY file, else that of the authors' code, which
    /// defines the layout.
    pub fn of_model(model: &Model) -> Self {
        if model.are_materials {
            return Self::DEFERRED;
        }
        let from_info = model.info.as_ref().and_then(|info| {
            let word = |key: &str| info.rest.get(key).and_then(Value::as_str);
            Self::from_names(&info.shading, word("axis"), word("prefilter"), word("reflections"))
        });
        let from_comments = || model.comments.iter().find_map(|comment| Self::from_comment(comment));
        from_info.or_else(from_comments).unwrap_or(Self::OFFICIAL)
    }

    /// Rejects a model with an unknown shading function, possibly of a later version.
    ///
    /// # Errors
    ///
    /// [`SceneError::UnknownShading`] with the name.
    pub fn refuse_unknown(model: &Model) -> Result<(), SceneError> {
        let in_info = model.info.as_ref().map(|info| info.shading.clone());
        let in_comments = || model.comments.iter().find_map(|comment| shading_in(comment));
        let name = in_info.filter(|name| !name.is_empty()).or_else(in_comments);
        match name
            .filter(|name| model.gaussians.layout.is_shaded() && Self::from_names(name, None, None, None).is_none())
        {
            None => Ok(()),
            Some(name) => Err(SceneError::UnknownShading(name)),
        }
    }

    fn from_names(
        shading: &str,
        axis: Option<&str>,
        prefilter: Option<&str>,
        reflections: Option<&str>,
    ) -> Option<Self> {
        let mut model = match shading {
            "paper" => Self::PAPER,
            "deferred" => Self::DEFERRED,
            "physical" => Self { shading: ShadingRules::PHYSICAL, ..Self::DEFERRED },
            "official" => Self::OFFICIAL,
            _ => return None,
        };
        model.shading.axis = match axis {
            Some("shortest") => AxisRule::Shortest,
            Some("sorted-row") => AxisRule::SortedRow,
            Some("none") => AxisRule::None,
            _ => model.shading.axis,
        };
        model.scheme = match prefilter {
            Some("exact") => PrefilterScheme::Exact,
            Some("official") => PrefilterScheme::Official,
            _ => model.scheme,
        };
        model.reflections = match reflections {
            Some("far") => Reflections::Far,
            Some("near") => Reflections::Near,
            _ => model.reflections,
        };
        Some(model)
    }

    /// Shading model named by a comment; `None` for other comments.
    pub fn from_comment(comment: &str) -> Option<Self> {
        let pairs = named_in(comment)?;
        let word = |key: &str| pairs.get(key).and_then(Value::as_str);
        Self::from_names(word("shading")?, word("axis"), word("prefilter"), word("reflections"))
    }

    /// Comment of a PLY file for [`ShadingModel::of_model`].
    pub fn comment(self) -> String {
        let [shading, axis, prefilter, reflections] = self.names();
        format!("{COMMENT} shading={shading} axis={axis} prefilter={prefilter} reflections={reflections}")
    }

    /// Converts attributes of this model to the numbers of files.
    pub fn encode(self, gaussians: &mut Gaussians<Vec<f32>>) {
        convert(gaussians, self.shading, 1.0);
    }

    /// Converts the numbers of files to attributes of this model.
    pub(crate) fn decode(self, gaussians: &mut Gaussians<Vec<f32>>) {
        convert(gaussians, self.shading, -1.0);
    }

    /// Names of the equation, the axis, the prefilter and the reflections.
    pub fn names(self) -> [&'static str; 4] {
        [
            match self.shading.form {
                ShadingForm::Paper => "paper",
                // Materials are a second interpretation of the same numbers.
                ShadingForm::Deferred | ShadingForm::Physical => "deferred",
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
            match self.reflections {
                Reflections::Far => "far",
                Reflections::Near => "near",
            },
        ]
    }
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

/// Names in a comment of a PLY file by their keys; none in other comments.
fn named_in(comment: &str) -> Option<Map<String, Value>> {
    let mut words = comment.split_whitespace();
    let pairs = |word: &str| word.split_once('=').map(|(key, word)| (key.to_owned(), word.into()));
    (words.next() == Some(COMMENT)).then(|| words.filter_map(pairs).collect())
}

fn shading_in(comment: &str) -> Option<String> {
    named_in(comment)?.get("shading")?.as_str().map(str::to_owned)
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
    fn the_papers_numbers_are_converted_to_the_authors() {
        let mut gaussians = one(0.25, 0.5);
        ShadingModel::PAPER.encode(&mut gaussians);
        let [in_file] = gaussians.get::<1>(0, DIFFUSE);
        assert!((sigmoid(in_file - ShadingRules::OFFICIAL.diffuse_shift()) - sigmoid(0.25)).abs() < 1e-6);
        assert_eq!(gaussians.get::<1>(0, NORMAL_RESIDUAL_2), [-0.5]);
    }

    #[test]
    fn the_authors_numbers_are_unchanged() {
        let mut gaussians = one(0.25, 0.5);
        ShadingModel::OFFICIAL.encode(&mut gaussians);
        assert_eq!(gaussians, one(0.25, 0.5));
    }

    #[test]
    fn a_file_is_read_back_as_it_was_written() {
        let mut gaussians = one(0.25, 0.5);
        ShadingModel::PAPER.encode(&mut gaussians);
        ShadingModel::PAPER.decode(&mut gaussians);
        assert!((gaussians.get::<1>(0, DIFFUSE)[0] - 0.25).abs() < 1e-6);
        assert_eq!(gaussians.get::<1>(0, NORMAL_RESIDUAL_2), [0.5]);
    }

    #[test]
    fn materials_reflect_the_surface_that_view_dependent_colours_may_ignore() {
        let far = ShadingModel { reflections: Reflections::Far, ..ShadingModel::DEFERRED };
        assert!(!far.traces_near() && ShadingModel::DEFERRED.traces_near());
        assert!(far.shaded(Shading::Physical).traces_near());
        assert!(!far.shaded(Shading::Physical).shaded(Shading::View).traces_near());
    }

    #[test]
    fn comments_name_the_shading_model() {
        let free_normals = ShadingRules { axis: AxisRule::None, ..ShadingRules::PAPER };
        let free = ShadingModel { shading: free_normals, ..ShadingModel::PAPER };
        let far = ShadingModel { reflections: Reflections::Far, ..ShadingModel::DEFERRED };
        for model in [ShadingModel::PAPER, ShadingModel::DEFERRED, ShadingModel::OFFICIAL, free, far] {
            assert_eq!(ShadingModel::from_comment(&model.comment()), Some(model));
        }
        assert_eq!(ShadingModel::from_comment("made with love"), None);
    }
}
