//! Which images the verified pairs tie together.

use volery_scene::TwoViewGeometry;

/// The component of every `usable` image, numbered by its first image; `None` for images that are
/// not usable or in no pair.
pub(crate) fn components(
    num_images: usize,
    pairs: &[TwoViewGeometry],
    usable: &[bool],
) -> Vec<Option<usize>> {
    let mut parent: Vec<usize> = (0..num_images).collect();
    let mut touched = vec![false; num_images];
    for pair in pairs {
        let (i, j) = (pair.image1.0 as usize, pair.image2.0 as usize);
        if i >= num_images || j >= num_images || !usable[i] || !usable[j] {
            continue;
        }
        touched[i] = true;
        touched[j] = true;
        let (a, b) = (root(&mut parent, i), root(&mut parent, j));
        // The smaller index leads.
        parent[a.max(b)] = a.min(b);
    }
    (0..num_images).map(|i| touched[i].then(|| root(&mut parent, i))).collect()
}

fn root(parent: &mut [usize], mut node: usize) -> usize {
    while parent[node] != node {
        parent[node] = parent[parent[node]];
        node = parent[node];
    }
    node
}
