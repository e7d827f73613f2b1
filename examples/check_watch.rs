//! Opens the page of `buffon render --watch` in headless Chromium, and checks that the picture is there, that its
//! controls change pixels, that its buttons end the render, and that no error is logged. Saves screenshots.
//!
//! `cargo run --example check_watch -- BUFFON SCENE DIR`

#[path = "support/browser.rs"]
mod browser;

use browser::{Browser, PIXELS, Result, expect};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, ExitCode, Stdio};
use std::time::{Duration, Instant};

/// The maximum time of a render after it was told to end.
const PATIENCE: Duration = Duration::from_secs(60);

/// A render with a page.
struct Render {
    process: Child,
    /// The address of the page.
    page: String,
    _stderr: BufReader<ChildStderr>,
}

impl Render {
    fn start(buffon: &Path, scene: &Path, folder: &Path) -> Result<Self> {
        let mut process = Command::new(buffon)
            .args(["render", "-q", "--watch", ":0", "--size", "160x160", "--threads", "1"])
            .args(["--spp", "100000000", "--target-error", "1e-5"])
            .arg(scene)
            .arg("-o")
            .arg(folder.join("watched.exr"))
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|e| format!("cannot start {}: {e}", buffon.display()))?;
        let mut stderr = BufReader::new(process.stderr.take().ok_or("no pipe from the render")?);
        let mut line = String::new();
        stderr.read_line(&mut line).map_err(|e| format!("the render says nothing: {e}"))?;
        let page = line.trim_end().strip_prefix("buffon: watch: ").map(str::to_owned);
        let page = page.ok_or_else(|| format!("expected the address of the page, found \"{line}\""))?;
        Ok(Render { process, page, _stderr: stderr })
    }

    /// Waits for the end, and returns the exit code.
    fn wait(&mut self) -> Result<Option<i32>> {
        let until = Instant::now() + PATIENCE;
        loop {
            if let Some(status) = self.process.try_wait().map_err(|e| e.to_string())? {
                return Ok(status.code());
            }
            if Instant::now() > until {
                return Err(format!("the render has not ended in {} s", PATIENCE.as_secs()));
            }
            std::thread::sleep(Duration::from_millis(50));
        }
    }
}

impl Drop for Render {
    fn drop(&mut self) {
        // The process may have ended already.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Uses exposure, zoom, pan and the error map, and checks that pixels change. The render itself changes them, too, but
/// no longer by much.
fn check_viewer(browser: &mut Browser) -> Result<()> {
    let seen = browser.evaluate(PIXELS)?;
    expect(seen[1].as_u64().unwrap_or(0) > 8, "the picture is shown")?;
    let scale = |browser: &mut Browser| browser.evaluate("document.querySelector('.scale').textContent");
    let before = scale(browser)?;
    for _ in 0..2 {
        browser.click(".viewer .in")?;
    }
    expect(scale(browser)? != before, "zoom changes the scale")?;
    let corner = "(() => { const c = document.querySelector('.viewer canvas'); \
        return [...c.getContext('2d').getImageData(0, 0, c.width, 24).data].reduce((a, b) => a + b) / c.width / 96; })()";
    let mean = |browser: &mut Browser| browser.evaluate(corner).map(|v| v.as_f64().unwrap_or(f64::NAN));
    let [x, y] = browser.centre(".viewer canvas")?;
    let still = mean(browser)?;
    browser.mouse("mousePressed", [x, y])?;
    browser.mouse("mouseMoved", [x - 60.0, y - 60.0])?;
    browser.mouse("mouseMoved", [x - 120.0, y - 140.0])?;
    browser.mouse("mouseReleased", [x - 120.0, y - 140.0])?;
    let panned = mean(browser)?;
    expect((panned - still).abs() > 1.0, &format!("panning changes pixels ({still:.1} to {panned:.1})"))?;
    browser.click(".viewer .fit")?;
    let dark = mean(browser)?;
    let expose = |value: i32| {
        format!(
            "(() => {{ const e = document.querySelector('.viewer .exposure'); e.value = {value}; \
             e.dispatchEvent(new Event('input')); }})()"
        )
    };
    browser.evaluate(&expose(3))?;
    let bright = mean(browser)?;
    expect(bright > dark + 5.0, &format!("exposure changes pixels ({dark:.1} to {bright:.1})"))?;
    browser.evaluate(&expose(0))?;
    let told = browser.evaluate(
        "(() => { const c = document.querySelector('.viewer canvas'), b = c.getBoundingClientRect(); \
         c.dispatchEvent(new PointerEvent('pointermove', { clientX: b.x + b.width / 2, clientY: b.y + b.height / 2 })); \
         return document.querySelector('.readout').textContent; })()",
    )?;
    let told = told.as_str().unwrap_or_default().to_owned();
    expect(told.starts_with("pixel ") && told.contains(" %"), &format!("values are told (\"{told}\")"))
}

/// Shows the picture or the error map.
fn pick(browser: &mut Browser, what: &str) -> Result<()> {
    let pick = format!(
        "(() => {{ const p = document.querySelector('.viewer .pick'); p.value = '{what}'; \
         p.dispatchEvent(new Event('change')); }})()"
    );
    browser.evaluate(&pick).map(drop)
}

fn check(buffon: &Path, scene: &Path, folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let mut browser = Browser::start(&["http://127.0.0.1:", "data:", "about:"])?;
    let mut render = Render::start(buffon, scene, folder)?;
    let page = render.page.clone();
    for (name, size, theme, phone) in [
        ("light", [1400, 900], "light", false),
        ("dark", [1400, 900], "dark", false),
        ("phone-light", [390, 844], "light", true),
        ("phone-dark", [390, 844], "dark", true),
    ] {
        println!("watch-{name}:");
        browser.open(&page, size, theme, phone)?;
        browser.wait_for("the plot has a line", "!!document.querySelector('#plot .line.s0')")?;
        if !phone {
            check_viewer(&mut browser)?;
        }
        let wide = browser.evaluate("document.documentElement.scrollWidth > innerWidth")?;
        expect(wide == false, "nothing is wider than the window")?;
        browser.grow(size[0], phone)?;
        browser.screenshot(&folder.join(format!("watch-{name}.png")))?;
        pick(&mut browser, "error")?;
        let legend = browser.evaluate("!document.querySelector('.viewer .heat').hidden")?;
        expect(legend == true, "the error map has a legend")?;
        browser.screenshot(&folder.join(format!("watch-{name}-error.png")))?;
    }
    for (theme, button, code) in [("light", "enough", 0), ("dark", "stop", 130)] {
        println!("{button}:");
        browser.open(&page_of(&mut render, buffon, scene, folder)?, [1400, 900], theme, false)?;
        browser.click(&format!("#{button}"))?;
        let ended = "document.body.dataset.phase === 'finished'";
        browser.wait_for("the page knows of the end", ended)?;
        let exit = render.wait()?;
        expect(exit == Some(code), &format!("the exit code is {code} ({exit:?})"))?;
        expect(folder.join("watched.exr").exists(), "the image is written")?;
        let picture = browser.evaluate(PIXELS)?;
        expect(picture[1].as_u64().unwrap_or(0) > 8, "the page keeps the last picture")?;
        let idle = browser.evaluate("document.querySelectorAll('.actions button:disabled').length")?;
        expect(idle == 2, "the buttons have no effect any more")?;
        browser.screenshot(&folder.join(format!("watch-{button}.png")))?;
    }
    expect(browser.errors.is_empty(), &format!("nothing is logged as an error {:?}", browser.errors))
}

/// Returns the page of a render, after starting another one if it has ended.
fn page_of(render: &mut Render, buffon: &Path, scene: &Path, folder: &Path) -> Result<String> {
    if render.process.try_wait().map_err(|e| e.to_string())?.is_some() {
        *render = Render::start(buffon, scene, folder)?;
    }
    Ok(render.page.clone())
}

fn main() -> ExitCode {
    let arguments: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [buffon, scene, folder] = arguments.as_slice() else {
        eprintln!("usage: check_watch BUFFON SCENE DIR");
        return ExitCode::from(2);
    };
    match check(buffon, scene, folder) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("check_watch: {}: {error}", scene.display());
            ExitCode::FAILURE
        }
    }
}
