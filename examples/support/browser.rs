//! Headless Chromium with one page, controlled through the Chrome DevTools Protocol over a pipe, with real mouse
//! events. The environment variable `CHROMIUM` names another browser.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// A result, whose error is a sentence.
pub type Result<T> = std::result::Result<T, String>;

/// The maximum time to wait for an answer of the browser.
const PATIENCE: Duration = Duration::from_secs(60);

/// A browser with one page.
pub struct Browser {
    process: Child,
    to: ChildStdin,
    messages: Receiver<Value>,
    session: Option<String>,
    next: u64,
    /// The messages that the page logged as errors.
    pub errors: Vec<String>,
    /// The beginnings of the addresses that the page may load.
    allowed: Vec<String>,
    /// The browser's profile, which is deleted with this value.
    _profile: tempfile::TempDir,
}

impl Browser {
    /// Starts the browser. The addresses that a page may load have one of the given beginnings.
    pub fn start(allowed: &[&str]) -> Result<Self> {
        let profile = tempfile::tempdir().map_err(|e| format!("no folder for the browser's profile: {e}"))?;
        let browser = std::env::var("CHROMIUM").unwrap_or_else(|_| "chromium".into());
        // The protocol uses the file descriptors 3 and 4.
        let mut process = Command::new("sh")
            .args(["-c", "exec \"$@\" 3<&0 4>&1 </dev/null >/dev/null 2>&1", "sh", &browser])
            .args([
                "--headless",
                "--no-sandbox",
                "--remote-debugging-pipe",
                "--disable-gpu",
                "--no-first-run",
            ])
            .args(["--disable-dev-shm-usage", "--hide-scrollbars", "--force-color-profile=srgb"])
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .arg("about:blank")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|e| format!("cannot start {browser}: {e}"))?;
        let to = process.stdin.take().ok_or("no pipe to the browser")?;
        let from = process.stdout.take().ok_or("no pipe from the browser")?;
        let (sender, messages) = channel();
        std::thread::spawn(move || {
            for message in BufReader::new(from).split(0).map_while(std::io::Result::ok) {
                if serde_json::from_slice(&message).map(|m| sender.send(m)).is_err() {
                    break;
                }
            }
        });
        let allowed = allowed.iter().copied().map(str::to_owned).collect();
        let mut browser = Browser {
            process,
            to,
            messages,
            session: None,
            next: 0,
            errors: Vec::new(),
            allowed,
            _profile: profile,
        };
        let target = browser.call("Target.createTarget", json!({ "url": "about:blank" }))?;
        let attach = json!({ "targetId": target["targetId"], "flatten": true });
        let session = browser.call("Target.attachToTarget", attach)?;
        browser.session = session["sessionId"].as_str().map(str::to_owned);
        for domain in ["Page", "Runtime", "Log", "Network"] {
            browser.call(&format!("{domain}.enable"), json!({}))?;
        }
        Ok(browser)
    }

    /// Calls a method and returns its result.
    fn call(&mut self, method: &str, parameters: Value) -> Result<Value> {
        self.next += 1;
        let mut message = json!({ "id": self.next, "method": method, "params": parameters });
        if let Some(session) = &self.session {
            message["sessionId"] = json!(session);
        }
        let sent = write!(self.to, "{message}\0").and_then(|()| self.to.flush());
        sent.map_err(|e| format!("{method}: the browser does not listen: {e}"))?;
        let until = Instant::now() + PATIENCE;
        loop {
            let left = until.saturating_duration_since(Instant::now());
            let message = self.messages.recv_timeout(left).map_err(|e| match e {
                RecvTimeoutError::Timeout => format!("{method}: no answer in {} s", PATIENCE.as_secs()),
                RecvTimeoutError::Disconnected => format!("{method}: the browser has ended"),
            })?;
            self.listen(&message);
            if message["id"] == self.next {
                return match &message["error"] {
                    Value::Null => Ok(message["result"].clone()),
                    error => Err(format!("{method}: {error}")),
                };
            }
        }
    }

    /// Records errors of the page and requests to other hosts.
    fn listen(&mut self, message: &Value) {
        let parameters = &message["params"];
        let error = match message["method"].as_str() {
            Some("Runtime.exceptionThrown") => Some(parameters["exceptionDetails"].to_string()),
            Some("Runtime.consoleAPICalled") if parameters["type"] != "log" => Some(parameters.to_string()),
            Some("Log.entryAdded") if parameters["entry"]["level"] == "error" => {
                Some(parameters["entry"].to_string())
            }
            Some("Network.requestWillBeSent") => {
                let url = parameters["request"]["url"].as_str().unwrap_or_default();
                let own = self.allowed.iter().any(|beginning| url.starts_with(beginning));
                (!own).then(|| format!("a request to {url}"))
            }
            _ => None,
        };
        self.errors.extend(error);
    }

    /// Returns the value of an expression in the page. Promises are awaited.
    pub fn evaluate(&mut self, expression: &str) -> Result<Value> {
        let parameters = json!({ "expression": expression, "returnByValue": true, "awaitPromise": true });
        let answer = self.call("Runtime.evaluate", parameters)?;
        match answer.get("exceptionDetails") {
            Some(details) => Err(format!("{expression}: {details}")),
            None => Ok(answer["result"]["value"].clone()),
        }
    }

    pub fn wait_for(&mut self, what: &str, expression: &str) -> Result<()> {
        let until = Instant::now() + PATIENCE;
        while self.evaluate(expression)? != Value::Bool(true) {
            if Instant::now() > until {
                return Err(format!("{what}: it did not happen in {} s", PATIENCE.as_secs()));
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        Ok(())
    }

    /// Opens a page in a window of the given size, in the given theme.
    pub fn open(&mut self, page: &str, [width, height]: [u32; 2], theme: &str, phone: bool) -> Result<()> {
        let scale = if phone { 2 } else { 1 };
        let metrics =
            json!({ "width": width, "height": height, "deviceScaleFactor": scale, "mobile": phone });
        self.call("Emulation.setDeviceMetricsOverride", metrics)?;
        let feature = json!({ "features": [{ "name": "prefers-color-scheme", "value": theme }] });
        self.call("Emulation.setEmulatedMedia", feature)?;
        self.call("Page.navigate", json!({ "url": page }))?;
        let ready = "document.readyState === 'complete' && \
                     [...document.querySelectorAll('.viewer')].every((v) => v.dataset.ready === 'true')";
        self.wait_for("the page is ready", ready)
    }

    /// Saves a screenshot of the whole page.
    pub fn screenshot(&mut self, path: &Path) -> Result<()> {
        let parameters = json!({ "format": "png", "captureBeyondViewport": true });
        let answer = self.call("Page.captureScreenshot", parameters)?;
        let bytes = STANDARD
            .decode(answer["data"].as_str().unwrap_or_default())
            .map_err(|e| format!("the screenshot is no Base64: {e}"))?;
        std::fs::write(path, bytes).map_err(|e| format!("{}: {e}", path.display()))?;
        println!("wrote {}", path.display());
        Ok(())
    }

    /// Enlarges the window to the size of the page, so that a screenshot shows all of it.
    pub fn grow(&mut self, width: u32, phone: bool) -> Result<()> {
        let height = self.evaluate("Math.min(document.documentElement.scrollHeight, 16000)")?;
        let scale = if phone { 2 } else { 1 };
        let metrics =
            json!({ "width": width, "height": height, "deviceScaleFactor": scale, "mobile": phone });
        self.call("Emulation.setDeviceMetricsOverride", metrics)?;
        self.evaluate("new Promise((r) => requestAnimationFrame(() => requestAnimationFrame(r)))").map(drop)
    }

    pub fn mouse(&mut self, kind: &str, [x, y]: [f64; 2]) -> Result<()> {
        let buttons = u32::from(kind != "mouseReleased");
        let parameters =
            json!({ "type": kind, "x": x, "y": y, "button": "left", "buttons": buttons, "clickCount": 1 });
        self.call("Input.dispatchMouseEvent", parameters).map(drop)
    }

    pub fn click(&mut self, selector: &str) -> Result<()> {
        let at = self.centre(selector)?;
        self.mouse("mousePressed", at)?;
        self.mouse("mouseReleased", at)
    }

    /// Returns the centre of an element in the window.
    pub fn centre(&mut self, selector: &str) -> Result<[f64; 2]> {
        let expression = format!(
            "(() => {{ const e = document.querySelector('{selector}'); e.scrollIntoView({{ block: 'center', behavior: 'instant' }}); \
             const b = e.getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2]; }})()"
        );
        let at = self.evaluate(&expression)?;
        match (at[0].as_f64(), at[1].as_f64()) {
            (Some(x), Some(y)) => Ok([x, y]),
            _ => Err(format!("{selector}: expected an element, found {at}")),
        }
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // The process may have ended already.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Evaluates to a hash of the first viewer's pixels and the number of their colours.
pub const PIXELS: &str = "(() => { const c = document.querySelector('.viewer canvas'); \
    const d = new Uint32Array(c.getContext('2d').getImageData(0, 0, c.width, c.height).data.buffer); \
    let h = 0; const colours = new Set(); for (const v of d) { h = (Math.imul(h, 31) + v) | 0; colours.add(v); } \
    return [h, colours.size]; })()";

/// Prints what holds.
///
/// # Errors
/// If it does not hold.
pub fn expect(holds: bool, what: &str) -> Result<()> {
    if holds {
        println!("ok: {what}");
        return Ok(());
    }
    Err(format!("expected that {what}"))
}
