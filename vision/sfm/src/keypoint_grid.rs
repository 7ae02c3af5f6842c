//! Keypoints by their place in the image.

use nalgebra::Point2;

/// Side of a cell, pixels.
const CELL: f64 = 12.0;

/// The keypoints of an image in square cells; those outside count to the cells at its edge.
pub(crate) struct KeypointGrid<'a> {
    keypoints: &'a [Point2<f64>],
    columns: usize,
    rows: usize,
    /// Cell c holds `members[starts[c]..starts[c + 1]]`.
    starts: Vec<u32>,
    members: Vec<u32>,
}

impl<'a> KeypointGrid<'a> {
    pub(crate) fn new(keypoints: &'a [Point2<f64>], width: u32, height: u32) -> Self {
        let (columns, rows) = (cell_of(width.into()) + 1, cell_of(height.into()) + 1);
        let cells: Vec<usize> = keypoints
            .iter()
            .map(|k| cell_of(k.y).min(rows - 1) * columns + cell_of(k.x).min(columns - 1))
            .collect();
        let mut starts = vec![0u32; columns * rows + 1];
        for &cell in &cells {
            starts[cell + 1] += 1;
        }
        for cell in 0..columns * rows {
            starts[cell + 1] += starts[cell];
        }
        let mut members: Vec<u32> = (0..keypoints.len() as u32).collect();
        members.sort_by_key(|&k| cells[k as usize]);
        Self { keypoints, columns, rows, starts, members }
    }

    /// Adds the keypoints within `radius` of `pixel` to `found`, cell by cell.
    pub(crate) fn near(&self, pixel: &Point2<f64>, radius: f64, found: &mut Vec<u32>) {
        let cells = |at: f64, count: usize| {
            cell_of(at - radius).min(count - 1)..(cell_of(at + radius) + 1).min(count)
        };
        let columns = cells(pixel.x, self.columns);
        for row in cells(pixel.y, self.rows) {
            let first = self.starts[row * self.columns + columns.start];
            let end = self.starts[row * self.columns + columns.end];
            found.extend(self.members[first as usize..end as usize].iter().copied().filter(|&k| {
                (self.keypoints[k as usize] - pixel).norm_squared() <= radius * radius
            }));
        }
    }
}

/// Column or row of a coordinate; what lies before the image counts as its edge.
fn cell_of(at: f64) -> usize {
    (at / CELL).max(0.0) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The grid finds what comparing with every keypoint finds.
    #[test]
    fn near_finds_all_within_the_radius() {
        let keypoints: Vec<Point2<f64>> = (0..400u32)
            .map(|i| Point2::new(f64::from(i * 7919 % 641), f64::from(i * 104_729 % 479)))
            .collect();
        let grid = KeypointGrid::new(&keypoints, 500, 400);
        for (x, y, radius) in
            [(0.0, 0.0, 30.0), (320.0, 240.0, 25.0), (640.0, 478.0, 5.0), (-9.0, 900.0, 40.0)]
        {
            let pixel = Point2::new(x, y);
            let mut found = Vec::new();
            grid.near(&pixel, radius, &mut found);
            found.sort_unstable();
            let expected: Vec<u32> =
                (0..400).filter(|&i| (keypoints[i as usize] - pixel).norm() <= radius).collect();
            assert_eq!(found, expected, "around {pixel}");
        }
    }

    #[test]
    fn no_keypoints_are_never_near() {
        let mut found = Vec::new();
        KeypointGrid::new(&[], 640, 480).near(&Point2::new(3.0, 4.0), 1e6, &mut found);
        assert!(found.is_empty());
    }
}
