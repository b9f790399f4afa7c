//! A headless Chromium, driven over its DevTools protocol through pipes, without a port and without a library.
//!
//! Messages are JSON, each ended by a zero byte, on the browser's file descriptors 3 and 4.

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

/// Time that any step may take on a busy machine.
const PATIENCE: Duration = Duration::from_mins(1);

/// Programs that are tried, unless STYLUS_BROWSER names one.
const PROGRAMS: [&str; 3] = ["chromium", "chromium-browser", "google-chrome"];

/// The least contrast of visible texts by the relative luminance of WCAG 2.1, section 1.4.3. A picture's ground is the
/// page's.
const LEAST_CONTRAST: &str = "(() => {
    const rgb = (text) => text.match(/[\\d.]+/g).map(Number);
    const lum = (c) => c.slice(0, 3).map((v) => v / 255)
        .map((v) => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
        .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
    const ground = (e) => {
        for (; e; e = e.parentElement) {
            const c = rgb(getComputedStyle(e).backgroundColor);
            if (c.length === 3 || c[3] === 1) return c;
        }
        return [255, 255, 255];
    };
    let least = 100;
    for (const e of document.body.querySelectorAll('*')) {
        const own = [...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim() !== '');
        if (!own || !e.checkVisibility() || ['SCRIPT', 'NOSCRIPT', 'STYLE', 'style'].includes(e.tagName)) continue;
        // Text on a cell of a map has the cell for its ground.
        if (e instanceof SVGElement && ['#FFFFFF', '#292929'].includes(e.getAttribute('fill'))) continue;
        const style = getComputedStyle(e);
        const [a, b] = [lum(rgb(e instanceof SVGElement ? style.fill : style.color)), lum(ground(e))];
        least = Math.min(least, (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05));
    }
    return least;
})()";

/// A browser with one page.
pub struct Browser {
    child: Child,
    input: ChildStdin,
    messages: Receiver<Value>,
    events: Vec<Value>,
    session: Option<String>,
    last: u64,
}

fn program() -> String {
    if let Ok(named) = std::env::var("STYLUS_BROWSER") {
        return named;
    }
    let is_there = |program: &&&str| {
        let found = Command::new("sh")
            .args(["-c", &format!("command -v {program}")])
            .output();
        found.is_ok_and(|output| output.status.success())
    };
    let found = PROGRAMS.iter().find(is_there);
    found
        .expect("install Chromium, or name a browser in STYLUS_BROWSER")
        .to_string()
}

impl Browser {
    /// Starts a browser with its profile and downloads in `folder`, and an empty page.
    pub fn start(folder: &Path) -> Self {
        let mut child = Command::new("sh")
            // The pipes of the shell's input and output become descriptors 3 and 4.
            .args([
                "-c",
                "exec \"$@\" 3<&0 4>&1 </dev/null >/dev/null 2>&1",
                "sh",
            ])
            .arg(program())
            .args([
                "--headless=new",
                "--remote-debugging-pipe",
                "--no-sandbox",
                "--disable-gpu",
            ])
            .args([
                "--no-first-run",
                "--disable-background-networking",
                "--disable-component-update",
            ])
            .args(["--disable-dev-shm-usage", "--window-size=900,1000"])
            .arg(format!(
                "--user-data-dir={}",
                folder.join("profile").display()
            ))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("a shell starts");
        let input = child.stdin.take().expect("it is piped");
        let output = child.stdout.take().expect("it is piped");
        let (sender, messages) = channel();
        std::thread::spawn(move || {
            for message in BufReader::new(output).split(0) {
                let Ok(message) = message else { return };
                let Ok(value) = serde_json::from_slice(&message) else {
                    return;
                };
                if sender.send(value).is_err() {
                    return;
                }
            }
        });
        let mut browser = Self {
            child,
            input,
            messages,
            events: Vec::new(),
            session: None,
            last: 0,
        };
        let target = browser.call("Target.createTarget", &json!({"url": "about:blank"}));
        let attached = browser.call(
            "Target.attachToTarget",
            &json!({"targetId": target["targetId"], "flatten": true}),
        );
        browser.call(
            "Browser.setDownloadBehavior",
            &json!({"behavior": "allow", "downloadPath": folder}),
        );
        browser.session = attached["sessionId"].as_str().map(str::to_owned);
        for domain in ["Page", "Runtime", "Network", "Log"] {
            browser.call(&format!("{domain}.enable"), &json!({}));
        }
        browser
    }

    /// Calls a method, and waits for its result.
    pub fn call(&mut self, method: &str, parameters: &Value) -> Value {
        self.last += 1;
        let mut message = json!({"id": self.last, "method": method, "params": parameters});
        if let Some(session) = &self.session {
            message["sessionId"] = json!(session);
        }
        let mut bytes = message.to_string().into_bytes();
        bytes.push(0);
        self.input.write_all(&bytes).expect("the browser listens");
        loop {
            let message = self
                .messages
                .recv_timeout(PATIENCE)
                .unwrap_or_else(|failure| panic!("{method}: no answer: {failure}"));
            if message["id"] == json!(self.last) {
                assert!(message["error"].is_null(), "{method}: {message}");
                return message["result"].clone();
            }
            self.events.push(message);
        }
    }

    /// The value of an expression in the page, after the promise that it may be.
    pub fn value(&mut self, expression: &str) -> Value {
        let answer = self.call(
            "Runtime.evaluate",
            &json!({"expression": expression, "awaitPromise": true, "returnByValue": true}),
        );
        assert!(
            answer["exceptionDetails"].is_null(),
            "{expression}: {answer}"
        );
        answer["result"]["value"].clone()
    }

    /// Waits until an expression holds.
    pub fn wait(&mut self, expression: &str) {
        let begin = Instant::now();
        while self.value(expression) != json!(true) {
            assert!(begin.elapsed() < PATIENCE, "never: {expression}");
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Opens a file, or the same page again, and waits until it has loaded.
    pub fn open(&mut self, path: &Path) {
        self.value("globalThis.isOld = true");
        let url = format!("file://{}", path.display());
        self.call("Page.navigate", &json!({"url": url}));
        self.wait("globalThis.isOld !== true && document.readyState === 'complete'");
    }

    /// Clicks the middle of an element, as a mouse does.
    pub fn click(&mut self, id: &str) {
        let place = self.value(&format!(
            "(() => {{ const e = document.getElementById('{id}'); e.scrollIntoView({{block: 'center'}}); \
             const r = e.getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2]; }})()"
        ));
        for kind in ["mouseMoved", "mousePressed", "mouseReleased"] {
            let button = if kind == "mouseMoved" { "none" } else { "left" };
            self.call(
                "Input.dispatchMouseEvent",
                &json!({"type": kind, "x": place[0], "y": place[1], "button": button, "clickCount": 1}),
            );
        }
    }

    /// Presses a key that writes one character.
    pub fn press(&mut self, key: char) {
        for kind in ["keyDown", "keyUp"] {
            let text = if kind == "keyDown" {
                key.to_string()
            } else {
                String::new()
            };
            self.call(
                "Input.dispatchKeyEvent",
                &json!({"type": kind, "key": key.to_string(), "text": text}),
            );
        }
    }

    /// Addresses that the page has asked for, and errors that it has logged.
    pub fn requests_and_errors(&mut self) -> (Vec<String>, Vec<String>) {
        // An answer comes after all events before it.
        self.value("1");
        let named = |event: &&Value, name: &str| event["method"] == json!(name);
        let requests = self
            .events
            .iter()
            .filter(|event| named(event, "Network.requestWillBeSent"))
            .map(|event| {
                event["params"]["request"]["url"]
                    .as_str()
                    .unwrap_or("")
                    .to_owned()
            });
        let errors = self.events.iter().filter(|event| {
            named(event, "Runtime.exceptionThrown") || named(event, "Log.entryAdded")
        });
        (requests.collect(), errors.map(Value::to_string).collect())
    }

    /// Makes the reader prefer a colour scheme, "light" or "dark".
    pub fn prefer(&mut self, scheme: &str) {
        self.call(
            "Emulation.setEmulatedMedia",
            &json!({"features": [{"name": "prefers-color-scheme", "value": scheme}]}),
        );
    }

    /// The least contrast of visible texts, 1 to 21.
    pub fn least_contrast(&mut self) -> f64 {
        self.value(LEAST_CONTRAST).as_f64().expect("a number")
    }

    /// A picture of the page as PNG, in base64.
    pub fn screenshot(&mut self) -> String {
        let taken = self.call(
            "Page.captureScreenshot",
            &json!({"format": "png", "captureBeyondViewport": true}),
        );
        taken["data"].as_str().expect("it is text").to_owned()
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
