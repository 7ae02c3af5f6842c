//! How firmly the parts of a map hang together.

use std::collections::BTreeMap;

use volery_scene::{ImageId, SparseModel};

/// Points across a cut that tie two parts of a map together.
pub(super) const MIN_TIE_POINTS: usize = 40;
/// Images on the smaller side of a cut that is worth a warning.
pub(super) const MIN_PART_IMAGES: usize = 3;
/// Points in three or more images across a cut that tie the scales of two parts together. A point
/// in two images, one on either side, says in which direction the parts lie and not how far.
pub(super) const MIN_SCALE_POINTS: usize = 12;

/// Fewest points shared across any weak cut of the map, with the number of images on the smaller
/// side.
pub(super) fn weakest_tie(model: &SparseModel) -> Option<(usize, usize)> {
    weakest_cut(model, 2, MIN_TIE_POINTS)
}

/// The same of points in three or more images. Two images have no scales to tie.
pub(super) fn weakest_scale_tie(model: &SparseModel) -> Option<(usize, usize)> {
    weakest_cut(model, 3, MIN_SCALE_POINTS)
}

/// Fewest points in `min_views` or more images across any cut of a maximum spanning tree over the
/// images (edges weigh shared points) at an edge of less than `limit` that leaves at least
/// [`MIN_PART_IMAGES`] on either side, with the number of images on the smaller side.
fn weakest_cut(model: &SparseModel, min_views: usize, limit: usize) -> Option<(usize, usize)> {
    let ids: Vec<ImageId> = model.images.keys().copied().collect();
    let index_of: BTreeMap<ImageId, usize> =
        ids.iter().enumerate().map(|(index, &id)| (id, index)).collect();
    let mut shared: BTreeMap<(usize, usize), usize> = BTreeMap::new();
    let seen_by: Vec<Vec<usize>> = model
        .points
        .values()
        .map(|point| point.track.iter().filter_map(|o| index_of.get(&o.image).copied()).collect())
        .collect();
    for images in &seen_by {
        for (position, &a) in images.iter().enumerate() {
            for &b in &images[..position] {
                *shared.entry((a.min(b), a.max(b))).or_default() +=
                    usize::from(images.len() >= min_views);
            }
        }
    }
    let mut edges: Vec<(usize, (usize, usize))> = shared.into_iter().map(|(e, n)| (n, e)).collect();
    edges.sort_by_key(|&(n, edge)| (std::cmp::Reverse(n), edge));
    let mut part: Vec<usize> = (0..ids.len()).collect();
    let mut tree = Vec::new();
    for &(n, (a, b)) in &edges {
        let (from, to) = (part[a], part[b]);
        if from != to {
            for p in part.iter_mut().filter(|p| **p == from) {
                *p = to;
            }
            tree.push((n, a, b));
        }
    }
    // Only weak edges of the tree can be part of a weak cut.
    let mut weakest: Option<(usize, usize)> = None;
    for cut in (0..tree.len()).filter(|&t| tree[t].0 < limit) {
        let side = side_of(&tree, cut, ids.len());
        let size = side.iter().filter(|&&inside| inside).count();
        let smaller = size.min(ids.len() - size);
        if smaller < MIN_PART_IMAGES {
            continue;
        }
        let across = seen_by
            .iter()
            .filter(|images| images.len() >= min_views)
            .filter(|images| images.iter().any(|&i| side[i]) && images.iter().any(|&i| !side[i]))
            .count();
        if weakest.is_none_or(|(least, _)| across < least) {
            weakest = Some((across, smaller));
        }
    }
    weakest
}

/// Nodes on the first side of `tree` without the edge `cut`.
fn side_of(tree: &[(usize, usize, usize)], cut: usize, num_nodes: usize) -> Vec<bool> {
    let mut neighbors = vec![Vec::new(); num_nodes];
    for (index, &(_, a, b)) in tree.iter().enumerate() {
        if index != cut {
            neighbors[a].push(b);
            neighbors[b].push(a);
        }
    }
    let mut inside = vec![false; num_nodes];
    let mut stack = vec![tree[cut].1];
    while let Some(node) = stack.pop() {
        if !std::mem::replace(&mut inside[node], true) {
            stack.extend(&neighbors[node]);
        }
    }
    inside
}
