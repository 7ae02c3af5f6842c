//! The demo's report: pictures of the scan, a top view with truth and estimate, the figures.

use std::fmt::Write;

use volery_geometry::Point3;
use volery_synthetic::DemoHall;

use super::{DemoReport, flight_plots};
use crate::plot::TopView;

/// Photos shown.
const NUM_PICTURES: usize = 8;

pub(super) fn page(hall: &DemoHall, report: &DemoReport) -> String {
    let mut html = String::new();
    // Writing to a string cannot fail.
    let _ = write_page(&mut html, hall, report);
    html
}

fn write_page(html: &mut String, hall: &DemoHall, report: &DemoReport) -> std::fmt::Result {
    let score = &report.score;
    write!(
        html,
        "<!doctype html><html lang=en><meta charset=utf-8><title>Volery demo</title><style>\
         body{{font:15px/1.45 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem}}\
         table{{border-collapse:collapse}}td,th{{border-bottom:1px solid #ddd;padding:.25rem .6rem;\
         text-align:left}}img{{width:24%;margin:.2%}}svg{{background:#f6f6f4;border:1px solid #ddd;\
         max-width:100%}}</style><h1>Volery demo</h1>\
         <p>A virtual drone scanned a synthetic hall; the ground station made a map of its photos \
         and told the places of other photos in it. All of it is compared with the truth.</p>"
    )?;
    let rows = [
        ("photos in the map", format!("{} of {}", score.num_registered, score.num_scan)),
        ("position error", format!("{:.1} mm rms", score.ate_m * 1e3)),
        ("rotation error", format!("{:.3}° median", score.rotation_deg)),
        ("scale error", format!("{:.2} %", score.scale_error * 100.0)),
        ("gravity error", format!("{:.2}°", score.gravity_deg)),
        (
            "mesh",
            format!(
                "<a href=map.glb>{} triangles</a>, median {:.1} mm from the true surfaces",
                score.num_triangles,
                score.mesh_m * 1e3
            ),
        ),
        ("queries placed", format!("{} of {}", score.num_localized, score.num_queries)),
        (
            "error of the queries",
            format!("{:.1} mm, {:.3}° median", score.query_m * 1e3, score.query_deg),
        ),
        ("map", report.map["quality"]["verdict"].as_str().unwrap_or("?").to_owned()),
    ];
    html.push_str("<table>");
    for (name, value) in rows {
        write!(html, "<tr><th>{name}<td>{value}")?;
    }
    html.push_str("</table><h2>Scan</h2>");
    let step = hall.scan.len().div_ceil(NUM_PICTURES).max(1);
    for shot in hall.scan.iter().step_by(step) {
        write!(html, "<img src='scan/{0}' alt='{0}'>", shot.name)?;
    }
    html.push_str(
        "<h2>Top view</h2><p>Gray: truth. Blue: the map's cameras. Orange: photos that were \
         localized, with a line to where they really were.</p>",
    );
    html.push_str(&top_view(hall, report));
    html.push_str("<h2>Queries</h2>");
    for shot in &hall.queries {
        write!(html, "<img src='query/{0}' alt='{0}'>", shot.name)?;
    }
    html.push_str("<table><tr><th>photo<th>answer<th>position<th>rotation<th>inliers<th>time");
    for query in &report.queries {
        let answer = query.reason.as_deref().unwrap_or("ok");
        let number = |value: Option<f64>, factor: f64, unit: &str| {
            value.map_or(String::new(), |v| format!("{:.3} {unit}", v * factor))
        };
        write!(
            html,
            "<tr><td>{}<td>{answer}<td>{}<td>{}<td>{}<td>{:.0} ms",
            query.name,
            number(query.error_m, 1e3, "mm"),
            number(query.error_deg, 1.0, "°"),
            query.num_inliers,
            query.total_ms
        )?;
    }
    html.push_str("</table>");
    if let Some(flight) = &report.flight {
        flight_plots::section(html, hall, flight)?;
    }
    html.push_str("<h2>Time</h2><table>");
    for (what, seconds) in &report.stages {
        write!(html, "<tr><th>{what}<td>{seconds:.1} s")?;
    }
    html.push_str("</table></html>\n");
    Ok(())
}

fn top_view(hall: &DemoHall, report: &DemoReport) -> String {
    let size = hall.hall.room.size;
    let mut view = TopView::new(size.x, size.y);
    let centers = &report.score.centers;
    view.line("#999", 2.0, centers.iter().map(|(_, truth)| *truth));
    view.line("#1f5fbf", 2.0, centers.iter().map(|(found, _)| *found));
    for (found, _) in centers {
        view.dot("#1f5fbf", 2.5, found, "");
    }
    for (query, shot) in report.queries.iter().zip(&hall.queries) {
        let truth = Point3::from(shot.cam_from_world.inverse().translation.vector);
        view.ring("#999", 5.0, &truth);
        if let Some(found) = &query.place {
            view.line("#c2410c", 1.0, [truth, *found]);
            view.dot("#c2410c", 3.5, found, &query.name);
        }
    }
    view.finish()
}
