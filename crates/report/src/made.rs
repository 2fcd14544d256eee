//! Page of `specula make`: a relit turntable in one file.

use crate::{error::Result, html::HtmlTable};
use askama::Template;
use base64::{Engine, prelude::BASE64_STANDARD};

/// Photograph, or turntable under a light.
#[derive(Clone, Debug)]
pub struct Figure {
    /// Caption.
    pub caption: String,
    /// Contents of the file.
    pub bytes: Vec<u8>,
    /// Format of the file.
    pub format: Format,
}

/// Format of a figure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// JPEG.
    Jpeg,
    /// PNG, which may be animated.
    Png,
    /// Video in MP4.
    Mp4,
}

impl Format {
    const fn media_type(self) -> &'static str {
        match self {
            Self::Jpeg => "image/jpeg",
            Self::Png => "image/png",
            Self::Mp4 => "video/mp4",
        }
    }
}

/// Contents of the page.
#[derive(Clone, Debug, Default)]
pub struct Made {
    /// Name of the scene.
    pub title: String,
    /// A photograph and turntables.
    pub figures: Vec<Figure>,
    /// Name of the page with the scene itself, if there is one.
    pub scene: Option<String>,
    /// Names and values of facts.
    pub facts: Vec<[String; 2]>,
    /// Improvements of a better capture.
    pub findings: Vec<String>,
    /// Command lines that made it.
    pub commands: Vec<String>,
}

impl Made {
    /// HTML of the page, with the figures in it.
    ///
    /// # Errors
    ///
    /// A template that cannot be rendered.
    pub fn html(&self) -> Result<String> {
        let figures = self.figures.iter().map(|Figure { caption, bytes, format }| Embedded {
            caption,
            is_video: *format == Format::Mp4,
            source: format!("data:{};base64,{}", format.media_type(), BASE64_STANDARD.encode(bytes)),
        });
        let facts = HtmlTable::new(["", ""], self.facts.clone());
        Ok(Page { made: self, figures: figures.collect(), facts }.render()?)
    }
}

struct Embedded<'a> {
    caption: &'a str,
    is_video: bool,
    source: String,
}

#[derive(Template)]
#[template(path = "made.html")]
struct Page<'a> {
    made: &'a Made,
    figures: Vec<Embedded<'a>>,
    facts: HtmlTable,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_holds_its_figures() {
        let figure = |format| Figure { caption: "sunset".into(), bytes: vec![1, 2, 3], format };
        let figures = vec![figure(Format::Jpeg), figure(Format::Mp4)];
        let made = Made { title: "a <vase>".into(), figures, ..Made::default() };
        let html = made.html().unwrap();
        for source in ["data:video/mp4;base64,AQID", "data:image/jpeg;base64,AQID", "sunset"] {
            assert!(html.contains(source), "{source} is missing: {html}");
        }
        assert!(!html.contains("<vase>"), "{html}");
    }
}
