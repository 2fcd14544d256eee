//! Pages of `specula export`: what a browser with WebGPU makes of them, without any server.

use crate::browser::{Browser, Page};
use crate::export::refuses;
use crate::site::Site;
use crate::tiny::{Tiny, psnr, specula, train};
use crate::view::{dropped, relightable, share_that_differs, shown, sky};
use base64::{Engine, prelude::BASE64_STANDARD};
use image::RgbImage;
use serde_json::json;
use specula_core::rules::Channels;
use specula_io::Input;
use specula_scene::{
    OpenedModel, RenderOptions, Scene, SceneRenderer,
    import::{Imported, scene_of_glb},
};
use specula_viewer::{TEXT_READER, text_of};
use std::{
    fs,
    io::{BufRead, BufReader, Read, Write},
    net::{TcpListener, TcpStream},
    path::{Path, PathBuf},
};

/// Pixels along an edge of the window.
const WINDOW: u32 = 400;
/// The same under a sun, since software takes a second for a thousand pixels with shadow rays.
const SMALL_WINDOW: u32 = 64;
/// PSNR in dB of the page's pictures against those of the CPU, where no number is rounded: both
/// executors round to 8 bits, and differ by a step in a pixel of some hundred.
const EXACT: f64 = 60.0;
/// The same with quantised numbers.
const QUANTISED: f64 = 45.0;
/// The same under a sun: rays at the rim of a shadow hit or miss by a rounding.
const LAMPS: f64 = 40.0;
/// PSNR in dB of a JPEG of quality 85 against its picture.
const STILL: f64 = 30.0;
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

/// Writes the page of a model; returns what the program said.
fn exported(model: &Path, page: &Path, words: &[&str]) -> String {
    let mut command = specula();
    let output = command.arg("export").arg(model).arg("-o").arg(page).args(words).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{said}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn url(file: &Path) -> String {
    format!("file://{}", file.display())
}

/// A web server of a folder, which ends with the test. Returns its address, which ends in a slash.
fn served(folder: &Path) -> String {
    let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
    let address = format!("http://{}/", listener.local_addr().unwrap());
    let folder = folder.to_owned();
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            let folder = folder.clone();
            // Browsers open connections in advance.
            std::thread::spawn(move || serve(stream, &folder));
        }
    });
    address
}

/// Answers a request with a file, as servers that know nothing of it do.
fn serve(mut stream: TcpStream, folder: &Path) {
    let mut lines = BufReader::new(stream.try_clone().unwrap()).lines().map_while(Result::ok);
    let first = lines.next().unwrap_or_default();
    lines.take_while(|line| !line.is_empty()).for_each(drop);
    let name = first.split(' ').nth(1).unwrap_or("/").split('?').next().unwrap_or_default();
    let name = name.trim_start_matches('/');
    let file = folder.join(if name.is_empty() { "index.html" } else { name });
    let kind = match file.extension().and_then(|ending| ending.to_str()) {
        Some("html") => "text/html",
        Some("js") => "text/javascript",
        _ => "application/octet-stream",
    };
    let (status, bytes) = fs::read(&file).map_or(("404 Not Found", Vec::new()), |bytes| ("200 OK", bytes));
    let head = format!(
        "HTTP/1.1 {status}\r\ncontent-type: {kind}\r\ncontent-length: {}\r\nconnection: close\r\n\r\n",
        bytes.len()
    );
    // A page that closes hears no more.
    let _ = stream.write_all(head.as_bytes()).and_then(|()| stream.write_all(&bytes));
    let _ = stream.read(&mut [0]);
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
    exported(&model, &exact, &[lights.as_slice(), &["--page-exact"]].concat());
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

#[test]
fn a_page_starts_under_the_lights_of_the_command_line() {
    let tiny = Tiny::new();
    let model = relightable(&tiny);
    fs::write(tiny.path("evening.hdr"), sky(&tiny)).unwrap();
    let evening = tiny.path("evening.hdr");
    let (file, folder) = (tiny.path("lit.html"), tiny.path("lit/"));
    let words = ["--env", evening.to_str().unwrap(), "--sun", "30,45", "--ground", "--page-exact"];
    exported(&model, &file, &words);
    exported(&model, &folder.join(""), &[&words[..], &["--no-error"]].concat());

    let site = Site::of(&model, &[&["--quiet"], &words[..5]].concat());
    let scene = site.get("/scene").json();
    let light = &scene["setup"];
    assert_eq!((&light["light"], &light["suns"], &light["ground"]), (&json!(1), &json!("30,45,3,0.53"), &json!(true)));
    let expected = |edge: u32| {
        let query = format!("/frame?view={}&size={edge},{edge}&light=1&suns=30,45&ground=on", scene["first"]);
        site.get(&query).picture()
    };
    // The still picture of browsers without WebGPU.
    let still = still_of(&fs::read_to_string(folder.join("index.html")).unwrap());
    let found = psnr(&still, &expected(still.width()));
    assert!(found > STILL, "the still picture: {found} dB");

    let plain = trained(&tiny, &[]);
    refuses(&tiny, &plain, "x.html", &["--sun", "30,45"], &["--relightable"]);
    refuses(&tiny, &model, "x.ply", &["--sun", "30,45"], &["pages"]);

    let Some(browser) = browser() else { return };
    let page = browser.open(&url(&file), [SMALL_WINDOW; 2]);
    let found = psnr(&shown(&page), &expected(SMALL_WINDOW));
    assert!(found >= LAMPS, "the first picture: {found} dB");
    assert_eq!(page.eval("document.querySelector('[data-shading=physical]').ariaChecked"), "true");
}

/// Still picture of a page.
fn still_of(html: &str) -> RgbImage {
    let text = html.split("src=\"data:image/jpeg;base64,").nth(1).unwrap().split('"').next().unwrap();
    let bytes = BASE64_STANDARD.decode(text).unwrap();
    image::load_from_memory(&bytes).unwrap().to_rgb8()
}

/// Number of pictures that a page has shown, and a promise of the time that several would take.
const COUNT: &str = "(document.getElementById('picture')?.dataset.shown ?? '')";
const FRAMES: &str = "new Promise((resume) => setTimeout(resume, 600))";

/// Script that tells a page that it is hidden, or shown.
fn hidden(is_hidden: bool) -> String {
    format!(
        "Object.defineProperty(document, 'hidden', {{ get: () => {is_hidden}, configurable: true }});
         document.dispatchEvent(new Event('visibilitychange'));"
    )
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
    exported(&model, &file, &["--no-error"]);
    for (script, words) in FAULTS {
        let page = browser.open("about:blank", [WINDOW; 2]);
        page.before_scripts(script);
        page.go(&url(&file));
        says(&page, words);
        assert_eq!(page.eval("document.getElementById('still')?.complete"), true, "a still picture is there");
        page.close();
    }

    let html = fs::read_to_string(&file).unwrap();
    let (start, rest) = html.split_once("id=\"scene\"").unwrap();
    let (attributes, rest) = rest.split_once('>').unwrap();
    let (scene, end) = rest.split_once("</script>").unwrap();
    for (name, text) in [("short.html", &scene[..scene.len() / 2]), ("none.html", "")] {
        fs::write(tiny.path(name), format!("{start}id=\"scene\"{attributes}>{text}</script>{end}")).unwrap();
        let page = browser.open(&url(&tiny.path(name)), [WINDOW; 2]);
        says(&page, "export it");
        page.close();
    }

    // A letter that became another one is no digit, or breaks the checksum.
    let middle = scene.len() / 2;
    let changed = [scene[..middle].trim_end_matches(|letter| letter != 'a').trim_end_matches('a'), "b"].concat();
    let other = [&changed, &scene[changed.len()..]].concat();
    let foreign = [&scene[..scene.len() - 1], "\u{e9}"].concat();
    for (name, text) in [("other.html", &other), ("foreign.html", &foreign)] {
        fs::write(tiny.path(name), format!("{start}id=\"scene\"{attributes}>{text}</script>{end}")).unwrap();
        let page = browser.open(&url(&tiny.path(name)), [WINDOW; 2]);
        says(&page, "export it");
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
    let other = browser.open(&url(&file), [WINDOW; 2]);
    assert!(share_that_differs(&shown(&other), &first) == 0.0, "a second page shows the same");
    // Both at once on one device.
    page.press("2");
    other.press("2");
    let normals = shown(&page);
    assert!(share_that_differs(&normals, &first) > 0.02 && share_that_differs(&shown(&other), &normals) == 0.0);
    page.press("1");
    other.close();
    shown(&page);

    page.resize([0, 0], false);
    page.eval("document.getElementById('picture').style.height = '0'");
    page.wait("document.getElementById('picture').clientHeight === 0");
    page.eval(FRAMES);
    let before = page.eval(COUNT);
    page.press("2");
    page.press("1");
    page.eval(FRAMES);
    assert_eq!(page.eval(COUNT), before, "nothing is rendered for no size");
    page.resize([WINDOW; 2], false);
    page.eval("document.getElementById('picture').style.height = ''");
    page.wait(&format!("{COUNT} > {before}"));
    assert!(share_that_differs(&shown(&page), &first) == 0.0, "no size at all does no harm");

    page.eval(&hidden(true));
    let before = page.eval(COUNT);
    page.press("2");
    page.press("o");
    page.eval(FRAMES);
    assert_eq!(page.eval(COUNT), before, "nothing is rendered where nobody sees it");
    page.press("o");
    page.eval(&hidden(false));
    page.wait(&format!("{COUNT} > {before}"));
    assert!(share_that_differs(&shown(&page), &first) > 0.02, "what was asked for appears when the page does");

    let unseen = browser.open("about:blank", [WINDOW; 2]);
    unseen.before_scripts(&hidden(true));
    unseen.go(&url(&file));
    unseen.wait("document.getElementById('name')?.textContent === 'vase'");
    unseen.eval(FRAMES);
    assert_eq!(unseen.eval(COUNT), "", "a page that opens behind others renders nothing");
    unseen.eval(&hidden(false));
    assert!(share_that_differs(&shown(&unseen), &first) == 0.0, "until it is seen");
    unseen.close();
    page.eval("window.device.destroy()");
    page.press("2");
    says(&page, "reload the page");
}

#[test]
fn the_text_of_a_page_becomes_the_bytes_that_it_was() {
    let Some(browser) = browser() else { return };
    let mut state = 1_u32;
    let mut random = |len: usize| -> Vec<u8> {
        let next = |_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        };
        (0..len).map(next).collect()
    };
    let mut all: Vec<Vec<u8>> = (0..=45).map(&mut random).collect();
    all.extend([vec![0; 63], vec![u8::MAX; 63], (0..=u8::MAX).collect(), random(6_000_000)]);
    let element = |bytes: &Vec<u8>| {
        let text = text_of(bytes);
        format!("<script type=\"application/octet-stream\" data-bytes=\"{}\">{text}</script>", bytes.len())
    };
    let elements: String = all.iter().map(element).collect();
    let folder = tempfile::tempdir().unwrap();
    // Charsets that a server may name, instead of that of the page: letters mean the same in each.
    for charset in ["utf-8", "windows-1252", "shift_jis", "gb18030"] {
        let file = folder.path().join(format!("{charset}.html"));
        let html = format!(
            "<!doctype html><meta charset=\"{charset}\"><body>{elements}<script type=\"module\">\n{TEXT_READER}
             window.bytesOf = bytesOf;</script>"
        );
        fs::write(&file, html).unwrap();
        let page = browser.open(&url(&file), [WINDOW; 2]);
        page.wait("document.readyState === 'complete' && window.bytesOf !== undefined");
        assert_eq!(page.eval("document.characterSet.toLowerCase()"), charset);
        // FNV-1a of each.
        let found = page.eval(
            "(() => {
              const start = performance.now();
              const all = [...document.querySelectorAll('[data-bytes]')].map((element) => bytesOf(element.textContent, Number(element.dataset.bytes)));
              window.time = performance.now() - start;
              return all.map((bytes) => bytes.reduce((sum, byte) => Math.imul(sum ^ byte, 16777619) >>> 0, 2166136261));
            })()",
        );
        let sum = |bytes: &Vec<u8>| {
            bytes.iter().fold(2_166_136_261_u32, |sum, byte| (sum ^ u32::from(*byte)).wrapping_mul(16_777_619))
        };
        assert_eq!(found, serde_json::json!(all.iter().map(sum).collect::<Vec<u32>>()), "{charset}");
        eprintln!("6 MB of {charset} are read in {} ms", page.eval("window.time"));
        let refused = page.eval(
            "['', 'a'.repeat(22), '<' + 'a'.repeat(22), '\\x7f'.repeat(23)].map((text) => { try { bytesOf(text, 20); return ''; } catch ({ message }) { return message; } })",
        );
        let all_say =
            |words: &str| refused.as_array().unwrap().iter().all(|said| said.as_str().unwrap().contains(words));
        assert!(all_say("export it"), "{refused}");
        page.close();
    }
}

#[test]
fn a_folder_is_served_and_its_page_loads_what_lies_beside_it() {
    let tiny = Tiny::new();
    let model = trained(&tiny, &[]);
    let folder = tiny.path("site/");
    let said = exported(&model, &folder, &["--no-error"]);
    assert!(said.contains("page, ") && said.contains("Gaussians"), "{said}");
    for name in ["index.html", "specula.wasm.gz", "scene.specula.gz", "specula-scene.js"] {
        assert!(folder.join(name).is_file(), "{name}");
    }

    let Some(browser) = browser() else { return };
    let glb = folder.join("other.glb");
    exported(&model, &glb, &["--no-error"]);
    exported(&model, &folder.join("light.hdr"), &[]);
    fs::write(folder.join("broken.glb"), &fs::read(&glb).unwrap()[..200]).unwrap();
    let element = "<!doctype html><script src=\"specula-scene.js\" defer></script>\
                   <specula-scene src=\"./\" view=\"layer=normal\" style=\"height: 300px\"></specula-scene>";
    fs::write(folder.join("article.html"), element).unwrap();
    let site = served(&folder);

    let page = browser.open(&site, [WINDOW; 2]);
    let first = shown(&page);
    let other = browser.open(&format!("{site}?scene=other.glb"), [WINDOW; 2]);
    let start = shown(&other);
    assert_eq!(other.eval("document.getElementById('name').textContent"), "other");
    assert!(page.eval("document.getElementById('views').options.length").as_u64() > Some(1));
    assert_eq!(other.eval("document.getElementById('views').options.length"), 1, "which has no cameras");
    other.press("2");
    assert!(share_that_differs(&shown(&other), &start) > 0.02, "normals are a layer of a scene with shading");
    assert_eq!(other.eval("location.search"), "?scene=other.glb", "the address keeps the scene");
    other.close();

    for (name, words) in [
        ("broken.glb", "cut short"),
        ("none.glb", "cannot load"),
        ("http://localhost:9/a.glb", "cannot load"),
        ("light.hdr", "scene of specula"),
    ] {
        let page = browser.open(&format!("{site}?scene={name}"), [WINDOW; 2]);
        says(&page, words);
        page.close();
    }

    // A scene that is dropped takes the place of the other one; a broken one does not.
    page.eval(&dropped(&fs::read(folder.join("broken.glb")).unwrap(), "broken.glb"));
    says(&page, "broken.glb");
    page.eval(&format!(
        "fetch('{site}other.glb').then((response) => response.blob()).then((blob) => {{
          const files = new DataTransfer();
          files.items.add(new File([blob], 'third.glb'));
          window.dispatchEvent(new DragEvent('drop', {{ dataTransfer: files, bubbles: true, cancelable: true }}));
        }})"
    ));
    page.wait("document.getElementById('name').textContent === 'third'");
    let third = shown(&page);
    assert!(share_that_differs(&third, &first) > 0.0 && share_that_differs(&third, &start) == 0.0);
    page.press("2");
    assert!(share_that_differs(&shown(&page), &third) > 0.02, "it hears keys, once");
    page.close();

    let article = browser.open(&format!("{site}article.html"), [WINDOW; 2]);
    let inner = "document.querySelector('specula-scene iframe')?.contentDocument";
    article.wait(&format!("{inner}?.getElementById('picture')?.dataset.still === 'true'"));
    let layer = format!("{inner}.querySelector('[data-layer=normal]').getAttribute('aria-checked')");
    assert_eq!(article.eval(&layer), "true", "the element passes its view on");
    article.eval("document.querySelector('specula-scene').setAttribute('view', 'layer=rgb')");
    article.wait(&format!("{inner}?.querySelector('[data-layer=rgb]')?.getAttribute('aria-checked') === 'true'"));
}

#[test]
fn a_scene_of_gltf_has_the_pictures_of_its_model() {
    /// PSNR in dB: normals of a Gaussian are one towards all cameras, and fixed, in the file.
    const NEAR: f64 = 32.0;
    let tiny = Tiny::new();
    let model = trained(&tiny, &[]);
    let file = tiny.path("vase.glb");
    specula().arg("export").arg(&model).arg("-o").arg(&file).arg("--no-error").assert().success();
    let bytes = fs::read(&file).unwrap();
    let Imported { scene, orientation, .. } = scene_of_glb(Input::memory("vase.glb", &bytes)).unwrap();
    assert_eq!(orientation.up, [0.0, 0.0, 1.0]);
    let opened = OpenedModel::open(&model).unwrap();
    let (_, camera) = opened.evaluation_cameras().unwrap()[0].clone();
    let picture = |scene| {
        let mut renderer = SceneRenderer::new(scene, Channels::Color, &RenderOptions::default()).unwrap();
        renderer.picture(&camera, [1.0; 3]).unwrap()
    };
    let expected = picture(opened.scene);
    let found = psnr(&picture(scene.clone()), &expected);
    assert!(found >= NEAR, "{found} dB");
    let dark =
        Scene { light: scene.light.clone().map(|light| light.with_values(vec![0.0; light.values.len()])), ..scene };
    assert!(psnr(&picture(dark), &expected) < NEAR, "which the light is part of");
}

#[test]
fn options_of_pages_need_a_page() {
    let tiny = Tiny::new();
    let model = trained(&tiny, &[]);
    let output = specula().arg("export").arg(&model).args(["-o", "a.splat", "--page-exact"]).output().unwrap();
    assert!(String::from_utf8_lossy(&output.stderr).contains("-o FILE.html"));
}

/// Counts what a page allocates: bytes of buffers and textures, and the memory of WebAssembly.
const COUNTING: &str = "
  window.bytes = 0;
  const sizes = { r32float: 4, rgba8unorm: 4, rgba16float: 8, rgba32float: 16 };
  const counted = (made, bytes) => {
    window.bytes += bytes;
    const destroy = made.destroy.bind(made);
    made.destroy = () => { window.bytes -= bytes; bytes = 0; destroy(); };
    return made;
  };
  const { createBuffer, createTexture } = GPUDevice.prototype;
  GPUDevice.prototype.createBuffer = function (of) { return counted(createBuffer.call(this, of), of.size); };
  GPUDevice.prototype.createTexture = function (of) {
    const [width, height = 1, layers = 1] = Array.isArray(of.size)
      ? of.size : [of.size.width, of.size.height, of.size.depthOrArrayLayers];
    return counted(createTexture.call(this, of), width * height * layers * (sizes[of.format] ?? 4));
  };
  for (const name of ['instantiate', 'instantiateStreaming']) {
    const original = WebAssembly[name];
    WebAssembly[name] = async (...words) => {
      const made = await original(...words);
      window.memory = (made.instance ?? made).exports.memory;
      return made;
    };
  }";

/// Figures of docs/lab/features.md, for the page that `SPECULA_PAGE` names.
#[test]
#[ignore = "it measures a page, and takes a minute"]
fn figures_of_a_page() {
    let Some(browser) = browser() else { return };
    let file = std::env::var("SPECULA_PAGE").expect("SPECULA_PAGE names a page");
    let page = browser.open("about:blank", [800, 800]);
    page.before_scripts(COUNTING);
    page.go(&url(&fs::canonicalize(file).unwrap()));
    page.wait("Number(document.getElementById('picture')?.dataset.shown) >= 1");
    let start = page.eval("performance.now()");
    shown(&page);
    let status = || page.eval("document.getElementById('status').textContent");
    eprintln!("first picture after {start} ms; at rest: {}", status());
    let count = || page.eval(COUNT).as_str().unwrap().parse::<u32>().unwrap();
    let before = count();
    page.press("o");
    page.eval("new Promise((resume) => setTimeout(resume, 20000))");
    let turned = count() - before;
    eprintln!("{turned} pictures in 20 s of the turntable; {}", status());
    eprintln!("at {} of the resolution", page.eval("document.getElementById('picture').dataset.scale"));
    eprintln!(
        "GPU: {} bytes; WebAssembly: {} bytes",
        page.eval("window.bytes"),
        page.eval("window.memory.buffer.byteLength")
    );
}
