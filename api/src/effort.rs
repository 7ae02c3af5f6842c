//! How much work a reconstruction spends, and where it ends.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// How much work a reconstruction may spend.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Preset {
    /// Fewer features, smaller images; ends with the sparse map, which is all that localization
    /// needs.
    Fast,
    /// The default; ends with a mesh.
    #[default]
    Balanced,
    /// Full resolution, most features; ends with a mesh.
    Best,
}

impl Preset {
    /// Every preset, the one with the least work first.
    pub const ALL: [Self; 3] = [Self::Fast, Self::Balanced, Self::Best];

    /// The part of the way that ends a job: the last one of `stages`, else the preset's own.
    pub fn last_stage(self, stages: &[StageGroup]) -> StageGroup {
        let own = if self == Self::Fast { StageGroup::Sfm } else { StageGroup::Mesh };
        stages.iter().copied().max().unwrap_or(own)
    }

    /// What it is for.
    pub fn description(self) -> &'static str {
        match self {
            Self::Fast => "a first look, or a map for localization by features alone",
            Self::Balanced => "a map with a painted surface, in a fraction of the time of `best`",
            Self::Best => "most detail: photos in full resolution, for hours of work",
        }
    }
}

/// Parts of the way from photos to a full environment map, in order; each needs those before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum StageGroup {
    /// Photos to a sparse metric map.
    Sfm,
    /// Depth maps, and the cloud they are fused to.
    Dense,
    /// The surface of the cloud.
    Mesh,
}

/// One table of the numbers that a preset sets and a job may set otherwise: their stage, unit,
/// range, and value with the presets `fast`, `balanced` and `best`.
macro_rules! effort {
    ($($(#[doc = $help:literal])+
        $name:ident: $stage:ident, $unit:literal, $min:tt..=$max:tt, $values:expr;)+) => {
        /// The numbers that a preset sets.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
        pub struct Effort {
            $($(#[doc = $help])+ pub $name: u32,)+
        }

        /// Numbers that a job sets otherwise than its preset; `GET /v1/options` lists their ranges.
        #[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
        #[serde(deny_unknown_fields)]
        pub struct JobOptions {
            $($(#[doc = $help])+
            #[schema(minimum = $min, maximum = $max)]
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub $name: Option<u32>,)+
        }

        impl JobOptions {
            /// By name, as on a command line.
            ///
            /// # Errors
            ///
            /// What is wrong with it, for people.
            pub fn set(&mut self, name: &str, value: u32) -> Result<(), String> {
                match name {
                    $(stringify!($name) => self.$name = Some(value),)+
                    _ => return Err(format!("there is no option {name:?}")),
                }
                self.problem().map_or(Ok(()), Err)
            }

            /// Both, where `self` has the last word.
            pub fn over(&self, other: &Self) -> Self {
                Self { $($name: self.$name.or(other.$name),)+ }
            }

            /// What is out of its range, if anything.
            pub fn problem(&self) -> Option<String> {
                $(if self.$name.is_some_and(|value| !($min..=$max).contains(&value)) {
                    let (name, value) = (stringify!($name), self.$name.unwrap_or_default());
                    return Some(format!("{name} must be {} to {}, got {value}", $min, $max));
                })+
                None
            }
        }

        impl Preset {
            /// Its numbers, but for those that `options` sets otherwise.
            pub fn effort(self, options: &JobOptions) -> Effort {
                Effort { $($name: options.$name.unwrap_or($values[self as usize]),)+ }
            }
        }

        /// Every number that a job may set.
        pub fn job_options() -> Vec<JobOption> {
            vec![$(JobOption {
                name: stringify!($name).to_owned(),
                description: concat!($($help),+).trim().to_owned(),
                stage: StageGroup::$stage,
                kind: "integer".to_owned(),
                unit: $unit.to_owned(),
                minimum: $min,
                maximum: $max,
                defaults: PresetDefaults {
                    fast: $values[0],
                    balanced: $values[1],
                    best: $values[2],
                },
            },)+]
        }
    };
}

effort! {
    /// Photos are made smaller until no side is longer.
    max_image_size: Sfm, "pixels", 64..=16_384, [1024, 1600, 3200];
    /// Features of a photo at most.
    max_features: Sfm, "features", 100..=50_000, [3000, 8192, 12_000];
    /// Photos that look alike, to each of which a photo is matched.
    similar_images: Sfm, "photos", 1..=500, [12, 20, 40];
    /// Pixels of a depth map at most.
    depth_map_pixels: Dense, "pixels", 10_000..=16_000_000, [80_000, 320_000, 1_280_000];
    /// Other photos that a depth map is computed from at most.
    depth_map_sources: Dense, "photos", 1..=32, [6, 8, 12];
    /// Greatest depth of the octree that the surface is found in.
    octree_depth: Mesh, "levels", 5..=13, [8, 10, 11];
    /// Triangles of the mesh at most.
    max_triangles: Mesh, "triangles", 1000..=20_000_000, [100_000, 300_000, 1_500_000];
    /// Longest side of the picture on the mesh.
    texture_size: Mesh, "pixels", 256..=16_384, [2048, 4096, 8192];
}

/// A number that a job may set in its `options`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct JobOption {
    /// Its name in `options`.
    pub name: String,
    /// What it means.
    pub description: String,
    /// The part of the way that it is for.
    pub stage: StageGroup,
    /// Always `integer`.
    #[serde(rename = "type")]
    pub kind: String,
    /// What it counts.
    pub unit: String,
    /// Least value.
    pub minimum: u32,
    /// Greatest value.
    pub maximum: u32,
    /// Its value when the job does not set it.
    pub defaults: PresetDefaults,
}

/// A value for each preset.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct PresetDefaults {
    /// With `fast`.
    pub fast: u32,
    /// With `balanced`.
    pub balanced: u32,
    /// With `best`.
    pub best: u32,
}

/// What a preset means.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct PresetInfo {
    /// Its name in a job.
    pub name: Preset,
    /// What it is for.
    pub description: String,
    /// Whether a job that names none has it.
    pub is_default: bool,
    /// Where a job ends that names no stages.
    pub last_stage: StageGroup,
    /// The numbers that it sets.
    pub values: Effort,
}

impl From<Preset> for PresetInfo {
    fn from(preset: Preset) -> Self {
        Self {
            name: preset,
            description: preset.description().to_owned(),
            is_default: preset == Preset::default(),
            last_stage: preset.last_stage(&[]),
            values: preset.effort(&JobOptions::default()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_table_lists_is_what_a_job_may_set() {
        for option in job_options() {
            let defaults = option.defaults;
            for (preset, default) in
                Preset::ALL.into_iter().zip([defaults.fast, defaults.balanced, defaults.best])
            {
                assert!((option.minimum..=option.maximum).contains(&default), "{option:?}");
                for value in [option.minimum, option.maximum] {
                    let mut options = JobOptions::default();
                    options.set(&option.name, value).unwrap();
                    let set = serde_json::to_value(preset.effort(&options)).unwrap();
                    let own = serde_json::to_value(PresetInfo::from(preset).values).unwrap();
                    for (name, number) in set.as_object().unwrap() {
                        let expected =
                            if *name == option.name { value } else { default_of(&own, name) };
                        assert_eq!(*number, expected, "{name} with {preset:?}");
                    }
                    assert_eq!(default_of(&own, &option.name), default);
                }
            }
            for value in [option.minimum - 1, option.maximum + 1] {
                let problem = JobOptions::default().set(&option.name, value).unwrap_err();
                assert!(problem.starts_with(&option.name), "{problem}");
            }
        }
        assert!(JobOptions::default().set("speed", 1).is_err());
    }

    fn default_of(values: &serde_json::Value, name: &str) -> u32 {
        values[name].as_u64().unwrap() as u32
    }
}
