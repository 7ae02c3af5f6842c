//! Bytes to scene and back.
//!
//! Everything that is read may come from a stranger: sizes are checked before memory is taken,
//! indices before they are used, and no number that is not finite is let in.

pub mod camera_json;
pub mod colmap;
pub mod decode;
pub mod exif;
pub mod features_file;
pub mod glb;
pub mod jpeg;
pub mod occupancy_file;
pub mod ply;
pub mod poses_csv;
pub mod positions_csv;
pub mod rendered_png;
pub mod resize;
pub mod telemetry_csv;
pub mod thumbnail;
pub mod transforms_json;

pub use camera_json::{CameraFileError, read_camera_json, write_camera_json};
pub use colmap::{ColmapError, ColmapFiles, read_colmap_poses};
pub use decode::{
    ColorImage, DecodeError, DecodeLimits, DecodedImage, ImageFormat, ImageHeader, Orientation,
    decode_image, sniff,
};
pub use exif::{ExifSummary, FocalGuess, FocalSource, read_exif};
pub use features_file::{
    FeaturesFileError, read_features, read_two_view_geometries, write_features,
    write_two_view_geometries,
};
pub use glb::{
    ForeignGlb, GlbMap, move_glb, read_glb_of_textured_mesh, write_glb, write_glb_of_mesh,
    write_glb_of_textured_mesh,
};
pub use jpeg::{WriteJpegError, write_jpeg};
pub use occupancy_file::{OccupancyFileError, read_occupancy, write_occupancy};
pub use ply::{
    PlyCloud, PlyError, read_ply, read_ply_of_cloud, read_ply_of_mesh, write_ply,
    write_ply_of_cloud, write_ply_of_mesh, write_ply_of_model,
};
pub use poses_csv::{NamedPose, read_poses_csv, write_poses_csv};
pub use positions_csv::{NamedPosition, read_positions_csv};
pub use rendered_png::{write_depth_png, write_png};
pub use resize::{downscale_to_max_side, downscaled_size};
pub use table::TableError;
pub use telemetry_csv::{TelemetryRow, TelemetrySigmas, read_telemetry_csv};
pub use thumbnail::write_thumbnail;
pub use transforms_json::{TransformsError, read_transforms_json, write_transforms_json};

mod bytes;
mod table;
