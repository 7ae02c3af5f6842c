//! The report of a registration for people.

use std::fmt::Write;

use super::report::{FoundBy, PairReport, RegisterReport};
use crate::report_html::{STYLE, escape};

/// The page.
pub(super) fn page(report: &RegisterReport) -> String {
    let mut html = String::new();
    // Writing to a string cannot fail.
    let _ = write_page(&mut html, report);
    html
}

fn write_page(html: &mut String, report: &RegisterReport) -> std::fmt::Result {
    write!(
        html,
        "<!doctype html><html lang=en><meta charset=utf-8>\
         <meta name=viewport content='width=device-width'><title>Joined maps</title>\
         <style>{STYLE}</style><h1>Joined maps</h1>"
    )?;
    if let Some(lack) = report.lack() {
        write!(html, "<p class=suspect>{}: {}</p>", escape(&lack.code), escape(&lack.detail))?;
    }
    let error = report.reprojection_px.map_or(String::new(), |px| format!(", {px:.2} px"));
    write!(
        html,
        "<p>{} points, {} shared{error}</p>",
        report.num_points, report.num_shared_points
    )?;
    write!(html, "<h2>Maps</h2><table><tr><th>Map<th class=n>Images<th class=n>Scale<th>Joined")?;
    for map in &report.maps {
        let (class, joined) = if map.joined { ("", "yes") } else { ("off", "no") };
        let (name, images, scale) = (escape(&map.name), map.num_images, map.scale);
        write!(
            html,
            "<tr class='{class}'><td>{name}<td class=n>{images}<td class=n>{scale:.4}<td>{joined}"
        )?;
    }
    write!(
        html,
        "</table><h2>Pairs</h2><table><tr><th>Moved<th>Onto<th class=n>Points<th class=n>Fitness\
         <th class=n>Overlap<th class=n>RMS<th>By<th>"
    )?;
    report.pairs.iter().try_for_each(|pair| write_pair(html, pair))?;
    write!(html, "</table>")?;
    if let Some(dense) = report.dense.as_ref().filter(|dense| dense.error.is_none()) {
        let maps = dense.num_depth_maps;
        write!(html, "<h2>Surface</h2><p>{} points of {maps} depth maps", dense.num_points)?;
        let triangles = report.mesh.as_ref().map(|mesh| mesh.num_triangles);
        write!(html, ", {} triangles</p>", triangles.unwrap_or(0))?;
    }
    if report.photos.is_empty() {
        return Ok(());
    }
    write!(html, "<h2>Photos</h2><table><tr><th>Photo<th>Joined<th>")?;
    for photo in &report.photos {
        let (class, joined) = if photo.joined { ("", "yes") } else { ("off", "no") };
        let reason = photo.reason.as_deref().unwrap_or_default();
        let same_as = photo.same_as.as_ref().map_or(String::new(), |name| format!(": {name}"));
        write!(
            html,
            "<tr class='{class}'><td>{}<td>{joined}<td>{reason}{}",
            escape(&photo.name),
            escape(&same_as)
        )?;
    }
    write!(html, "</table>")
}

fn write_pair(html: &mut String, pair: &PairReport) -> std::fmt::Result {
    let class = if pair.used { "" } else { "off" };
    let rms = pair.rms.map_or(String::new(), |rms| format!("{rms:.3}"));
    let error = pair.error.as_ref().map_or("", |error| &error.detail);
    let by = match pair.by {
        Some(FoundBy::Points) => "points",
        Some(FoundBy::Surfaces) => "surfaces",
        None => "",
    };
    write!(
        html,
        "<tr class='{class}'><td>{}<td>{}<td class=n>{} of {}<td class=n>{:.2}<td class=n>{:.2}\
         <td class=n>{rms}<td>{by}<td>{}",
        escape(&pair.source),
        escape(&pair.target),
        pair.num_inliers,
        pair.num_pairs,
        pair.fitness,
        pair.overlap,
        escape(error)
    )
}
