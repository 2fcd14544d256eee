//! Parameters that determine the error and the cost of a picture, and their values.

use crate::subject::Subject;
use core::fmt;
use specula_core::{
    cutoffs::{
        ALPHA_MIN,
        BlendOrder::{self, Mean, Pixel, Window},
        Cutoffs, ProjectionModel, TRANSMITTANCE_MIN, WINDOW_MAX,
    },
    pack::Storage,
    prefilter::PrefilterScheme,
    random,
    rules::{Channels, RenderRules},
    scene::Environment,
    shade::ShadingForm,
};

/// Value of every parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    /// Number format of stored Gaussians and light.
    pub storage: Storage,
    /// Prefilter of the light.
    pub scheme: PrefilterScheme,
    /// Texels along an edge of the light's faces; zero without light.
    pub light: usize,
    /// Highest band of the spherical harmonics.
    pub sh_degree: Option<u8>,
    /// Shading form: light per Gaussian or per pixel.
    pub form: ShadingForm,
    /// Culling and termination thresholds, the projection, and the order of splats.
    pub cutoffs: Cutoffs,
    /// Channels to blend.
    pub channels: Channels,
}

impl Setting {
    /// Default setting of `render`, with splats in the order of exact pictures.
    pub fn default_for(subject: &Subject) -> Self {
        Self { cutoffs: Cutoffs::DEFAULT.with_order(subject.order), ..Self::exact(subject) }
    }

    /// Most exact setting: only the rounding of `f32` and the prefilter of the light remain.
    pub fn exact(subject: &Subject) -> Self {
        Self {
            storage: Storage::F32,
            scheme: subject.scheme,
            light: subject.light.as_ref().filter(|_| subject.is_lit()).map_or(0, |light| light.resolution),
            sh_degree: subject.gaussians.layout.sh_degree,
            form: subject.shading.form,
            cutoffs: Cutoffs::REFERENCE.with_order(subject.order),
            channels: Channels::Color,
        }
    }

    /// Rendering rules of the setting.
    pub fn rules(&self, subject: &Subject) -> RenderRules {
        let shading = specula_core::shade::ShadingRules { form: self.form, ..subject.shading };
        RenderRules {
            sh_degree: self.sh_degree,
            traces_near: subject.near_field.is_some(),
            ..RenderRules::full(shading, self.scheme, self.channels)
        }
    }

    /// Name and value of each parameter.
    pub fn words(&self) -> Vec<(&'static str, String)> {
        PARAMETERS.iter().map(|parameter| (parameter.name, (parameter.words)(self))).collect()
    }

    /// Replaces one parameter by its value in another setting.
    fn with(mut self, parameter: &Parameter, like: &Self) -> Self {
        (parameter.copy)(like, &mut self);
        self
    }
}

/// Displays the parameters in which a setting differs from the default.
#[derive(Clone, Copy, Debug)]
pub struct Difference<'a>(pub &'a Setting, pub &'a Setting);

impl fmt::Display for Difference<'_> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let words = self.0.words().into_iter().zip(self.1.words());
        let words: Vec<String> = words
            .filter(|(value, default)| value != default)
            .map(|((name, value), _)| format!("{name} {value}"))
            .collect();
        out.write_str(&if words.is_empty() { "default".to_owned() } else { words.join(", ") })
    }
}

/// A parameter of rendering.
#[derive(Clone, Copy, Debug)]
pub struct Parameter {
    /// Name in reports.
    pub name: &'static str,
    /// Value in a setting, as text.
    words: fn(&Setting) -> String,
    copy: fn(&Setting, &mut Setting),
    /// Settings with every value of the parameter.
    values: fn(&Subject, &Setting) -> Vec<Setting>,
}

/// All parameters.
pub const PARAMETERS: [Parameter; 11] = [
    Parameter {
        name: "storage",
        words: |setting| if setting.storage == Storage::F16 { "f16" } else { "f32" }.into(),
        copy: |from, to| to.storage = from.storage,
        values: |_, base| [Storage::F32, Storage::F16].map(|storage| Setting { storage, ..*base }).into(),
    },
    Parameter {
        name: "prefilter",
        words: |setting| if setting.scheme == PrefilterScheme::Exact { "exact" } else { "official" }.into(),
        copy: |from, to| to.scheme = from.scheme,
        values: |subject, base| {
            let schemes = [PrefilterScheme::Exact, PrefilterScheme::Official].into_iter();
            let is_network = subject.light.as_ref().is_some_and(Environment::is_network);
            schemes
                .filter(|scheme| base.light >= scheme.resolution_min())
                .filter(|scheme| !is_network || *scheme == PrefilterScheme::Exact)
                .map(|scheme| Setting { scheme, ..*base })
                .collect()
        },
    },
    Parameter {
        name: "light",
        words: |setting| if setting.light == 0 { "none".into() } else { setting.light.to_string() },
        copy: |from, to| to.light = from.light,
        values: |_, base| {
            let halves = core::iter::successors(Some(base.light), |light| Some(light / 2));
            halves
                .take_while(|light| *light >= base.scheme.resolution_min())
                .map(|light| Setting { light, ..*base })
                .collect()
        },
    },
    Parameter {
        name: "harmonics",
        words: |setting| setting.sh_degree.map_or("none".into(), |degree| degree.to_string()),
        copy: |from, to| to.sh_degree = from.sh_degree,
        values: |subject, base| {
            let degrees = subject.gaussians.layout.sh_degree.into_iter().flat_map(|most| (0..=most).rev());
            let none = subject.gaussians.layout.is_shaded().then_some(None);
            degrees.map(Some).chain(none).map(|sh_degree| Setting { sh_degree, ..*base }).collect()
        },
    },
    Parameter {
        name: "least alpha",
        words: |setting| share(setting.cutoffs.alpha_min()),
        copy: |from, to| to.cutoffs = to.cutoffs.with_alpha_min(from.cutoffs.alpha_min()),
        values: |_, base| {
            let values = [0.0, 1e-6, 1.0 / 8192.0, 1.0 / 2048.0, 1.0 / 1024.0, 1.0 / 512.0, ALPHA_MIN, 1.0 / 128.0];
            let coarse = [1.0 / 64.0, 1.0 / 32.0, 1.0 / 16.0];
            values.into_iter().chain(coarse).map(|least| limited(base, base.cutoffs.with_alpha_min(least))).collect()
        },
    },
    Parameter {
        name: "least transmittance",
        words: |setting| share(setting.cutoffs.transmittance_min()),
        copy: |from, to| to.cutoffs = to.cutoffs.with_transmittance_min(from.cutoffs.transmittance_min()),
        values: |_, base| {
            let values = [0.0, 1e-6, 1e-5, TRANSMITTANCE_MIN, 1e-3, 3e-3, 0.01, 0.03, 0.1];
            values.map(|least| limited(base, base.cutoffs.with_transmittance_min(least))).into()
        },
    },
    Parameter {
        name: "extent",
        words: |setting| match setting.cutoffs.reach_max() {
            f32::INFINITY => "exact".into(),
            sigmas => format!("{sigmas} σ"),
        },
        copy: |from, to| to.cutoffs = to.cutoffs.with_reach_max(from.cutoffs.reach_max()),
        values: |_, base| {
            let values = [f32::INFINITY, 4.0, 3.5, 3.0, 2.5, 2.0];
            values.map(|sigmas| limited(base, base.cutoffs.with_reach_max(sigmas))).into()
        },
    },
    Parameter {
        name: "projection",
        words: |setting| match setting.cutoffs.projection() {
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
    Parameter {
        name: "order",
        words: |setting| match setting.cutoffs.order() {
            Mean => "of means".into(),
            Window(count) => format!("window of {count}"),
            Pixel => "per pixel".into(),
        },
        copy: |from, to| to.cutoffs = to.cutoffs.with_order(from.cutoffs.order()),
        values: |subject, base| {
            let coarser = ORDERS.into_iter().filter(|order| is_coarser(*order, subject.order));
            let orders = core::iter::once(subject.order).chain(coarser);
            orders.map(|order| limited(base, base.cutoffs.with_order(order))).collect()
        },
    },
    Parameter {
        name: "light per",
        words: |setting| if setting.form == ShadingForm::Deferred { "pixel" } else { "Gaussian" }.into(),
        copy: |from, to| to.form = from.form,
        values: |subject, base| {
            let forms = [ShadingForm::Deferred, ShadingForm::Paper].into_iter().filter(|_| subject.is_lit());
            forms.map(|form| Setting { form, ..*base }).collect()
        },
    },
    Parameter {
        name: "channels",
        words: |setting| {
            match setting.channels {
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

/// Orders below that of a pixel, the most exact first.
const ORDERS: [BlendOrder; 5] = [Window(WINDOW_MAX), Window(32), Window(16), Window(8), Mean];

/// True if an order sorts fewer splats of a pixel than another.
fn is_coarser(order: BlendOrder, other: BlendOrder) -> bool {
    match (order.window(), other.window()) {
        (Some(count), Some(other)) => count < other,
        (count, other) => count.is_some() && other.is_none(),
    }
}

/// Properties without alternatives in a report, in which exact pictures are sorted by means.
pub const FIXED: [(&str, &str); 3] = [
    ("sort", "by depth of the mean, also in exact pictures; errors and times of other orders are below"),
    ("levels of light", "ten (exact) or by resolution (official)"),
    ("largest alpha", "0.99, which is part of the model"),
];

fn limited(base: &Setting, cutoffs: Cutoffs) -> Setting {
    Setting { cutoffs, ..*base }
}

/// Text of a share: a fraction if it is close to one, zero if it is negligible.
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

impl Parameter {
    /// Settings with each value of the parameter, the most exact first; empty for a single value.
    pub fn settings(&self, subject: &Subject, base: &Setting) -> Vec<Setting> {
        let values = (self.values)(subject, base);
        if values.len() > 1 { values } else { Vec::new() }
    }

    /// Value of the parameter in a setting, as text.
    pub fn value(&self, setting: &Setting) -> String {
        (self.words)(setting)
    }
}

/// A measured setting.
#[derive(Clone, Copy, Debug)]
pub struct Tried {
    /// The setting.
    pub setting: Setting,
    /// Error against exact pictures.
    pub error: f64,
    /// Cost of its pictures.
    pub cost: f64,
}

/// Combines parameters: each takes its cheapest value with an error within `error`.
///
/// `trials` are the measurements of each parameter with all others at their most exact value. Each
/// parameter may use the whole error, so the combined error may exceed it.
pub fn together(exact: &Setting, trials: &[(Parameter, Vec<Tried>)], error: f64) -> Setting {
    trials.iter().fold(*exact, |setting, (parameter, tried)| {
        let fits = tried.iter().filter(|tried| tried.error <= error);
        let cheapest = fits.min_by(|a, b| a.cost.total_cmp(&b.cost));
        cheapest.map_or(setting, |cheapest| setting.with(parameter, &cheapest.setting))
    })
}

/// Setting with a random value of every parameter, determined by a seed.
pub fn random_setting(subject: &Subject, exact: &Setting, seed: u64) -> Setting {
    PARAMETERS.iter().enumerate().fold(*exact, |setting, (stream, parameter)| {
        let values = parameter.settings(subject, exact);
        let draw = random::uniform(seed, stream as u64, 0) * values.len() as f32;
        values.get(draw as usize).map_or(setting, |value| setting.with(parameter, value))
    })
}

/// Returns whether the prefilter supports the light's resolution.
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
            near_field: None,
            shading: ShadingRules::DEFERRED,
            scheme: PrefilterScheme::Exact,
            cameras: vec![camera(8, 8)],
            background: [0.0; 3],
            order: Pixel,
        }
    }

    #[test]
    fn candidate_orders_are_coarser_than_that_of_exact_pictures() {
        let names = |order: BlendOrder| {
            let subject = Subject { order, ..subject() };
            let parameter = PARAMETERS.into_iter().find(|parameter| parameter.name == "order").expect("it is one");
            let settings = parameter.settings(&subject, &Setting::exact(&subject));
            settings.iter().map(|setting| parameter.value(setting)).collect::<Vec<_>>()
        };
        assert_eq!(names(Window(16)), ["window of 16", "window of 8", "of means"]);
        assert_eq!(names(Window(2)), ["window of 2", "of means"]);
        assert_eq!(names(Pixel).len(), 1 + ORDERS.len());
        assert!(names(Mean).is_empty() && names(Window(1)).is_empty(), "nothing is coarser than one order for all");
    }

    #[test]
    fn a_parameter_changes_only_itself() {
        let (subject, exact) = (subject(), Setting::exact(&subject()));
        for parameter in PARAMETERS {
            let varied = parameter.settings(&subject, &exact);
            assert!(varied.len() > 1, "{} can be varied", parameter.name);
            assert_eq!(varied[0], exact, "{} begins with the most exact value", parameter.name);
            for setting in varied {
                assert_eq!(exact.with(&parameter, &setting), setting);
                let others = |setting: &Setting| {
                    setting.words().into_iter().filter(|(name, _)| *name != parameter.name).collect::<Vec<_>>()
                };
                assert_eq!(others(&setting), others(&exact));
            }
        }
    }

    #[test]
    fn combined_parameters_take_the_cheapest_fitting_value_of_each() {
        let (subject, exact) = (subject(), Setting::exact(&subject()));
        let tried = |parameter: &Parameter| {
            let varied = parameter.settings(&subject, &exact).into_iter().enumerate();
            varied.map(|(k, setting)| Tried { setting, error: k as f64, cost: -(k as f64) }).collect::<Vec<_>>()
        };
        let trials: Vec<_> = PARAMETERS.iter().map(|parameter| (*parameter, tried(parameter))).collect();
        assert_eq!(together(&exact, &trials, 0.5), exact);
        let one_step = together(&exact, &trials, 1.0);
        for (parameter, tried) in &trials {
            assert_eq!(parameter.value(&one_step), parameter.value(&tried[1].setting), "{}", parameter.name);
        }
    }

    #[test]
    fn random_settings_are_equal_for_equal_seeds() {
        let (subject, exact) = (subject(), Setting::exact(&subject()));
        let draw = |seed: u64| random_setting(&subject, &exact, seed);
        assert_eq!(draw(1), draw(1));
        assert!((2..9).any(|seed| draw(seed) != draw(1)), "seeds differ");
    }

    #[test]
    fn shares_are_printed_as_fractions_near_one() {
        assert_eq!([0.0, 1e-6, 1.0 / 255.0, 1.0 / 8192.0, 0.1].map(share), ["0", "1e-6", "1/255", "1/8192", "0.1"]);
        assert_eq!([1e-12, 1e-4, 0.003].map(share), ["0", "1e-4", "0.003"]);
    }

    #[test]
    fn differences_are_in_words() {
        let (default, exact) = (Setting::default_for(&subject()), Setting::exact(&subject()));
        assert_eq!(Difference(&default, &default).to_string(), "default");
        assert_eq!(
            Difference(&exact, &default).to_string(),
            "least alpha 0, least transmittance 0, projection along rays"
        );
    }
}
