//! Photos of a painted hall placed by comparing them with views of its mesh (P62-P73).
//!
//! `VOLERY_LONG=1` takes 60 photos in place of 10.

use std::sync::OnceLock;

use nalgebra::{Isometry3, Point3, Vector3, Vector6};
use volery_geometry::triangulation::camera_center;
use volery_geometry::{Camera, CameraModel, Rng};
use volery_localization::localize::{NotFoundReason, Status};
use volery_localization::template::Similarity;
use volery_localization::{
    LocalizationPrior, SearchSide, TemplateAnswer, TemplateOptions, localize_by_template,
    render_score,
};
use volery_rendering::DrawableMesh;
use volery_scene::GrayImage;
use volery_synthetic::{Hall, Renderer, Sensor, cam_from_heading};

/// Standard deviation of the yaw that telemetry reports, radians.
const YAW_SIGMA: f64 = 2.0 * std::f64::consts::PI / 180.0;

struct Stage {
    hall: Hall,
    mesh: DrawableMesh,
    renderer: Renderer,
    queries: Vec<Query>,
}

struct Query {
    truth: Isometry3<f64>,
    photo: GrayImage,
    prior: LocalizationPrior,
}

fn camera() -> Camera {
    Camera::from_focal(CameraModel::Pinhole, 640, 480, 457.0).unwrap()
}

/// The hall with its queries: hovering anywhere with 0.8 m of clearance, looking anywhere, the
/// start of the search within 0.5 m.
fn stage() -> &'static Stage {
    static STAGE: OnceLock<Stage> = OnceLock::new();
    STAGE.get_or_init(|| {
        let hall = Hall::standard(0.01, 7);
        let mesh = DrawableMesh::new(&hall.mesh(0.03)).unwrap();
        let renderer = Renderer::new(&camera());
        let num = if std::env::var_os("VOLERY_LONG").is_some() { 60 } else { 10 };
        let mut rng = Rng::new(5);
        let mut queries = Vec::new();
        while queries.len() < num {
            let place =
                Point3::new(rng.range(-4.0, 4.0), rng.range(-3.0, 3.0), rng.range(0.8, 2.2));
            let yaw = rng.range(0.0, std::f64::consts::TAU);
            let tilt = [0; 2].map(|_| 0.5_f64.to_radians() * rng.normal());
            if hall.room.is_free(&place, 0.8) {
                let truth = cam_from_heading(&place, yaw, tilt[0], tilt[1]);
                let seed = rng.bits();
                let photo = Sensor::default().expose(&renderer.render(&hall, &truth), seed).gray();
                let offset = rng.normal3().normalize() * (0.5 * rng.uniform().cbrt());
                let prior = prior_at(&truth, offset, YAW_SIGMA * rng.normal());
                queries.push(Query { truth, photo, prior });
            }
        }
        Stage { hall, mesh, renderer, queries }
    })
}

fn prior_at(truth: &Isometry3<f64>, offset: Vector3<f64>, turn: f64) -> LocalizationPrior {
    let forward = truth.rotation.inverse() * Vector3::z();
    LocalizationPrior {
        position: Some((camera_center(truth) + offset, 0.3)),
        yaw: Some((forward.y.atan2(forward.x) + turn, YAW_SIGMA)),
    }
}

fn locate(
    photo: &GrayImage,
    prior: &LocalizationPrior,
    options: &TemplateOptions,
) -> TemplateAnswer {
    localize_by_template(photo, &camera(), &stage().mesh, prior, options)
}

/// Distance and angle of an accepted pose to the truth.
fn errors(answer: &TemplateAnswer, truth: &Isometry3<f64>) -> Option<(f64, f64)> {
    let Status::Ok(pose) = &answer.status else { return None };
    let distance = (pose.map_from_camera.translation.vector - camera_center(truth).coords).norm();
    Some((distance, (pose.map_from_camera.rotation * truth.rotation).angle().to_degrees()))
}

/// Number of queries within 5 cm and 1 degree; fails on any confident wrong pose.
fn num_placed(change: impl Fn(&GrayImage) -> GrayImage, options: &TemplateOptions) -> usize {
    let placed = stage().queries.iter().filter(|query| {
        let answer = locate(&change(&query.photo), &query.prior, options);
        let Some((distance, angle)) = errors(&answer, &query.truth) else { return false };
        assert!(distance < 0.15 && angle < 3.0, "ok, but {distance} m, {angle} degrees off");
        distance < 0.05 && angle < 1.0
    });
    placed.count()
}

fn relit(photo: &GrayImage, gain: f64, gamma: f64) -> GrayImage {
    let level = |v: &u8| (255.0 * gain * (f64::from(*v) / 255.0).powf(gamma)).min(255.0) as u8;
    let pixels = photo.pixels().iter().map(level).collect();
    GrayImage::new(photo.width(), photo.height(), pixels).unwrap()
}

/// 9 of 10 within 5 cm and 1 degree from a start within 0.5 m and a yaw of 2 degrees (P69, P70),
/// and no more than 5 of 100 fewer in other light.
#[test]
fn photos_find_their_place_in_any_light() {
    let options = TemplateOptions::default();
    let num = stage().queries.len();
    let placed = num_placed(GrayImage::clone, &options);
    println!("{placed} of {num} placed");
    assert!(placed * 10 >= num * 9, "{placed} of {num}");
    for (gain, gamma) in [(0.5, 1.0), (2.0, 1.0), (1.0, 0.6), (1.0, 1.6)] {
        let relit = num_placed(|photo| relit(photo, gain, gamma), &options);
        println!("{relit} of {num} placed with gain {gain}, gamma {gamma}");
        assert!(relit * 20 + num >= placed * 20, "{relit} of {placed} with {gain}, {gamma}");
    }
}

/// The covariance holds what it says: 19 of 20 squared errors lie below the 95 % bound of χ²₆, and
/// it is no larger than a tenth of what the search starts from.
#[test]
fn poses_err_no_more_than_they_claim() {
    let options = TemplateOptions::default();
    let (mut num, mut num_within) = (0, 0);
    for query in &stage().queries {
        let answer = locate(&query.photo, &query.prior, &options);
        let Status::Ok(pose) = &answer.status else { continue };
        let shift = pose.map_from_camera.translation.vector - camera_center(&query.truth).coords;
        let turn = (pose.map_from_camera.rotation * query.truth.rotation).scaled_axis();
        let error = Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z);
        let inverse = pose.covariance.try_inverse().unwrap();
        num += 1;
        num_within += usize::from(error.dot(&(inverse * error)) < 12.59);
        let sigma = pose.covariance.fixed_view::<3, 3>(0, 0).trace().sqrt();
        assert!(sigma < 0.05, "{sigma} m");
    }
    assert!(num > 0 && (num - num_within) * 20 <= num + 10, "{num_within} of {num}");
}

/// The paper's own measure, Eq. (6), finds the place in the light of the map (P65).
#[test]
fn squared_differences_serve_as_well_in_equal_light() {
    let options = TemplateOptions {
        similarity: Similarity::SquaredDifferences,
        ..TemplateOptions::default()
    };
    let num = stage().queries.len();
    let placed = num_placed(GrayImage::clone, &options);
    assert!(placed * 10 >= num * 8, "{placed} of {num}");
}

/// A drone that flew forward is found among half of the places (P71).
#[test]
fn the_half_ahead_is_enough_for_a_drone_that_flew_forward() {
    let mut compared = 0;
    for query in stage().queries.iter().take(6) {
        let forward = query.truth.rotation.inverse() * Vector3::z();
        let prior = prior_at(&query.truth, -0.3 * forward, 0.0);
        let whole = locate(&query.photo, &prior, &TemplateOptions::default());
        let options = TemplateOptions { side: SearchSide::Ahead, ..TemplateOptions::default() };
        let half = locate(&query.photo, &prior, &options);
        // The row through the last position belongs to both halves.
        let row = 2 * (whole.num_places as f64).sqrt().ceil() as usize;
        assert!(2 * half.num_places <= whole.num_places + row, "{}", half.num_places);
        assert!(half.num_places < whole.num_places);
        // A better known last position leaves fewer places (P72).
        let near = locate(&query.photo, &prior, &TemplateOptions { radius: 0.35, ..options });
        assert!(near.num_places < half.num_places);
        let (Status::Ok(a), Status::Ok(b)) = (&whole.status, &half.status) else { continue };
        let apart = a.map_from_camera.inverse() * b.map_from_camera;
        assert!(apart.translation.vector.norm() < 0.01 && apart.rotation.angle() < 0.005);
        compared += 1;
    }
    assert!(compared >= 5, "{compared}");
}

/// From wrong places and headings, and in a hall of other pictures, there is no answer, never a
/// wrong one.
#[test]
fn wrong_starts_are_not_found() {
    let other = DrawableMesh::new(&Hall::standard(0.02, 99).mesh(0.06)).unwrap();
    let options = TemplateOptions::default();
    for query in &stage().queries {
        let Some((position, sigma)) = query.prior.position else { continue };
        let Some((yaw, yaw_sigma)) = query.prior.yaw else { continue };
        let mirrored = Point3::new(-position.x, -position.y, position.z);
        let is_far = (mirrored - position).norm() > 1.5;
        let elsewhere = LocalizationPrior { position: Some((mirrored, sigma)), ..query.prior };
        if is_far {
            let answer = locate(&query.photo, &elsewhere, &options);
            assert!(matches!(answer.status, Status::NotFound(_)), "{:?}", answer.status);
        }
        let turned = LocalizationPrior { yaw: Some((yaw + 1.6, yaw_sigma)), ..query.prior };
        let answer = locate(&query.photo, &turned, &options);
        assert!(matches!(answer.status, Status::NotFound(_)), "{:?}", answer.status);
        let answer = localize_by_template(&query.photo, &camera(), &other, &query.prior, &options);
        assert!(matches!(answer.status, Status::NotFound(_)), "{:?}", answer.status);
    }
}

/// A lens with distortion, and another size of photo.
#[test]
fn distorted_photos_find_their_place() {
    let stage = stage();
    let params = [330.0, 335.0, 262.0, 190.0, -0.2, 0.05, 0.001, -0.002];
    let camera = Camera::new(CameraModel::OpenCv, 520, 390, &params).unwrap();
    let renderer = Renderer::new(&camera);
    let mut placed = 0;
    for query in stage.queries.iter().take(5) {
        let photo = Sensor::default().expose(&renderer.render(&stage.hall, &query.truth), 1).gray();
        let answer = localize_by_template(
            &photo,
            &camera,
            &stage.mesh,
            &query.prior,
            &TemplateOptions::default(),
        );
        let close = errors(&answer, &query.truth).is_some_and(|(d, a)| d < 0.05 && a < 1.0);
        placed += usize::from(close);
    }
    assert!(placed >= 4, "{placed}");
}

#[test]
fn light_and_blur_are_told() {
    let stage = stage();
    let query = &stage.queries[0];
    let of = |photo: &GrayImage| locate(photo, &query.prior, &TemplateOptions::default());
    let light = of(&query.photo).proof.unwrap().light;
    assert!(!light.is_other() && !light.is_blurred(), "{light:?}");
    let dark = of(&relit(&query.photo, 0.45, 1.0)).proof.unwrap().light;
    assert!(dark.is_other() && (0.35..0.55).contains(&dark.gain), "{dark:?}");
    let soft = of(&relit(&query.photo, 1.0, 0.6)).proof.unwrap().light;
    assert!(soft.is_other() && (0.5..0.75).contains(&soft.gamma), "{soft:?}");
    // Out of focus: told, and placed as long as anything is left to compare.
    let mut ideal = stage.renderer.render(&stage.hall, &query.truth);
    ideal.depth.clear();
    let blurred = |blur_px| of(&Sensor { blur_px, ..Sensor::default() }.expose(&ideal, 1).gray());
    let slight = blurred(3.0);
    assert!(slight.proof.unwrap().light.is_blurred());
    assert!(errors(&slight, &query.truth).is_some_and(|(d, a)| d < 0.05 && a < 1.0));
    assert_eq!(blurred(14.0).status, Status::NotFound(NotFoundReason::Blurred));
}

/// The second opinion on a pose from elsewhere.
#[test]
fn the_render_score_tells_right_poses_from_wrong_ones() {
    let stage = stage();
    for query in stage.queries.iter().take(5) {
        let score = |pose: &Isometry3<f64>| {
            render_score(&query.photo, &camera(), &stage.mesh, pose).unwrap()
        };
        let right = score(&query.truth);
        let mut moved = query.truth;
        moved.translation.vector += Vector3::new(0.2, 0.05, -0.1);
        let wrong = score(&moved);
        assert!(right.agreement > 0.5 && right.correlation > 0.5, "{right:?}");
        assert!(wrong.agreement < 0.25 * right.agreement + 0.05, "{wrong:?} {right:?}");
        assert_eq!(right.seen, 1.0);
    }
    assert_eq!(
        render_score(&stage.queries[0].photo, &small(), &stage.mesh, &stage.queries[0].truth),
        None
    );
}

fn small() -> Camera {
    Camera::from_focal(CameraModel::Pinhole, 64, 48, 50.0).unwrap()
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let stage = stage();
    let query = &stage.queries[0];
    let options = TemplateOptions::default();
    let reason = |answer: TemplateAnswer| match answer.status {
        Status::NotFound(reason) => reason,
        status => panic!("{status:?}"),
    };
    let blind = LocalizationPrior { yaw: None, ..query.prior };
    assert_eq!(reason(locate(&query.photo, &blind, &options)), NotFoundReason::NoPrior);
    let photo = GrayImage::new(64, 48, vec![7; 64 * 48]).unwrap();
    let answer = localize_by_template(&photo, &small(), &stage.mesh, &query.prior, &options);
    assert_eq!(reason(answer), NotFoundReason::TooSmall);
    let outside = Some((Point3::new(0.0, 90.0, 1.0), 0.3));
    let away = LocalizationPrior { position: outside, yaw: Some((1.5, 0.1)) };
    assert_eq!(reason(locate(&query.photo, &away, &options)), NotFoundReason::NothingInView);
    let blank = GrayImage::new(640, 480, vec![90; 640 * 480]).unwrap();
    assert!(matches!(reason(locate(&blank, &query.prior, &options)), NotFoundReason::Blurred));
}
