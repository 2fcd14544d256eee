//! A real browser, asked over its DevTools protocol what it shows.

use core::{cell::RefCell, time::Duration};
use serde_json::{Value, json};
use std::{
    io::{BufRead, BufReader},
    net::TcpStream,
    process::{Child, Command, Stdio},
    thread::sleep,
    time::Instant,
};
use tempfile::TempDir;
use tungstenite::{Message, WebSocket, client};

/// Names of browsers that speak the protocol.
const NAMES: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "chrome"];
/// Time limit of every wait for a page.
const PATIENCE: Duration = Duration::from_secs(30);

/// A browser without a window, which ends when it is dropped.
pub(crate) struct Browser {
    child: Child,
    socket: RefCell<(WebSocket<TcpStream>, u64)>,
    _profile: TempDir,
}

impl Browser {
    /// The one that `SPECULA_BROWSER` names, or whichever is on the path; none if there is none, or
    /// "none" is named.
    pub(crate) fn start() -> Option<Self> {
        Self::with(&["--disable-gpu"])
    }

    /// The same with WebGPU on a software adapter, which not every browser has.
    pub(crate) fn with_webgpu() -> Option<Self> {
        Self::with(&["--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader"])
    }

    fn with(words: &[&str]) -> Option<Self> {
        let named = std::env::var("SPECULA_BROWSER").ok();
        if named.as_deref() == Some("none") {
            return None;
        }
        let name = named.or_else(|| NAMES.into_iter().find(|name| is_there(name)).map(str::to_owned))?;
        let profile = tempfile::tempdir().unwrap();
        let mut command = Command::new(name);
        command.args(["--headless", "--no-sandbox", "--disable-dev-shm-usage", "--no-first-run"]).args(words);
        command.args(["--force-color-profile=srgb", "--remote-debugging-port=0", "about:blank"]);
        command.arg(format!("--user-data-dir={}", profile.path().display()));
        command.env("XDG_RUNTIME_DIR", profile.path()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().expect("the browser starts");
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
        let url = lines.find_map(|line| Some(line.ok()?.split_once("listening on ")?.1.to_owned()));
        let url = url.expect("the browser says where it listens");
        // Whatever else it says is read, so that it never waits.
        std::thread::spawn(move || lines.for_each(drop));
        let address = url.trim_start_matches("ws://").split('/').next().unwrap();
        let stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let (socket, _) = client(&url, stream).unwrap();
        Some(Self { child, socket: RefCell::new((socket, 0)), _profile: profile })
    }

    /// Page of this size, in a separate profile.
    pub(crate) fn open(&self, url: &str, [width, height]: [u32; 2]) -> Page<'_> {
        let context = self.call(None, "Target.createBrowserContext", json!({}))["browserContextId"].clone();
        let about = json!({"url": "about:blank", "browserContextId": context});
        let target = self.call(None, "Target.createTarget", about)["targetId"].clone();
        let attached = self.call(None, "Target.attachToTarget", json!({"targetId": target, "flatten": true}));
        let page = Page { browser: self, session: attached["sessionId"].as_str().unwrap().to_owned(), target };
        page.resize([width, height], false);
        page.call("Page.enable", json!({}));
        page.go(url);
        page
    }

    fn call(&self, session: Option<&str>, method: &str, params: Value) -> Value {
        self.asked(session, method, params).unwrap_or_else(|error| panic!("{method}: {error}"))
    }

    /// Answer of the browser, or the reason for none.
    fn asked(&self, session: Option<&str>, method: &str, params: Value) -> Result<Value, Value> {
        let (socket, count) = &mut *self.socket.borrow_mut();
        *count += 1;
        let mut message = json!({"id": *count, "method": method, "params": params});
        if let Some(session) = session {
            message["sessionId"] = session.into();
        }
        socket.send(Message::text(message.to_string())).unwrap();
        loop {
            let Message::Text(text) = socket.read().unwrap_or_else(|error| panic!("{method}: {error}")) else {
                continue;
            };
            let answer: Value = serde_json::from_str(&text).unwrap();
            if answer["id"] == *count {
                return if answer["error"].is_null() {
                    Ok(answer["result"].clone())
                } else {
                    Err(answer["error"].clone())
                };
            }
        }
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn is_there(name: &str) -> bool {
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path).any(|folder| folder.join(name).is_file())
}

/// A page that a browser shows.
pub(crate) struct Page<'a> {
    browser: &'a Browser,
    session: String,
    target: Value,
}

impl Page<'_> {
    fn call(&self, method: &str, params: Value) -> Value {
        self.browser.call(Some(&self.session), method, params)
    }

    /// Shows another address.
    pub(crate) fn go(&self, url: &str) {
        self.call("Page.navigate", json!({"url": url}));
    }

    /// Runs a script before those of the pages that are shown from now on.
    pub(crate) fn before_scripts(&self, script: &str) {
        self.call("Page.addScriptToEvaluateOnNewDocument", json!({"source": script}));
    }

    /// Sets the window's size, with a phone's touch screen where `phone` asks for one.
    pub(crate) fn resize(&self, [width, height]: [u32; 2], is_phone: bool) {
        let size = json!({"width": width, "height": height, "deviceScaleFactor": 1, "mobile": is_phone});
        self.call("Emulation.setDeviceMetricsOverride", size);
        self.call("Emulation.setTouchEmulationEnabled", json!({"enabled": is_phone}));
    }

    /// Emulates a link of this latency, in milliseconds, and this rate, in bytes per second.
    pub(crate) fn slow_down(&self, latency: u32, rate: u32) {
        self.call("Network.enable", json!({}));
        let link = json!({"offline": false, "latency": latency, "downloadThroughput": rate, "uploadThroughput": rate});
        self.call("Network.emulateNetworkConditions", link);
    }

    /// Value of an expression; promises are awaited.
    pub(crate) fn eval(&self, expression: &str) -> Value {
        self.try_eval(expression).unwrap_or_else(|error| panic!("{expression}: {error}"))
    }

    /// The same, where a page may be on its way to another.
    fn try_eval(&self, expression: &str) -> Result<Value, Value> {
        let asked = json!({"expression": expression, "awaitPromise": true, "returnByValue": true});
        let answer = self.browser.asked(Some(&self.session), "Runtime.evaluate", asked)?;
        let exception = &answer["exceptionDetails"];
        if exception.is_null() { Ok(answer["result"]["value"].clone()) } else { Err(exception.clone()) }
    }

    /// Waits until an expression holds.
    pub(crate) fn wait(&self, expression: &str) {
        let start = Instant::now();
        while !self.holds(expression) {
            let said =
                || self.eval("document.getElementById('message')?.textContent + ' | ' + document.body?.innerText");
            assert!(start.elapsed() < PATIENCE, "{expression} does not come true; the page says: {}", said());
            sleep(Duration::from_millis(30));
        }
    }

    /// Returns whether an expression holds; nothing holds on a page that makes place for another.
    fn holds(&self, expression: &str) -> bool {
        /// Code of the debugger's own errors, such as that of a page that went away.
        const NOT_NOW: i32 = -32000;
        match self.try_eval(expression) {
            Ok(value) => value == true,
            Err(error) if error["code"] == NOT_NOW => false,
            Err(error) => panic!("{expression}: {error}"),
        }
    }

    /// Acts, and waits until the page has heard of the event that comes last of it.
    fn until_heard(&self, event: &str, act: impl FnOnce()) {
        self.eval(&format!(
            "(() => {{
              window.isHeard = false;
              window.addEventListener('{event}', () => (window.isHeard = true), {{ once: true, capture: true }});
            }})()"
        ));
        act();
        self.wait("window.isHeard");
    }

    /// Presses, moves and releases the mouse.
    pub(crate) fn drag(&self, from: [f64; 2], to: [f64; 2]) {
        const STEPS: u32 = 6;
        let mouse = |kind: &str, [x, y]: [f64; 2], buttons: u32| {
            let event = json!({"type": kind, "x": x, "y": y, "button": "left", "buttons": buttons, "clickCount": 1});
            self.call("Input.dispatchMouseEvent", event);
        };
        self.until_heard("pointerup", || {
            mouse("mousePressed", from, 1);
            for step in 1..=STEPS {
                let share = f64::from(step) / f64::from(STEPS);
                mouse("mouseMoved", [0, 1].map(|k| from[k] + share * (to[k] - from[k])), 1);
            }
            mouse("mouseReleased", to, 0);
        });
    }

    /// A finger that goes from one place to another.
    pub(crate) fn swipe(&self, from: [f64; 2], to: [f64; 2]) {
        let touch = |kind: &str, points: Value| {
            self.call("Input.dispatchTouchEvent", json!({"type": kind, "touchPoints": points}));
        };
        touch("touchStart", json!([{"x": from[0], "y": from[1]}]));
        touch("touchMove", json!([{"x": to[0], "y": to[1]}]));
        touch("touchEnd", json!([]));
    }

    /// Presses a key that is a character.
    pub(crate) fn press(&self, key: &str) {
        let stroke = |kind: &str, text: &str| {
            self.call("Input.dispatchKeyEvent", json!({"type": kind, "key": key, "text": text}));
        };
        self.until_heard("keyup", || {
            stroke("keyDown", key);
            stroke("keyUp", "");
        });
    }

    /// Closes it, whatever it waits for.
    pub(crate) fn close(self) {
        self.browser.call(None, "Target.closeTarget", json!({"targetId": self.target}));
    }
}
