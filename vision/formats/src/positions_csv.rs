//! Positions of images in a metric, z-up frame.

use nalgebra::Point3;
use volery_scene::PositionPrior;

use crate::TableError;
use crate::table::Table;

/// The position of an image.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedPosition {
    /// File name.
    pub image: String,
    /// Where.
    pub prior: PositionPrior,
}

/// Reads `image,x,y,z[,sigma]` or the columns `tx,ty,tz` of `poses.csv` (rotations are ignored).
/// `default_sigma` (meters) holds where no sigma is given.
///
/// # Errors
///
/// [`TableError`] with the line of the first field, column or name that is wrong.
pub fn read_positions_csv(
    bytes: &[u8],
    default_sigma: f64,
) -> Result<Vec<NamedPosition>, TableError> {
    let table = Table::parse(bytes)?;
    let images = table.image_names()?;
    let names = if table.column("x").is_some() { ["x", "y", "z"] } else { ["tx", "ty", "tz"] };
    let [x, y, z] =
        [table.required(names[0])?, table.required(names[1])?, table.required(names[2])?];
    let sigma = table.column("sigma");
    images
        .into_iter()
        .zip(table.rows())
        .map(|(image, row)| {
            let position = Point3::new(row.number(x)?, row.number(y)?, row.number(z)?);
            let given = row.optional(sigma)?;
            if let (Some(column), Some(value)) = (sigma, given)
                && value <= 0.0
            {
                return Err(row.out_of_range(column, "a sigma is positive"));
            }
            let sigma = given.unwrap_or(default_sigma);
            Ok(NamedPosition { image, prior: PositionPrior { position, sigma } })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_headers() {
        let short = read_positions_csv(b"image,x,y,z,sigma\na,1,2,3,0.5\nb,4,5,6,\n", 0.1).unwrap();
        assert_eq!(short[0].prior, PositionPrior { position: Point3::new(1., 2., 3.), sigma: 0.5 });
        assert_eq!(short[1].prior.sigma, 0.1);
        let poses =
            read_positions_csv(b"image,qw,qx,qy,qz,tx,ty,tz\na,1,0,0,0,7,8,9\n", 0.1).unwrap();
        assert_eq!(poses[0].prior.position, Point3::new(7., 8., 9.));
    }

    #[test]
    fn sigma_is_positive() {
        let text = b"image,x,y,z,sigma\na,1,2,3,0\n";
        assert!(matches!(read_positions_csv(text, 0.1), Err(TableError::OutOfRange { .. })));
    }
}
