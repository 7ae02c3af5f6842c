//! Where the charts lie in the texture.

use nalgebra::{Point2, Vector2};

use super::charts::Chart;

/// Texels around a chart that no other chart has.
pub(super) const PADDING: u32 = 3;
/// Charts shrink by this factor until they fit.
const SHRINK: f64 = 0.96;
/// Smallest texture.
const MIN_SIDE: u32 = 64;

/// Places of the charts in a texture.
#[derive(Debug, Clone)]
pub(super) struct Layout {
    pub(super) width: u32,
    pub(super) height: u32,
    /// Texels per pixel of the images, at most 1.
    pub(super) scale: f64,
    /// Upper left texels, padding included.
    pub(super) places: Vec<[u32; 2]>,
}

impl Layout {
    /// Packs the charts into the smallest texture of powers of two, or shrinks them until they fit
    /// into one of `max_side`. `None` if there are too many for any size.
    pub(super) fn new(charts: &[Chart], max_side: u32) -> Option<Self> {
        let mut scale = 1.0;
        loop {
            let sizes: Vec<[u32; 2]> = charts.iter().map(|chart| size(chart, scale)).collect();
            let area: u64 = sizes.iter().map(|&[w, h]| u64::from(w) * u64::from(h)).sum();
            let mut side = MIN_SIDE.min(max_side);
            while side <= max_side {
                for height in [side / 2, side] {
                    if u64::from(side) * u64::from(height) < area {
                        continue;
                    }
                    if let Some(places) = pack(&sizes, side, height) {
                        return Some(Self { width: side, height, scale, places });
                    }
                }
                side *= 2;
            }
            let padded = u64::from(2 * PADDING + 1).pow(2) * charts.len() as u64;
            if padded > u64::from(max_side).pow(2) {
                return None;
            }
            scale *= SHRINK;
        }
    }

    /// Size of a chart with its padding, texels.
    pub(super) fn size(&self, chart: &Chart) -> [u32; 2] {
        size(chart, self.scale)
    }

    /// Where a vertex of a chart lies from the upper left texel of the chart.
    pub(super) fn in_chart(&self, chart: &Chart, local: usize) -> Point2<f64> {
        let origin = (chart.bounds[0] * self.scale).map(f64::floor);
        let from_origin: Vector2<f64> = chart.pixels[local] * self.scale - origin;
        Point2::from(from_origin.add_scalar(f64::from(PADDING)))
    }

    /// Where all vertices of a chart lie from its upper left texel.
    pub(super) fn all_in_chart(&self, chart: &Chart) -> Vec<Point2<f64>> {
        (0..chart.pixels.len()).map(|local| self.in_chart(chart, local)).collect()
    }
}

fn size(chart: &Chart, scale: f64) -> [u32; 2] {
    let [low, high] = chart.bounds;
    let side = |axis: usize| {
        let texels = (high[axis] * scale).ceil() - (low[axis] * scale).floor();
        texels.max(1.0) as u32 + 2 * PADDING
    };
    [side(0), side(1)]
}

/// Upper left corners of rectangles that do not overlap, `None` if they do not fit: each in turn,
/// the highest first, as low as the skyline of those before it lets it fall.
///
/// Source: Jylänki, "A Thousand Ways to Pack the Bin", 2010, section 4 (Skyline Bottom-Left).
fn pack(sizes: &[[u32; 2]], width: u32, height: u32) -> Option<Vec<[u32; 2]>> {
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.sort_by_key(|&i| (std::cmp::Reverse([sizes[i][1], sizes[i][0]]), i));
    let mut places = vec![[0; 2]; sizes.len()];
    // Begin and height of each step; the last one ends the texture.
    let mut skyline: Vec<[u32; 2]> = vec![[0, 0], [width, u32::MAX]];
    for index in order {
        let [w, h] = sizes[index];
        let mut best: Option<([u32; 2], usize)> = None;
        for first in 0..skyline.len() - 1 {
            let x = skyline[first][0];
            if x + w > width {
                break;
            }
            let under = skyline[first..].iter().take_while(|step| step[0] < x + w);
            let y = under.map(|step| step[1]).max().unwrap_or(0);
            if y + h <= height && best.is_none_or(|([_, best_y], _)| y < best_y) {
                best = Some(([x, y], first));
            }
        }
        let (place @ [x, y], first) = best?;
        places[index] = place;
        let end = first + skyline[first..].iter().take_while(|step| step[0] < x + w).count();
        let last_height = skyline[end - 1][1];
        let goes_on = skyline[end][0] > x + w;
        let steps = [[x, y + h], [x + w, last_height]];
        skyline.splice(first..end, steps[..1 + usize::from(goes_on)].iter().copied());
    }
    Some(places)
}

#[cfg(test)]
mod tests {
    use volery_geometry::Rng;

    use super::*;

    #[test]
    fn rectangles_neither_overlap_nor_stick_out() {
        let mut random = Rng::new(5);
        let side = |random: &mut Rng| (random.uniform().powi(3) * 60.0) as u32 + 1;
        let sizes: Vec<[u32; 2]> =
            (0..300).map(|_| [side(&mut random), side(&mut random)]).collect();
        let (width, height) = (256, 512);
        let places = pack(&sizes, width, height).unwrap();
        let mut taken = vec![false; (width * height) as usize];
        for ([x, y], [w, h]) in places.iter().zip(&sizes) {
            for y in *y..y + h {
                for x in *x..x + w {
                    assert!(x < width && y < height);
                    assert!(!std::mem::replace(&mut taken[(y * width + x) as usize], true));
                }
            }
        }
        assert_eq!(pack(&sizes, 128, 128), None);
        assert_eq!(pack(&[[8, 8]; 4], 16, 16).unwrap().len(), 4);
        assert_eq!(pack(&[[8, 8]; 5], 16, 16), None);
    }
}
