//! A triangle as it is drawn.

use crate::finder::{BlockRange, Finder};

/// A corner in normalized coordinates: x/z, y/z, 1/z.
pub(crate) type Corner = [f64; 3];

/// Linear functions of the normalized coordinates (x, y): a x + b y + c.
pub(crate) type Line = [f32; 3];

/// A triangle in front of the camera.
pub(crate) struct Triangle {
    /// Blocks it may be seen in.
    pub(crate) blocks: BlockRange,
    /// Not negative inside.
    pub(crate) edges: [Line; 3],
    /// Inverse depth.
    pub(crate) inverse_depth: Line,
    /// Its range at the corners.
    pub(crate) range: [f32; 2],
}

impl Triangle {
    /// `None` if it has no area or no pixel's center can lie inside.
    #[inline(always)]
    pub(crate) fn new([p, q, r]: [Corner; 3], finder: &Finder) -> Option<Self> {
        let low = [p[0].min(q[0]).min(r[0]), p[1].min(q[1]).min(r[1])];
        let high = [p[0].max(q[0]).max(r[0]), p[1].max(q[1]).max(r[1])];
        let blocks = finder.blocks(low.map(|v| v as f32), high.map(|v| v as f32))?;
        let twice_area = (q[0] - p[0]) * (r[1] - p[1]) - (r[0] - p[0]) * (q[1] - p[1]);
        if twice_area == 0.0 || twice_area.is_nan() {
            return None;
        }
        // Seen from behind, the corners are taken the other way round.
        let (q, r) = if twice_area > 0.0 { (q, r) } else { (r, q) };
        let edges = [edge(q, r), edge(r, p), edge(p, q)];
        // w = Σ wᵢ eᵢ / 2A, relative to a corner, where the differences are small.
        let scale = 1.0 / twice_area.abs();
        let (dq, dr) = (q[2] - p[2], r[2] - p[2]);
        let a = (dq * edges[1][0] + dr * edges[2][0]) * scale;
        let b = (dq * edges[1][1] + dr * edges[2][1]) * scale;
        let range = [p[2].min(q[2]).min(r[2]), p[2].max(q[2]).max(r[2])];
        Some(Self {
            blocks,
            edges: edges.map(|line| line.map(|v| v as f32)),
            inverse_depth: [a, b, p[2] - a * p[0] - b * p[1]].map(|v| v as f32),
            range: range.map(|v| v as f32),
        })
    }
}

/// Twice the area of (from, to, (x, y)). The same edge of two neighbors, run the other way, gives
/// exactly the negative: no pixel falls between them.
#[inline(always)]
fn edge(from: Corner, to: Corner) -> [f64; 3] {
    [from[1] - to[1], to[0] - from[0], from[0] * to[1] - to[0] * from[1]]
}
