//! Page: its files for the server, and as one file with the renderer and a scene.

mod bundle;
mod text;

use crate::packed::{PackPrecision, PackedScene};
use bundle::bundle;
use flate2::{Compression, write::GzEncoder};
use std::io::Write;
pub use text::text_of;

const SCRIPT: &str = "text/javascript; charset=utf-8";

/// Files of the page: path, content type, text.
pub(crate) const FILES: [(&str, &str, &str); 16] = [
    ("/", "text/html; charset=utf-8", include_str!("page/index.html")),
    ("/style.css", "text/css; charset=utf-8", include_str!("page/style.css")),
    ("/life.js", SCRIPT, include_str!("page/life.js")),
    ("/server.js", SCRIPT, include_str!("page/server.js")),
    ("/address.js", SCRIPT, include_str!("page/address.js")),
    ("/camera.js", SCRIPT, include_str!("page/camera.js")),
    ("/controls.js", SCRIPT, include_str!("page/controls.js")),
    ("/stream.js", SCRIPT, include_str!("page/stream.js")),
    ("/path.js", SCRIPT, include_str!("page/path.js")),
    ("/light.js", SCRIPT, include_str!("page/light.js")),
    ("/lamps.js", SCRIPT, include_str!("page/lamps.js")),
    ("/handles.js", SCRIPT, include_str!("page/handles.js")),
    ("/materials.js", SCRIPT, include_str!("page/materials.js")),
    ("/training.js", SCRIPT, include_str!("page/training.js")),
    ("/turntable.js", SCRIPT, include_str!("page/turntable.js")),
    ("/main.js", SCRIPT, include_str!("page/main.js")),
];

/// Module that replaces the server by a renderer in the page.
const WEB_SERVER: (&str, &str) = ("server.js", include_str!("page/web/server.js"));

/// Reader of the text of renderer and scene in a page in one file: a JavaScript module; its
/// `bytesOf` is the inverse of [`text_of`], given the number of bytes.
pub const TEXT_READER: &str = include_str!("page/web/text.js");

/// Element that embeds the page of a folder in other pages.
const ELEMENT_SCRIPT: &str = include_str!("page/web/specula-scene.js");

/// Policy of a page in one file: nothing is loaded, and nothing is sent.
const CLOSED: &str = "default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval'; style-src 'unsafe-inline'; \
                      img-src data: blob:; base-uri 'none'; form-action 'none'";
/// Additional policy if renderer and scene are files next to the page.
const HOSTED: &str = "connect-src 'self'";

/// Renderer of web pages, written by `scripts/build-web`.
#[derive(Clone, Copy, Debug)]
pub struct WebRenderer<'a> {
    /// JavaScript that loads it.
    pub script: &'a str,
    /// WebAssembly, compressed with gzip.
    pub module: &'a [u8],
}

/// Page with a scene and its renderer.
#[derive(Clone, Debug)]
pub struct WebPage {
    title: String,
    script: String,
    /// Still picture, as a JPEG, for browsers without WebGPU.
    still: Vec<u8>,
    /// Compressed renderer and scene.
    module: Vec<u8>,
    scene: Vec<u8>,
}

impl WebPage {
    /// Name of the page of a folder.
    pub const PAGE: &str = "index.html";
    /// Name of the renderer in a folder.
    pub const MODULE: &str = "specula.wasm.gz";
    /// Name of the scene in a folder.
    pub const SCENE: &str = "scene.specula.gz";

    /// Name of the script of a folder that defines an element for other pages.
    pub const ELEMENT: &str = "specula-scene.js";

    /// Page of a scene. `still` is a JPEG of it.
    pub fn new(renderer: WebRenderer<'_>, scene: &PackedScene, precision: PackPrecision, still: Vec<u8>) -> Self {
        Self {
            title: scene.viewed.name.clone(),
            script: renderer.script.to_owned(),
            still,
            module: renderer.module.to_owned(),
            scene: compressed(&scene.pack(precision)),
        }
    }

    /// The page in one file.
    pub fn file(&self) -> String {
        let data = |bytes: &[u8]| (format!(" data-bytes=\"{}\"", bytes.len()), text_of(bytes));
        self.html(CLOSED, data(&self.module), data(&self.scene))
    }

    /// Files of a folder for a web server: names and contents.
    pub fn folder(&self) -> [(&'static str, Vec<u8>); 4] {
        let source = |name: &str| (format!(" data-source=\"{name}\""), String::new());
        let page = self.html(&format!("{CLOSED}; {HOSTED}"), source(Self::MODULE), source(Self::SCENE));
        [
            (Self::PAGE, page.into_bytes()),
            (Self::MODULE, self.module.clone()),
            (Self::SCENE, self.scene.clone()),
            (Self::ELEMENT, ELEMENT_SCRIPT.into()),
        ]
    }

    /// The page with attributes and text of the elements of renderer and scene.
    fn html(&self, policy: &str, module: (String, String), scene: (String, String)) -> String {
        let [(_, _, html), (_, _, style), ..] = FILES;
        let modules: Vec<(&str, &str)> = FILES[2..]
            .iter()
            .map(|(path, _, text)| (path.trim_start_matches('/'), *text))
            .map(|module| if module.0 == WEB_SERVER.0 { WEB_SERVER } else { module })
            .collect();
        let modules = [&[("text.js", TEXT_READER)], modules.as_slice()].concat();
        let packed = |id: &str, (attributes, text): &(String, String)| {
            format!("<script type=\"application/octet-stream\" id=\"{id}\"{attributes}>{text}</script>\n")
        };
        let still = format!("<img id=\"still\" alt=\"\" src=\"data:image/jpeg;base64,{}\">\n", base64(&self.still));
        let scripts = [
            packed("renderer", &module),
            packed("scene", &scene),
            format!("<script>\n{}</script>\n", self.script),
            format!("<script type=\"module\">\n{}</script>\n", bundle(&modules)),
        ];
        html.replace(
            "<meta charset=\"utf-8\">",
            &format!("<meta charset=\"utf-8\">\n<meta http-equiv=\"Content-Security-Policy\" content=\"{policy}\">"),
        )
        .replace("<title>specula</title>", &format!("<title>{} · specula</title>", escaped(&self.title)))
        .replace(STYLE_LINK, &format!("<style>\n{style}</style>"))
        .replace(SCRIPT_LINK, "")
        .replace(HANDLES, &format!("{still}{HANDLES}"))
        .replace("</body>", &format!("{}</body>", scripts.concat()))
    }
}

/// Elements of the page that name its files.
const STYLE_LINK: &str = "<link rel=\"stylesheet\" href=\"style.css\">";
/// Element that follows the still picture, which is above the canvas and below all controls.
const HANDLES: &str = "<div id=\"handles\"></div>";
const SCRIPT_LINK: &str = "<script type=\"module\" src=\"main.js\"></script>\n";

/// Bytes compressed with gzip, which browsers can decompress.
fn compressed(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    // Writing to memory does not fail.
    let written = encoder.write_all(bytes).and_then(|()| encoder.finish());
    written.unwrap_or_default()
}

/// Text with the special characters of HTML escaped.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

/// Base64 of RFC 4648, with padding.
fn base64(bytes: &[u8]) -> String {
    const LETTERS: [u8; 64] = *b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let word = (0..3).fold(0, |word, k| word << 8 | u32::from(chunk.get(k).copied().unwrap_or(0)));
        for k in 0..4 {
            let letter = LETTERS[(word >> (18 - 6 * k) & 63) as usize];
            text.push(if k > chunk.len() { '=' } else { letter.into() });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_that_of_the_standard() {
        let cases = [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")];
        for (bytes, text) in cases {
            assert_eq!(base64(bytes.as_bytes()), text);
        }
    }

    #[test]
    fn the_page_in_one_file_has_all_modules_and_names_no_file() {
        let page = WebPage {
            title: "<vase>".to_owned(),
            script: "let wasm_bindgen;\n".to_owned(),
            still: vec![1],
            module: vec![2],
            scene: vec![3],
        };
        let html = page.file();
        for (path, _, _) in &FILES[2..] {
            assert!(html.contains(&format!("modules[\"{}\"] =", path.trim_start_matches('/'))), "{path}");
        }
        for word in ["import {", "\nexport ", "src=\"main.js\"", "href=\"style.css\"", "<vase>", "data-source"] {
            assert!(!html.contains(word), "{word} is in the page");
        }
        assert!(html.contains("&lt;vase&gt;") && html.contains(CLOSED) && html.contains("WebViewer"));
        let [(_, hosted), ..] = page.folder();
        let hosted = String::from_utf8(hosted).unwrap();
        assert!(hosted.contains(HOSTED) && hosted.contains("data-source=\"scene.specula.gz\""));
    }
}
