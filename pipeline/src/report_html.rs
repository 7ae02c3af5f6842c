//! The report for people: one file without any other.

use std::fmt::Write;

use nalgebra::Vector3;
use serde::Serialize;
use volery_scene::{EnvironmentMap, Verdict};

use crate::{
    export::bounds,
    report_surface::{SurfacePictures, section},
    summary::{ImageReport, Summary},
};

/// Points drawn at most.
const MAX_POINTS: usize = 6000;

/// Longer side of the top view, pixels.
const VIEW_SIZE: f64 = 720.0;

pub(crate) const STYLE: &str = "body{font:15px/1.45 system-ui,sans-serif;max-width:60rem;margin:2rem auto;\
padding:0 1rem;color:#1b1b1b}table{border-collapse:collapse;width:100%}\
td,th{border-bottom:1px solid #ddd;padding:.25rem .5rem;text-align:left}\
td.n,th.n{text-align:right;font-variant-numeric:tabular-nums}\
.good{color:#17692b}.suspect{color:#9a6200}.failed{color:#a3161a}\
img{max-width:100%}.views td{width:33%;vertical-align:bottom}.views img{width:100%}\
svg{background:#f6f6f4;border:1px solid #ddd;max-width:100%;height:auto}\
tr.off td{color:#a3161a}";

/// The page.
pub(crate) fn page(
    summary: &Summary,
    map: Option<&EnvironmentMap>,
    pictures: &SurfacePictures,
) -> String {
    let mut html = String::with_capacity(64 << 10);
    // Writing to a string cannot fail.
    let _ = write_page(&mut html, summary, map, pictures);
    html
}

fn write_page(
    html: &mut String,
    summary: &Summary,
    map: Option<&EnvironmentMap>,
    pictures: &SurfacePictures,
) -> std::fmt::Result {
    let (class, verdict) = match summary.quality.verdict {
        Verdict::Good => ("good", "good"),
        Verdict::Suspect => ("suspect", "suspect"),
        Verdict::Failed => ("failed", "failed"),
    };
    write!(
        html,
        "<!doctype html><html lang=en><meta charset=utf-8>\
         <meta name=viewport content='width=device-width'><title>Map report</title>\
         <style>{STYLE}</style><h1>Map report</h1>\
         <p><b class={class}>Verdict: {verdict}</b></p>"
    )?;
    list(html, summary.quality.reasons.iter().map(|r| format!("{}: {}", r.code, r.detail)))?;
    if let Some(error) = &summary.error {
        let hint = error.hint.as_deref().unwrap_or_default();
        write!(html, "<p class=failed>{}</p><p>{}</p>", escape(&error.detail), escape(hint))?;
    }
    facts(html, summary)?;
    if let Some(map) = map {
        html.push_str("<h2>Top view</h2>");
        top_view(html, map)?;
    }
    section(html, summary, pictures)?;
    if !summary.warnings.is_empty() {
        html.push_str("<h2>Warnings</h2>");
        list(
            html,
            summary.warnings.iter().map(|w| match &w.hint {
                Some(hint) => format!("{} ({hint})", w.detail),
                None => w.detail.clone(),
            }),
        )?;
    }
    if !summary.advice.is_empty() {
        html.push_str("<h2>For the next capture</h2>");
        list(html, summary.advice.iter().cloned())?;
    }
    html.push_str(
        "<h2>Stages</h2><table><tr><th>stage<th class=n>units<th class=n>cached\
         <th class=n>wall s<th class=n>CPU s<th class=n>peak MiB so far",
    );
    for stage in &summary.stages {
        write!(
            html,
            "<tr><td>{}<td class=n>{}<td class=n>{}<td class=n>{:.2}<td class=n>{:.2}<td class=n>{}",
            escape(&stage.name),
            stage.units,
            stage.cached,
            stage.wall_s,
            stage.cpu_s,
            stage.peak_rss_mib.map_or(String::new(), |mib| format!("{mib:.0}"))
        )?;
    }
    write!(
        html,
        "<tr><td>all<td><td><td class=n>{:.2}<td class=n>{:.2}</table>",
        summary.wall_s, summary.cpu_s
    )?;
    html.push_str(
        "<h2>Images</h2><table><tr><th>image<th>pose<th class=n>features\
         <th class=n>points seen<th class=n>error px",
    );
    summary.images.iter().try_for_each(|image| image_row(html, image))?;
    html.push_str("</table></html>\n");
    Ok(())
}

fn facts(html: &mut String, summary: &Summary) -> std::fmt::Result {
    let number = |value: Option<f64>, digits: usize, unit: &str| {
        value.map_or("unknown".to_owned(), |v| format!("{v:.digits$}{unit}"))
    };
    let scale = if summary.scale.metric {
        let sigma = number(summary.scale.sigma_rel.map(|s| s * 100.0), 2, " %");
        format!("metric, from {}, sigma {sigma}", words(&summary.scale.source))
    } else {
        "NOT METRIC".to_owned()
    };
    let gravity_sigma = number(summary.gravity.sigma.map(f64::to_degrees), 2, "°");
    let rows = [
        ("images with a pose", format!("{} of {}", summary.num_registered, summary.num_images)),
        ("points", summary.num_points.to_string()),
        ("observations", summary.num_observations.to_string()),
        ("mean reprojection error", number(summary.mean_reprojection_px, 3, " px")),
        ("mean track length", number(summary.mean_track_length, 2, "")),
        ("verified image pairs", summary.num_verified_pairs.to_string()),
        ("other zones", summary.num_zones.to_string()),
        ("mapper", summary.mapper.clone()),
        ("scale", scale),
        ("gravity", format!("from {}, sigma {gravity_sigma}", words(&summary.gravity.source))),
        ("origin", words(&summary.origin)),
        ("peak memory", number(summary.peak_rss_mib, 0, " MiB")),
    ];
    html.push_str("<table>");
    for (name, value) in rows {
        write!(html, "<tr><th>{name}<td>{}", escape(&value))?;
    }
    for (i, camera) in summary.cameras.iter().enumerate() {
        let params: Vec<String> = camera.camera.params.iter().map(|p| format!("{p:.5}")).collect();
        write!(
            html,
            "<tr><th>camera {i}<td>{} {}x{}, {} images, {} (focal {:.1} px): {}",
            camera.camera.model.name(),
            camera.camera.width,
            camera.camera.height,
            camera.num_images,
            words(&camera.source),
            camera.initial_focal_px,
            params.join(", ")
        )?;
    }
    html.push_str("</table>");
    Ok(())
}

/// The name of a choice as people write it.
fn words(choice: &impl Serialize) -> String {
    let name = serde_json::to_value(choice).unwrap_or_default();
    name.as_str().unwrap_or_default().replace('_', " ")
}

/// Points and cameras from above: map x up, map y to the left.
fn top_view(html: &mut String, map: &EnvironmentMap) -> std::fmt::Result {
    let centers: Vec<_> = map.model.images.values().map(|image| image.center()).collect();
    let [mut low, mut high] = bounds(&map.model).unwrap_or([[0.0; 3]; 2]);
    for center in &centers {
        for axis in 0..3 {
            low[axis] = low[axis].min(center[axis]);
            high[axis] = high[axis].max(center[axis]);
        }
    }
    let extent = (high[0] - low[0]).max(high[1] - low[1]).max(1e-9);
    let scale = VIEW_SIZE / (1.1 * extent);
    let margin = 0.05 * extent * scale;
    let place = |x: f64, y: f64| ((high[1] - y) * scale + margin, (high[0] - x) * scale + margin);
    let (width, height) = place(low[0], low[1]);
    write!(
        html,
        "<svg viewBox='0 0 {:.0} {:.0}' width='{:.0}' role=img aria-label='map from above'>",
        width + margin,
        height + margin,
        width + margin
    )?;
    let step = map.model.points.len().div_ceil(MAX_POINTS).max(1);
    for point in map.model.points.values().step_by(step) {
        let inside = (0..2).all(|a| (low[a]..=high[a]).contains(&point.position[a]));
        if inside {
            let (u, v) = place(point.position.x, point.position.y);
            let [r, g, b] = point.color;
            write!(html, "<circle cx='{u:.1}' cy='{v:.1}' r='1' fill='rgb({r},{g},{b})'/>")?;
        }
    }
    html.push_str("<polyline fill='none' stroke='#1f5fbf' stroke-width='1.2' points='");
    for center in &centers {
        let (u, v) = place(center.x, center.y);
        write!(html, "{u:.1},{v:.1} ")?;
    }
    html.push_str("'/>");
    for image in map.model.images.values() {
        let center = image.center();
        let forward = image.cam_from_world.rotation.inverse() * Vector3::z();
        let (u, v) = place(center.x, center.y);
        let (du, dv) = (-forward.y * 9.0, -forward.x * 9.0);
        write!(
            html,
            "<line x1='{u:.1}' y1='{v:.1}' x2='{:.1}' y2='{:.1}' stroke='#c2410c' \
             stroke-width='1.5'><title>{}</title></line>",
            u + du,
            v + dv,
            escape(&image.name)
        )?;
    }
    let unit = if map.scale.metric { "m" } else { "units (not metric)" };
    let length = 10_f64.powf((extent / 3.0).log10().floor());
    write!(
        html,
        "<line x1='12' y1='{y:.1}' x2='{:.1}' y2='{y:.1}' stroke='#111' stroke-width='2'/>\
         <text x='12' y='{:.1}' font-size='12'>{length} {unit}</text></svg>",
        12.0 + length * scale,
        height + margin - 14.0,
        y = height + margin - 8.0
    )
}

fn image_row(html: &mut String, image: &ImageReport) -> std::fmt::Result {
    let (class, pose) = match (image.registered, &image.duplicate_of, image.reason) {
        (_, Some(first), _) => ("", format!("repeats {first}")),
        (true, ..) => ("", "yes".to_owned()),
        (false, None, reason) => {
            let reason = reason.map_or("no map", |r| r.code());
            let detail = image.detail.as_deref().map_or(String::new(), |d| format!(" ({d})"));
            (" class=off", format!("{reason}{detail}"))
        }
    };
    write!(
        html,
        "<tr{class}><td>{}<td>{}<td class=n>{}<td class=n>{}<td class=n>{}",
        escape(&image.name),
        escape(&pose),
        image.num_features,
        image.num_observations,
        image.reprojection_px.map_or(String::new(), |e| format!("{e:.2}"))
    )
}

fn list(html: &mut String, items: impl Iterator<Item = String>) -> std::fmt::Result {
    html.push_str("<ul>");
    for item in items {
        write!(html, "<li>{}", escape(&item))?;
    }
    html.push_str("</ul>");
    Ok(())
}

/// Names and details come from strangers' files.
pub(crate) fn escape(text: &str) -> String {
    text.chars().fold(String::with_capacity(text.len()), |mut out, c| {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c => out.push(c),
        }
        out
    })
}
