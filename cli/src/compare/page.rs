//! The comparison as a page and as plots.

use std::fmt::Write;

use volery_synthetic::Room;

use super::{Comparison, RADIO, System};
use crate::plot::{Series, TopView, chart, color};

/// Files of the plots, with what they show.
const PLOTS: [(&str, &str); 4] = [
    ("ways.svg", "Ways from above; gray: the truth"),
    ("errors.svg", "Error at each place, meters"),
    ("near.svg", "The same without radio, centimeters"),
    ("noise.svg", "Median level error of radio over the noise of its strength"),
];

/// Names and contents of the plots.
pub(super) fn plots(room: &Room, comparison: &Comparison) -> [(&'static str, String); 4] {
    let all = errors(comparison, "m", 1.0, |_| true);
    let near = errors(comparison, "cm", 1e2, |system| system.name != RADIO);
    let texts = [ways(room, comparison), all, near, noise(comparison)];
    let mut texts = texts.into_iter();
    PLOTS.map(|(name, _)| (name, texts.next().unwrap_or_default()))
}

pub(super) fn page(comparison: &Comparison) -> String {
    let mut html = "<!doctype html><html lang=en><meta charset=utf-8><title>Positioning compared\
        </title><style>body{font:15px/1.45 system-ui,sans-serif;max-width:60rem;margin:2rem auto;\
        padding:0 1rem}table{border-collapse:collapse}td,th{border-bottom:1px solid #ddd;\
        padding:.25rem .6rem;text-align:left}img{max-width:100%;background:#f6f6f4;\
        border:1px solid #ddd}</style><h1>Positioning compared</h1><p>One flight through one hall. \
        Camera: each photo is localized alone in a map made of a scan. Radio: the strength of three \
        emitters, in the plane of the mean height. Ultrasound: distances to the emitters in sight, \
        and the height over whatever is below.</p><table><tr><th>system<th>places<th>median\
        <th>p95<th>largest<th>level, rms<th>height, rms"
        .to_owned();
    for system in &comparison.systems {
        // Writing to a string cannot fail.
        let _ = match &system.figures {
            None => write!(html, "<tr><th>{}<td colspan=6>no answers", system.name),
            Some(f) => write!(
                html,
                "<tr><th>{}<td>{} of {}<td>{:.3} m<td>{:.3} m<td>{:.3} m<td>{:.3} m<td>{:.3} m",
                system.name,
                f.num_answered,
                f.num_asked,
                f.median_m,
                f.p95_m,
                f.max_m,
                f.rmse_horizontal_m,
                f.rmse_height_m
            ),
        };
    }
    html.push_str("</table>");
    for (name, words) in PLOTS {
        let _ = write!(html, "<h2>{words}</h2><img src='{name}' alt='{words}'>");
    }
    html.push_str("</html>\n");
    html
}

fn ways(room: &Room, comparison: &Comparison) -> String {
    let mut view = TopView::of(room);
    view.line("#999", 4.0, comparison.truth.iter().copied());
    for (index, system) in comparison.systems.iter().enumerate().rev() {
        for (truth, found) in comparison.truth.iter().zip(&system.estimates) {
            if let Some(found) = found {
                view.line(color(index), 0.6, [*truth, *found]);
                view.dot(color(index), 3.0, found, system.name);
            }
        }
    }
    view.finish()
}

fn errors(
    comparison: &Comparison,
    unit: &str,
    per_meter: f64,
    is_shown: impl Fn(&System) -> bool,
) -> String {
    let lines: Vec<_> = comparison
        .systems
        .iter()
        .enumerate()
        .filter(|(_, system)| is_shown(system))
        .map(|(index, system)| Series {
            name: system.name,
            color: color(index),
            points: comparison
                .truth
                .iter()
                .zip(&system.estimates)
                .enumerate()
                .filter_map(|(place, (truth, found))| {
                    Some([place as f64, (found.as_ref()? - truth).norm() * per_meter])
                })
                .collect(),
        })
        .collect();
    chart(["places", unit], &lines, None)
}

fn noise(comparison: &Comparison) -> String {
    let points = comparison.radio_by_noise.clone();
    chart(["dB", "m"], &[Series { name: RADIO, color: color(1), points }], None)
}
