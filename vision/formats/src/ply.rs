//! Colored points as PLY.

use nalgebra::{Point3, Vector3};
use volery_scene::SparseModel;

mod cloud;
mod mesh;

pub use cloud::{read_ply_of_cloud, write_ply_of_cloud};
pub use mesh::{read_ply_of_mesh, write_ply_of_mesh};

/// Bytes that the header may take.
const MAX_HEADER_BYTES: usize = 64 << 10;

/// Points with colors.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PlyCloud {
    /// Positions.
    pub points: Vec<Point3<f64>>,
    /// sRGB; as many as points, white where the file has none.
    pub colors: Vec<[u8; 3]>,
    /// As many as points, or none. [`write_ply`] leaves them out.
    pub normals: Vec<Vector3<f32>>,
}

/// Why a file was refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PlyError {
    /// No or a broken header.
    #[error("not a PLY file: {0}")]
    Header(String),
    /// Fewer bytes than the header promises.
    #[error("PLY data end too early, at vertex {vertex}")]
    Truncated {
        /// The first vertex that is not whole.
        vertex: usize,
    },
    /// A field that is no finite number.
    #[error("PLY vertex {vertex} is not a finite number")]
    NotANumber {
        /// Which vertex.
        vertex: usize,
    },
}

/// Writes binary little endian: x, y, z as 32-bit floats and red, green, blue.
pub fn write_ply(cloud: &PlyCloud) -> Vec<u8> {
    let header = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float \
         y\nproperty float z\nproperty uchar red\nproperty uchar green\nproperty uchar \
         blue\nend_header\n",
        cloud.points.len()
    );
    let mut bytes = header.into_bytes();
    bytes.reserve(cloud.points.len() * 15);
    for (point, color) in cloud.points.iter().zip(&cloud.colors) {
        bytes.extend(point.iter().flat_map(|&v| (v as f32).to_le_bytes()));
        bytes.extend(color);
    }
    bytes
}

/// The points of a model in the order of their ids.
pub fn write_ply_of_model(model: &SparseModel) -> Vec<u8> {
    let points = model.points.values();
    write_ply(&PlyCloud {
        points: points.clone().map(|p| p.position).collect(),
        colors: points.map(|p| p.color).collect(),
        normals: Vec::new(),
    })
}

/// Reads the vertices of an ASCII or binary PLY of any byte order. Other properties of a vertex
/// are skipped; elements after the vertices are not looked at.
///
/// # Errors
///
/// [`PlyError`] for a broken header, missing bytes, and coordinates that are not finite.
pub fn read_ply(bytes: &[u8]) -> Result<PlyCloud, PlyError> {
    let (layout, data) = read_header(bytes)?;
    let mut cloud = PlyCloud::default();
    layout.each_vertex(data, &mut |values| layout.push(&mut cloud, values))?;
    Ok(cloud)
}

#[derive(Clone, Copy, PartialEq)]
enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// Scalar types of PLY under their old and new names.
#[derive(Clone, Copy, PartialEq)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Of `size` bytes, little endian in the first of `raw`.
    fn read(self, raw: [u8; 8]) -> f64 {
        let [a, b, c, d, ..] = raw;
        match self {
            Self::I8 => f64::from(a as i8),
            Self::U8 => f64::from(a),
            Self::I16 => f64::from(i16::from_le_bytes([a, b])),
            Self::U16 => f64::from(u16::from_le_bytes([a, b])),
            Self::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Self::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Self::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Self::F64 => f64::from_le_bytes(raw),
        }
    }
}

struct Layout {
    encoding: Encoding,
    num_vertices: usize,
    properties: Vec<(String, Scalar)>,
    /// Positions of x, y, z among the properties.
    xyz: [usize; 3],
    /// Positions of red, green, blue.
    rgb: Option<[usize; 3]>,
    /// Positions of the normal.
    normal: Option<[usize; 3]>,
}

fn read_header(bytes: &[u8]) -> Result<(Layout, &[u8]), PlyError> {
    let error = |text: &str| PlyError::Header(text.to_owned());
    let mut offset = 0;
    let mut next_line = || {
        let rest = &bytes[offset..bytes.len().min(MAX_HEADER_BYTES).max(offset)];
        let length = rest.iter().position(|&b| b == b'\n').ok_or_else(|| error("no end_header"))?;
        offset += length + 1;
        let line = std::str::from_utf8(&rest[..length]).map_err(|_| error("header is not text"))?;
        Ok((line.trim(), offset))
    };
    if next_line()?.0 != "ply" {
        return Err(error("no magic word"));
    }
    let (mut encoding, mut num_vertices, mut properties) = (None, None, Vec::new());
    let mut in_vertices = false;
    let data_start = loop {
        let (line, end) = next_line()?;
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match words[..] {
            [] | ["comment" | "obj_info", ..] => {}
            ["format", "ascii", _] => encoding = Some(Encoding::Ascii),
            ["format", "binary_little_endian", _] => encoding = Some(Encoding::LittleEndian),
            ["format", "binary_big_endian", _] => encoding = Some(Encoding::BigEndian),
            ["element", "vertex", count] => {
                let count = count.parse::<usize>().map_err(|_| error("bad vertex count"))?;
                num_vertices = Some(count);
                in_vertices = true;
            }
            ["element", ..] if num_vertices.is_none() => {
                return Err(error("vertices are not the first element"));
            }
            ["element", ..] => in_vertices = false,
            ["property", ..] if !in_vertices => {}
            ["property", kind, name] => {
                let kind = Scalar::from_name(kind).ok_or_else(|| error("unknown property type"))?;
                properties.push((name.to_owned(), kind));
            }
            ["end_header"] => break end,
            _ => return Err(error("line that is not understood")),
        }
    };
    let find = |name: &str| properties.iter().position(|(property, _)| property == name);
    let all = |names: [&str; 3]| {
        let [a, b, c] = names.map(find);
        Some([a?, b?, c?])
    };
    let layout = Layout {
        encoding: encoding.ok_or_else(|| error("no format"))?,
        num_vertices: num_vertices.ok_or_else(|| error("no vertices"))?,
        xyz: all(["x", "y", "z"]).ok_or_else(|| error("vertices have no x, y, z"))?,
        rgb: all(["red", "green", "blue"]),
        normal: all(["nx", "ny", "nz"]),
        properties,
    };
    Ok((layout, &bytes[data_start..]))
}

/// Takes the properties of the next vertex.
type Take<'a> = dyn FnMut(&[f64]) -> Result<(), PlyError> + 'a;

impl Layout {
    /// Bytes of a vertex in a binary file.
    fn stride(&self) -> usize {
        self.properties.iter().map(|(_, kind)| kind.size()).sum()
    }

    fn each_vertex(&self, data: &[u8], take: &mut Take<'_>) -> Result<(), PlyError> {
        match self.encoding {
            Encoding::Ascii => self.each_ascii_vertex(data, take),
            Encoding::LittleEndian => self.each_binary_vertex(data, false, take),
            Encoding::BigEndian => self.each_binary_vertex(data, true, take),
        }
    }

    fn each_binary_vertex(
        &self,
        data: &[u8],
        big_endian: bool,
        take: &mut Take<'_>,
    ) -> Result<(), PlyError> {
        let num_whole = data.len() / self.stride();
        if num_whole < self.num_vertices {
            return Err(PlyError::Truncated { vertex: num_whole });
        }
        let mut values = vec![0.0; self.properties.len()];
        for record in data.chunks_exact(self.stride()).take(self.num_vertices) {
            let mut at = 0;
            for (value, (_, kind)) in values.iter_mut().zip(&self.properties) {
                let mut raw = [0; 8];
                let bytes = &mut raw[..kind.size()];
                bytes.copy_from_slice(&record[at..at + kind.size()]);
                if big_endian {
                    bytes.reverse();
                }
                *value = kind.read(raw);
                at += kind.size();
            }
            take(&values)?;
        }
        Ok(())
    }

    fn each_ascii_vertex(&self, data: &[u8], take: &mut Take<'_>) -> Result<(), PlyError> {
        let text = String::from_utf8_lossy(data);
        let mut words = text.split_ascii_whitespace();
        let mut values = vec![0.0; self.properties.len()];
        for vertex in 0..self.num_vertices {
            for value in &mut values {
                let word = words.next().ok_or(PlyError::Truncated { vertex })?;
                *value = word.parse().map_err(|_| PlyError::NotANumber { vertex })?;
            }
            take(&values)?;
        }
        Ok(())
    }

    fn push(&self, cloud: &mut PlyCloud, values: &[f64]) -> Result<(), PlyError> {
        let point = Point3::from(self.xyz.map(|i| values[i]));
        if !point.iter().all(|v| v.is_finite()) {
            return Err(PlyError::NotANumber { vertex: cloud.points.len() });
        }
        let color = |i: usize| match self.properties[i].1 {
            Scalar::F32 | Scalar::F64 => (values[i] * 255.0).round().clamp(0.0, 255.0) as u8,
            _ => values[i].clamp(0.0, 255.0) as u8,
        };
        if let Some(normal) = self.normal {
            let normal = Vector3::from(normal.map(|i| values[i] as f32));
            if !normal.iter().all(|v| v.is_finite()) {
                return Err(PlyError::NotANumber { vertex: cloud.points.len() });
            }
            cloud.normals.push(normal);
        }
        cloud.points.push(point);
        cloud.colors.push(self.rgb.map_or([255; 3], |rgb| rgb.map(color)));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud() -> PlyCloud {
        PlyCloud {
            points: vec![Point3::new(0.5, -1.25, 3.0), Point3::new(1e6, 0.0, -1e-3_f32 as f64)],
            colors: vec![[0, 127, 255], [1, 2, 3]],
            normals: Vec::new(),
        }
    }

    #[test]
    fn round_trip() {
        assert_eq!(read_ply(&write_ply(&cloud())), Ok(cloud()));
        assert_eq!(read_ply(&write_ply(&PlyCloud::default())), Ok(PlyCloud::default()));
    }

    #[test]
    fn ascii_with_other_properties_and_elements() {
        let text = "ply\r\nformat ascii 1.0\r\ncomment by hand\r\nelement vertex 2\r\nproperty double \
                    x\r\nproperty float nx\r\nproperty double y\r\nproperty double z\r\nelement face \
                    1\r\nproperty list uchar int vertex_indices\r\nend_header\r\n1 9 2 3\r\n4 9 5 \
                    6\r\n3 0 1 0\r\n";
        let read = read_ply(text.as_bytes()).unwrap();
        assert_eq!(read.points, [Point3::new(1.0, 2.0, 3.0), Point3::new(4.0, 5.0, 6.0)]);
        assert_eq!(read.colors, [[255; 3]; 2]);
        assert!(read.normals.is_empty(), "nx alone is no normal");
    }

    #[test]
    fn normals_are_read() {
        let text = |z: &str| {
            format!(
                "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float \
                 y\nproperty float z\nproperty float nx\nproperty float ny\nproperty float \
                 nz\nend_header\n1 2 3 0 0.6 {z}\n"
            )
        };
        let read = read_ply(text("-0.8").as_bytes()).unwrap();
        assert_eq!(read.normals, [Vector3::new(0.0, 0.6, -0.8)]);
        assert_eq!(read_ply(text("inf").as_bytes()), Err(PlyError::NotANumber { vertex: 0 }));
    }

    #[test]
    fn big_endian() {
        let mut bytes = b"ply\nformat binary_big_endian 1.0\nelement vertex 1\nproperty float \
            x\nproperty short y\nproperty double z\nend_header\n"
            .to_vec();
        bytes.extend(1.5_f32.to_be_bytes());
        bytes.extend((-300_i16).to_be_bytes());
        bytes.extend(0.1_f64.to_be_bytes());
        assert_eq!(read_ply(&bytes).unwrap().points, [Point3::new(1.5, -300.0, 0.1)]);
    }

    #[test]
    fn every_truncation_is_an_error() {
        let whole = write_ply(&cloud());
        for end in 0..whole.len() {
            assert!(read_ply(&whole[..end]).is_err(), "cut at {end}");
        }
    }

    #[test]
    fn lies_are_refused() {
        let header = |count: &str| {
            format!(
                "ply\nformat binary_little_endian 1.0\nelement vertex {count}\nproperty float x\n\
                property float y\nproperty float z\nend_header\n"
            )
        };
        assert_eq!(
            read_ply(header("18446744073709551615").as_bytes()),
            Err(PlyError::Truncated { vertex: 0 })
        );
        let mut nan = header("1").into_bytes();
        nan.extend([f32::NAN; 3].iter().flat_map(|v| v.to_le_bytes()));
        assert_eq!(read_ply(&nan), Err(PlyError::NotANumber { vertex: 0 }));
        assert!(matches!(
            read_ply(b"ply\nformat ascii 1.0\nend_header\n"),
            Err(PlyError::Header(_))
        ));
    }
}
