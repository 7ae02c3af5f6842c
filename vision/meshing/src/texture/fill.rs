//! Texels that no chart has take the colors around them.

use super::paint::Canvas;

/// Fills what is not painted from coarser and coarser copies of the texture, so that smaller copies
/// of it (mipmaps) mix no foreign color into the charts.
///
/// Source: Gortler, Grzeszczuk, Szeliski and Cohen, "The Lumigraph", SIGGRAPH 1996, section 3.4
/// (push-pull), with weights 0 and 1.
pub(super) fn fill(canvas: Canvas) -> volery_scene::Texture {
    let Canvas { mut texture, painted } = canvas;
    fill_level(&mut texture.pixels, &painted, [texture.width as usize, texture.height as usize]);
    texture
}

fn fill_level(pixels: &mut [[u8; 3]], painted: &[bool], [width, height]: [usize; 2]) {
    if painted.iter().all(|&painted| painted) || width * height <= 1 {
        return;
    }
    let [half_width, half_height] = [width, height].map(|side| side.div_ceil(2));
    let mut sums = vec![[0_u32; 4]; half_width * half_height];
    for (index, (color, _)) in pixels.iter().zip(painted).enumerate().filter(|(_, (_, p))| **p) {
        let sum = &mut sums[index / width / 2 * half_width + index % width / 2];
        sum.iter_mut().zip(color).for_each(|(sum, &v)| *sum += u32::from(v));
        sum[3] += 1;
    }
    let mean = |[r, g, b, n]: [u32; 4]| [r, g, b].map(|v| ((v + n / 2) / n.max(1)) as u8);
    let mut coarse: Vec<[u8; 3]> = sums.iter().map(|&sum| mean(sum)).collect();
    let known: Vec<bool> = sums.iter().map(|sum| sum[3] > 0).collect();
    fill_level(&mut coarse, &known, [half_width, half_height]);
    for (index, color) in pixels.iter_mut().enumerate().filter(|(index, _)| !painted[*index]) {
        *color = coarse[index / width / 2 * half_width + index % width / 2];
    }
}
