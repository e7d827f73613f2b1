//! The page: plots, bars, tables, images and the viewer.

use super::{BenchRow, Combination, Report, SceneReport, handicaps, tables};
use crate::error::Result;
use crate::report::{
    Axis, Bar, Bars, Html, Line, MOST_PIXELS, Page, Picture, Plot, Point, Series, Viewer, error_thumbnail,
    exposure_of, gallery, number, thumbnail,
};
use crate::util::relative;
use std::path::Path;

/// Width of the small images in pixels.
const THUMBNAIL: usize = 240;

/// Creates the page of a benchmark, with paths relative to its folder.
///
/// # Errors
/// If an image cannot be encoded.
pub fn page(report: &Report, folder: &Path) -> Result<Page> {
    let options = &report.options;
    let names: Vec<String> = report.scenes.iter().map(SceneReport::name).collect();
    let mut page = Page::new(format!("Speed against error: {}", names.join(", ")));
    page.lead(&Html::paragraph(&format!(
        "Each combination of integrator, sampler and traversal was rendered with each budget, {} with {} and {}. \
         The renders took turns; figures are medians.",
        crate::error::counted(options.runs, "time", "times"),
        crate::error::counted(options.threads as u64, "thread", "threads"),
        if options.runs == 1 { "one seed" } else { "another seed every time" },
    )));
    let mut winners = Vec::new();
    for scene in &report.scenes {
        winners.extend(winner(scene));
    }
    page.lead(&Html::list(winners));
    let mut pixels = MOST_PIXELS;
    for scene in &report.scenes {
        page.section(scene.name(), section(report, scene, folder, &mut pixels)?);
    }
    page.section("How to read this", explanation(report));
    page.circumstances();
    Ok(page)
}

/// Integrators that omit part of the light. Their error is small at small budgets, but does not converge to zero.
const INCOMPLETE: [&str; 2] = ["direct", "whitted"];

/// Returns the most efficient combination of a scene at its last budget. If any integrator renders all light, only
/// those that do are compared.
fn winner(scene: &SceneReport) -> Option<String> {
    let last = |row: &BenchRow| row.medians().last().copied().flatten();
    let complete = |row: &BenchRow| !INCOMPLETE.contains(&row.combination.integrator.as_str());
    let some_complete = scene.rows.iter().any(|row| row.failure.is_none() && complete(row));
    let compared = scene.rows.iter().filter(|row| complete(row) || !some_complete);
    let mut rows: Vec<(f64, &BenchRow)> =
        compared.filter_map(|row| Some((last(row)?.efficiency, row))).collect();
    rows.sort_by(|a, b| b.0.total_cmp(&a.0));
    let (best, first) = rows.first()?;
    let lead = rows.get(1).map_or_else(String::new, |(second, row)| {
        format!(", {}× that of {}", number((best / second * 100.0).round() / 100.0), label(&row.combination))
    });
    Some(format!(
        "{}: most efficient is {}, at {} per second{lead}.",
        scene.name(),
        label(&first.combination),
        number(three_digits(*best))
    ))
}

fn label(c: &Combination) -> String {
    format!("{}\u{a0}· {}\u{a0}· {}", c.integrator, c.sampler, c.accel)
}

fn section(report: &Report, scene: &SceneReport, folder: &Path, pixels: &mut usize) -> Result<Html> {
    let [width, height] = scene.size;
    let reference = tables::reference(scene, Some(folder));
    let triangles = crate::error::counted(scene.triangles as u64, "triangle", "triangles");
    let mut html = Html::paragraph(&format!(
        "{}: {width} × {height} pixels, {triangles}; {reference}.",
        relative(&scene.path, folder).display()
    ));
    let mut figures = convergence(report, scene).html();
    figures.push(&efficiency(scene).html());
    figures.push(&rays(scene).html());
    html.push(&Html::element("div", "figures", &figures));
    html.push(&tables::figures(report, scene).html());
    for reason in tables::unknown_slopes(scene) {
        html.push(&Html::element("p", "note", &Html::text(&reason)));
    }
    if tables::any_near_floor(scene) {
        html.push(&Html::element("p", "note", &Html::text(tables::NEAR_FLOOR)));
    }
    html.push(&Html::element("h3", "", &Html::text("Pictures and errors at the last budget")));
    html.push(&gallery(&pictures(scene)?));
    html.push(&viewer(scene, pixels)?);
    Ok(html)
}

/// Returns the rows with measurements, each with the style of its integrator and sampler. All traversals of one
/// integrator and sampler have the same style.
fn styled(scene: &SceneReport) -> Vec<(usize, &BenchRow)> {
    let mut seen: Vec<(&str, String)> = Vec::new();
    let rows = scene.rows.iter().filter(|row| row.cells.iter().any(|runs| !runs.is_empty()));
    rows.map(|row| {
        let key = (row.combination.integrator.as_str(), row.combination.sampler.to_string());
        let style = seen.iter().position(|s| *s == key).unwrap_or_else(|| {
            seen.push(key);
            seen.len() - 1
        });
        (style, row)
    })
    .collect()
}

/// Plots relMSE against seconds.
fn convergence(report: &Report, scene: &SceneReport) -> Plot {
    let accels = &report.options.accels;
    let mut series = Vec::new();
    for (style, row) in styled(scene) {
        let mut points: Vec<Point> = row
            .medians()
            .into_iter()
            .zip(&report.options.budgets)
            .filter_map(|(median, budget)| {
                let m = median?;
                Some(Point {
                    interval: (report.options.runs > 1).then_some(m.relmse_range),
                    note: format!("{budget}, {} spp", m.samples_per_pixel),
                    ..Point::new(m.seconds, m.relmse)
                })
            })
            .collect();
        points.sort_by(|a, b| a.x.total_cmp(&b.x));
        let place = accels.iter().position(|accel| *accel == row.combination.accel);
        let line = [Line::Solid, Line::Dashed, Line::Dotted][place.unwrap_or(0).min(2)];
        series.push(Series { name: label(&row.combination), points, style, line });
    }
    // The law of independent samples, through the first point with the greatest error.
    if let Some(start) = series.iter().flat_map(|s| s.points.first()).max_by(|a, b| a.y.total_cmp(&b.y)) {
        let law = |x: f64| Point::new(x, start.y * start.x / x);
        let points = vec![law(start.x * 1e-6), law(start.x * 1e6)];
        series.push(Series { name: "slope −1".into(), points, line: Line::Guide, ..Series::default() });
    }
    Plot {
        title: format!("{}: error against time", scene.name()),
        x: Axis::log("seconds of sampling"),
        y: Axis::log("relMSE"),
        series,
    }
}

/// Plots the efficiency at the last budget.
fn efficiency(scene: &SceneReport) -> Bars {
    let bars = styled(scene).into_iter().filter_map(|(style, row)| {
        let median = row.medians().last().copied().flatten()?;
        Some(Bar {
            name: label(&row.combination),
            value: three_digits(median.efficiency),
            style,
            ..Bar::default()
        })
    });
    Bars {
        title: format!("{}: efficiency at the last budget", scene.name()),
        unit: "1/s".into(),
        bars: bars.collect(),
    }
}

/// Plots the median rays per second by traversal and kind of query, over all combinations.
fn rays(scene: &SceneReport) -> Bars {
    let mut bars = Vec::new();
    for (style, traversal) in scene.traversals.iter().enumerate() {
        let rows = || scene.rows.iter().filter(|row| row.combination.accel == traversal.accel);
        for (i, kind) in ["nearest hits", "occlusion"].into_iter().enumerate() {
            let rates: Vec<f64> =
                rows().map(|row| row.mrays_per_thread_second()[i]).filter(|v| v.is_finite()).collect();
            let Some(value) = super::summary::median(rates.clone()) else { continue };
            let ends = [f64::min, f64::max].map(|pick| rates.iter().copied().fold(value, pick));
            let range = (rates.len() > 1).then_some(ends);
            let name = format!("{}: {kind}", traversal.accel);
            bars.push(Bar { name, value: three_digits(value), range, style });
        }
    }
    Bars {
        title: format!("{}: ray queries, per thread and second inside the traversal", scene.name()),
        unit: "Mray/s".into(),
        bars,
    }
}

fn three_digits(value: f64) -> f64 {
    format!("{value:.2e}").parse().unwrap_or(value)
}

/// Returns each combination's image and error map.
fn pictures(scene: &SceneReport) -> Result<Vec<Picture>> {
    let reference = &scene.reference.image;
    let exposure = exposure_of(reference);
    let mut pictures = vec![Picture {
        images: vec![thumbnail(reference, THUMBNAIL, exposure)?],
        title: "reference".into(),
        note: scene.reference.floor.map_or_else(String::new, |f| format!("relMSE about {}", number(f))),
    }];
    for row in &scene.rows {
        let (Some(image), Some(Some(m))) = (&row.image, row.medians().pop()) else { continue };
        pictures.push(Picture {
            images: vec![
                thumbnail(image, THUMBNAIL, exposure)?,
                error_thumbnail(image, reference, THUMBNAIL)?,
            ],
            title: label(&row.combination),
            note: format!(
                "{:.2} s, {} spp, relMSE {}",
                m.seconds,
                m.samples_per_pixel,
                number(three_digits(m.relmse))
            ),
        });
    }
    Ok(pictures)
}

/// Returns the viewer, with as many images as the limit of the page allows.
fn viewer(scene: &SceneReport, pixels: &mut usize) -> Result<Html> {
    let each = scene.size[0] * scene.size[1];
    let mut images = vec![("reference".to_string(), &scene.reference.image)];
    images.extend(scene.rows.iter().filter_map(|row| Some((label(&row.combination), row.image.as_ref()?))));
    let (all, room) = (images.len(), *pixels / each.max(1));
    images.truncate(room);
    *pixels -= images.len() * each;
    if images.len() < 2 {
        let reason = "The viewer is left out: the images are too large for one page, or there is none.";
        return Ok(Html::element("p", "note", &Html::text(reason)));
    }
    let left_out = all - images.len();
    let viewer = Viewer {
        title: format!("{}: side by side", scene.name()),
        images,
        reference: Some(0),
        left: 1,
        right: 0,
        exposure: exposure_of(&scene.reference.image),
    };
    let mut html = viewer.html()?;
    let mut note = "Drag the divider, or use the arrow keys on it. Double-click, pinch, or turn the wheel with Ctrl \
                    held to zoom; drag to pan. Images and errors can be chosen for either side; the page holds them \
                    as half floats."
        .to_string();
    if left_out > 0 {
        note.push_str(&format!(" {left_out} more images are left out for want of room."));
    }
    html.push(&Html::element("p", "note", &Html::text(&note)));
    Ok(html)
}

fn explanation(report: &Report) -> Html {
    let mut html = Html::list([
        "relMSE is the mean over pixels and channels of (x − r)² / (r² + 0.01), x the image and r the reference. It \
         holds the reference's own error, which stands above each table. An integrator that leaves light out keeps an \
         error that no time removes.",
        "trimmed is relMSE without the 0.1 % worst pixels: what is left when a few rare bright paths do not decide.",
        "FLIP is what a viewer sees when the image and the reference alternate, from 0 to 1, at the worst of several \
         exposures: buffon diff --metric flip makes maps of it.",
        "Efficiency is 1 / (relMSE · seconds): twice the efficiency is half the time to the same error. Seconds \
         are wall time of sampling alone.",
        "Mray/s in the table counts all queries over wall time, shading and sampling included; in the bars it is \
         per thread and per second inside the traversal, and the black line spans the combinations.",
        "The slope is that of log relMSE against log seconds over all runs, with its 95 % interval. Independent \
         samples give −1; an interval from few runs is wide, and no slope is stated if it is wider than 1. \
         Error bars in the plot span the runs.",
    ]);
    html.push(&Html::element("h3", "", &Html::text("The traversals and their handicaps")));
    let threads = report.options.threads;
    html.push(&Html::list(report.options.accels.iter().map(|&accel| handicaps::of(accel, threads))));
    let costs = report.scenes.iter().flat_map(|scene| {
        scene.traversals.iter().map(|t| format!("{}, {}", scene.name(), handicaps::cost(t)))
    });
    html.push(&Html::list(costs));
    html
}
