//! The part of the report about the dense cloud and the mesh.

use std::{collections::BTreeSet, fmt::Write};

use volery_formats::write_jpeg;
use volery_mvs::{DenseOptions, Shelf, depth_map, small_photo};
use volery_scene::{ImageId, Occupancy, OccupancyGrid, RegisteredImage, SparseModel, Texture};

use crate::{
    report_html::escape,
    summary::{FreeSpaceSummary, Summary},
    view::Surface,
};

/// Photos shown beside their depth maps.
const NUM_PICTURES: usize = 4;
/// Longest side of a picture, pixels.
const PICTURE_SIDE: usize = 480;
/// Of the pictures.
const JPEG_QUALITY: u8 = 80;
/// Part of the depths of a picture that lies beyond either end of the scale of colors.
const BEYOND_SCALE: f64 = 0.02;
/// sRGB from near to far.
const NEAR_TO_FAR: [[f32; 3]; 4] =
    [[253.0, 231.0, 37.0], [53.0, 183.0, 121.0], [49.0, 104.0, 142.0], [68.0, 1.0, 84.0]];
/// sRGB of pixels without a depth.
const UNKNOWN: [u8; 3] = [40; 3];

/// sRGB of voxels.
const FREE: [u8; 3] = [190, 228, 190];
const OCCUPIED: [u8; 3] = [60, 50, 50];
const UNSEEN: [u8; 3] = [205; 3];
const CAMERA: [u8; 3] = [30, 90, 200];

/// A photo, its depth map and the mesh from the same place, as JPEG.
#[derive(Debug, Clone)]
pub(crate) struct ViewPicture {
    image: ImageId,
    name: String,
    photo: Vec<u8>,
    depth: Vec<u8>,
    mesh: Option<Vec<u8>>,
}

/// Pictures of a surface.
#[derive(Debug, Clone, Default)]
pub(crate) struct SurfacePictures {
    pub(crate) views: Vec<ViewPicture>,
    /// A layer of the free space as JPEG.
    pub(crate) plan: Option<Vec<u8>>,
}

/// The layer of a grid at the height of the middle camera, seen from above.
pub(crate) fn plan(grid: &OccupancyGrid, model: &SparseModel) -> Option<Vec<u8>> {
    let in_voxels = |image: &RegisteredImage| {
        grid.map_from_grid().inverse_transform_point(&image.center()) / grid.voxel()
    };
    let cameras: Vec<_> = model.images.values().map(in_voxels).collect();
    let mut heights: Vec<f64> = cameras.iter().map(|center| center.z).collect();
    heights.sort_by(f64::total_cmp);
    let [nx, ny, nz] = grid.size();
    let layer = (*heights.get(heights.len() / 2)? as usize).min(nz.checked_sub(1)?);
    let spots: BTreeSet<[usize; 2]> =
        cameras.iter().map(|center| [center.x as usize, center.y as usize]).collect();
    let scale = (PICTURE_SIDE / nx.max(ny).max(1)).max(1);
    let color = |index: usize| {
        // Rows go down, y goes up.
        let (x, y) = (index % (nx * scale) / scale, ny - 1 - index / (nx * scale) / scale);
        if spots.contains(&[x, y]) {
            return CAMERA;
        }
        match grid.states()[(layer * ny + y) * nx + x] {
            Occupancy::Unseen => UNSEEN,
            Occupancy::Free => FREE,
            Occupancy::Occupied => OCCUPIED,
        }
    };
    small_jpeg(nx * scale, ny * scale, &color)
}

/// Pictures of a few images, evenly over the scan; none of images that the shelf has not kept.
pub(crate) fn pictures(
    images: &[ImageId],
    model: &SparseModel,
    shelf: &dyn Shelf,
    options: &DenseOptions,
) -> Vec<ViewPicture> {
    let step = images.len().div_ceil(NUM_PICTURES).max(1);
    let picture = |id| {
        let (camera, photo) = small_photo(model, shelf, options, id)?;
        let map = depth_map(model, shelf, options, id)?;
        let (width, height) = (camera.width as usize, camera.height as usize);
        let inverse: Vec<f32> = map.depth.iter().map(|d| 1.0 / d).collect();
        let mut known: Vec<f32> = inverse.iter().copied().filter(|w| w.is_finite()).collect();
        known.sort_by(f32::total_cmp);
        let cut = (known.len() as f64 * BEYOND_SCALE) as usize;
        let far = known.get(cut).copied().unwrap_or(0.0);
        let near = known.len().checked_sub(cut + 1).map_or(1.0, |at| known[at]);
        let color = |index: usize| {
            let part = (near - inverse[index]) / (near - far).max(f32::MIN_POSITIVE);
            let color = if inverse[index].is_finite() { scale_color(part) } else { UNKNOWN };
            // Concluded, not seen: pale.
            color.map(|v| if map.inferred[index] { v / 2 + 127 } else { v })
        };
        Some(ViewPicture {
            image: id,
            name: model.images.get(&id)?.name.clone(),
            photo: small_jpeg(width, height, &|index| photo[index])?,
            depth: small_jpeg(width, height, &color)?,
            mesh: None,
        })
    };
    images.iter().copied().skip(step / 2).step_by(step).filter_map(picture).collect()
}

/// Adds what the cameras see of a surface.
pub(crate) fn draw_surface(views: &mut [ViewPicture], surface: &Surface, model: &SparseModel) {
    for view in views {
        let Some(image) = model.images.get(&view.image) else { continue };
        let Some(camera) = model.cameras.get(&image.camera) else { continue };
        let side = f64::from(camera.width.max(camera.height));
        let scale = (PICTURE_SIDE as f64 / side).min(1.0);
        let size = |v: u32| (f64::from(v) * scale).round().max(1.0) as u32;
        let camera = camera.scaled(scale, size(camera.width), size(camera.height));
        let drawn = surface.draw(&camera, &image.cam_from_world);
        let (width, height) = (drawn.width as usize, drawn.height as usize);
        view.mesh = small_jpeg(width, height, &|index| drawn.colors[index]);
    }
}

/// From 0 (near) to 1 (far).
fn scale_color(part: f32) -> [u8; 3] {
    let at = part.clamp(0.0, 1.0) * (NEAR_TO_FAR.len() - 1) as f32;
    let low = (at as usize).min(NEAR_TO_FAR.len() - 2);
    let mix = |k: usize| {
        let [a, b] = [NEAR_TO_FAR[low][k], NEAR_TO_FAR[low + 1][k]];
        (a + (at - low as f32) * (b - a)).round() as u8
    };
    [mix(0), mix(1), mix(2)]
}

fn small_jpeg(width: usize, height: usize, color: &dyn Fn(usize) -> [u8; 3]) -> Option<Vec<u8>> {
    let step = width.max(height).div_ceil(PICTURE_SIDE);
    let rows = (0..height).step_by(step);
    let pixels = rows.flat_map(|y| (0..width).step_by(step).map(move |x| y * width + x));
    let picture = Texture {
        width: width.div_ceil(step) as u32,
        height: height.div_ceil(step) as u32,
        pixels: pixels.map(color).collect(),
    };
    write_jpeg(&picture, JPEG_QUALITY).ok()
}

/// Writes the section; nothing if neither cloud nor mesh were asked for.
pub(crate) fn section(
    html: &mut String,
    summary: &Summary,
    pictures: &SurfacePictures,
) -> std::fmt::Result {
    let Some(dense) = &summary.dense else { return Ok(()) };
    html.push_str("<h2>Surface</h2>");
    for error in [dense.error.as_ref(), summary.mesh.as_ref().and_then(|mesh| mesh.error.as_ref())]
    {
        let Some(error) = error else { continue };
        let hint = error.hint.as_deref().unwrap_or_default();
        write!(html, "<p class=suspect>{}: {}", error.code, escape(&error.detail))?;
        write!(html, " {}</p>", escape(hint))?;
    }
    let unit = if summary.scale.metric { "m" } else { "units" };
    html.push_str("<table>");
    if dense.error.is_none() {
        let percent = 100.0 * dense.num_known as f64 / dense.num_pixels.max(1) as f64;
        write!(
            html,
            "<tr><th>depth maps<td>{} of {:.1} MP, {percent:.0} % of the pixels with a depth\
             <tr><th>dense points<td>{}, of which {} inferred; at least {:.4} {unit} apart",
            dense.num_depth_maps,
            dense.num_pixels as f64 * 1e-6,
            dense.num_points,
            dense.num_inferred,
            dense.spacing.unwrap_or(0.0)
        )?;
    }
    if let Some(mesh) = summary.mesh.as_ref().filter(|mesh| mesh.num_triangles > 0) {
        let (triangles, vertices) = (mesh.num_triangles, mesh.num_vertices);
        write!(
            html,
            "<tr><th>mesh<td>{triangles} triangles over {vertices} vertices, {:.1} {unit}²",
            mesh.area
        )?;
    }
    html.push_str("</table>");
    if let Some(space) = &dense.free_space {
        free_space(html, space, unit, pictures.plan.as_deref())?;
    }
    if pictures.views.is_empty() {
        return Ok(());
    }
    html.push_str(
        "<p>Photos, the mesh from the same places, and depth maps: yellow is near, violet far, pale \
         concluded from the surroundings, dark unknown.</p><table class=views>",
    );
    for ViewPicture { name, photo, depth, mesh, .. } in &pictures.views {
        let name = escape(name);
        write!(html, "<tr><td>{name}<br>{}", picture(photo, &name))?;
        for (jpeg, what) in mesh.iter().map(|mesh| (mesh, "the mesh")).chain([(depth, "depth")]) {
            write!(html, "<td><br>{}", picture(jpeg, what))?;
        }
    }
    html.push_str("</table>");
    Ok(())
}

fn picture(jpeg: &[u8], what: &str) -> String {
    format!("<img alt='{what}' src='data:image/jpeg;base64,{}'>", base64(jpeg))
}

/// Free space and where it ends without a surface.
fn free_space(
    html: &mut String,
    space: &FreeSpaceSummary,
    unit: &str,
    plan: Option<&[u8]>,
) -> std::fmt::Result {
    let FreeSpaceSummary { voxel, free, occupied, .. } = space;
    write!(
        html,
        "<h3>Free space</h3><p>Cameras saw through {free:.1} {unit}³; {occupied:.1} {unit}³ hold \
         surfaces, in voxels of {voxel:.3} {unit}.</p>"
    )?;
    if let Some(plan) = plan {
        write!(
            html,
            "<p>At the height of the cameras, from above: green free, black surfaces, gray unseen, \
             blue cameras.</p><p>{}</p>",
            picture(plan, "free space")
        )?;
    }
    if space.unseen_areas.is_empty() {
        return Ok(());
    }
    write!(
        html,
        "<p>Here free space ends without a surface; photos that look there add to the map:</p>\
         <table><tr><th>area<th class=n>middle, {unit}<th class=n>box, {unit}<th class=n>{unit}²"
    )?;
    for area in &space.unseen_areas {
        let [[x, y, z], [a, b, c]] = [area.center, area.size];
        let name = escape(&area.name);
        write!(
            html,
            "<tr><td>{name}<td class=n>{x:.1}, {y:.1}, {z:.1}<td class=n>{a:.1} × {b:.1} × {c:.1}\
             <td class=n>{:.1}",
            area.area
        )?;
    }
    html.push_str("</table>");
    Ok(())
}

/// RFC 4648, section 4.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for group in bytes.chunks(3) {
        let byte = |i: usize| u32::from(group.get(i).copied().unwrap_or(0));
        let bits = byte(0) << 16 | byte(1) << 8 | byte(2);
        for digit in 0..4 {
            let known = digit <= group.len();
            let value = DIGITS[(bits >> (18 - 6 * digit) & 63) as usize];
            text.push(if known { char::from(value) } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The test vectors of RFC 4648, section 10.
    #[test]
    fn base64_is_that_of_the_standard() {
        for (plain, coded) in
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")]
        {
            assert_eq!(base64(plain.as_bytes()), coded);
        }
    }

    #[test]
    fn the_scale_ends_where_it_should() {
        assert_eq!(scale_color(0.0), [253, 231, 37]);
        assert_eq!(scale_color(1.0), [68, 1, 84]);
        assert_eq!(
            [scale_color(-3.0), scale_color(f32::INFINITY)],
            [scale_color(0.0), scale_color(1.0)]
        );
    }
}
