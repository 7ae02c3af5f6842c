//! A room whose walls have a known color everywhere.

mod scene;

use std::collections::HashMap;

use nalgebra::{Point2, Point3, Vector3};
use volery_geometry::Rng;
use volery_scene::{GrayImage, ImageId, NoProgress, Photo, Photos, SparseModel, TriangleMesh};

use super::labels::{Candidate, SEAM_COST};
use super::*;
use crate::test_shapes::ROOM_SIZE;
use scene::{BOARD, BOARD_Y, Scan, World, paint as true_color};

fn color_at(textured: &TexturedMesh, uv: [f64; 2]) -> [f64; 3] {
    let texture = &textured.texture;
    let (width, height) = (texture.width as usize, texture.height as usize);
    let at = Point2::new(uv[0] * width as f64, uv[1] * height as f64);
    paint::between(&at, width, height, |x, y| texture.pixels[y * width + x])
}

/// Points of the seen triangles with the color that the texture gives them.
fn samples(textured: &TexturedMesh, per_triangle: usize) -> Vec<(Point3<f64>, [f64; 3])> {
    let mut random = Rng::new(9);
    let seen = textured.mesh.triangles[..textured.num_textured].iter();
    seen.flat_map(|triangle| std::iter::repeat_n(*triangle, per_triangle))
        .map(|triangle| {
            let (mut s, mut t) = (random.uniform(), random.uniform());
            if s + t > 1.0 {
                (s, t) = (1.0 - s, 1.0 - t);
            }
            let weights = [1.0 - s - t, s, t];
            let (mut point, mut uv) = (Vector3::zeros(), [0.0; 2]);
            for (v, w) in triangle.into_iter().zip(weights) {
                point += textured.mesh.vertices[v as usize].coords * w;
                let corner = textured.uvs[v as usize];
                (0..2).for_each(|k| uv[k] += f64::from(corner[k]) * w);
            }
            (Point3::from(point), color_at(textured, uv))
        })
        .collect()
}

fn error(found: &[f64; 3], truth: &[f64; 3]) -> f64 {
    found.iter().zip(truth).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

fn quantile(mut values: Vec<f64>, q: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * q) as usize]
}

/// Dies if a texel is off by one, if the lens is forgotten, or if v runs upward.
#[test]
fn walls_have_their_colors() {
    let scan = Scan::new(World { has_board: false }, 0.0);
    let mesh = scan.world.mesh(0.25);
    let textured = scan.texture(&mesh);
    assert_eq!(textured.num_textured, mesh.triangles.len());
    let errors =
        samples(&textured, 20).iter().map(|(p, c)| error(c, &true_color(p))).collect::<Vec<_>>();
    // Half of the gray levels of rounding, and the bend of a wave within a texel of 3 cm.
    let [median, p99] = [0.5, 0.99].map(|q| quantile(errors.clone(), q));
    assert!(median < 1.0 && p99 < 5.0, "{median} {p99}");
    assert!(scan.asked.lock().unwrap().values().all(|&count| count == 1));
}

/// A pixel of 160 x 120 covers 3 cm: large triangles must not bend the picture.
#[test]
fn large_triangles_are_painted_as_exactly() {
    let scan = Scan::new(World { has_board: false }, 0.0);
    let textured = scan.texture(&scan.world.mesh(0.8));
    assert!(textured.num_textured > 0);
    let errors = samples(&textured, 100).iter().map(|(p, c)| error(c, &true_color(p))).collect();
    let p99 = quantile(errors, 0.99);
    assert!(p99 < 5.0, "{p99}");
}

/// Differences of the colors at vertices that are in several charts.
fn seam_differences(textured: &TexturedMesh) -> Vec<f64> {
    let mut first: HashMap<[u64; 3], [f64; 3]> = HashMap::new();
    let mut found = Vec::new();
    for (vertex, uv) in textured.mesh.vertices.iter().zip(&textured.uvs) {
        let color = color_at(textured, uv.map(f64::from));
        let key = [vertex.x, vertex.y, vertex.z].map(f64::to_bits);
        match first.get(&key) {
            Some(other) => found.push(error(&color, other)),
            None => drop(first.insert(key, color)),
        }
    }
    found
}

/// Exposures differ by up to 40 %: about 40 levels at a seam.
#[test]
fn seams_are_leveled() {
    let world = World { has_board: false };
    let textured = Scan::new(world, 0.2).texture(&world.mesh(0.25));
    let differences = seam_differences(&textured);
    assert!(differences.len() > 100, "{}", differences.len());
    let [median, p95] = [0.5, 0.95].map(|q| quantile(differences.clone(), q));
    assert!(median < 3.0 && p95 < 12.0, "{median} {p95}");
}

/// The wall behind the board is seen past it or not at all, never through it.
#[test]
fn nothing_is_painted_through_a_board() {
    let scan = Scan::new(World { has_board: true }, 0.0);
    let mesh = scan.world.mesh(0.1);
    let textured = scan.texture(&mesh);
    let unseen = &textured.mesh.triangles[textured.num_textured..];
    let at = |v: u32| textured.mesh.vertices[v as usize];
    let is_hidden = |p: &Point3<f64>| p.y > BOARD_Y + 0.01 && p.y < ROOM_SIZE[1] + 0.01;
    assert!(unseen.len() > 50 && unseen.iter().flatten().all(|&v| is_hidden(&at(v))));
    let [x, z] = BOARD;
    // A pixel covers 3 cm: the colors of the board and of the wall mix along its edge.
    let inset = |v: f64, [low, high]: [f64; 2]| (v - low).min(high - v);
    for (point, color) in samples(&textured, 4) {
        let is_red = color[1] < 40.0;
        let is_on_board = (point.y - BOARD_Y).abs() < 1e-9;
        let from_edge = inset(point.x, x).min(inset(point.z, z));
        assert!(is_red == is_on_board || from_edge < 0.05, "{color:?} at {point}");
    }
}

#[test]
fn no_two_triangles_share_a_texel() {
    let scan = Scan::new(World { has_board: false }, 0.0);
    let textured = scan.texture(&scan.world.mesh(0.25));
    let (width, height) = (textured.texture.width, textured.texture.height);
    assert!(width.is_power_of_two() && height.is_power_of_two() && width <= 4096);
    assert_eq!(textured.texture.pixels.len(), (width * height) as usize);
    assert_eq!(textured.uvs.len(), textured.mesh.vertices.len());
    assert!(textured.uvs.iter().flatten().all(|v| (0.0..=1.0).contains(v)));
    let mut owners = HashMap::new();
    for (index, triangle) in textured.mesh.triangles.iter().enumerate() {
        let [a, b, c] = triangle.map(|v| {
            let [u, v] = textured.uvs[v as usize].map(f64::from);
            Point2::new(u * f64::from(width), v * f64::from(height))
        });
        let area = (b - a).perp(&(c - a));
        let (low, high) = (a.inf(&b).inf(&c), a.sup(&b).sup(&c));
        for y in low.y as u32..=high.y as u32 {
            for x in low.x as u32..=high.x as u32 {
                let p = Point2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                let inside = [(a, b), (b, c), (c, a)]
                    .iter()
                    .all(|(p0, p1)| (p1 - p0).perp(&(p - p0)) * area.signum() > 1e-3);
                if inside && let Some(other) = owners.insert((x, y), index) {
                    panic!("{other} and {index} share texel {x}, {y}");
                }
            }
        }
    }
}

#[test]
fn a_small_texture_holds_the_same_picture_smaller() {
    let scan = Scan::new(World { has_board: false }, 0.0);
    let mesh = scan.world.mesh(0.25);
    let options = TextureOptions { max_side: 128 };
    let textured = texture_mesh(&mesh, &scan.model, &scan, &options, &NoProgress).unwrap();
    assert!(textured.texture.width <= 128 && textured.texture.height <= 128);
    let errors = samples(&textured, 10).iter().map(|(p, c)| error(c, &true_color(p))).collect();
    let median = quantile(errors, 0.5);
    assert!(median < 6.0, "{median}");
}

#[test]
fn threads_do_not_matter() {
    let mesh = World { has_board: true }.mesh(0.25);
    let with = |num_threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(num_threads).build().unwrap();
        let (world, mesh) = (World { has_board: true }, &mesh);
        pool.install(|| Scan::new(world, 0.2).texture(mesh))
    };
    assert!(with(1) == with(3));
}

#[test]
fn what_cannot_be_painted_is_named() {
    let scan = Scan::new(World { has_board: false }, 0.0);
    let mesh = scan.world.mesh(0.5);
    let run = |mesh: &TriangleMesh, model: &SparseModel, photos: &dyn Photos, max_side: u32| {
        texture_mesh(mesh, model, photos, &TextureOptions { max_side }, &NoProgress).unwrap_err()
    };
    let empty = TriangleMesh::default();
    assert_eq!(run(&empty, &scan.model, &scan, 4096), MeshingError::NoTriangles);
    assert!(matches!(run(&mesh, &scan.model, &scan, 1000), MeshingError::Option { .. }));
    let nobody = SparseModel::default();
    assert_eq!(run(&mesh, &nobody, &scan, 4096), MeshingError::NothingSeen);
    // From outside, the room turns its back to every camera.
    let mut outside = scan.model.clone();
    outside.transform(&nalgebra::Similarity3::new(
        Vector3::new(50.0, 0.0, 0.0),
        Vector3::zeros(),
        1.0,
    ));
    assert_eq!(run(&mesh, &outside, &scan, 4096), MeshingError::NothingSeen);
    let mut broken = mesh.clone();
    broken.triangles[3][1] = 1 << 30;
    assert_eq!(run(&broken, &nobody, &scan, 64), MeshingError::NoSuchVertex { triangle: 3 });
    broken.clone_from(&mesh);
    broken.vertices[7].x = f64::NAN;
    assert_eq!(run(&broken, &nobody, &scan, 64), MeshingError::NotFinite { index: 7 });
    struct Lost;
    impl Photos for Lost {
        fn photo(&self, _image: ImageId) -> Option<Photo> {
            None
        }
    }
    assert!(matches!(run(&mesh, &scan.model, &Lost, 4096), MeshingError::NoPhoto { .. }));
    struct Small;
    impl Photos for Small {
        fn photo(&self, _image: ImageId) -> Option<Photo> {
            Some(Photo { gray: GrayImage::new(2, 2, vec![0; 4])?, colors: None })
        }
    }
    assert!(matches!(run(&mesh, &scan.model, &Small, 4096), MeshingError::WrongSize { .. }));
}

/// On a strip of triangles, a tree, the labels are the best of all.
#[test]
fn labels_of_a_strip_are_the_cheapest() {
    let count = 9;
    let strip = TriangleMesh {
        vertices: (0..count + 2)
            .map(|i| Point3::new(f64::from(i / 2), f64::from(i % 2), 0.0))
            .collect(),
        triangles: (0..count).map(|i| [i, i + 1, i + 2]).collect(),
        colors: Vec::new(),
    };
    let fans = Fans::new(strip.vertices.len(), &strip.triangles);
    let mut random = Rng::new(11);
    for _ in 0..20 {
        let candidates: Vec<Vec<Candidate>> = (0..count)
            .map(|_| {
                let of = |view: u32, random: &mut Rng| Candidate {
                    view,
                    quality: random.range(0.2, 1.0) as f32,
                };
                let mut list: Vec<_> = (0..3).map(|view| of(view, &mut random)).collect();
                list.remove((random.uniform() * 3.0) as usize % 3);
                list
            })
            .collect();
        // All triangles are alike; inner edges are 1 and √2 long.
        let lengths: Vec<f64> =
            (1..count).map(|i| if i % 2 == 1 { 2.0_f64.sqrt() } else { 1.0 }).collect();
        let mean = lengths.iter().sum::<f64>() / lengths.len() as f64;
        let cost = |labels: &[u32]| {
            let data: f64 = candidates
                .iter()
                .zip(labels)
                .map(|(list, label)| {
                    let best = list.iter().map(|c| c.quality).fold(0.0, f32::max);
                    let own = list.iter().find(|c| c.view == *label);
                    own.map_or(f64::INFINITY, |c| 1.0 - f64::from(c.quality / best))
                })
                .sum();
            let seams = labels.windows(2).zip(&lengths).filter(|(pair, _)| pair[0] != pair[1]);
            data + seams.map(|(_, length)| f64::from(SEAM_COST) * length / mean).sum::<f64>()
        };
        let found: Vec<u32> = choose_views(&strip, &fans, candidates.clone())
            .into_iter()
            .map(|l| l.unwrap())
            .collect();
        let all = (0..3_u32.pow(count)).map(|code| {
            let labels: Vec<u32> = (0..count).map(|i| code / 3_u32.pow(i) % 3).collect();
            cost(&labels)
        });
        let least = all.fold(f64::INFINITY, f64::min);
        assert!(cost(&found) < least + 1e-5, "{} {least}", cost(&found));
    }
}
