//! Occupancy grids as bytes.
//!
//! ```text
//! "VOLOCC01"
//! f64 × 4   rotation of the grid in the map, quaternion w x y z
//! f64 × 3   origin of the grid in the map: the least corner of the first voxel
//! f64       edge of a voxel, in units of the map
//! u32 × 3   voxels along x, y and z of the grid
//! then runs of equal states, x first, then y, then z, until all voxels have theirs:
//! u8        0 unseen, 1 free, 2 occupied
//! LEB128    number of voxels
//! ```
//!
//! All little endian. A point `p` of the grid, in voxels, lies at `origin + edge · R p` in the map.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use volery_scene::{Occupancy, OccupancyGrid};

use crate::bytes::{ByteReader, OutOfBytes};

const MAGIC: &[u8; 8] = b"VOLOCC01";
/// Most voxels that are read.
const MAX_VOXELS: usize = 1 << 26;

/// Why bytes are no occupancy grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum OccupancyFileError {
    /// Some other file.
    #[error("not an occupancy grid")]
    OtherFile,
    /// The bytes end too early.
    #[error("cut off at byte {offset}")]
    CutOff {
        /// Where.
        offset: usize,
    },
    /// A value that no grid has.
    #[error("impossible {what}")]
    Impossible {
        /// Which.
        what: &'static str,
    },
}

impl From<OutOfBytes> for OccupancyFileError {
    fn from(OutOfBytes { offset }: OutOfBytes) -> Self {
        Self::CutOff { offset }
    }
}

/// The grid as bytes.
pub fn write_occupancy(grid: &OccupancyGrid) -> Vec<u8> {
    let pose = grid.map_from_grid();
    let [x, y, z, w] = pose.rotation.coords.into();
    let [tx, ty, tz] = pose.translation.vector.into();
    let mut bytes = MAGIC.to_vec();
    for value in [w, x, y, z, tx, ty, tz, grid.voxel()] {
        bytes.extend(value.to_le_bytes());
    }
    for side in grid.size() {
        bytes.extend((side as u32).to_le_bytes());
    }
    for run in grid.states().chunk_by(|a, b| a == b) {
        bytes.push(run[0].code());
        let mut left = run.len();
        while left >= 0x80 {
            bytes.push(left as u8 | 0x80);
            left >>= 7;
        }
        bytes.push(left as u8);
    }
    bytes
}

/// The grid that bytes hold.
///
/// # Errors
///
/// [`OccupancyFileError`].
pub fn read_occupancy(bytes: &[u8]) -> Result<OccupancyGrid, OccupancyFileError> {
    let impossible = |what| OccupancyFileError::Impossible { what };
    let mut reader = ByteReader::new(bytes);
    if reader.take(MAGIC.len()).ok() != Some(&MAGIC[..]) {
        return Err(OccupancyFileError::OtherFile);
    }
    let mut numbers = [0.0; 8];
    for number in &mut numbers {
        *number = reader.f64()?;
    }
    let [w, x, y, z, tx, ty, tz, voxel] = numbers;
    let rotation = Quaternion::new(w, x, y, z);
    let is_pose =
        (rotation.norm() - 1.0).abs() < 1e-6 && [tx, ty, tz].iter().all(|t| t.is_finite());
    if !is_pose {
        return Err(impossible("pose"));
    }
    // As it was written: to normalize it again would change its bits.
    let rotation = UnitQuaternion::new_unchecked(rotation);
    let pose = Isometry3::from_parts(Translation3::new(tx, ty, tz), rotation);
    let mut size = [0; 3];
    for side in &mut size {
        *side = reader.u32()? as usize;
    }
    let num = size.iter().try_fold(1_usize, |num, &side| num.checked_mul(side));
    let num = num.filter(|&num| num <= MAX_VOXELS).ok_or(impossible("size"))?;
    let mut grid = OccupancyGrid::unseen(pose, voxel, size).ok_or(impossible("voxel"))?;
    let mut at = 0;
    while at < num {
        let state = Occupancy::from_code(reader.u8()?).ok_or(impossible("state"))?;
        let run = run_length(&mut reader)?;
        let cells = grid.states_mut().get_mut(at..at.saturating_add(run));
        cells.filter(|_| run > 0).ok_or(impossible("run"))?.fill(state);
        at += run;
    }
    if reader.is_at_end() { Ok(grid) } else { Err(impossible("end")) }
}

fn run_length(reader: &mut ByteReader<'_>) -> Result<usize, OccupancyFileError> {
    let mut length = 0;
    for shift in (0..35).step_by(7) {
        let byte = reader.u8()?;
        length |= usize::from(byte & 0x7f) << shift;
        if byte < 0x80 {
            return Ok(length);
        }
    }
    Err(OccupancyFileError::Impossible { what: "run" })
}

#[cfg(test)]
mod tests {
    use volery_geometry::Rng;

    use super::*;

    fn grid(seed: u64) -> OccupancyGrid {
        let mut rng = Rng::new(seed);
        let pose = Isometry3::new(rng.normal3(), rng.normal3());
        let mut grid = OccupancyGrid::unseen(pose, 0.07, [30, 20, 11]).unwrap();
        let mut state = Occupancy::Unseen;
        for cell in grid.states_mut() {
            if rng.uniform() < 0.02 {
                state = Occupancy::ALL[(rng.uniform() * 3.0) as usize];
            }
            *cell = state;
        }
        grid
    }

    #[test]
    fn a_grid_comes_back() {
        for seed in 0..5 {
            let grid = grid(seed);
            let bytes = write_occupancy(&grid);
            assert!(bytes.len() < 800, "{}", bytes.len());
            assert_eq!(read_occupancy(&bytes), Ok(grid));
        }
        let empty = OccupancyGrid::unseen(Isometry3::identity(), 1.0, [5, 0, 3]).unwrap();
        assert_eq!(read_occupancy(&write_occupancy(&empty)), Ok(empty));
        let large = OccupancyGrid::unseen(Isometry3::identity(), 1.0, [200, 200, 100]).unwrap();
        let bytes = write_occupancy(&large);
        assert_eq!(bytes.len(), 8 + 64 + 12 + 1 + 4);
        assert_eq!(read_occupancy(&bytes), Ok(large));
    }

    #[test]
    fn no_bytes_are_believed_blindly() {
        let bytes = write_occupancy(&grid(1));
        for len in 0..bytes.len() {
            assert!(read_occupancy(&bytes[..len]).is_err(), "{len}");
        }
        let mut longer = bytes.clone();
        longer.push(0);
        assert_eq!(read_occupancy(&longer), Err(OccupancyFileError::Impossible { what: "end" }));
        let lying = |at: usize, value: &[u8]| {
            let mut bytes = bytes.clone();
            bytes[at..at + value.len()].copy_from_slice(value);
            read_occupancy(&bytes)
        };
        let impossible = |what| Err(OccupancyFileError::Impossible { what });
        assert_eq!(lying(0, b"x"), Err(OccupancyFileError::OtherFile));
        assert_eq!(lying(8, &f64::NAN.to_le_bytes()), impossible("pose"));
        assert_eq!(lying(40, &f64::INFINITY.to_le_bytes()), impossible("pose"));
        assert_eq!(lying(64, &(-1.0_f64).to_le_bytes()), impossible("voxel"));
        assert_eq!(lying(72, &[0xff; 12]), impossible("size"));
        assert_eq!(lying(84, &[7]), impossible("state"));
        assert_eq!(lying(85, &[0]), impossible("run"));
        assert_eq!(lying(85, &[0xff; 5]), impossible("run"));
    }
}
