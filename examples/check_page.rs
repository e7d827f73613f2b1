//! Opens a page of Buffon in headless Chromium and checks that it has plots and names, that the viewer's slider, zoom
//! and exposure change pixels, and that no error is logged. Saves screenshots.
//!
//! `cargo run --example check_page -- PAGE.html DIR`

#[path = "support/browser.rs"]
mod browser;

use browser::{Browser, PIXELS, Result, expect};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Checks the content that every page must have.
fn check_content(browser: &mut Browser) -> Result<()> {
    let count = |browser: &mut Browser, selector: &str| {
        browser
            .evaluate(&format!("document.querySelectorAll('{selector}').length"))
            .map(|v| v.as_u64().unwrap_or(0))
    };
    let (plots, markers) = (count(browser, ".plot > svg")?, count(browser, ".plot > svg .marker")?);
    expect(plots >= 1 && markers >= 2, &format!("plots are there ({plots} with {markers} markers)"))?;
    let tables = count(browser, "table tbody tr")?;
    expect(tables >= 1, &format!("tables have rows ({tables})"))?;
    let broken = browser.evaluate("[...document.images].filter((i) => !i.naturalWidth).length")?;
    expect(broken == 0, "every picture is shown")?;
    let wide = browser.evaluate("document.documentElement.scrollWidth > innerWidth")?;
    expect(wide == false, "nothing is wider than the window")
}

/// Uses the slider, zoom, pan and exposure, and checks that pixels change.
fn check_viewer(browser: &mut Browser) -> Result<()> {
    let mut seen = browser.evaluate(PIXELS)?;
    expect(seen[1].as_u64().unwrap_or(0) > 8, "the viewer shows a picture")?;
    let mut changes = |browser: &mut Browser, what: &str| {
        browser.evaluate("new Promise((r) => setTimeout(r, 150))")?;
        let now = browser.evaluate(PIXELS)?;
        let changed = now != seen;
        seen = now;
        expect(changed, what)
    };
    let [x, y] = browser.centre(".viewer .divider")?;
    browser.mouse("mousePressed", [x, y])?;
    browser.mouse("mouseMoved", [x - 40.0, y])?;
    browser.mouse("mouseMoved", [x - 90.0, y])?;
    browser.mouse("mouseReleased", [x - 90.0, y])?;
    let value =
        browser.evaluate("Number(document.querySelector('.divider').getAttribute('aria-valuenow'))")?;
    expect(value.as_f64().is_some_and(|v| v < 50.0), "the slider moves with the mouse")?;
    changes(browser, "the slider changes pixels")?;
    let told = browser.evaluate(
        "(() => { const c = document.querySelector('.viewer canvas'), b = c.getBoundingClientRect(); \
         c.dispatchEvent(new PointerEvent('pointermove', { clientX: b.x + b.width / 2 + 5, clientY: b.y + b.height / 2 })); \
         return new Promise((r) => setTimeout(() => r(document.querySelector('.readout').textContent), 150)); })()",
    )?;
    let told = told.as_str().unwrap_or_default().to_owned();
    expect(told.starts_with("pixel ") && told.contains("right"), &format!("values are told (\"{told}\")"))?;
    for _ in 0..3 {
        browser.click(".viewer .in")?;
    }
    changes(browser, "zoom changes pixels")?;
    let [x, y] = browser.centre(".viewer canvas")?;
    browser.mouse("mousePressed", [x + 60.0, y])?;
    browser.mouse("mouseMoved", [x + 30.0, y + 20.0])?;
    browser.mouse("mouseMoved", [x, y + 40.0])?;
    browser.mouse("mouseReleased", [x, y + 40.0])?;
    changes(browser, "panning changes pixels")?;
    browser.click(".viewer .fit")?;
    changes(browser, "fitting changes pixels")?;
    browser.evaluate(
        "(() => { const e = document.querySelector('.viewer .exposure'); e.value = Number(e.value) + 2; \
         e.dispatchEvent(new Event('input')); })()",
    )?;
    changes(browser, "exposure changes pixels")?;
    let errors = browser.evaluate(
        "(() => { const p = document.querySelector('.viewer .pick-right'); \
         const e = [...p.options].find((o) => o.value.startsWith('e')); if (!e) return false; \
         p.value = e.value; p.dispatchEvent(new Event('change')); return true; })()",
    )?;
    if errors == true {
        changes(browser, "the error map changes pixels")?;
        let legend = browser.evaluate("!document.querySelector('.viewer .heat').hidden")?;
        expect(legend == true, "the error map has a legend")?;
    }
    Ok(())
}

fn check(page: &Path, folder: &Path) -> Result<()> {
    let path = page.canonicalize().map_err(|e| format!("{}: {e}", page.display()))?;
    std::fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    // Other characters with a meaning in URLs are rare in the names of temporary folders.
    let address = format!(
        "file://{}",
        path.display().to_string().replace('%', "%25").replace('#', "%23").replace('?', "%3F")
    );
    let mut browser = Browser::start(&["file:", "data:", "about:"])?;
    for (name, size, theme, phone) in [
        ("desktop-light", [1280, 900], "light", false),
        ("desktop-dark", [1280, 900], "dark", false),
        ("phone-light", [390, 844], "light", true),
        ("phone-dark", [390, 844], "dark", true),
    ] {
        println!("{name}:");
        browser.open(&address, size, theme, phone)?;
        check_content(&mut browser)?;
        browser.grow(size[0], phone)?;
        browser.screenshot(&folder.join(format!("{name}.png")))?;
        let viewers = browser.evaluate("document.querySelectorAll('.viewer').length")?;
        if !phone && viewers != 0 {
            browser.open(&address, size, theme, phone)?;
            check_viewer(&mut browser)?;
            browser.screenshot(&folder.join(format!("{name}-viewer.png")))?;
        }
    }
    expect(browser.errors.is_empty(), &format!("nothing is logged as an error {:?}", browser.errors))
}

fn main() -> ExitCode {
    let arguments: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [page, folder] = arguments.as_slice() else {
        eprintln!("usage: check_page PAGE.html DIR");
        return ExitCode::from(2);
    };
    match check(page, folder) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("check_page: {}: {error}", page.display());
            ExitCode::FAILURE
        }
    }
}
