//! The knobs: what a picture's error and its time depend on, and what each can be turned to.

use crate::subject::Subject;
use core::fmt;
use specula_core::{
    cutoffs::{ALPHA_MIN, Cutoffs, ProjectionModel, TRANSMITTANCE_MIN},
    pack::Storage,
    prefilter::PrefilterScheme,
    random,
    rules::{Channels, RenderRules},
    shade::ShadingForm,
};

/// How every knob is turned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    /// How Gaussians and light are stored.
    pub storage: Storage,
    /// How light is filtered.
    pub scheme: PrefilterScheme,
    /// Texels along an edge of the light's faces; zero without light.
    pub light: usize,
    /// Highest band of the spherical harmonics.
    pub sh_degree: Option<u8>,
    /// Who looks the light up.
    pub form: ShadingForm,
    /// What is cut off.
    pub cutoffs: Cutoffs,
    /// What is blended.
    pub channels: Channels,
}

impl Setting {
    /// What `render` does without being told otherwise.
    pub fn usual(subject: &Subject) -> Self {
        Self { cutoffs: Cutoffs::DEFAULT, ..Self::exact(subject) }
    }

    /// Every knob at its most exact: what is left is the rounding of `f32`, and that of the light's filter.
    pub fn exact(subject: &Subject) -> Self {
        Self {
            storage: Storage::F32,
            scheme: subject.scheme,
            light: subject.light.as_ref().filter(|_| subject.is_lit()).map_or(0, |light| light.resolution),
            sh_degree: subject.gaussians.layout.sh_degree,
            form: subject.shading.form,
            cutoffs: Cutoffs::REFERENCE,
            channels: Channels::Color,
        }
    }

    /// How a scene is asked to be rendered under it; without what the scene does not need.
    pub fn rules(&self, subject: &Subject) -> RenderRules {
        let shading = specula_core::shade::ShadingRules { form: self.form, ..subject.shading };
        RenderRules { sh_degree: self.sh_degree, ..RenderRules::full(shading, self.scheme, self.channels) }
    }

    /// Each knob's name, and in words how it is turned.
    pub fn words(&self) -> Vec<(&'static str, String)> {
        KNOBS.iter().map(|knob| (knob.name, (knob.words)(self))).collect()
    }

    /// This setting with one knob turned as in another.
    fn with(mut self, knob: &Knob, like: &Self) -> Self {
        (knob.copy)(like, &mut self);
        self
    }
}

/// In words, what differs from the usual setting of a subject.
#[derive(Clone, Copy, Debug)]
pub struct Difference<'a>(pub &'a Setting, pub &'a Setting);

impl fmt::Display for Difference<'_> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let words = self.0.words().into_iter().zip(self.1.words());
        let words: Vec<String> =
            words.filter(|(own, usual)| own != usual).map(|((name, own), _)| format!("{name} {own}")).collect();
        out.write_str(&if words.is_empty() { "the usual".to_owned() } else { words.join(", ") })
    }
}

/// One thing that can be turned.
#[derive(Clone, Copy, Debug)]
pub struct Knob {
    /// What it is called.
    pub name: &'static str,
    /// How it is turned, in words.
    words: fn(&Setting) -> String,
    copy: fn(&Setting, &mut Setting),
    /// What it can be turned to.
    values: fn(&Subject, &Setting) -> Vec<Setting>,
}

/// Every knob that there is.
pub const KNOBS: [Knob; 10] = [
    Knob {
        name: "storage",
        words: |own| if own.storage == Storage::F16 { "f16" } else { "f32" }.into(),
        copy: |from, to| to.storage = from.storage,
        values: |_, base| [Storage::F32, Storage::F16].map(|storage| Setting { storage, ..*base }).into(),
    },
    Knob {
        name: "prefilter",
        words: |own| if own.scheme == PrefilterScheme::Exact { "exact" } else { "official" }.into(),
        copy: |from, to| to.scheme = from.scheme,
        values: |_, base| {
            let schemes = [PrefilterScheme::Exact, PrefilterScheme::Official].into_iter();
            schemes
                .filter(|scheme| base.light >= scheme.resolution_min())
                .map(|scheme| Setting { scheme, ..*base })
                .collect()
        },
    },
    Knob {
        name: "light",
        words: |own| if own.light == 0 { "none".into() } else { own.light.to_string() },
        copy: |from, to| to.light = from.light,
        values: |_, base| {
            let halves = core::iter::successors(Some(base.light), |light| Some(light / 2));
            halves
                .take_while(|light| *light >= base.scheme.resolution_min())
                .map(|light| Setting { light, ..*base })
                .collect()
        },
    },
    Knob {
        name: "harmonics",
        words: |own| own.sh_degree.map_or("none".into(), |degree| degree.to_string()),
        copy: |from, to| to.sh_degree = from.sh_degree,
        values: |subject, base| {
            let degrees = subject.gaussians.layout.sh_degree.into_iter().flat_map(|most| (0..=most).rev());
            let none = subject.gaussians.layout.is_shaded().then_some(None);
            degrees.map(Some).chain(none).map(|sh_degree| Setting { sh_degree, ..*base }).collect()
        },
    },
    Knob {
        name: "least alpha",
        words: |own| share(own.cutoffs.alpha_min()),
        copy: |from, to| to.cutoffs = to.cutoffs.with_alpha_min(from.cutoffs.alpha_min()),
        values: |_, base| {
            let values = [0.0, 1e-6, 1.0 / 8192.0, 1.0 / 2048.0, 1.0 / 1024.0, 1.0 / 512.0, ALPHA_MIN, 1.0 / 128.0];
            let coarse = [1.0 / 64.0, 1.0 / 32.0, 1.0 / 16.0];
            values.into_iter().chain(coarse).map(|least| limited(base, base.cutoffs.with_alpha_min(least))).collect()
        },
    },
    Knob {
        name: "least transmittance",
        words: |own| share(own.cutoffs.transmittance_min()),
        copy: |from, to| to.cutoffs = to.cutoffs.with_transmittance_min(from.cutoffs.transmittance_min()),
        values: |_, base| {
            let values = [0.0, 1e-6, 1e-5, TRANSMITTANCE_MIN, 1e-3, 3e-3, 0.01, 0.03, 0.1];
            values.map(|least| limited(base, base.cutoffs.with_transmittance_min(least))).into()
        },
    },
    Knob {
        name: "extent",
        words: |own| match own.cutoffs.reach_max() {
            f32::INFINITY => "exact".into(),
            sigmas => format!("{sigmas} σ"),
        },
        copy: |from, to| to.cutoffs = to.cutoffs.with_reach_max(from.cutoffs.reach_max()),
        values: |_, base| {
            let values = [f32::INFINITY, 4.0, 3.5, 3.0, 2.5, 2.0];
            values.map(|sigmas| limited(base, base.cutoffs.with_reach_max(sigmas))).into()
        },
    },
    Knob {
        name: "projection",
        words: |own| match own.cutoffs.projection() {
            ProjectionModel::Ray => "along rays".into(),
            ProjectionModel::Within(alpha) => format!("affine within {alpha}"),
            ProjectionModel::Tangent => "tangent".into(),
            ProjectionModel::Affine => "affine".into(),
        },
        copy: |from, to| to.cutoffs = to.cutoffs.with_projection(from.cutoffs.projection()),
        values: |_, base| {
            let within = [1e-3, 1e-2, 0.1].map(ProjectionModel::Within);
            let values = [ProjectionModel::Ray]
                .into_iter()
                .chain(within)
                .chain([ProjectionModel::Tangent, ProjectionModel::Affine]);
            values.map(|projection| limited(base, base.cutoffs.with_projection(projection))).collect()
        },
    },
    Knob {
        name: "light per",
        words: |own| if own.form == ShadingForm::Deferred { "pixel" } else { "Gaussian" }.into(),
        copy: |from, to| to.form = from.form,
        values: |subject, base| {
            let forms = [ShadingForm::Deferred, ShadingForm::Paper].into_iter().filter(|_| subject.is_lit());
            forms.map(|form| Setting { form, ..*base }).collect()
        },
    },
    Knob {
        name: "channels",
        words: |own| {
            match own.channels {
                Channels::Color => "colour",
                Channels::Training => "training",
                Channels::Lit | Channels::Surface => "surface",
                Channels::Layers => "layers",
            }
            .into()
        },
        copy: |from, to| to.channels = from.channels,
        values: |_, base| {
            [Channels::Color, Channels::Training, Channels::Layers].map(|channels| Setting { channels, ..*base }).into()
        },
    },
];

/// What cannot be turned, because there is only one way.
pub const FIXED: [(&str, &str); 3] = [
    ("sort", "by depth of the mean; how far that is from an order for each pixel is said below"),
    ("levels of light", "ten (exact) or by resolution (official)"),
    ("largest alpha", "0.99, which is part of the model"),
];

fn limited(base: &Setting, cutoffs: Cutoffs) -> Setting {
    Setting { cutoffs, ..*base }
}

/// A share in words: as a fraction where it is one, zero where it is as good as that.
fn share(x: f32) -> String {
    let inverse = 1.0 / x;
    if x <= Cutoffs::REFERENCE.alpha_min() {
        "0".into()
    } else if x > 1e-4 && (inverse - inverse.round()).abs() < 1e-3 && !(inverse.round() as u32).is_multiple_of(10) {
        format!("1/{inverse:.0}")
    } else if x < 1e-3 {
        format!("{x:.0e}")
    } else {
        format!("{x}")
    }
}

impl Knob {
    /// What a setting becomes as this knob is turned; nothing where there is only one way.
    pub fn turned(&self, subject: &Subject, base: &Setting) -> Vec<Setting> {
        let values = (self.values)(subject, base);
        if values.len() > 1 { values } else { Vec::new() }
    }

    /// How it is turned in a setting, in words.
    pub fn word(&self, setting: &Setting) -> String {
        (self.words)(setting)
    }
}

/// A setting that was tried: its error, and what it costs.
#[derive(Clone, Copy, Debug)]
pub struct Tried {
    /// The setting.
    pub setting: Setting,
    /// How far its pictures are from exact ones.
    pub error: f64,
    /// What they cost.
    pub cost: f64,
}

/// Settings that turn every knob at once: for each of some errors the cheapest value of each knob that alone is not
/// further off.
///
/// `of_knobs` are the trials of each knob, all others at their most exact. Where `error` says how far a whole setting may
/// be off, each knob gets all of it; the sum may be more.
pub fn together(exact: &Setting, of_knobs: &[(Knob, Vec<Tried>)], error: f64) -> Setting {
    of_knobs.iter().fold(*exact, |setting, (knob, tried)| {
        let fits = tried.iter().filter(|tried| tried.error <= error);
        let cheapest = fits.min_by(|a, b| a.cost.total_cmp(&b.cost));
        cheapest.map_or(setting, |cheapest| setting.with(knob, &cheapest.setting))
    })
}

/// A setting with every knob turned at random, the same for a seed.
pub fn random_setting(subject: &Subject, exact: &Setting, seed: u64) -> Setting {
    KNOBS.iter().enumerate().fold(*exact, |setting, (stream, knob)| {
        let values = knob.turned(subject, exact);
        let draw = random::uniform(seed, stream as u64, 0) * values.len() as f32;
        values.get(draw as usize).map_or(setting, |value| setting.with(knob, value))
    })
}

/// Whether light can be filtered so.
pub fn is_possible(setting: &Setting) -> bool {
    setting.light == 0 || setting.light >= setting.scheme.resolution_min()
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::{
        scene::{Layout, RadianceActivation},
        shade::ShadingRules,
    };
    use specula_oracle::scenes::{camera, random_cloud, random_environment};

    fn subject() -> Subject {
        Subject {
            gaussians: random_cloud(3, Layout::shaded(Some(2)), 1),
            light: Some(random_environment(64, RadianceActivation::Identity, 1)),
            shading: ShadingRules::DEFERRED,
            scheme: PrefilterScheme::Exact,
            cameras: vec![camera(8, 8)],
            background: [0.0; 3],
        }
    }

    #[test]
    fn a_knob_turns_nothing_but_itself() {
        let (subject, exact) = (subject(), Setting::exact(&subject()));
        for knob in KNOBS {
            let turned = knob.turned(&subject, &exact);
            assert!(turned.len() > 1, "{} can be turned", knob.name);
            assert_eq!(turned[0], exact, "{} begins with what is most exact", knob.name);
            for setting in turned {
                assert_eq!(exact.with(&knob, &setting), setting);
                let others =
                    |own: &Setting| own.words().into_iter().filter(|(name, _)| *name != knob.name).collect::<Vec<_>>();
                assert_eq!(others(&setting), others(&exact));
            }
        }
    }

    #[test]
    fn all_knobs_together_take_the_cheapest_that_fits_of_each() {
        let (subject, exact) = (subject(), Setting::exact(&subject()));
        let tried = |knob: &Knob| {
            let turned = knob.turned(&subject, &exact).into_iter().enumerate();
            turned.map(|(k, setting)| Tried { setting, error: k as f64, cost: -(k as f64) }).collect::<Vec<_>>()
        };
        let of_knobs: Vec<_> = KNOBS.iter().map(|knob| (*knob, tried(knob))).collect();
        assert_eq!(together(&exact, &of_knobs, 0.5), exact);
        let one_step = together(&exact, &of_knobs, 1.0);
        for (knob, tried) in &of_knobs {
            assert_eq!(knob.word(&one_step), knob.word(&tried[1].setting), "{}", knob.name);
        }
    }

    #[test]
    fn what_is_drawn_at_random_is_the_same_for_a_seed() {
        let (subject, exact) = (subject(), Setting::exact(&subject()));
        let draw = |seed: u64| random_setting(&subject, &exact, seed);
        assert_eq!(draw(1), draw(1));
        assert!((2..9).any(|seed| draw(seed) != draw(1)), "seeds differ");
    }

    #[test]
    fn shares_are_fractions_where_they_are() {
        assert_eq!([0.0, 1e-6, 1.0 / 255.0, 1.0 / 8192.0, 0.1].map(share), ["0", "1e-6", "1/255", "1/8192", "0.1"]);
        assert_eq!([1e-12, 1e-4, 0.003].map(share), ["0", "1e-4", "0.003"]);
    }

    #[test]
    fn differences_are_told_in_words() {
        let (usual, exact) = (Setting::usual(&subject()), Setting::exact(&subject()));
        assert_eq!(Difference(&usual, &usual).to_string(), "the usual");
        assert_eq!(
            Difference(&exact, &usual).to_string(),
            "least alpha 0, least transmittance 0, projection along rays"
        );
    }
}
