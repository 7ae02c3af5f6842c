//! What radio and ultrasound tell of places in a room.

use nalgebra::{Point3, Vector3};
use volery_flight::positioning::{
    HorizontalFix, PathLoss, Range, compare, trilaterate, with_height,
};
use volery_synthetic::{Rng, Room};

/// Standard deviation of a distance by ultrasound, and of one by light straight down, meters.
const SOUND_SIGMA: f64 = 0.03;
const LIGHT_SIGMA: f64 = 0.02;
/// Noise of radio that is tried, decibels, and how often each.
const NOISES_DB: [f64; 7] = [0.0, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0];
const NUM_TRIALS: u64 = 20;
/// Under a ceiling.
const GAP: f64 = 0.3;

/// Emitters on the walls and under the ceiling.
#[derive(Debug)]
pub(super) struct Beacons {
    /// Three, as the least that tell a place in the plane.
    radio: Vec<Point3<f64>>,
    /// More than three: shelves and beams hide some.
    sound: Vec<Point3<f64>>,
}

impl Beacons {
    pub(super) fn around(room: &Room) -> Self {
        let [x, y] = [room.size.x / 2.0 - 0.3, room.size.y / 2.0 - 0.3];
        let high = room.size.z - GAP;
        let at =
            |places: &[[f64; 2]], z| places.iter().map(|p| Point3::new(p[0], p[1], z)).collect();
        let inner = [x / 2.0, y / 2.0];
        Self {
            radio: at(&[[-x, -y], [x, -y], [0.0, y]], high),
            sound: at(
                &[
                    [-inner[0], -inner[1]],
                    [inner[0], -inner[1]],
                    [inner[0], inner[1]],
                    [-inner[0], inner[1]],
                    [0.0, 0.0],
                ],
                high,
            ),
        }
    }

    /// The place in the plane of `height` where the three circles come nearest to meeting.
    pub(super) fn by_radio(
        &self,
        truth: &[Point3<f64>],
        height: f64,
        sigma_db: f64,
        seed: u64,
    ) -> Vec<Option<Point3<f64>>> {
        let mut rng = Rng::fork(seed, 0x7261);
        let model = PathLoss { sigma_db: sigma_db.max(0.1), ..PathLoss::default() };
        let mut hear = |beacon: &Point3<f64>, place: &Point3<f64>| {
            let strength = model.strength((place - beacon).norm()) + sigma_db * rng.normal();
            model.range(*beacon, strength)
        };
        truth
            .iter()
            .map(|place| {
                let ranges: Vec<_> = self.radio.iter().map(|beacon| hear(beacon, place)).collect();
                let fix = trilaterate(&ranges, height).ok()?;
                Some(Point3::new(fix.position.x, fix.position.y, height))
            })
            .collect()
    }

    /// Distances to the emitters in sight, and the height over whatever is below.
    pub(super) fn by_sound(
        &self,
        room: &Room,
        truth: &[Point3<f64>],
        seed: u64,
    ) -> Vec<Option<Point3<f64>>> {
        let mut rng = Rng::fork(seed, 0x756c);
        truth
            .iter()
            .map(|place| {
                let seen = self.sound.iter().filter(|beacon| room.sees(place, beacon));
                let ranges: Vec<_> = seen
                    .map(|beacon| {
                        let distance = (place - beacon).norm() + SOUND_SIGMA * rng.normal();
                        Range { beacon: *beacon, distance, sigma: SOUND_SIGMA }
                    })
                    .collect();
                let down = (clearance(room, place) + LIGHT_SIGMA * rng.normal()).max(0.0);
                let fix: HorizontalFix = trilaterate(&ranges, down).ok()?;
                Some(with_height(&fix, 0.0, down, LIGHT_SIGMA).ok()?.position)
            })
            .collect()
    }

    /// Median level error of radio over its noise.
    pub(super) fn radio_by_noise(
        &self,
        truth: &[Point3<f64>],
        height: f64,
        seed: u64,
    ) -> Vec<[f64; 2]> {
        // What the height is off is not radio's fault.
        let flat: Vec<_> = truth.iter().map(|p| Point3::new(p.x, p.y, height)).collect();
        let median = |sigma_db: f64| {
            let trials = (0..NUM_TRIALS)
                .flat_map(|trial| self.by_radio(&flat, height, sigma_db, seed ^ trial << 32));
            let all: Vec<_> = flat.iter().copied().cycle().zip(trials).collect();
            let (truth, found): (Vec<_>, Vec<_>) = all.into_iter().unzip();
            compare(&truth, &found).map(|figures| [sigma_db, figures.median])
        };
        NOISES_DB.into_iter().filter_map(median).collect()
    }
}

/// From a place straight down to a thing or the floor.
fn clearance(room: &Room, place: &Point3<f64>) -> f64 {
    let down = -Vector3::z() * place.z;
    let hits = room.furniture.iter().filter_map(|item| item.span(place, &down));
    let nearest = hits.map(|(enter, _)| enter).filter(|enter| *enter >= 0.0);
    nearest.fold(1.0, f64::min) * place.z
}

#[cfg(test)]
mod tests {
    use super::*;

    fn eight() -> Vec<Point3<f64>> {
        super::super::flight(60, 1)
            .iter()
            .map(|shot| volery_geometry::triangulation::camera_center(&shot.cam_from_world))
            .collect()
    }

    /// Without noise radio is exact in the plane; its error grows with the noise, to meters.
    #[test]
    fn the_error_of_radio_grows_with_noise() {
        let beacons = Beacons::around(&Room::standard());
        let curve = beacons.radio_by_noise(&eight(), 2.1, 3);
        assert!(curve[0][1] < 1e-6, "{curve:?}");
        assert!(curve.windows(2).all(|pair| pair[0][1] < pair[1][1]), "{curve:?}");
        assert!(curve[5][1] > 0.5, "{curve:?}");
    }

    /// Over a crate the height sensor sees the crate.
    #[test]
    fn height_is_over_what_is_below() {
        let mut room = Room::standard();
        room.furniture = vec![volery_synthetic::Cuboid::standing(
            1.0,
            0.0,
            0.0,
            Vector3::new(0.5, 0.5, 0.8),
            0.0,
        )];
        assert!((clearance(&room, &Point3::new(1.0, 0.0, 2.0)) - 1.2).abs() < 1e-9);
        assert!((clearance(&room, &Point3::new(0.0, 0.0, 2.0)) - 2.0).abs() < 1e-9);
    }
}
