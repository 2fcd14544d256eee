//! Command-line arguments as plain data: types, defaults, help texts and parsers. Commands import
//! this module; it imports nothing of the program.

#![expect(clippy::doc_markdown, reason = "comments are the help that is printed, as they stand")]

pub(crate) mod demo;
mod export;
mod info;
mod light_reference;
mod lights;
mod measure;
mod parse;
mod prefilter;
mod preset;
mod render;
mod scene;
mod train;
pub(crate) mod view;

use clap::{Parser, Subcommand};
pub(crate) use demo::Demo;
pub(crate) use export::{BakeName, Export};
pub(crate) use info::{Doctor, Info, TryNetwork};
pub(crate) use light_reference::LightReference;
pub(crate) use lights::{EnvChoice, LampOptions, Lights};
pub(crate) use measure::{Compare, Eval, Report, TableFormat};
pub(crate) use prefilter::{MipName, Prefilter, SchemeName};
pub(crate) use preset::Preset;
pub(crate) use render::{DEFAULT_LAYERS, Relight, Render, ViewOptions};
pub(crate) use scene::{ProfileName, Up};
use specula_scene::ExecutorChoice;
use std::ffi::OsString;
pub(crate) use train::{
    AT_MOST_1100, AT_MOST_1600, Densify, LONGER_EDGE, LightKind, LightPer, Losses, Photographs, Reflections,
    ResumeOptions, Start, Train, ViewUntil, WhitePixels,
};
pub(crate) use view::View;

/// Train, render and relight scenes of 3D Gaussians with a shading function.
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
        Self::try_parse_from(with_hyphens(words))
    }
}

/// Command line with hyphens in the names of long options, which the authors' tools spell with
/// underscores: `--save_iterations=7000` becomes `--save-iterations=7000`. Values, and words after
/// `--`, are kept.
pub(crate) fn with_hyphens(words: impl IntoIterator<Item = OsString>) -> Vec<OsString> {
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
    Train(Box<Train>),
    Render(Render),
    Relight(Relight),
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
            Self::Eval(args) => Some(&args.renderer.executor),
            Self::View(args) => Some(&args.scene_options.renderer.executor),
            Self::Export(args) => Some(&args.scene_options.renderer.executor),
            Self::Demo(_)
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
    fn underscores_in_the_names_of_options_are_hyphens() {
        let line = "specula --a_b c_d -e_f --g_h=i_j -- --k_l";
        let words = with_hyphens(line.split(' ').map(OsString::from));
        assert_eq!(words.join(" ".as_ref()), "specula --a-b c_d -e_f --g-h=i_j -- --k_l");
    }
}
