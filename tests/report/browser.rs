//! A headless Chromium, driven over the DevTools protocol through its debugging pipe: JSON messages that end with a zero byte.

use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

pub struct Browser {
    child: Child,
    to: File,
    from: BufReader<File>,
    messages: u64,
    session: Option<String>,
    /// What the page did unasked: console messages, exceptions, requests.
    pub events: Vec<Value>,
    done: Arc<AtomicBool>,
    _profile: tempfile::TempDir,
    _alone: MutexGuard<'static, ()>,
}

/// One browser at a time: several that start at once on two cores keep one another from drawing.
static ALONE: Mutex<()> = Mutex::new(());

/// Longer than any test of a page may take; then the browser is ended, and the test fails on the closed pipe.
const PATIENCE: Duration = Duration::from_secs(120);

fn executable() -> Option<PathBuf> {
    let names = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path).flat_map(|folder| names.map(|name| folder.join(name))).find(|p| p.exists())
}

impl Browser {
    /// None, with a word about it, where there is no browser and none is required.
    pub fn start() -> Option<Self> {
        let Some(executable) = executable() else {
            assert!(
                std::env::var_os("RIGBENCH_REQUIRE_BROWSER").is_none(),
                "RIGBENCH_REQUIRE_BROWSER is set and there is no Chromium"
            );
            eprintln!("skipped: no Chromium on this machine (apt-get install chromium)");
            return None;
        };
        let alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
        let profile = tempfile::tempdir().unwrap();
        let pipe = |name: &str| {
            let path = profile.path().join(name);
            assert!(Command::new("mkfifo").arg(&path).status().unwrap().success());
            path
        };
        let (input, output) = (pipe("in"), pipe("out"));
        let child = Command::new("sh")
            .args(["-c", "exec \"$0\" \"$@\" 3<\"$PIPE_IN\" 4>\"$PIPE_OUT\""])
            .arg(&executable)
            .args(["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--remote-debugging-pipe"])
            .args(["--disable-background-networking", "--disable-component-update", "--disable-extensions"])
            .args(["--disable-renderer-backgrounding", "--disable-backgrounding-occluded-windows"])
            .args(["--force-color-profile=srgb", "--force-device-scale-factor=1", "--window-size=1280,900"])
            .arg(format!("--user-data-dir={}", profile.path().join("profile").display()))
            .env("PIPE_IN", &input)
            .env("PIPE_OUT", &output)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .process_group(0)
            .spawn()
            .unwrap();
        let done = Arc::new(AtomicBool::new(false));
        let (id, finished) = (child.id(), done.clone());
        std::thread::spawn(move || {
            let begun = Instant::now();
            while begun.elapsed() < PATIENCE {
                std::thread::sleep(Duration::from_millis(200));
                if finished.load(Ordering::Relaxed) {
                    return;
                }
            }
            // the whole group, and not by asking: what hangs does not answer
            let _ = Command::new("kill").args(["-9", "--", &format!("-{id}")]).status();
        });
        // the shell opens them in this order
        let to = File::options().write(true).open(&input).unwrap();
        let from = BufReader::new(File::open(&output).unwrap());
        let mut browser = Self {
            child,
            to,
            from,
            messages: 0,
            session: None,
            events: Vec::new(),
            done,
            _profile: profile,
            _alone: alone,
        };
        let target = browser.call("Target.createTarget", json!({ "url": "about:blank" }));
        let attached =
            browser.call("Target.attachToTarget", json!({ "targetId": target["targetId"], "flatten": true }));
        browser.session = Some(attached["sessionId"].as_str().unwrap().to_owned());
        for domain in ["Page", "Runtime", "Log", "Network"] {
            browser.call(&format!("{domain}.enable"), json!({}));
        }
        browser.emulate("", "light");
        Some(browser)
    }

    fn receive(&mut self) -> Value {
        let mut bytes = Vec::new();
        self.from.read_until(0, &mut bytes).unwrap();
        assert_eq!(bytes.pop(), Some(0), "the browser has gone");
        serde_json::from_slice(&bytes).unwrap()
    }

    /// One command of the protocol; its answer.
    pub fn call(&mut self, method: &str, parameters: Value) -> Value {
        self.messages += 1;
        let id = self.messages;
        let mut message = json!({ "id": id, "method": method, "params": parameters });
        if let Some(session) = &self.session {
            message["sessionId"] = json!(session);
        }
        self.to.write_all(format!("{message}\0").as_bytes()).unwrap();
        loop {
            let mut answer = self.receive();
            if answer["id"] == id {
                assert!(answer["error"].is_null(), "{method}: {}", answer["error"]);
                return answer["result"].take();
            }
            if answer.get("method").is_some() {
                self.events.push(answer);
            }
        }
    }

    /// Opens a page and waits until it is whole.
    pub fn open(&mut self, url: &str) {
        self.events.clear();
        self.call("Page.navigate", json!({ "url": url }));
        self.wait_for("document.readyState === 'complete' && location.href !== 'about:blank'");
    }

    /// The value of an expression in the page; promises are waited for.
    pub fn evaluate(&mut self, expression: &str) -> Value {
        let mut answer = self.call(
            "Runtime.evaluate",
            json!({ "expression": expression, "awaitPromise": true, "returnByValue": true, "userGesture": true }),
        );
        assert!(answer["exceptionDetails"].is_null(), "{expression}: {}", answer["exceptionDetails"]);
        answer["result"]["value"].take()
    }

    pub fn wait_for(&mut self, condition: &str) {
        let begun = Instant::now();
        while self.evaluate(&format!("Boolean({condition})")) != json!(true) {
            assert!(begun.elapsed() < Duration::from_secs(30), "waited in vain for {condition}");
            std::thread::sleep(Duration::from_millis(30));
        }
    }

    /// A real click on the middle of the first element that a selector finds.
    pub fn click(&mut self, selector: &str) {
        let [x, y] = self.middle(selector);
        for kind in ["mouseMoved", "mousePressed", "mouseReleased"] {
            let button = if kind == "mouseMoved" { "none" } else { "left" };
            self.call(
                "Input.dispatchMouseEvent",
                json!({ "type": kind, "x": x, "y": y, "button": button, "clickCount": 1 }),
            );
        }
    }

    pub fn hover(&mut self, selector: &str) {
        let [x, y] = self.middle(selector);
        self.call("Input.dispatchMouseEvent", json!({ "type": "mouseMoved", "x": x, "y": y }));
    }

    /// Where the middle of an element is, once it rests there.
    fn middle(&mut self, selector: &str) -> [f64; 2] {
        let quoted = json!(selector);
        let measure = format!(
            "(() => {{ const e = document.querySelector({quoted}); if (!e) return null; e.scrollIntoView({{ block: 'center', behavior: 'instant' }}); \
             const b = e.getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2]; }})()"
        );
        let mut before = Value::Null;
        for _ in 0..200 {
            let place = self.evaluate(&measure);
            assert!(place.is_array(), "no element {selector}");
            if place == before {
                return [place[0].as_f64().unwrap(), place[1].as_f64().unwrap()];
            }
            before = place;
            std::thread::sleep(Duration::from_millis(60));
        }
        panic!("{selector} does not come to rest");
    }

    /// A real key on what has the focus.
    pub fn press(&mut self, key: &str, code: u32) {
        let text = match key {
            "Enter" => "\r",
            _ if key.chars().count() == 1 => key,
            _ => "",
        };
        self.call(
            "Input.dispatchKeyEvent",
            json!({ "type": "keyDown", "key": key, "windowsVirtualKeyCode": code, "text": text }),
        );
        self.call("Input.dispatchKeyEvent", json!({ "type": "keyUp", "key": key, "windowsVirtualKeyCode": code }));
    }

    /// Errors and warnings that the page has caused so far.
    pub fn complaints(&mut self) -> Vec<String> {
        self.evaluate("0");
        let told = |e: &Value| match e["method"].as_str().unwrap_or_default() {
            "Runtime.exceptionThrown" => true,
            "Runtime.consoleAPICalled" => matches!(e["params"]["type"].as_str(), Some("error" | "warning" | "assert")),
            // hints about speed, which this test's own reading of pixels causes, are no complaints
            "Log.entryAdded" => {
                let entry = &e["params"]["entry"];
                entry["level"] == "error" || (entry["level"] == "warning" && entry["source"] != "rendering")
            }
            _ => false,
        };
        self.events.iter().filter(|e| told(e)).map(Value::to_string).collect()
    }

    /// Addresses that the page asked for.
    pub fn requests(&mut self) -> Vec<String> {
        self.evaluate("0");
        let asked = self.events.iter().filter(|e| e["method"] == "Network.requestWillBeSent");
        asked.map(|e| e["params"]["request"]["url"].as_str().unwrap_or_default().to_owned()).collect()
    }

    /// Media features and type as the page sees them.
    pub fn emulate(&mut self, media: &str, scheme: &str) {
        // without smooth scrolling what was found stays where it was found
        let features = json!([
            { "name": "prefers-color-scheme", "value": scheme },
            { "name": "prefers-reduced-motion", "value": "reduce" },
        ]);
        self.call("Emulation.setEmulatedMedia", json!({ "media": media, "features": features }));
        let media = if media.is_empty() { "screen" } else { media };
        self.wait_for(&format!("matchMedia('{media} and (prefers-color-scheme: {scheme})').matches"));
    }

    /// Texts that stand out too little from what is behind them: WCAG 2's ratio under 4.5, each with its ratio.
    pub fn faint_texts(&mut self) -> Vec<String> {
        let found = self.evaluate(
            "(() => { const numbers = (c) => c.match(/[\\d.]+/g).map(Number); const linear = (v) => (v / 255 <= 0.04045 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4);\
             const light = ([r, g, b]) => 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b) + 0.05;\
             const behind = (e) => { for (; e; e = e.parentElement) { const c = numbers(getComputedStyle(e).backgroundColor); if (c.length < 4 || c[3] > 0) return c; } return [255, 255, 255]; };\
             const found = []; const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);\
             while (texts.nextNode()) { const text = texts.currentNode.data.trim(), e = texts.currentNode.parentElement;\
               if (!text || !e.checkVisibility() || e.closest('script, style, canvas')) continue;\
               const style = getComputedStyle(e), pair = [light(numbers(e.ownerSVGElement ? style.fill : style.color)), light(behind(e))];\
               const ratio = Math.max(...pair) / Math.min(...pair); if (ratio < 4.5) found.push(`${e.tagName} ${text.slice(0, 40)}: ${ratio.toFixed(2)}`); }\
             return found; })()",
        );
        serde_json::from_value(found).unwrap()
    }

    /// A picture of what is in the window, for people, where RIGBENCH_SCREENSHOTS names a folder.
    pub fn screenshot(&mut self, name: &str) {
        let Some(folder) = std::env::var_os("RIGBENCH_SCREENSHOTS") else { return };
        let answer = self.call("Page.captureScreenshot", json!({ "format": "png" }));
        let text = answer["data"].as_str().unwrap();
        let path = Path::new(&folder).join(name);
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(path.with_extension("base64"), text).unwrap();
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        self.done.store(true, Ordering::Relaxed);
        // the whole of it goes with the first process
        let _ = self.to.write_all(b"{\"id\":0,\"method\":\"Browser.close\"}\0");
        let begun = Instant::now();
        while begun.elapsed() < Duration::from_secs(5) {
            if matches!(self.child.try_wait(), Ok(Some(_))) {
                return;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
