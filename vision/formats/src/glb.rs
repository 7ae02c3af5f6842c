//! A map as binary glTF 2.0.

use nalgebra::{Point3, Vector3};
use serde_json::{Value, json};
use volery_geometry::Camera;
use volery_scene::{EnvironmentMap, OriginRule, RegisteredImage};

mod mesh;
mod moved;
mod read;
mod textured;

pub use mesh::write_glb_of_mesh;
pub use moved::{ForeignGlb, move_glb};
pub use read::read_glb_of_textured_mesh;
pub use textured::write_glb_of_textured_mesh;

/// glTF from map axes (x forward, y left, z up to y up, z forward, x left), as `[x, y, z, w]`;
/// the rotation of `volery_geometry::frames::gltf_from_map`.
const GLTF_FROM_MAP: [f64; 4] = [-0.5, -0.5, -0.5, 0.5];

/// Depth of the drawn frusta relative to the spread of the cameras.
const FRUSTUM_DEPTH_RATIO: f64 = 0.03;

/// glTF's numbers for what we use.
mod gltf {
    pub(super) const FLOAT: u32 = 5126;
    pub(super) const UNSIGNED_BYTE: u32 = 5121;
    pub(super) const UNSIGNED_INT: u32 = 5125;
    pub(super) const ARRAY_BUFFER: u32 = 34962;
    pub(super) const ELEMENT_ARRAY_BUFFER: u32 = 34963;
    pub(super) const LINEAR: u32 = 9729;
    pub(super) const LINEAR_MIPMAP_LINEAR: u32 = 9987;
    pub(super) const CLAMP_TO_EDGE: u32 = 33071;
    pub(super) const POINTS: u32 = 0;
    pub(super) const LINES: u32 = 1;
    pub(super) const JSON_CHUNK: u32 = 0x4e4f_534a;
    pub(super) const BIN_CHUNK: u32 = 0x004e_4942;
    pub(super) const MAGIC: u32 = 0x4654_6c67;
}

/// What a GLB says of its map in `asset.extras`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GlbMap<'a> {
    /// `map_id`, if the surface is that of a map.
    pub id: Option<&'a str>,
    /// `unit`: `meter`, or `unknown` without metric scale.
    pub is_metric: bool,
    /// `origin`: the rule of it, if there is one.
    pub origin: Option<OriginRule>,
}

impl<'a> GlbMap<'a> {
    /// Of a map.
    pub fn of(map: &EnvironmentMap, id: &'a str) -> Self {
        Self { id: Some(id), is_metric: map.scale.metric, origin: Some(map.origin) }
    }

    /// `asset`, which carries `frame` too.
    fn asset(&self) -> Value {
        let mut extras = json!({
            "unit": if self.is_metric { "meter" } else { "unknown" },
            "frame": "vertices: x forward, y left, z up",
        });
        if let Some(id) = self.id {
            extras["map_id"] = json!(id);
        }
        if let Some(origin) = self.origin {
            extras["origin"] = json!(origin);
        }
        json!({ "version": "2.0", "generator": "Volery", "extras": extras })
    }
}

/// Writes the points and the camera frusta of a map as a GLB. Vertices are in map coordinates; the
/// root node turns them to glTF's axes. `asset.extras` is as [`GlbMap`] says.
pub fn write_glb(map: &EnvironmentMap, map_id: &str) -> Vec<u8> {
    let points: Vec<Point3<f64>> = map.model.points.values().map(|p| p.position).collect();
    let colors: Vec<[u8; 3]> = map.model.points.values().map(|p| p.color).collect();
    let mut buffer = Buffer::default();
    let (mut meshes, mut children) = (Vec::new(), Vec::new());
    if !points.is_empty() {
        let position = buffer.positions(&points);
        let color = buffer.colors(&colors);
        meshes.push(json!({
            "name": "points",
            "primitives": [{
                "attributes": { "POSITION": position, "COLOR_0": color },
                "mode": gltf::POINTS,
            }],
        }));
        children.push("points");
    }
    let lines = frusta(map);
    if !lines.is_empty() {
        let position = buffer.positions(&lines);
        meshes.push(json!({
            "name": "cameras",
            "primitives": [{ "attributes": { "POSITION": position }, "mode": gltf::LINES }],
        }));
        children.push("cameras");
    }
    let mut nodes =
        vec![json!({ "name": "map", "rotation": GLTF_FROM_MAP, "children": Vec::<usize>::new() })];
    if children.is_empty() {
        nodes[0].as_object_mut().expect("it is an object").remove("children");
    }
    for (mesh, name) in children.into_iter().enumerate() {
        nodes[0]["children"].as_array_mut().expect("it is an array").push(json!(mesh + 1));
        nodes.push(json!({ "name": name, "mesh": mesh }));
    }
    let mut document = json!({
        "asset": GlbMap::of(map, map_id).asset(),
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": nodes,
    });
    if !meshes.is_empty() {
        document["meshes"] = json!(meshes);
        document["accessors"] = json!(buffer.accessors);
        document["bufferViews"] = json!(buffer.views);
        document["buffers"] = json!([{ "byteLength": buffer.bytes.len() }]);
    }
    container(&document, buffer.bytes)
}

/// Binary data with the views and accessors into it.
#[derive(Default)]
struct Buffer {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Buffer {
    /// Index of the new accessor.
    fn positions(&mut self, points: &[Point3<f64>]) -> usize {
        let mut bounds = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
        let start = self.bytes.len();
        for point in points {
            for (axis, value) in point.iter().map(|&v| v as f32).enumerate() {
                bounds[0][axis] = bounds[0][axis].min(value);
                bounds[1][axis] = bounds[1][axis].max(value);
                self.bytes.extend(value.to_le_bytes());
            }
        }
        self.view(start, gltf::ARRAY_BUFFER, None);
        self.accessors.push(json!({
            "bufferView": self.views.len() - 1,
            "componentType": gltf::FLOAT,
            "count": points.len(),
            "type": "VEC3",
            "min": bounds[0],
            "max": bounds[1],
        }));
        self.accessors.len() - 1
    }

    /// RGBA, so that every element starts at a multiple of four bytes.
    fn colors(&mut self, colors: &[[u8; 3]]) -> usize {
        let start = self.bytes.len();
        self.bytes.extend(colors.iter().flat_map(|&[r, g, b]| [r, g, b, 255]));
        self.view(start, gltf::ARRAY_BUFFER, Some(4));
        self.accessors.push(json!({
            "bufferView": self.views.len() - 1,
            "componentType": gltf::UNSIGNED_BYTE,
            "normalized": true,
            "count": colors.len(),
            "type": "VEC4",
        }));
        self.accessors.len() - 1
    }

    /// Places in a texture.
    fn uvs(&mut self, uvs: &[[f32; 2]]) -> usize {
        let start = self.bytes.len();
        self.bytes.extend(uvs.iter().flatten().flat_map(|v| v.to_le_bytes()));
        self.view(start, gltf::ARRAY_BUFFER, None);
        self.accessors.push(json!({
            "bufferView": self.views.len() - 1,
            "componentType": gltf::FLOAT,
            "count": uvs.len(),
            "type": "VEC2",
        }));
        self.accessors.len() - 1
    }

    /// Index of the view of an encoded picture; what follows starts at a multiple of four bytes.
    fn image(&mut self, encoded: &[u8]) -> usize {
        self.views.push(json!({
            "buffer": 0,
            "byteOffset": self.bytes.len(),
            "byteLength": encoded.len(),
        }));
        self.bytes.extend(encoded);
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views.len() - 1
    }

    /// Corners of triangles.
    fn indices(&mut self, triangles: &[[u32; 3]]) -> usize {
        let start = self.bytes.len();
        self.bytes.extend(triangles.iter().flatten().flat_map(|v| v.to_le_bytes()));
        self.view(start, gltf::ELEMENT_ARRAY_BUFFER, None);
        self.accessors.push(json!({
            "bufferView": self.views.len() - 1,
            "componentType": gltf::UNSIGNED_INT,
            "count": 3 * triangles.len(),
            "type": "SCALAR",
        }));
        self.accessors.len() - 1
    }

    fn view(&mut self, start: usize, target: u32, stride: Option<usize>) {
        let mut view = json!({
            "buffer": 0,
            "byteOffset": start,
            "byteLength": self.bytes.len() - start,
            "target": target,
        });
        if let Some(stride) = stride {
            view["byteStride"] = json!(stride);
        }
        self.views.push(view);
    }
}

/// End points of the lines that draw the cameras.
fn frusta(map: &EnvironmentMap) -> Vec<Point3<f64>> {
    let centers: Vec<Point3<f64>> = map.model.images.values().map(|i| i.center()).collect();
    let n = centers.len().max(1) as f64;
    let mean = centers.iter().map(|c| c.coords).sum::<Vector3<f64>>() / n;
    let spread = (centers.iter().map(|c| (c.coords - mean).norm_squared()).sum::<f64>() / n).sqrt();
    // A single camera has no spread: one thirtieth of a unit then.
    let depth = FRUSTUM_DEPTH_RATIO * if spread > 1e-9 { spread } else { 1.0 };
    map.model
        .images
        .values()
        .filter_map(|image| {
            let camera = map.model.cameras.get(&image.camera)?;
            Some(frustum(image, camera, depth))
        })
        .flatten()
        .collect()
}

fn frustum(image: &RegisteredImage, camera: &Camera, depth: f64) -> [Point3<f64>; 16] {
    let k = camera.calibration_matrix();
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    let world_from_cam = image.cam_from_world.inverse();
    let apex = image.center();
    let corner = |u: f64, v: f64| {
        let (x, y) = ((u - k[(0, 2)]) / k[(0, 0)], (v - k[(1, 2)]) / k[(1, 1)]);
        world_from_cam * Point3::new(x * depth, y * depth, depth)
    };
    let [a, b, c, d] =
        [corner(0.0, 0.0), corner(width, 0.0), corner(width, height), corner(0.0, height)];
    [apex, a, apex, b, apex, c, apex, d, a, b, b, c, c, d, d, a]
}

/// Header, JSON chunk padded with spaces, binary chunk padded with zeros.
fn container(document: &Value, mut binary: Vec<u8>) -> Vec<u8> {
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    binary.resize(binary.len().next_multiple_of(4), 0);
    let binary_chunk = if binary.is_empty() { 0 } else { 8 + binary.len() };
    let total = 12 + 8 + text.len() + binary_chunk;
    let mut bytes = Vec::with_capacity(total);
    for word in [gltf::MAGIC, 2, total as u32, text.len() as u32, gltf::JSON_CHUNK] {
        bytes.extend(word.to_le_bytes());
    }
    bytes.extend(text);
    if binary_chunk > 0 {
        bytes.extend((binary.len() as u32).to_le_bytes());
        bytes.extend(gltf::BIN_CHUNK.to_le_bytes());
        bytes.extend(binary);
    }
    bytes
}

#[cfg(test)]
mod tests {
    use nalgebra::{Quaternion, UnitQuaternion};
    use volery_geometry::frames::gltf_from_map;
    use volery_scene::{
        Gravity, GravitySource, OriginRule, Quality, Scale, ScaleSource, SparseModel, Verdict,
    };

    use super::*;

    pub(super) const METRIC: GlbMap<'_> = GlbMap { id: None, is_metric: true, origin: None };

    fn map(model: SparseModel) -> EnvironmentMap {
        EnvironmentMap {
            model,
            zones: Vec::new(),
            unplaced: Vec::new(),
            scale: Scale { metric: true, source: ScaleSource::Positions, sigma_rel: Some(0.01) },
            gravity: Gravity { source: GravitySource::CameraUp, sigma: None },
            origin: OriginRule::LastCamera,
            quality: Quality { verdict: Verdict::Good, reasons: Vec::new() },
        }
    }

    fn document(glb: &[u8]) -> Value {
        let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
        serde_json::from_slice(&glb[20..20 + length]).unwrap()
    }

    #[test]
    fn root_node_turns_map_to_gltf() {
        let [x, y, z, w] = GLTF_FROM_MAP;
        let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
        for v in [Vector3::x(), Vector3::y(), Vector3::new(1.0, 2.0, 3.0)] {
            assert!((rotation * v - gltf_from_map(&v)).norm() < 1e-12);
        }
    }

    /// Lengths in the header, chunk padding, accessor counts and bounds, vertices in map frame.
    #[test]
    fn chunks_and_accessors_are_consistent() {
        let model = crate::colmap::tests::model();
        let glb = write_glb(&map(model.clone()), "m-1");
        let word = |at: usize| u32::from_le_bytes(glb[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!(&glb[..4], b"glTF");
        assert_eq!(word(8), glb.len());
        let json_length = word(12);
        assert_eq!(json_length % 4, 0);
        let document = document(&glb);
        assert_eq!(document["asset"]["extras"]["map_id"], "m-1");
        assert_eq!(document["asset"]["extras"]["unit"], "meter");
        assert!(document["asset"]["extras"]["origin"].is_string());
        assert_eq!(document["accessors"][0]["count"], model.points.len());
        assert_eq!(document["accessors"][2]["count"], 16 * model.images.len());
        let binary = &glb[20 + json_length + 8..];
        assert_eq!(document["buffers"][0]["byteLength"], binary.len());
        let first = f32::from_le_bytes(binary[..4].try_into().unwrap());
        assert_eq!(first, model.points.values().next().unwrap().position.x as f32);
        let x = model.points.values().map(|p| p.position.x as f32);
        assert_eq!(document["accessors"][0]["max"][0], f64::from(x.fold(f32::MIN, f32::max)));
        for view in document["bufferViews"].as_array().unwrap() {
            let end = view["byteOffset"].as_u64().unwrap() + view["byteLength"].as_u64().unwrap();
            assert!(end as usize <= binary.len());
        }
    }

    /// The apex of a frustum is the camera, and its base lies in front.
    #[test]
    fn frusta_stand_at_the_cameras() {
        let model = crate::colmap::tests::model();
        let (_, image) = model.images.iter().next().unwrap();
        let lines = frustum(image, &model.cameras[&image.camera], 0.5);
        assert!((lines[0] - image.center()).norm() < 1e-12);
        for corner in &lines[8..] {
            assert!(((image.cam_from_world * corner).z - 0.5).abs() < 1e-12);
        }
    }

    /// Empty arrays are not allowed in glTF.
    #[test]
    fn an_empty_map_is_valid() {
        let document = document(&write_glb(&map(SparseModel::default()), ""));
        assert!(document.get("meshes").is_none() && document.get("buffers").is_none());
        assert!(document["nodes"][0].get("children").is_none());
    }
}
