//! The nouns of a reconstruction, in the order of the data.

pub mod depth_map;
pub mod features;
pub mod image;
pub mod map;
pub mod matches;
pub mod occupancy;
pub mod photo;
pub mod point_cloud;
pub mod priors;
pub mod progress;
pub mod sparse;
pub mod textured_mesh;
pub mod triangle_mesh;

pub use depth_map::{DepthMap, OctNormal};
pub use features::{DESCRIPTOR_LEN, Descriptor, Features, Keypoint};
pub use image::{CameraId, GrayImage, ImageId, ImageSize, PointId};
pub use map::{
    EnvironmentMap, Gravity, GravitySource, OriginRule, Quality, QualityReason, Scale, ScaleSource,
    Verdict,
};
pub use matches::{FeatureMatch, TwoViewGeometry, TwoViewKind};
pub use occupancy::{Occupancy, OccupancyGrid};
pub use photo::{Photo, Photos};
pub use point_cloud::{OrientedPoint, PointCloud};
pub use priors::{AttitudePrior, HeightPrior, ImagePrior, KnownDistance, PositionPrior};
pub use progress::{Cancelled, NoProgress, Progress, Stage};
pub use sparse::{
    Observation, Point3d, RegisteredImage, SparseModel, UnplacedImage, UnplacedReason,
};
pub use textured_mesh::{Texture, TexturedMesh};
pub use triangle_mesh::TriangleMesh;
