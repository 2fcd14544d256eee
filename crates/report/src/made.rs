//! Page of `specula make`: a relit turntable in one file.

use crate::{error::Result, html::HtmlTable};
use askama::Template;
use base64::{Engine, prelude::BASE64_STANDARD};

/// Turntable under a light.
#[derive(Clone, Debug)]
pub struct Turntable {
    /// Light, as a caption.
    pub caption: String,
    /// Video in MP4, or an animated PNG.
    pub bytes: Vec<u8>,
    /// Whether it is a video.
    pub is_video: bool,
}

/// Contents of the page.
#[derive(Clone, Debug, Default)]
pub struct Made {
    /// Name of the scene.
    pub title: String,
    /// Turntables.
    pub turntables: Vec<Turntable>,
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
    /// HTML of the page, with the turntables in it.
    ///
    /// # Errors
    ///
    /// A template that cannot be rendered.
    pub fn html(&self) -> Result<String> {
        let turntables = self.turntables.iter().map(|turntable| Embedded {
            caption: &turntable.caption,
            is_video: turntable.is_video,
            source: format!(
                "data:{};base64,{}",
                if turntable.is_video { "video/mp4" } else { "image/png" },
                BASE64_STANDARD.encode(&turntable.bytes)
            ),
        });
        let facts = HtmlTable::new(["", ""], self.facts.clone());
        Ok(Page { made: self, turntables: turntables.collect(), facts }.render()?)
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
    turntables: Vec<Embedded<'a>>,
    facts: HtmlTable,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_holds_its_turntables() {
        let turntable = Turntable { caption: "sunset".into(), bytes: vec![1, 2, 3], is_video: true };
        let made = Made { title: "a <vase>".into(), turntables: vec![turntable], ..Made::default() };
        let html = made.html().unwrap();
        assert!(html.contains("data:video/mp4;base64,AQID") && html.contains("sunset"), "{html}");
        assert!(!html.contains("<vase>"), "{html}");
    }
}
