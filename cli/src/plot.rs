//! Plots as SVG: lines over time, and paths seen from above.

use std::fmt::Write;

use nalgebra::{Point3, Vector3};
use volery_synthetic::Room;

/// Colors of drones or systems, in order.
const COLORS: [&str; 6] = ["#1f5fbf", "#c2410c", "#15803d", "#7e22ce", "#a16207", "#0e7490"];

const WIDTH: f64 = 760.0;
const HEIGHT: f64 = 200.0;
/// Room for the numbers at the axes.
const LEFT: f64 = 52.0;
const BOTTOM: f64 = 24.0;
/// About so many lines of the grid per axis.
const NUM_TICKS: f64 = 5.0;
/// Pixels per meter seen from above.
const SCALE: f64 = 70.0;
/// What begins higher hangs under the ceiling, meters.
const HANGING: f64 = 3.0;

/// The color of the one at `index`.
pub(crate) fn color(index: usize) -> &'static str {
    COLORS[index % COLORS.len()]
}

/// A line of a chart.
#[derive(Debug, Clone)]
pub(crate) struct Series<'a> {
    pub(crate) name: &'a str,
    pub(crate) color: &'a str,
    pub(crate) points: Vec<[f64; 2]>,
}

/// Lines over a common axis; `limit` is drawn across, with its meaning.
pub(crate) fn chart(axes: [&str; 2], series: &[Series<'_>], limit: Option<(f64, &str)>) -> String {
    let all = || series.iter().flat_map(|line| &line.points);
    let (x0, x1) = all().fold((f64::MAX, f64::MIN), |(a, b), p| (a.min(p[0]), b.max(p[0])));
    let highest = all().fold(limit.map_or(0.0, |l| l.0), |high, p| high.max(p[1]));
    let y1 = if highest > 0.0 { highest * 1.08 } else { 1.0 };
    let (x0, x1) = if x0 < x1 { (x0, x1) } else { (0.0, 1.0) };
    let place = |x: f64, y: f64| {
        let u = LEFT + (x - x0) / (x1 - x0) * (WIDTH - LEFT - 8.0);
        (u, (HEIGHT - BOTTOM) - y / y1 * (HEIGHT - BOTTOM - 8.0))
    };
    let mut svg = format!(
        "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {WIDTH} {}' width='{WIDTH}' \
         font-family='system-ui,sans-serif' font-size='11' fill='#444'>",
        HEIGHT + 18.0
    );
    let mut add = |part: std::fmt::Arguments<'_>| {
        // Writing to a string cannot fail.
        let _ = svg.write_fmt(part);
    };
    for y in ticks(0.0, y1) {
        let (_, v) = place(x0, y);
        add(format_args!(
            "<line x1='{LEFT}' x2='{}' y1='{v:.1}' y2='{v:.1}' stroke='#ddd'/>\
             <text x='{}' y='{:.1}' text-anchor='end'>{y}</text>",
            WIDTH - 8.0,
            LEFT - 5.0,
            v + 4.0
        ));
    }
    for x in ticks(x0, x1) {
        let (u, v) = place(x, 0.0);
        add(format_args!("<text x='{u:.1}' y='{:.1}' text-anchor='middle'>{x}</text>", v + 14.0));
    }
    if let Some((y, name)) = limit {
        let (u, v) = place(x1, y);
        add(format_args!(
            "<line x1='{LEFT}' x2='{u:.1}' y1='{v:.1}' y2='{v:.1}' stroke='#b91c1c' \
             stroke-dasharray='5 4'/><text x='{u:.1}' y='{:.1}' text-anchor='end' \
             fill='#b91c1c'>{name}</text>",
            v - 4.0
        ));
    }
    for line in series {
        add(format_args!(
            "<polyline fill='none' stroke='{}' stroke-width='1.4' points='",
            line.color
        ));
        for [x, y] in &line.points {
            let (u, v) = place(*x, *y);
            add(format_args!("{u:.1},{v:.1} "));
        }
        add(format_args!("'/>"));
    }
    let mut at = LEFT;
    for line in series {
        add(format_args!(
            "<text x='{at:.0}' y='{}' fill='{}'>{}</text>",
            HEIGHT + 13.0,
            line.color,
            line.name
        ));
        at += 24.0 + 7.0 * line.name.len() as f64;
    }
    add(format_args!(
        "<text x='{:.0}' y='{}' text-anchor='end'>{} over {}</text></svg>",
        WIDTH - 8.0,
        HEIGHT + 13.0,
        axes[1],
        axes[0]
    ));
    svg
}

/// Round numbers from `low` to `high`.
fn ticks(low: f64, high: f64) -> impl Iterator<Item = f64> {
    let rough = (high - low) / NUM_TICKS;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|k| k * power).into_iter().find(|s| *s >= rough);
    let step = step.unwrap_or(rough);
    let first = (low / step).ceil() as i64;
    (first..)
        .map(move |k| (k as f64 * step * 1e9).round() / 1e9)
        .take_while(move |value| *value <= high)
}

/// A room seen from above, x to the right, y up, its middle at the origin. Meters.
#[derive(Debug)]
pub(crate) struct TopView {
    svg: String,
    size: [f64; 2],
}

impl TopView {
    pub(crate) fn new(length: f64, width: f64) -> Self {
        let size = [length * SCALE, width * SCALE];
        let svg = format!(
            "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {0:.0} {1:.0}' width='{0:.0}' \
             font-family='system-ui,sans-serif' font-size='13'>",
            size[0], size[1]
        );
        Self { svg, size }
    }

    /// A room with the things in it; what hangs under its ceiling is left out.
    pub(crate) fn of(room: &Room) -> Self {
        let mut view = Self::new(room.size.x, room.size.y);
        for item in room.furniture.iter().filter(|item| item.center.z - item.half.z < HANGING) {
            let corner = |[x, y]: [f64; 2]| {
                item.center + item.world(&Vector3::new(x * item.half.x, y * item.half.y, 0.0))
            };
            let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(corner);
            view.area("#e4e2dc", &corners);
        }
        view
    }

    fn place(&self, p: &Point3<f64>) -> (f64, f64) {
        (self.size[0] / 2.0 + p.x * SCALE, self.size[1] / 2.0 - p.y * SCALE)
    }

    fn add(&mut self, part: std::fmt::Arguments<'_>) {
        // Writing to a string cannot fail.
        let _ = self.svg.write_fmt(part);
    }

    /// A closed outline, filled.
    fn area(&mut self, color: &str, corners: &[Point3<f64>]) {
        self.points("polygon", &format!("fill='{color}'"), corners.iter().copied());
    }

    /// A path.
    pub(crate) fn line(
        &mut self,
        color: &str,
        width: f64,
        points: impl IntoIterator<Item = Point3<f64>>,
    ) {
        let style = format!("fill='none' stroke='{color}' stroke-width='{width}'");
        self.points("polyline", &style, points);
    }

    fn points(&mut self, kind: &str, style: &str, points: impl IntoIterator<Item = Point3<f64>>) {
        self.add(format_args!("<{kind} {style} points='"));
        for point in points {
            let (u, v) = self.place(&point);
            self.add(format_args!("{u:.1},{v:.1} "));
        }
        self.add(format_args!("'/>"));
    }

    /// A dot, with words for who points at it.
    pub(crate) fn dot(&mut self, color: &str, radius: f64, point: &Point3<f64>, words: &str) {
        let (u, v) = self.place(point);
        self.add(format_args!(
            "<circle cx='{u:.1}' cy='{v:.1}' r='{radius}' fill='{color}'><title>{words}</title>\
             </circle>"
        ));
    }

    /// A ring around a place.
    pub(crate) fn ring(&mut self, color: &str, radius: f64, point: &Point3<f64>) {
        let (u, v) = self.place(point);
        self.add(format_args!(
            "<circle cx='{u:.1}' cy='{v:.1}' r='{radius}' fill='none' stroke='{color}' \
             stroke-width='1.5'/>"
        ));
    }

    /// Words beside a place.
    pub(crate) fn label(&mut self, color: &str, point: &Point3<f64>, words: &str) {
        let (u, v) = self.place(point);
        self.add(format_args!(
            "<text x='{:.1}' y='{:.1}' fill='{color}'>{words}</text>",
            u + 7.0,
            v - 7.0
        ));
    }

    pub(crate) fn finish(mut self) -> String {
        self.svg.push_str("</svg>");
        self.svg
    }
}
