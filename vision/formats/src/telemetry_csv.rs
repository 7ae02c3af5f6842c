//! `telemetry.csv`: what a drone reported per image.

use nalgebra::Point3;
use volery_scene::{AttitudePrior, HeightPrior, ImagePrior, PositionPrior};

use crate::TableError;
use crate::table::Table;

/// One image's telemetry.
#[derive(Debug, Clone, PartialEq)]
pub struct TelemetryRow {
    /// File name.
    pub image: String,
    /// Its priors.
    pub prior: ImagePrior,
}

/// How far telemetry is trusted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TelemetrySigmas {
    /// Of yaw, radians.
    pub yaw: f64,
    /// Of pitch and roll, radians.
    pub tilt: f64,
    /// Of height, meters.
    pub height: f64,
    /// Of each coordinate of the position, meters.
    pub position: f64,
}

impl Default for TelemetrySigmas {
    /// A small drone with magnetometer and range finder, and positions of motion capture.
    fn default() -> Self {
        let (yaw, tilt) = (2.0_f64.to_radians(), 0.5_f64.to_radians());
        Self { yaw, tilt, height: 0.05, position: 0.05 }
    }
}

/// Reads `image` and any of `time_s, yaw_deg, pitch_deg, roll_deg, height_m, x_m, y_m, z_m`, found
/// by the names in the header line; empty fields and missing columns are `None`. An attitude needs
/// all three angles, a position (metric, z up) all three coordinates. Other columns are ignored.
///
/// # Errors
///
/// [`TableError`] with the line of the first field, column or name that is wrong.
pub fn read_telemetry_csv(
    bytes: &[u8],
    sigmas: &TelemetrySigmas,
) -> Result<Vec<TelemetryRow>, TableError> {
    let table = Table::parse(bytes)?;
    let images = table.image_names()?;
    let [time_s, yaw, pitch, roll, height] =
        ["time_s", "yaw_deg", "pitch_deg", "roll_deg", "height_m"].map(|name| table.column(name));
    let [x, y, z] = ["x_m", "y_m", "z_m"].map(|name| table.column(name));
    images
        .into_iter()
        .zip(table.rows())
        .map(|(image, row)| {
            let angles = [row.optional(yaw)?, row.optional(pitch)?, row.optional(roll)?];
            let attitude = match angles {
                [Some(yaw), Some(pitch), Some(roll)] => Some(AttitudePrior {
                    yaw: yaw.to_radians(),
                    pitch: pitch.to_radians(),
                    roll: roll.to_radians(),
                    sigma_yaw: sigmas.yaw,
                    sigma_tilt: sigmas.tilt,
                }),
                _ => None,
            };
            let height = row.optional(height)?;
            let position = match [row.optional(x)?, row.optional(y)?, row.optional(z)?] {
                [Some(x), Some(y), Some(z)] => {
                    Some(PositionPrior { position: Point3::new(x, y, z), sigma: sigmas.position })
                }
                _ => None,
            };
            let prior = ImagePrior {
                attitude,
                height: height.map(|height| HeightPrior { height, sigma: sigmas.height }),
                position,
                time_s: row.optional(time_s)?,
                ..ImagePrior::default()
            };
            Ok(TelemetryRow { image, prior })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Vec<TelemetryRow> {
        read_telemetry_csv(text.as_bytes(), &TelemetrySigmas::default()).unwrap()
    }

    /// P91: yaw, pitch, roll and height of each image reach the reconstruction, in radians.
    #[test]
    fn columns_are_found_by_name() {
        let rows = read("height_m,image,roll_deg,yaw_deg,extra,pitch_deg\n2.5,a.jpg,-1,180,x,3\n");
        let prior = rows[0].prior;
        let attitude = prior.attitude.unwrap();
        assert!((attitude.yaw - std::f64::consts::PI).abs() < 1e-12);
        assert!((attitude.pitch - 3.0_f64.to_radians()).abs() < 1e-12);
        assert!((attitude.roll + 1.0_f64.to_radians()).abs() < 1e-12);
        assert_eq!(prior.height.unwrap().height, 2.5);
        assert_eq!(prior.time_s, None);
    }

    #[test]
    fn positions_come_with_the_rest_or_not() {
        let rows = read("image,x_m,y_m,z_m\na,1,2,3\nb,,,\n");
        let position = rows[0].prior.position.unwrap();
        assert_eq!((position.position, position.sigma), (Point3::new(1.0, 2.0, 3.0), 0.05));
        assert_eq!(rows[1].prior.position, None);
    }

    #[test]
    fn half_an_attitude_or_position_is_none() {
        let rows =
            read("image,time_s,yaw_deg,pitch_deg,roll_deg,height_m,x_m,y_m\na,7,10,,0,,1,2\n");
        assert_eq!(rows[0].prior.attitude, None);
        assert_eq!(rows[0].prior.position, None);
        assert_eq!(rows[0].prior.height, None);
        assert_eq!(rows[0].prior.time_s, Some(7.0));
    }
}
