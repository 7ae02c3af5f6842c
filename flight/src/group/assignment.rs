//! Who flies to which goal.

/// The assignment of rows to columns with the smallest sum of costs: the column of each row.
///
/// * `cost`: n rows of m ≥ n finite numbers, each row as long as the first.
/// * Returns `None` if there are more rows than columns, rows differ in length or a cost is not
///   finite.
///
/// With squared distances as costs the straight ways of vehicles that start and arrive together
/// cross least: such ways keep apart by 1/√2 of the smallest distance between starts and goals
/// (Turpin, Michael, Kumar, "CAPT", IJRR 2014).
///
/// # Source
///
/// The Hungarian method with potentials `u`, `v` and shortest augmenting paths, O(n² m): Jonker
/// and Volgenant, Computing 38, 1987.
pub fn assign(cost: &[Vec<f64>]) -> Option<Vec<usize>> {
    let n = cost.len();
    let m = cost.first().map_or(0, Vec::len);
    let valid = |row: &Vec<f64>| row.len() == m && row.iter().all(|c| c.is_finite());
    if n > m || !cost.iter().all(valid) {
        return None;
    }
    // Column m is where the row to be placed waits; `row_of[j]` is n for a free column.
    let (mut u, mut v) = (vec![0.0; n + 1], vec![0.0; m + 1]);
    let mut row_of = vec![n; m + 1];
    for row in 0..n {
        row_of[m] = row;
        let mut column = m;
        let mut reduced = vec![f64::INFINITY; m];
        let mut before = vec![m; m];
        let mut visited = vec![false; m + 1];
        // Shortest augmenting path from `row` to a free column.
        while row_of[column] != n {
            visited[column] = true;
            let i = row_of[column];
            let (mut delta, mut next) = (f64::INFINITY, column);
            for j in (0..m).filter(|&j| !visited[j]) {
                let c = cost[i][j] - u[i] - v[j];
                if c < reduced[j] {
                    (reduced[j], before[j]) = (c, column);
                }
                if reduced[j] < delta {
                    (delta, next) = (reduced[j], j);
                }
            }
            for j in 0..=m {
                if visited[j] {
                    u[row_of[j]] += delta;
                    v[j] -= delta;
                } else {
                    reduced[j] -= delta;
                }
            }
            column = next;
        }
        while column != m {
            row_of[column] = row_of[before[column]];
            column = before[column];
        }
    }
    let mut column_of = vec![0; n];
    for (column, &row) in row_of[..m].iter().enumerate().filter(|(_, row)| **row != n) {
        column_of[row] = column;
    }
    Some(column_of)
}

#[cfg(test)]
mod tests {
    use volery_geometry::Rng;

    use super::*;

    fn brute_force(cost: &[Vec<f64>], row: usize, taken: &mut Vec<usize>) -> f64 {
        if row == cost.len() {
            return 0.0;
        }
        let mut best = f64::INFINITY;
        for column in 0..cost[0].len() {
            if !taken.contains(&column) {
                taken.push(column);
                best = best.min(cost[row][column] + brute_force(cost, row + 1, taken));
                taken.pop();
            }
        }
        best
    }

    #[test]
    fn no_assignment_is_cheaper() {
        let mut rng = Rng::new(5);
        for round in 0..300 {
            let n = 1 + rng.index(5);
            let m = n + rng.index(3);
            // Every second round has many equal costs.
            let entry = |rng: &mut Rng| match round % 2 {
                0 => rng.normal(),
                _ => rng.index(3) as f64,
            };
            let cost: Vec<Vec<f64>> =
                (0..n).map(|_| (0..m).map(|_| entry(&mut rng)).collect()).collect();
            let columns = assign(&cost).unwrap();
            let mut distinct = columns.clone();
            distinct.sort_unstable();
            distinct.dedup();
            assert_eq!(distinct.len(), n, "no goal is given twice");
            let sum: f64 = columns.iter().enumerate().map(|(i, &j)| cost[i][j]).sum();
            let best = brute_force(&cost, 0, &mut Vec::new());
            assert!((sum - best).abs() < 1e-9, "{sum} against {best}");
        }
    }

    #[test]
    fn what_cannot_be_assigned_is_refused() {
        assert_eq!(assign(&[]), Some(vec![]));
        assert_eq!(assign(&[vec![1.0], vec![2.0]]), None, "two rows, one column");
        assert_eq!(assign(&[vec![1.0, f64::NAN]]), None);
        assert_eq!(assign(&[vec![1.0, 2.0], vec![1.0]]), None);
    }
}
