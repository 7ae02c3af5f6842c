//! Triangles that reach behind the near plane.

use crate::triangle::Corner;

/// The part of a triangle (camera frame) beyond `near`, as up to two triangles of
/// `(x/z, y/z, 1/z)`.
pub(crate) fn clip(corners: [[f64; 3]; 3], near: f64) -> impl Iterator<Item = [Corner; 3]> {
    let mut polygon = [[0.0; 3]; 4];
    let mut len = 0;
    let mut push = |corner: Corner| {
        polygon[len] = corner;
        len += 1;
    };
    for k in 0..3 {
        let (a, b) = (corners[k], corners[(k + 1) % 3]);
        if a[2] >= near {
            push(project(a));
        }
        // Always from the inside out, so that neighbors get the same point.
        match (a[2] >= near, b[2] >= near) {
            (true, false) => push(crossing(a, b, near)),
            (false, true) => push(crossing(b, a, near)),
            _ => {}
        }
    }
    let [p, q, r, s] = polygon;
    let second = (len == 4).then_some([p, r, s]);
    (len >= 3).then_some([p, q, r]).into_iter().chain(second)
}

#[inline(always)]
fn project([x, y, z]: [f64; 3]) -> Corner {
    let w = 1.0 / z;
    [x * w, y * w, w]
}

fn crossing(inside: [f64; 3], outside: [f64; 3], near: f64) -> Corner {
    let s = (inside[2] - near) / (inside[2] - outside[2]);
    let at = |k: usize| inside[k] + s * (outside[k] - inside[k]);
    project([at(0), at(1), near])
}
