//! Texels that no chart has take the colors around them.

use volery_scene::Texture;

use super::packing::PADDING;
use super::paint::Canvas;

/// Fills what is not painted: first the padding of the charts, texel by texel, then the rest from
/// coarser and coarser copies of the texture, so that smaller copies of it (mipmaps) mix no foreign
/// color into the charts.
///
/// Source: Gortler, Grzeszczuk, Szeliski and Cohen, "The Lumigraph", SIGGRAPH 1996, section 3.4
/// (push-pull), with weights 0 and 1.
pub(super) fn fill(canvas: Canvas) -> Texture {
    let Canvas { mut texture, mut painted } = canvas;
    for _ in 0..PADDING {
        widen(&mut texture, &mut painted);
    }
    fill_level(&mut texture.pixels, &painted, [texture.width as usize, texture.height as usize]);
    texture
}

/// Texels beside painted ones become their mean.
fn widen(texture: &mut Texture, painted: &mut [bool]) {
    let (width, height) = (texture.width as usize, texture.height as usize);
    let mut found = Vec::new();
    for index in (0..painted.len()).filter(|&index| !painted[index]) {
        let (x, y) = (index % width, index / width);
        let rows = y.saturating_sub(1)..(y + 2).min(height);
        let columns = x.saturating_sub(1)..(x + 2).min(width);
        let around = rows.flat_map(|y| columns.clone().map(move |x| y * width + x));
        let (mut sum, mut count) = ([0_u32; 3], 0);
        for other in around.filter(|&other| painted[other]) {
            sum.iter_mut().zip(texture.pixels[other]).for_each(|(sum, v)| *sum += u32::from(v));
            count += 1;
        }
        if count > 0 {
            found.push((index, sum.map(|v| ((v + count / 2) / count) as u8)));
        }
    }
    for (index, color) in found {
        texture.pixels[index] = color;
        painted[index] = true;
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    /// What is painted stays, and the rest has the color of what is near.
    #[test]
    fn the_nearest_color_spreads() {
        let (width, height) = (9, 5);
        let mut canvas = Canvas {
            texture: Texture { width, height, pixels: vec![[0; 3]; 45] },
            painted: vec![false; 45],
        };
        canvas.put([0, 0], &[([0, 0], [200, 10, 10]), ([8, 4], [10, 10, 200])]);
        let filled = fill(canvas);
        assert_eq!((filled.pixels[0], filled.pixels[44]), ([200, 10, 10], [10, 10, 200]));
        assert_eq!((filled.pixels[10], filled.pixels[43]), ([200, 10, 10], [10, 10, 200]));
        assert!(filled.pixels.iter().all(|[r, g, b]| *g == 10 && (205..=215).contains(&(r + b))));
    }
}
