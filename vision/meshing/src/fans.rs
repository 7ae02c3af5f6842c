//! Which triangles meet at a vertex and at an edge.

/// The triangles around every vertex.
#[derive(Debug, Clone)]
pub(crate) struct Fans {
    /// Begin and end of each vertex' triangles.
    ranges: Vec<[u32; 2]>,
    triangles: Vec<u32>,
}

impl Fans {
    pub(crate) fn new(num_vertices: usize, triangles: &[[u32; 3]]) -> Self {
        let mut ranges = vec![[0; 2]; num_vertices];
        triangles.iter().flatten().for_each(|&v| ranges[v as usize][1] += 1);
        let mut start = 0;
        for range in &mut ranges {
            let len = range[1];
            *range = [start; 2];
            start += len;
        }
        let mut all = vec![0; 3 * triangles.len()];
        for (index, triangle) in triangles.iter().enumerate() {
            for &v in triangle {
                let end = &mut ranges[v as usize][1];
                all[*end as usize] = index as u32;
                *end += 1;
            }
        }
        Self { ranges, triangles: all }
    }

    pub(crate) fn len(&self) -> usize {
        self.ranges.len()
    }

    pub(crate) fn of(&self, vertex: u32) -> &[u32] {
        let [begin, end] = self.ranges[vertex as usize];
        &self.triangles[begin as usize..end as usize]
    }

    /// Takes a triangle away from a vertex.
    pub(crate) fn remove(&mut self, vertex: u32, triangle: u32) {
        let [begin, end] = self.ranges[vertex as usize].map(|v| v as usize);
        let list = &mut self.triangles[begin..end];
        if let Some(place) = list.iter().position(|&t| t == triangle) {
            list[place..].rotate_left(1);
            self.ranges[vertex as usize][1] -= 1;
        }
    }

    /// Gives the triangles of `other` to `vertex`.
    pub(crate) fn take(&mut self, vertex: u32, other: u32) {
        let start = self.triangles.len() as u32;
        for [begin, end] in [vertex, other].map(|v| self.ranges[v as usize]) {
            self.triangles.extend_from_within(begin as usize..end as usize);
        }
        self.ranges[vertex as usize] = [start, self.triangles.len() as u32];
        self.ranges[other as usize] = [start; 2];
    }
}

/// An edge of two triangles, or of one, with `None`. Where more meet, each is paired with the one
/// before it.
pub(crate) fn for_each_edge(
    triangles: &[[u32; 3]],
    fans: &Fans,
    mut visit: impl FnMut([u32; 2], u32, Option<u32>),
) {
    const NONE: u32 = u32::MAX;
    #[derive(Clone, Copy)]
    struct Seen {
        from: u32,
        triangle: u32,
        is_paired: bool,
    }
    let mut seen = vec![Seen { from: NONE, triangle: NONE, is_paired: false }; fans.len()];
    let mut ends = Vec::new();
    for from in 0..fans.len() as u32 {
        ends.clear();
        for &triangle in fans.of(from) {
            for &to in triangles[triangle as usize].iter().filter(|&&to| to > from) {
                let last = &mut seen[to as usize];
                if last.from == from {
                    visit([from, to], last.triangle, Some(triangle));
                    *last = Seen { from, triangle, is_paired: true };
                } else {
                    *last = Seen { from, triangle, is_paired: false };
                    ends.push(to);
                }
            }
        }
        for &to in &ends {
            let last = seen[to as usize];
            if !last.is_paired {
                visit([from, to], last.triangle, None);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_has_one_inner_edge() {
        let triangles = [[0, 1, 2], [1, 3, 2]];
        let fans = Fans::new(4, &triangles);
        assert_eq!(fans.of(1), [0, 1]);
        assert_eq!(fans.of(3), [1]);
        let mut edges = Vec::new();
        for_each_edge(&triangles, &fans, |edge, a, b| edges.push((edge, a, b)));
        edges.sort_unstable();
        let truth = [([0, 1], 0, None), ([0, 2], 0, None), ([1, 2], 0, Some(1))];
        assert_eq!(edges[..3], truth);
        assert_eq!(edges[3..], [([1, 3], 1, None), ([2, 3], 1, None)]);
    }

    #[test]
    fn triangles_go_from_hand_to_hand() {
        let mut fans = Fans::new(4, &[[0, 1, 2], [1, 3, 2]]);
        fans.remove(1, 0);
        assert_eq!(fans.of(1), [1]);
        fans.take(0, 1);
        assert_eq!((fans.of(0), fans.of(1)), (&[0, 1][..], &[][..]));
    }
}
