//! Command-line arguments as plain data: types, defaults, help texts and parsers. Commands import
//! this module; it imports nothing of the program.

#![expect(clippy::doc_markdown, reason = "comments are the help that is printed, as they stand")]

mod capture;
pub(crate) mod demo;
mod export;
mod fit_light;
mod info;
mod light_reference;
mod lights;
mod make;
mod measure;
mod parse;
mod prefilter;
mod preset;
mod render;
mod scene;
mod train;
pub(crate) mod view;

pub(crate) use capture::{Capture, CaptureOptions, LENS};
use clap::{CommandFactory, Parser, Subcommand};
pub(crate) use demo::Demo;
pub(crate) use export::{BakeName, Export};
pub(crate) use fit_light::FitLight;
pub(crate) use info::{Doctor, Info, TryNetwork};
pub(crate) use light_reference::LightReference;
pub(crate) use lights::{EnvChoice, FirstLights, LampOptions, Lights};
pub(crate) use make::Make;
pub(crate) use measure::{Compare, Eval, Report, TableFormat};
pub(crate) use prefilter::{MipName, Prefilter, SchemeName};
pub(crate) use preset::Preset;
pub(crate) use render::{DEFAULT_LAYERS, Relight, Render, ViewOptions};
pub(crate) use scene::{OwnLightOption, ProfileName, SceneOptions, Up};
use specula_scene::ExecutorChoice;
use std::ffi::OsString;
pub(crate) use train::{
    AT_MOST_1100, AT_MOST_1600, Densify, LONGER_EDGE, LightKind, LightPer, Losses, Photographs, Reflections,
    ResumeOptions, SETTINGS, Start, Train, ViewUntil, WhitePixels,
};
pub(crate) use view::View;

/// Make 3D scenes of photographs that can be relit: train, render and relight Gaussians with a
/// shading function.
///
/// Each Gaussian has a diffuse colour, a specular tint, a roughness and a normal. All Gaussians
/// share one environment light, a cube map that is trained along with them. Glossy surfaces keep
/// their reflections in new views, and the light can be replaced.
#[derive(Debug, Parser)]
#[command(name = "specula", version, max_term_width = 110, after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// Command to run.
    #[command(subcommand)]
    pub(crate) command: Command,
    /// Print only results and errors.
    #[arg(long, short, global = true, help_heading = "General")]
    pub(crate) quiet: bool,
    /// Number of threads; all cores by default. Results do not depend on it.
    #[arg(long, global = true, value_name = "N", help_heading = "General", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) threads: Option<u16>,
}

const EXAMPLES: &str = "\
Examples:
  specula demo                                    try everything, without any data
  specula make walk.mov -o out/vase --quick       from a video or photographs to a relit turntable
  specula capture walk.mov -o data/vase           estimate their cameras
  specula train data/chair -m out/chair --eval    train a scene, measure held-out views
  specula render out/chair --layers rgb,normal    render the test views
  specula relight out/chair --env sunset.hdr      render them under another light
  specula compare out/chair out/plain             tabulate quality, size and training time
  specula view out/chair                          explore the scene in a browser
  specula export out/chair -o chair.ply           convert it for other viewers
  specula prefilter sunset.hdr -o sunset.ktx2     prefilter a light for game engines
  specula info out/chair                          print its contents";

impl Arguments {
    /// Parses the words of a command line, the program's name first.
    ///
    /// # Errors
    /// The error that clap reports, or its help.
    pub(crate) fn parse_words(words: impl IntoIterator<Item = OsString>) -> Result<Self, clap::Error> {
        Self::try_parse_from(words_of(words))
    }
}

/// Command line in the words of the parser: hyphens in the names of options, and each `--set
/// NAME=VALUE` as the option NAME.
pub(crate) fn words_of(words: impl IntoIterator<Item = OsString>) -> Vec<OsString> {
    let mut words = with_hyphens(words).into_iter();
    let (mut parsed, mut are_options) = (Vec::new(), true);
    while let Some(word) = words.next() {
        are_options &= word != "--";
        let given = match word.to_str().filter(|_| are_options) {
            Some("--set") => words.next(),
            Some(text) => text.strip_prefix("--set=").map(OsString::from),
            None => None,
        };
        match given {
            None => parsed.push(word),
            Some(given) if given == "help" => parsed.push("--help".into()),
            Some(given) => match given.to_str().and_then(option_of) {
                Some(option) => parsed.extend(option),
                None => parsed.extend(["--set".into(), given]),
            },
        }
    }
    parsed
}

/// Option for a setting; none for a switch that is off. `None` for words that name no setting.
fn option_of(setting: &str) -> Option<Option<OsString>> {
    let (name, value) = setting.split_once('=')?;
    let name = name.replace('_', "-");
    let command = Arguments::command();
    let train = command.find_subcommand("train").expect("it is there");
    let arg = train.get_arguments().find(|arg| is_setting(arg) && arg.get_long() == Some(&name))?;
    match (arg.get_action().takes_values(), value) {
        (true, _) => Some(Some(format!("--{name}={value}").into())),
        (false, "true") => Some(Some(format!("--{name}").into())),
        (false, "false") => Some(None),
        (false, _) => None,
    }
}

/// True for options that only `--set help` lists.
pub(crate) fn is_setting(arg: &clap::Arg) -> bool {
    arg.get_help_heading().is_some_and(|heading| SETTINGS.contains(&heading))
}

/// Command line with hyphens in the names of long options, which the authors' tools spell with
/// underscores: `--save_iterations=7000` becomes `--save-iterations=7000`. Values, and words after
/// `--`, are kept.
fn with_hyphens(words: impl IntoIterator<Item = OsString>) -> Vec<OsString> {
    let mut are_options = true;
    let renamed = |word: OsString| {
        are_options &= word != "--";
        let option = word.to_str().filter(|text| are_options && text.starts_with("--"));
        option
            .map(|text| match text.split_once('=') {
                Some((name, value)) => format!("{}={value}", name.replace('_', "-")).into(),
                None => text.replace('_', "-").into(),
            })
            .unwrap_or(word)
    };
    words.into_iter().map(renamed).collect()
}

/// Commands of the program.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    Demo(Demo),
    Capture(Capture),
    Make(Make),
    Train(Box<Train>),
    Render(Render),
    Relight(Relight),
    FitLight(FitLight),
    Eval(Eval),
    Compare(Compare),
    View(View),
    Export(Export),
    Prefilter(Prefilter),
    Report(Report),
    Info(Info),
    Doctor(Doctor),
    /// Read a network for LPIPS and nothing else; eval runs this in a process with limited memory.
    #[command(hide = true)]
    TryNetwork(TryNetwork),
}

impl Command {
    /// Executor of the command; `None` for commands that have no such option.
    pub(crate) fn executor(&self) -> Option<&ExecutorChoice> {
        match self {
            Self::Train(args) => Some(&args.executor),
            Self::Render(args) => Some(&args.views.scene_options.renderer.executor),
            Self::Relight(args) => Some(&args.views.scene_options.renderer.executor),
            Self::FitLight(args) => Some(&args.executor),
            Self::Eval(args) => Some(&args.renderer.executor),
            Self::View(args) => Some(&args.scene_options.renderer.executor),
            Self::Export(args) => Some(&args.scene_options.renderer.executor),
            Self::Demo(_)
            | Self::Capture(_)
            | Self::Make(_)
            | Self::Compare(_)
            | Self::Prefilter(_)
            | Self::Report(_)
            | Self::Info(_)
            | Self::Doctor(_)
            | Self::TryNetwork(_) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    fn parsed(line: &str) -> Result<Arguments, clap::Error> {
        Arguments::parse_words(line.split(' ').map(OsString::from))
    }

    #[test]
    fn counts_are_typed_as_people_write_them_and_points_have_a_limit() {
        let words = "specula train data -m out --iterations 7k --save-iterations 1e3,2_000 --random-points 20k";
        let Command::Train(train) = parsed(words).unwrap().command else { panic!("train") };
        assert_eq!((train.iterations, train.save_iterations), (7000, vec![1000, 2000]));
        assert_eq!(train.start.random_points, Some(20_000));
        for wrong in ["--random-points 500000000", "--iterations 0", "--iterations many", "--background-points 1e9"] {
            let words = format!("specula train data -m out {wrong}");
            assert!(parsed(&words).is_err(), "{wrong} was taken");
        }
    }

    #[test]
    fn the_command_line_is_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn the_fields_names_are_understood() {
        let words =
            "specula train -s data -m out --lambda_zero_one 0.001 --densify_grad_threshold 0.0004 --sh_degree 2";
        let authors = "specula train -s data -m out --eval -w -r -1 --brdf_dim 0 --sh_degree -1 --brdf_env 512";
        let Command::Train(train) = parsed(authors).unwrap().command else { panic!("train") };
        assert_eq!((train.resolution, train.brdf_dim, train.start.sh_degree), (AT_MOST_1600, Some(0), Some(-1)));
        assert_eq!(train.start.light_resolution, Some(512));
        let eval = "specula eval out -r -1";
        assert!(parsed(eval).is_err(), "a model has one size already");
        let Command::Train(train) = parsed(words).unwrap().command else { panic!("train") };
        assert_eq!((train.losses.lambda_sparse, train.start.sh_degree), (Some(0.001), Some(2)));
    }

    #[test]
    fn settings_are_options_of_their_own_names() {
        let words = |line: &str| words_of(line.split(' ').map(OsString::from)).join(" ".as_ref());
        for (line, expected) in [
            ("specula train data --set lambda_normal=0.3", "specula train data --lambda-normal=0.3"),
            ("specula train data --set=no-axis=true --set no-sparse=false", "specula train data --no-axis"),
            ("specula train data --set iterations=7", "specula train data --set iterations=7"),
            ("specula train -- --set lambda-normal=0.3", "specula train -- --set lambda-normal=0.3"),
            ("specula train data --set", "specula train data --set"),
        ] {
            assert_eq!(words(line), expected, "{line}");
        }
        for (wrong, sentence) in [
            ("--set iterations=7", "no setting \"iterations\""),
            ("--set no-axis=maybe", "no setting \"no-axis\""),
            ("--set lambda-normal", "NAME=VALUE"),
            ("--set lambda-normal=-1", "lambda-normal"),
        ] {
            let error = parsed(&format!("specula train data -m out {wrong}")).unwrap_err().to_string();
            assert!(error.contains(sentence), "{wrong}: {error}");
        }
    }

    #[test]
    fn underscores_in_the_names_of_options_are_hyphens() {
        let line = "specula --a_b c_d -e_f --g_h=i_j -- --k_l";
        let words = with_hyphens(line.split(' ').map(OsString::from));
        assert_eq!(words.join(" ".as_ref()), "specula --a-b c_d -e_f --g-h=i_j -- --k_l");
    }
}
