//! Pages of `specula export`: what a browser with WebGPU makes of them, without any server.

use crate::browser::{Browser, Page};
use crate::site::Site;
use crate::tiny::{Tiny, specula, train};
use crate::view::{dropped, share_that_differs, shown, sky};
use image::RgbImage;
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Pixels along an edge of the window.
const WINDOW: u32 = 400;
/// PSNR in dB of the page's pictures against those of the CPU, where no number is rounded: both
/// executors round to 8 bits, and differ by a step in a pixel of some hundred.
const EXACT: f64 = 60.0;
/// The same with quantised numbers.
const QUANTISED: f64 = 45.0;
/// Largest file of the tiny scene, nearly all of it the renderer, in bytes.
const SMALL: u64 = 3_000_000;

/// Browser and exporter, where both are there.
fn browser() -> Option<Browser> {
    let Some(browser) = Browser::with_webgpu() else {
        eprintln!("NOT TESTED, because there is no chromium on the path, nor one that SPECULA_BROWSER names");
        return None;
    };
    // Files are trusted with WebGPU, and `about:blank` is not.
    let folder = tempfile::tempdir().unwrap();
    let blank = folder.path().join("blank.html");
    fs::write(&blank, "<!doctype html>").unwrap();
    let page = browser.open(&url(&blank), [WINDOW; 2]);
    page.wait("document.readyState === 'complete' && location.protocol === 'file:'");
    let adapter =
        page.eval("navigator.gpu ? navigator.gpu.requestAdapter().then((adapter) => adapter !== null) : false");
    if adapter != true {
        eprintln!("NOT TESTED, because the browser has no adapter of WebGPU");
        return None;
    }
    page.close();
    Some(browser)
}

fn trained(tiny: &Tiny, words: &[&str]) -> PathBuf {
    train(tiny, "vase").args(["--eval", "--quiet"]).args(words).assert().success();
    tiny.path("vase")
}

/// Page of a model; none where the program was built without the renderer of pages.
fn exported(model: &Path, page: &Path, words: &[&str]) -> Option<String> {
    let mut command = specula();
    let output = command.arg("export").arg(model).arg("-o").arg(page).args(words).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    if said.contains("scripts/build-web") {
        eprintln!("NOT TESTED, because scripts/build-web was not run before");
        return None;
    }
    assert!(output.status.success(), "{said}");
    Some(String::from_utf8_lossy(&output.stdout).into_owned())
}

fn url(file: &Path) -> String {
    format!("file://{}", file.display())
}

fn psnr(one: &RgbImage, other: &RgbImage) -> f64 {
    assert_eq!(one.dimensions(), other.dimensions(), "the window is the same");
    let square = |(a, b): (&u8, &u8)| f64::from(a.abs_diff(*b)).powi(2);
    let mean = one.as_raw().iter().zip(other.as_raw()).map(square).sum::<f64>() / one.as_raw().len() as f64;
    10.0 * (255.0 * 255.0 / mean.max(1e-9)).log10()
}

fn choose_light(page: &Page<'_>, id: &str) {
    page.eval(&format!(
        "(() => {{ const list = document.getElementById('lights'); list.value = '{id}'; \
         list.dispatchEvent(new Event('change')); }})()"
    ));
}

/// Checks the words of the page.
fn says(page: &Page<'_>, words: &str) {
    page.wait(&format!("document.getElementById('message')?.textContent.includes({words:?}) === true"));
    assert_eq!(page.eval("document.getElementById('message').hidden"), false, "the sentence is seen");
}

#[test]
fn a_measure_of_pictures_sees_a_wrong_step() {
    let grey = RgbImage::from_pixel(10, 10, image::Rgb([100; 3]));
    let mut other = grey.clone();
    assert!(psnr(&grey, &other) > 100.0);
    other.put_pixel(3, 3, image::Rgb([103; 3]));
    assert!(psnr(&grey, &other) > EXACT - 2.0 && psnr(&grey, &other) < EXACT, "{}", psnr(&grey, &other));
}

#[test]
fn a_page_shows_turns_and_relights_the_scene_with_the_numbers_of_the_cpu() {
    let Some(browser) = browser() else { return };
    let tiny = Tiny::new();
    let model = trained(&tiny, &[]);
    fs::write(tiny.path("evening.hdr"), sky(&tiny)).unwrap();
    let evening = tiny.path("evening.hdr");
    let lights = ["--page-env", evening.to_str().unwrap(), "--no-error"];
    let (exact, rounded) = (tiny.path("exact.html"), tiny.path("rounded.html"));
    let Some(_) = exported(&model, &exact, &[lights.as_slice(), &["--page-exact"]].concat()) else { return };
    exported(&model, &rounded, &lights[..2]);

    let site = Site::of(&model, &["--quiet", "--env", evening.to_str().unwrap()]);
    let expected = |words: &str| site.get(&format!("/frame?view=0&size={WINDOW},{WINDOW}&{words}")).picture();
    for (file, least) in [(&exact, EXACT), (&rounded, QUANTISED)] {
        let page = browser.open(&url(file), [WINDOW; 2]);
        let first = shown(&page);
        let close = |shown: &RgbImage, words: &str| {
            let found = psnr(shown, &expected(words));
            eprintln!("{}: {words} at {found:.1} dB", file.display());
            assert!(found >= least, "{words} at {found} dB");
        };
        close(&first, "layer=rgb");
        page.press("2");
        close(&shown(&page), "layer=normal");
        page.press("1");
        choose_light(&page, "1");
        let relit = shown(&page);
        close(&relit, "layer=rgb&light=1");
        assert!(share_that_differs(&first, &relit) > 0.02, "another light is another picture");
        assert!(psnr(&first, &relit) < QUANTISED, "which the measure sees");
    }

    let page = browser.open(&url(&rounded), [WINDOW; 2]);
    let first = shown(&page);
    page.drag([120.0, 160.0], [180.0, 200.0]);
    assert!(share_that_differs(&first, &shown(&page)) > 0.02, "a drag turns the scene");
    page.press("r");
    shown(&page);
    page.eval(&dropped(&sky(&tiny), "dropped.hdr"));
    page.wait("document.getElementById('lights').value === '2'");
    assert!(share_that_differs(&first, &shown(&page)) > 0.02, "a light that is dropped lights the scene");
    page.eval(&dropped(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X 16\nbroken", "broken.hdr"));
    says(&page, "broken.hdr");
    page.eval(&dropped(b"text", "notes.txt"));
    says(&page, ".hdr or .exr");
    let loaded = page.eval("performance.getEntriesByType('resource').map(({ name }) => name).filter((name) => /^(http|file)/.test(name)).join()");
    assert_eq!(loaded, "", "nothing is loaded");
    let refused = page.eval("fetch('http://127.0.0.1:9/').then(() => 'sent', () => 'refused')");
    assert_eq!(refused, "refused", "and nothing is sent");
    assert!(fs::metadata(&rounded).unwrap().len() < SMALL);
}

/// Script that is run before those of the page, and words that the page then says.
const FAULTS: [(&str, &str); 4] = [
    ("Object.defineProperty(Navigator.prototype, 'gpu', { get: () => undefined })", "no WebGPU"),
    ("GPU.prototype.requestAdapter = async () => null", "no graphics adapter"),
    (
        "Object.defineProperty(GPUSupportedLimits.prototype, 'maxStorageBuffersPerShaderStage', { get: () => 4 })",
        "max_storage_buffers_per_shader_stage",
    ),
    ("delete window.DecompressionStream", "damaged"),
];

#[test]
fn a_page_that_cannot_go_on_says_so() {
    let Some(browser) = browser() else { return };
    let tiny = Tiny::new();
    let model = trained(&tiny, &[]);
    let file = tiny.path("vase.html");
    let Some(_) = exported(&model, &file, &["--no-error"]) else { return };
    for (script, words) in FAULTS {
        let page = browser.open("about:blank", [WINDOW; 2]);
        page.before_scripts(script);
        page.go(&url(&file));
        says(&page, words);
        assert_eq!(page.eval("document.getElementById('still')?.complete"), true, "a still picture is there");
        page.close();
    }

    let html = fs::read_to_string(&file).unwrap();
    let (start, rest) = html.split_once("id=\"scene\">").unwrap();
    let (scene, end) = rest.split_once("</script>").unwrap();
    for (name, text) in [("short.html", &scene[..scene.len() / 8 * 4]), ("none.html", "")] {
        fs::write(tiny.path(name), format!("{start}id=\"scene\">{text}</script>{end}")).unwrap();
        let page = browser.open(&url(&tiny.path(name)), [WINDOW; 2]);
        says(&page, "export it once more");
        page.close();
    }

    let page = browser.open("about:blank", [WINDOW; 2]);
    page.before_scripts(
        "const request = GPUAdapter.prototype.requestDevice;
         GPUAdapter.prototype.requestDevice = async function (...words) {
           return (window.device = await request.apply(this, words));
         };",
    );
    page.go(&url(&file));
    let first = shown(&page);
    page.eval("document.getElementById('picture').style.height = '0'");
    page.eval("document.getElementById('picture').style.height = ''");
    let other = browser.open(&url(&file), [WINDOW; 2]);
    assert!(share_that_differs(&shown(&other), &first) == 0.0, "a second page shows the same");
    assert!(share_that_differs(&shown(&page), &first) == 0.0, "no size at all does no harm");
    page.eval("window.device.destroy()");
    page.press("2");
    says(&page, "reload the page");
}

#[test]
fn a_folder_is_served_and_its_page_loads_what_lies_beside_it() {
    let tiny = Tiny::new();
    let model = trained(&tiny, &[]);
    let folder = tiny.path("site/");
    let Some(said) = exported(&model, &folder, &["--no-error"]) else { return };
    assert!(said.contains("page, ") && said.contains("Gaussians"), "{said}");
    for name in ["index.html", "specula.wasm.gz", "scene.specula.gz"] {
        assert!(folder.join(name).is_file(), "{name}");
    }
}

#[test]
fn options_of_pages_need_a_page() {
    let tiny = Tiny::new();
    let model = trained(&tiny, &[]);
    let output = specula().arg("export").arg(&model).args(["-o", "a.splat", "--page-exact"]).output().unwrap();
    assert!(String::from_utf8_lossy(&output.stderr).contains("-o FILE.html"));
}
