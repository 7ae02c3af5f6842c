//! Values of arguments.

use clap::ValueEnum;
use volery_api::{JobOptions, LocalizeMethod, RegistrationMethod};
use volery_pipeline::{Preset, StageGroup};
use volery_scene::{KnownDistance, OriginRule};

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum MethodArg {
    Auto,
    Pnp,
    Template,
}

impl From<MethodArg> for LocalizeMethod {
    fn from(method: MethodArg) -> Self {
        match method {
            MethodArg::Auto => Self::Auto,
            MethodArg::Pnp => Self::Pnp,
            MethodArg::Template => Self::Template,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum RegistrationArg {
    Auto,
    Points,
    Surfaces,
}

impl From<RegistrationArg> for RegistrationMethod {
    fn from(method: RegistrationArg) -> Self {
        match method {
            RegistrationArg::Auto => Self::Auto,
            RegistrationArg::Points => Self::Points,
            RegistrationArg::Surfaces => Self::Surfaces,
        }
    }
}

/// Three numbers separated by commas.
pub(super) fn position(text: &str) -> Result<[f64; 3], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|v| v.trim().parse()).collect();
    let position = numbers.ok().and_then(|all| <[f64; 3]>::try_from(all).ok());
    position
        .filter(|p| p.iter().all(|v| v.is_finite()))
        .ok_or_else(|| "three numbers separated by commas are expected".to_owned())
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum PresetArg {
    Fast,
    Balanced,
    Best,
}

impl From<PresetArg> for Preset {
    fn from(preset: PresetArg) -> Self {
        match preset {
            PresetArg::Fast => Self::Fast,
            PresetArg::Balanced => Self::Balanced,
            PresetArg::Best => Self::Best,
        }
    }
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum StageArg {
    Sfm,
    Dense,
    Mesh,
}

impl From<StageArg> for StageGroup {
    fn from(stage: StageArg) -> Self {
        match stage {
            StageArg::Sfm => Self::Sfm,
            StageArg::Dense => Self::Dense,
            StageArg::Mesh => Self::Mesh,
        }
    }
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum OriginArg {
    LastCamera,
    MeanCameras,
    Given,
}

impl From<OriginArg> for OriginRule {
    fn from(origin: OriginArg) -> Self {
        match origin {
            OriginArg::LastCamera => Self::LastCamera,
            OriginArg::MeanCameras => Self::MeanCameras,
            OriginArg::Given => Self::Given,
        }
    }
}

pub(super) fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value > 0.0 => Ok(value),
        _ => Err("expected a positive number".to_owned()),
    }
}

pub(super) fn known_distance(text: &str) -> Result<KnownDistance, String> {
    let fields: Vec<&str> = text.split(',').collect();
    let [a, b, meters] = fields[..] else {
        return Err("expected A,B,METERS: two image names and a distance".to_owned());
    };
    let meters = positive(meters).map_err(|e| format!("{meters:?}: {e}"))?;
    Ok(KnownDistance { image_a: a.to_owned(), image_b: b.to_owned(), meters })
}

/// `NAME=NUMBER`.
pub(super) fn job_option(text: &str) -> Result<JobOptions, String> {
    let (name, number) = text.split_once('=').ok_or("expected NAME=NUMBER")?;
    let number = number.parse().map_err(|_| format!("{number:?} is no whole number"))?;
    let mut options = JobOptions::default();
    options.set(name, number)?;
    Ok(options)
}

/// `udp:HOST:PORT`.
pub(super) fn udp_address(text: &str) -> Result<std::net::SocketAddr, String> {
    let address = text.strip_prefix("udp:").ok_or("expected udp:HOST:PORT")?;
    address.parse().map_err(|e| format!("{e}; expected udp:HOST:PORT"))
}

/// A factor above 0.
pub(super) fn speed(text: &str) -> Result<f64, String> {
    let speed = text.parse().ok().filter(|speed: &f64| *speed > 0.0 && speed.is_finite());
    speed.ok_or_else(|| "expected a number above 0".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_checked_by_their_table() {
        assert_eq!(job_option("max_features=500").unwrap().max_features, Some(500));
        for bad in ["", "max_features", "max_features=", "max_features=1", "speed=3"] {
            assert!(job_option(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn known_distances_are_checked() {
        assert_eq!(known_distance("a.jpg,b.jpg,3").unwrap().meters, 3.0);
        for bad in ["", "a,b", "a,b,0", "a,b,-1", "a,b,nan", "a,b,1,2"] {
            assert!(known_distance(bad).is_err(), "{bad}");
        }
    }
}
