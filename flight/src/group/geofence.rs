//! Where vehicles may be.

use nalgebra::{Point2, Point3, Vector2};

/// Upright block over a polygon.
#[derive(Debug, Clone, PartialEq)]
pub struct Prism {
    /// Corners in order, either way round. Meters, in the map.
    pub outline: Vec<Point2<f64>>,
    /// Lowest height.
    pub floor: f64,
    /// Highest height.
    pub ceiling: f64,
}

/// What is wrong with a fence.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum GeofenceError {
    /// A number is infinite or NaN.
    #[error("a corner, height or margin is not a finite number")]
    NotFinite,
    /// The outline has no area.
    #[error("an outline needs at least 3 corners that enclose an area")]
    NoArea,
    /// Two edges of the outline cross.
    #[error("edges {first} and {second} of an outline cross")]
    Crossing {
        /// Number of the first edge, from its corner of that number.
        first: usize,
        /// Number of the other edge.
        second: usize,
    },
    /// The ceiling is not above the floor.
    #[error("the ceiling is not above the floor")]
    NoHeight,
    /// The margin is negative or leaves nothing.
    #[error("the margin is negative or leaves no room")]
    Margin,
}

/// Which rule of the fence a place breaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Breach {
    /// Outside the area, or nearer to its walls than the margin.
    Outside,
    /// Below the floor with its margin.
    BelowFloor,
    /// Above the ceiling with its margin.
    AboveCeiling,
    /// In the forbidden block of this number, or nearer to it than the margin.
    KeepOut(usize),
}

impl Breach {
    /// Stable name of the rule.
    pub fn code(self) -> &'static str {
        match self {
            Self::Outside => "outside",
            Self::BelowFloor => "below_floor",
            Self::AboveCeiling => "above_ceiling",
            Self::KeepOut(_) => "keep_out",
        }
    }
}

/// Where vehicles may be: inside one block, outside others, with a margin to all of them.
#[derive(Debug, Clone, PartialEq)]
pub struct Geofence {
    area: Prism,
    keep_out: Vec<Prism>,
    margin: f64,
}

impl Geofence {
    /// Checks the blocks.
    ///
    /// # Errors
    ///
    /// Outlines without area or with crossing edges, numbers that are not finite, no height, a
    /// negative margin or one that the height of the area does not leave room for.
    pub fn new(area: Prism, keep_out: Vec<Prism>, margin: f64) -> Result<Self, GeofenceError> {
        for prism in std::iter::once(&area).chain(&keep_out) {
            prism.check()?;
        }
        if !margin.is_finite() {
            return Err(GeofenceError::NotFinite);
        }
        if margin < 0.0 || 2.0 * margin >= area.ceiling - area.floor {
            return Err(GeofenceError::Margin);
        }
        Ok(Self { area, keep_out, margin })
    }

    /// The box between two opposite corners, as the bounds of a map give it.
    pub fn around(
        low: &Point3<f64>,
        high: &Point3<f64>,
        margin: f64,
    ) -> Result<Self, GeofenceError> {
        Self::new(Prism::between(low, high), Vec::new(), margin)
    }

    /// The allowed block.
    pub fn area(&self) -> &Prism {
        &self.area
    }

    /// The forbidden blocks.
    pub fn keep_out(&self) -> &[Prism] {
        &self.keep_out
    }

    /// Distance kept to every wall, floor and ceiling. Meters.
    pub fn margin(&self) -> f64 {
        self.margin
    }

    /// The lowest and the highest allowed height.
    pub fn heights(&self) -> (f64, f64) {
        (self.area.floor + self.margin, self.area.ceiling - self.margin)
    }

    /// The rule that a place breaks.
    pub fn breach(&self, place: &Point3<f64>) -> Option<Breach> {
        self.breach_between(place, place)
    }

    /// The first rule in the list of [`Breach`] that the straight line between two places breaks
    /// anywhere: exact, not sampled.
    pub fn breach_between(&self, from: &Point3<f64>, to: &Point3<f64>) -> Option<Breach> {
        let (lowest, highest) = self.heights();
        let (a, b) = (from.xy(), to.xy());
        let finite = from.iter().chain(to.iter()).all(|v| v.is_finite());
        // Not `<`: a NaN is outside.
        let clear = |room: f64| room >= self.margin;
        if !finite || !self.area.covers(&a) || !clear(self.area.distance_to_walls(&a, &b)) {
            return Some(Breach::Outside);
        }
        if from.z.min(to.z) < lowest {
            return Some(Breach::BelowFloor);
        }
        if from.z.max(to.z) > highest {
            return Some(Breach::AboveCeiling);
        }
        let hits = |prism: &Prism| {
            let span = (prism.floor - self.margin, prism.ceiling + self.margin);
            part_at_heights(from, to, span).is_some_and(|(a, b)| {
                prism.covers(&a) || prism.distance_to_walls(&a, &b) < self.margin.max(1e-9)
            })
        };
        self.keep_out.iter().position(hits).map(Breach::KeepOut)
    }
}

impl Prism {
    /// The box between two opposite corners.
    pub fn between(low: &Point3<f64>, high: &Point3<f64>) -> Self {
        let outline = [(low.x, low.y), (high.x, low.y), (high.x, high.y), (low.x, high.y)]
            .map(|(x, y)| Point2::new(x, y));
        Self { outline: outline.to_vec(), floor: low.z, ceiling: high.z }
    }

    fn edges(&self) -> impl Iterator<Item = (&Point2<f64>, &Point2<f64>)> {
        self.outline.iter().zip(self.outline.iter().cycle().skip(1))
    }

    fn check(&self) -> Result<(), GeofenceError> {
        let heights = [self.floor, self.ceiling];
        if !self.outline.iter().flat_map(|p| p.iter()).chain(&heights).all(|v| v.is_finite()) {
            return Err(GeofenceError::NotFinite);
        }
        let twice_area: f64 = self.edges().map(|(p, q)| p.coords.perp(&q.coords)).sum();
        if self.outline.len() < 3 || twice_area.abs() < 1e-6 {
            return Err(GeofenceError::NoArea);
        }
        if self.ceiling <= self.floor {
            return Err(GeofenceError::NoHeight);
        }
        let n = self.outline.len();
        let edges: Vec<_> = self.edges().collect();
        for first in 0..n {
            for second in first + 2..n {
                let neighbors = first == 0 && second == n - 1;
                let ((a, b), (c, d)) = (edges[first], edges[second]);
                if !neighbors && segment_distance(a, b, c, d) == 0.0 {
                    return Err(GeofenceError::Crossing { first, second });
                }
            }
        }
        Ok(())
    }

    /// Whether a place lies over the outline (ray crossing).
    fn covers(&self, p: &Point2<f64>) -> bool {
        let crossings = self.edges().filter(|(a, b)| {
            (a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x)
        });
        crossings.count() % 2 == 1
    }

    /// Horizontal distance from a line to the nearest wall.
    fn distance_to_walls(&self, a: &Point2<f64>, b: &Point2<f64>) -> f64 {
        self.edges().map(|(p, q)| segment_distance(a, b, p, q)).fold(f64::INFINITY, f64::min)
    }
}

/// Horizontal ends of the part of a line whose heights lie strictly inside the span.
fn part_at_heights(
    from: &Point3<f64>,
    to: &Point3<f64>,
    (low, high): (f64, f64),
) -> Option<(Point2<f64>, Point2<f64>)> {
    let rise = to.z - from.z;
    let (mut start, mut end) = (0.0, 1.0);
    if rise == 0.0 {
        if from.z <= low || from.z >= high {
            return None;
        }
    } else {
        let (t0, t1) = ((low - from.z) / rise, (high - from.z) / rise);
        start = t0.min(t1).max(0.0);
        end = t0.max(t1).min(1.0);
        if start >= end {
            return None;
        }
    }
    let way = to - from;
    Some(((from + way * start).xy(), (from + way * end).xy()))
}

/// Distance between the lines `a b` and `c d` in the plane; 0 where they touch.
fn segment_distance(a: &Point2<f64>, b: &Point2<f64>, c: &Point2<f64>, d: &Point2<f64>) -> f64 {
    let side = |p: &Point2<f64>, q: &Point2<f64>, r: &Point2<f64>| (q - p).perp(&(r - p));
    let apart = |x: f64, y: f64| (x > 0.0 && y < 0.0) || (x < 0.0 && y > 0.0);
    if apart(side(a, b, c), side(a, b, d)) && apart(side(c, d, a), side(c, d, b)) {
        return 0.0;
    }
    let ends = [
        point_distance(a, c, d),
        point_distance(b, c, d),
        point_distance(c, a, b),
        point_distance(d, a, b),
    ];
    ends.into_iter().fold(f64::INFINITY, f64::min)
}

/// Distance from a point to the line `a b`.
fn point_distance(p: &Point2<f64>, a: &Point2<f64>, b: &Point2<f64>) -> f64 {
    let along: Vector2<f64> = b - a;
    let length_squared = along.norm_squared();
    let t = if length_squared == 0.0 { 0.0 } else { (p - a).dot(&along) / length_squared };
    (p - (a + along * t.clamp(0.0, 1.0))).norm()
}

#[cfg(test)]
mod tests;
