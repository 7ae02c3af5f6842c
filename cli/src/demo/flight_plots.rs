//! The flight in the demo's report: ways from above, separation and errors over time, legs.

use std::fmt::Write;

use nalgebra::Point3;
use volery_synthetic::DemoHall;

use super::flight_score::FlightScore;
use crate::plot::{Series, TopView, chart, color};

pub(super) fn section(
    html: &mut String,
    hall: &DemoHall,
    flight: &FlightScore,
) -> std::fmt::Result {
    html.push_str(
        "<h2>Group flight</h2><p>Drones whose cameras are localized live in the map fly through \
         its middle to the other side and back, all at once.</p><table>",
    );
    let cm = |meters: f64| format!("{:.1} cm", meters * 1e2);
    let distance = flight.min_separation_m.map_or("-".to_owned(), |d| format!("{d:.2} m"));
    let frames: Vec<_> = flight.frames.iter().map(|(what, n)| format!("{n} {what}")).collect();
    let rows = [
        ("drones at all their goals", format!("{} of {}", flight.arrived, flight.drones)),
        ("farthest from a goal", flight.arrival_error_max_m.map_or("-".to_owned(), cm)),
        ("nearest to each other", distance),
        (
            "error of live poses",
            format!(
                "{} median, {} p95, {:.2}° median",
                cm(flight.pose_error_median_m),
                cm(flight.pose_error_p95_m),
                flight.pose_error_median_deg
            ),
        ),
        (
            "from picture to pose",
            format!("{:.0} ms median, {:.0} ms p95", flight.server_ms_median, flight.server_ms_p95),
        ),
        ("pictures", frames.join(", ")),
        ("in the air", format!("{:.0} s", flight.flight_s)),
    ];
    for (name, value) in rows {
        write!(html, "<tr><th>{name}<td>{value}")?;
    }
    html.push_str("</table>");
    for mishap in &flight.mishaps {
        write!(html, "<p>{mishap}")?;
    }
    html.push_str(
        "<p>Gray: where the drones truly flew. Colors: where the map placed their cameras. Rings: \
         goals.</p>",
    );
    html.push_str(&ways(hall, flight));
    html.push_str("<h3>Distance of the nearest two, meters</h3>");
    let separation = Series {
        name: "nearest pair in the air",
        color: color(0),
        points: flight.separations.iter().map(|&(t, d)| [t, d]).collect(),
    };
    html.push_str(&chart(["s", "m"], &[separation], Some((1.0, "least allowed"))));
    html.push_str("<h3>Error of live poses, centimeters</h3>");
    let names: Vec<String> = flight.paths.iter().map(|path| format!("drone {}", path.id)).collect();
    let errors: Vec<_> = flight
        .paths
        .iter()
        .enumerate()
        .map(|(index, path)| Series {
            name: &names[index],
            color: color(index),
            points: path.errors.iter().map(|&(t, e)| [t, e * 1e2]).collect(),
        })
        .collect();
    html.push_str(&chart(["s", "cm"], &errors, None));
    legs(html, flight)
}

fn ways(hall: &DemoHall, flight: &FlightScore) -> String {
    let mut view = TopView::of(&hall.hall.room);
    for (index, path) in flight.paths.iter().enumerate() {
        view.line("#999", 4.0, path.truth.iter().map(|(_, p)| *p));
        view.line(color(index), 1.2, path.believed.iter().map(|(_, p)| *p));
        for goal in &path.goals {
            view.ring(color(index), 0.15 * 70.0, goal);
        }
        if let Some((_, start)) = path.truth.first() {
            view.label(color(index), &Point3::from(start.coords), &format!("drone {}", path.id));
        }
    }
    view.finish()
}

fn legs(html: &mut String, flight: &FlightScore) -> std::fmt::Result {
    html.push_str(
        "<h3>Legs</h3><table><tr><th>crossing<th>drone<th>plan, seconds on its clock\
         <th>off its goal",
    );
    for (number, crossing) in flight.crossings.iter().enumerate() {
        for way in &crossing.plan.drones {
            let legs: Vec<_> = way
                .legs
                .iter()
                .map(|leg| format!("{} {:.1}–{:.1}", leg.kind, leg.start_s, leg.end_s))
                .collect();
            let error = crossing.errors_m.get(&way.id);
            let error = error.map_or("-".to_owned(), |e| format!("{:.1} cm", e * 1e2));
            write!(
                html,
                "<tr><td>{} ({})<td>{}<td>{}<td>{error}",
                number + 1,
                crossing.state,
                way.id,
                legs.join(", ")
            )?;
        }
    }
    html.push_str("</table>");
    Ok(())
}
