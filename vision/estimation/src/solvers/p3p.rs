//! Pose from three points.

use arrayvec::ArrayVec;
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};

use super::polynomial::{cubic_roots, quadratic_roots};

/// Poses of a camera that sees three points along three bearings; up to four.
///
/// The distances λᵢ to the points satisfy three conics
///
/// ```text
/// λᵢ² + λⱼ² − 2 (bᵢ·bⱼ) λᵢλⱼ = ‖Xᵢ − Xⱼ‖²
/// ```
///
/// Eliminating the right-hand side leaves two homogeneous conics `C₁`, `C₂`; the member
/// `C₁ + γC₂` of their pencil with zero determinant is a pair of lines, and each line meets the
/// conics in two points.
///
/// * `bearings`: unit rays in the camera frame; `points`: world.
/// * Collinear points and parallel rays give no pose.
///
/// Source: the pencil of conics as in Persson & Nordberg, "Lambda Twist", ECCV 2018, and Ding et
/// al., "Revisiting the P3P Problem", CVPR 2023; the line pair by the adjugate, Richter-Gebert,
/// Perspectives on Projective Geometry, 11.1.
pub fn p3p(bearings: &[Vector3<f64>; 3], points: &[Point3<f64>; 3]) -> ArrayVec<Isometry3<f64>, 4> {
    let mut poses = ArrayVec::new();
    let edge = [points[0] - points[1], points[0] - points[2], points[1] - points[2]];
    let a = edge.map(|e| e.norm_squared());
    let cosine = [
        bearings[0].dot(&bearings[1]),
        bearings[0].dot(&bearings[2]),
        bearings[1].dot(&bearings[2]),
    ];
    let normal = edge[0].cross(&edge[1]);
    let is_triangle = normal.norm_squared() > 1e-20 * a[0] * a[1] && a[2] > 0.0;
    if !is_triangle {
        return poses;
    }
    let [m12, m13, m23] = [
        Matrix3::new(1.0, -cosine[0], 0.0, -cosine[0], 1.0, 0.0, 0.0, 0.0, 0.0),
        Matrix3::new(1.0, 0.0, -cosine[1], 0.0, 0.0, 0.0, -cosine[1], 0.0, 1.0),
        Matrix3::new(0.0, 0.0, 0.0, 0.0, 1.0, -cosine[2], 0.0, -cosine[2], 1.0),
    ];
    let c1 = m12 - m23 * (a[0] / a[2]);
    let c2 = m13 - m23 * (a[1] / a[2]);

    let (adj1, adj2) = (adjugate(&c1), adjugate(&c2));
    let (det1, det2) = (c1.determinant(), c2.determinant());
    // det(C₁ + γC₂) = det C₂ γ³ + tr(adj C₂ C₁) γ² + tr(adj C₁ C₂) γ + det C₁
    let roots = cubic_roots(det2, (adj2 * c1).trace(), (adj1 * c2).trace(), det1);
    for gamma in roots {
        let Some(lines) = split_line_pair(&(c1 + c2 * gamma)) else { continue };
        for line in lines {
            for depths in depths_on_line(&line, &c1, &c2, &cosine, a[2]) {
                let Some(depths) = polish_depths(depths, &a, &cosine) else { continue };
                if let Some(pose) = pose_from_depths(&depths, bearings, points, &edge, &normal)
                    && !poses.is_full()
                {
                    poses.push(pose);
                }
            }
        }
        // One real line pair holds all four intersections.
        break;
    }
    poses
}

fn adjugate(m: &Matrix3<f64>) -> Matrix3<f64> {
    let (r0, r1, r2) = (m.row(0).transpose(), m.row(1).transpose(), m.row(2).transpose());
    Matrix3::from_columns(&[r1.cross(&r2), r2.cross(&r0), r0.cross(&r1)])
}

/// The real lines l, m of a degenerate conic `l mᵀ + m lᵀ`, `None` where they are complex.
fn split_line_pair(conic: &Matrix3<f64>) -> Option<[Vector3<f64>; 2]> {
    let b = -adjugate(conic);
    let i = b.diagonal().imax();
    let diagonal = b[(i, i)];
    if diagonal.is_nan() || diagonal <= 0.0 {
        return None;
    }
    let p = b.column(i) / diagonal.sqrt();
    let n = conic + Vector3::cross_matrix(&p.into_owned());
    // n has rank one: its largest row and column are the lines.
    let (mut row, mut column, mut largest) = (0, 0, 0.0);
    for r in 0..3 {
        for c in 0..3 {
            if n[(r, c)].abs() > largest {
                (row, column, largest) = (r, c, n[(r, c)].abs());
            }
        }
    }
    (largest > 0.0).then(|| [n.row(row).transpose(), n.column(column).into_owned()])
}

/// Positive depths where a line of the pencil meets the conics.
fn depths_on_line(
    line: &Vector3<f64>,
    c1: &Matrix3<f64>,
    c2: &Matrix3<f64>,
    cosine: &[f64; 3],
    a23: f64,
) -> ArrayVec<Vector3<f64>, 2> {
    let mut depths = ArrayVec::new();
    // λ_i from the other two, i where the line is steepest.
    let i = line.iamax();
    let (j, k) = ((i + 1) % 3, (i + 2) % 3);
    let mut on_j = Vector3::zeros();
    (on_j[j], on_j[i]) = (1.0, -line[j] / line[i]);
    let mut on_k = Vector3::zeros();
    (on_k[k], on_k[i]) = (1.0, -line[k] / line[i]);
    let quadratic = |c: &Matrix3<f64>| {
        [on_j.dot(&(c * on_j)), 2.0 * on_j.dot(&(c * on_k)), on_k.dot(&(c * on_k))]
    };
    // Either conic of the pencil will do; one of them may contain the line.
    let (q1, q2) = (quadratic(c1), quadratic(c2));
    let size = |q: &[f64; 3]| q.iter().map(|v| v.abs()).sum::<f64>();
    let [qa, qb, qc] = if size(&q1) >= size(&q2) { q1 } else { q2 };
    for ratio in quadratic_roots(qa, qb, qc) {
        if ratio.is_nan() || ratio <= 0.0 {
            continue;
        }
        let direction = on_j * ratio + on_k;
        let (l2, l3) = (direction[1], direction[2]);
        let scale2 = l2 * l2 + l3 * l3 - 2.0 * cosine[2] * l2 * l3;
        if scale2.is_nan() || scale2 <= 0.0 {
            continue;
        }
        let depth = direction * (a23 / scale2).sqrt();
        if depth.min() > 0.0 {
            depths.push(depth);
        }
    }
    depths
}

/// Newton on the three distance equations: takes out what the cubic's rounding left.
fn polish_depths(
    mut depths: Vector3<f64>,
    a: &[f64; 3],
    cosine: &[f64; 3],
) -> Option<Vector3<f64>> {
    const PAIRS: [(usize, usize); 3] = [(0, 1), (0, 2), (1, 2)];
    for _ in 0..3 {
        let mut residual = Vector3::zeros();
        let mut jacobian = Matrix3::zeros();
        for (row, &(i, j)) in PAIRS.iter().enumerate() {
            let (l, m) = (depths[i], depths[j]);
            residual[row] = l * l + m * m - 2.0 * cosine[row] * l * m - a[row];
            jacobian[(row, i)] = 2.0 * (l - cosine[row] * m);
            jacobian[(row, j)] = 2.0 * (m - cosine[row] * l);
        }
        if residual.amax() < 1e-14 * (a[0] + a[1] + a[2]) {
            break;
        }
        let Some(inverse) = jacobian.try_inverse() else { break };
        depths -= inverse * residual;
    }
    (depths.min() > 0.0 && depths.max().is_finite()).then_some(depths)
}

fn pose_from_depths(
    depths: &Vector3<f64>,
    bearings: &[Vector3<f64>; 3],
    points: &[Point3<f64>; 3],
    edge: &[Vector3<f64>; 3],
    normal: &Vector3<f64>,
) -> Option<Isometry3<f64>> {
    let seen = [bearings[0] * depths[0], bearings[1] * depths[1], bearings[2] * depths[2]];
    let (s12, s13) = (seen[0] - seen[1], seen[0] - seen[2]);
    let world = Matrix3::from_columns(&[edge[0], edge[1], *normal]).try_inverse()?;
    let r = Matrix3::from_columns(&[s12, s13, s12.cross(&s13)]) * world;
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(r));
    let t = seen[0] - rotation * points[0].coords;
    let pose = Isometry3::from_parts(t.into(), rotation);
    pose.translation
        .vector
        .iter()
        .chain(rotation.coords.iter())
        .all(|v| v.is_finite())
        .then_some(pose)
}
