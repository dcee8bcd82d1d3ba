use super::*;
use crate::color::{ColorLearner, YuvEncoding};
use crate::detect::likeness;
use crate::shape::{Sphere, SphereOutline};
use crate::view::View;
use crate::{Frame, PixelFormat};
use pardalis_camera::Pose;
use pardalis_camera::{Camera, Pinhole};

const SIZE: (usize, usize) = (160, 120);
const RADIUS_M: f64 = 0.1;

fn view() -> View {
    let camera = Camera::Pinhole(Pinhole::new([200.0; 2], [79.5, 59.5], &[]).unwrap());
    View::new(camera, Pose::identity(), SIZE, None).unwrap()
}

/// An orange ball at a place before a green ground, its edge as soft as a camera's, with what hides columns from `hidden_from` on.
fn picture([x, y, z]: [f64; 3], hidden_from: usize) -> (Frame, Vec<bool>) {
    let (mut bytes, mut labels) = (Vec::new(), Vec::new());
    let center = nalgebra::Vector3::new(x, y, z);
    for i in 0..SIZE.0 * SIZE.1 {
        let (column, row) = (i % SIZE.0, i / SIZE.0);
        let ray = nalgebra::Vector3::new(
            (column as f64 - 79.5) / 200.0,
            (row as f64 - 59.5) / 200.0,
            1.0,
        );
        let off = ray.angle(&center) - (RADIUS_M / center.norm()).asin();
        let share = 0.5 * libm::erfc(off * 200.0 / 0.9 / 2.0_f64.sqrt());
        labels.push(share > 0.5);
        let mixed = [(230.0, 60.0), (110.0, 100.0), (20.0, 70.0)]
            .map(|(ball, ground)| ground + share * (ball - ground));
        let hidden = column >= hidden_from;
        bytes.extend(mixed.map(|value| if hidden { 15 } else { value as u8 }));
    }
    let encoding = YuvEncoding::default();
    let frame = Frame::new(PixelFormat::Rgb8, encoding, SIZE.0, SIZE.1, bytes, 0.0).unwrap();
    (frame, labels)
}

fn colors() -> ColorModel {
    let mut learner = ColorLearner::new(Palette::HSI).unwrap();
    for x in [-0.1, 0.0, 0.13] {
        let (frame, labels) = picture([x, 0.02, 1.3 + x], SIZE.0);
        learner.add(&frame, &labels).unwrap();
    }
    learner.learn().unwrap()
}

/// What is found in a picture from a start.
fn fitted(frame: &Frame, start_m: [f64; 3], known_around: Option<&Around>) -> Option<Sighting> {
    let colors = colors();
    let shape = Shape::Sphere(Sphere::new(RADIUS_M, SphereOutline::Tangent).unwrap());
    let settings = EdgeSettings::default();
    let mut cue = EdgeCue::new(settings, shape, &colors, Level::best()).unwrap();
    let mut view = view();
    let kind = PixelKind::of(frame);
    view.prepare(kind, cue.palette());
    view.prepare_ranges(kind, cue.ranges().unwrap());
    let evidence = view.evidence(frame);
    let likeness = likeness(&evidence, &colors, &IlluminationCorrection::NONE, 1);
    let look = Look::new(
        0,
        evidence,
        (cue.palette(), cue.ranges()),
        (&likeness, IlluminationCorrection::NONE),
        known_around,
    );
    cue.fit(&[look], start_m, None, false)
}

#[test]
fn an_outline_is_found_to_a_fraction_of_a_pixel_from_some_pixels_off() {
    let place_m = [0.05, -0.03, 1.2];
    let (frame, _) = picture(place_m, SIZE.0);
    // 3 px aside, and a tenth too far.
    for start_m in [[0.068, -0.03, 1.2], [0.05, -0.02, 1.32], [0.05, -0.03, 1.1]] {
        let sighting = fitted(&frame, start_m, None).unwrap();
        for axis in 0..3 {
            // 0.05 px across, 0.1 px of 17 in radius.
            let allowed_m = [3e-4, 3e-4, 7e-3][axis];
            let off_m = (sighting.position_m[axis] - place_m[axis]).abs();
            assert!(off_m < allowed_m, "{start_m:?}: {:?}", sighting.position_m);
        }
        assert!(sighting.log_ratio > 15.0 && sighting.seen_share() > 0.95);
        assert!(sighting.information.cholesky().is_some());
    }
}

#[test]
fn where_nothing_has_the_colours_there_is_no_sighting() {
    let (frame, _) = picture([0.05, -0.03, 1.2], SIZE.0);
    assert!(fitted(&frame, [-0.25, 0.1, 1.2], None).is_none());
    assert!(
        fitted(&frame, [0.0, 0.0, -1.2], None).is_none(),
        "behind the camera"
    );
    assert!(
        fitted(&frame, [3.0, 0.0, 1.2], None).is_none(),
        "out of the image"
    );
}

#[test]
fn what_has_come_between_does_not_make_a_small_body_smaller() {
    // A ball of 5 px in radius.
    let place_m = [0.1, -0.03, 4.0];
    let (whole, _) = picture(place_m, SIZE.0);
    let mut around = None;
    let seen = fitted(&whole, place_m, None).unwrap();
    seen.learn_around(0, &mut around);
    // The right third of it is hidden.
    let (partly, _) = picture(place_m, 86);
    let naive = fitted(&partly, place_m, None).unwrap();
    let aware = fitted(&partly, place_m, around.as_ref()).unwrap();
    let error_m = |sighting: &Sighting| (sighting.position_m[2] - place_m[2]).abs();
    let found = [&seen, &naive, &aware].map(|sighting| sighting.position_m);
    // A tenth of a pixel in radius.
    assert!(error_m(&seen) < 0.08, "{found:?}");
    assert!(error_m(&aware) < 0.5 * error_m(&naive), "{found:?}");
}
