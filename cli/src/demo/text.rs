//! The demo's figures as text.

use std::path::Path;

use volery_api::LocalizeStatus;

use super::{DemoReport, flight_score::FlightScore, mapping::GLB_FILE};

pub(super) fn print(report: &DemoReport, page: &Path) {
    let score = &report.score;
    println!(
        "map       {} of {} photos, verdict {}",
        score.num_registered,
        score.num_scan,
        report.map["quality"]["verdict"].as_str().unwrap_or("?")
    );
    println!(
        "          position error {:.1} mm rms, rotation error {:.3} deg median",
        score.ate_m * 1e3,
        score.rotation_deg
    );
    println!(
        "          scale error {:.2} %, gravity error {:.2} deg",
        score.scale_error * 100.0,
        score.gravity_deg
    );
    println!(
        "mesh      {} triangles, median {:.1} mm from the true surfaces: {GLB_FILE}",
        score.num_triangles,
        score.mesh_m * 1e3
    );
    println!(
        "queries   {} of {} placed, median {:.1} mm, {:.3} deg",
        score.num_localized,
        score.num_queries,
        score.query_m * 1e3,
        score.query_deg
    );
    for query in &report.queries {
        match (query.status, query.error_m, query.error_deg) {
            (LocalizeStatus::Ok, Some(m), Some(deg)) => println!(
                "          {}  {:6.1} mm  {deg:.3} deg  {} inliers  {:.0} ms",
                query.name,
                m * 1e3,
                query.num_inliers,
                query.total_ms
            ),
            _ => println!(
                "          {}  not placed: {}",
                query.name,
                query.reason.as_deref().unwrap_or("?")
            ),
        }
    }
    if let Some(flight) = &report.flight {
        print_flight(flight);
    }
    println!("report    {}", page.display());
}

fn print_flight(flight: &FlightScore) {
    println!(
        "flight    {} of {} drones at all their goals, {:.0} s in the air",
        flight.arrived, flight.drones, flight.flight_s
    );
    if let Some(error) = flight.arrival_error_max_m {
        println!("          {:.1} cm off a goal at most", error * 1e2);
    }
    if let Some(distance) = flight.min_separation_m {
        println!("          never nearer to each other than {distance:.2} m");
    }
    println!(
        "          live poses off by {:.1} cm median, {:.1} cm p95, {:.2} deg; {:.0} ms median",
        flight.pose_error_median_m * 1e2,
        flight.pose_error_p95_m * 1e2,
        flight.pose_error_median_deg,
        flight.server_ms_median
    );
    let frames: Vec<_> = flight.frames.iter().map(|(what, n)| format!("{n} {what}")).collect();
    println!("          pictures: {}", frames.join(", "));
    for mishap in &flight.mishaps {
        println!("          {mishap}");
    }
}
