//! A texture from the photos.
//!
//! Every triangle is painted from one photo that sees it well; neighbors keep to the same photo
//! where they can. The parts that hang together are cut out of the photos, made alike in color where
//! they meet, and laid side by side into one texture.

use volery_rendering::{DrawableMesh, MeshError};
use volery_scene::{Photos, Progress, SparseModel, TexturedMesh, TriangleMesh};

use crate::MeshingError;
use crate::fans::Fans;

mod charts;
mod fill;
mod labels;
mod packing;
mod paint;
mod seams;
mod view;

#[cfg(test)]
mod tests;

use charts::{Chart, charts};
use labels::{candidates, choose_views};
use packing::Layout;
use paint::Canvas;
use view::View;

/// Largest texture that common graphics hardware takes.
const MAX_SIDE: u32 = 16_384;

/// Options of [`texture_mesh`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TextureOptions {
    /// Longest side of the texture, texels: a power of two. Photos are scaled down to fit.
    pub max_side: u32,
}

impl Default for TextureOptions {
    fn default() -> Self {
        Self { max_side: 4096 }
    }
}

/// Paints `mesh` with the photos of the images of `model`.
///
/// One photo is held at a time, and each is asked for at most once. Triangles that no image sees
/// whole keep the colors of their vertices and come last.
///
/// # Errors
///
/// [`MeshingError`]: a mesh without triangles or one that cannot be, a model that sees nothing of
/// it, a photo that is missing or of another size than its camera, a texture that is too small for
/// the parts, or when cancelled.
pub fn texture_mesh(
    mesh: &TriangleMesh,
    model: &SparseModel,
    photos: &dyn Photos,
    options: &TextureOptions,
    progress: &dyn Progress,
) -> Result<TexturedMesh, MeshingError> {
    let drawable = check(mesh, options)?;
    let views: Vec<View> = model
        .images
        .iter()
        .filter_map(|(&id, image)| Some(View::new(id, image, model.cameras.get(&image.camera)?)))
        .collect();
    let fans = Fans::new(mesh.vertices.len(), &mesh.triangles);
    let labels = choose_views(mesh, &fans, candidates(mesh, &drawable, &views, progress)?);
    progress.check()?;
    let (charts, chart_of) = charts(mesh, &fans, &views, &labels);
    if charts.is_empty() {
        return Err(MeshingError::NothingSeen);
    }
    let layout = Layout::new(&charts, options.max_side)
        .ok_or(MeshingError::TextureTooSmall { num_charts: charts.len() })?;
    let mut canvas = Canvas::paint(mesh, &views, &charts, &layout, photos, progress)?;
    seams::level_seams(mesh, &fans, &charts, &chart_of, &layout, &mut canvas);
    progress.check()?;
    let mut textured = unpainted(mesh, &charts, &chart_of, &layout);
    textured.texture = fill::fill(canvas);
    Ok(textured)
}

fn check(mesh: &TriangleMesh, options: &TextureOptions) -> Result<DrawableMesh, MeshingError> {
    let side = options.max_side;
    if !side.is_power_of_two() || side > MAX_SIDE {
        return Err(MeshingError::Option { name: "max_side", got: f64::from(side) });
    }
    if mesh.triangles.is_empty() {
        return Err(MeshingError::NoTriangles);
    }
    DrawableMesh::new(mesh).map_err(|error| match error {
        MeshError::MissingVertex { triangle } => MeshingError::NoSuchVertex { triangle },
        MeshError::NotFinite { vertex } => MeshingError::NotFinite { index: vertex },
        MeshError::WrongColors { .. } | MeshError::WrongTexture => MeshingError::WrongColors,
    })
}

/// The mesh with its vertices in the texture: chart after chart, then what is not seen.
fn unpainted(
    mesh: &TriangleMesh,
    charts: &[Chart],
    chart_of: &[Option<u32>],
    layout: &Layout,
) -> TexturedMesh {
    let mut result = TexturedMesh::default();
    let add_vertex = |result: &mut TexturedMesh, vertex: u32, uv: [f32; 2]| {
        result.mesh.vertices.push(mesh.vertices[vertex as usize]);
        result.mesh.colors.extend(mesh.colors.get(vertex as usize));
        result.uvs.push(uv);
    };
    let [width, height] = [layout.width, layout.height].map(f64::from);
    for (chart, &[x, y]) in charts.iter().zip(&layout.places) {
        for (&vertex, position) in chart.vertices.iter().zip(layout.all_in_chart(chart)) {
            let uv = [(position.x + f64::from(x)) / width, (position.y + f64::from(y)) / height];
            add_vertex(&mut result, vertex, uv.map(|v| v as f32));
        }
        let triangles = chart.triangles.iter().map(|t| t.map(|v| v + chart.first_vertex));
        result.mesh.triangles.extend(triangles);
    }
    result.num_textured = result.mesh.triangles.len();
    let mut place = vec![u32::MAX; mesh.vertices.len()];
    for (triangle, _) in mesh.triangles.iter().zip(chart_of).filter(|(_, chart)| chart.is_none()) {
        let corners = triangle.map(|v| {
            if place[v as usize] == u32::MAX {
                place[v as usize] = result.mesh.vertices.len() as u32;
                add_vertex(&mut result, v, [0.0; 2]);
            }
            place[v as usize]
        });
        result.mesh.triangles.push(corners);
    }
    result
}
