//! Crowds: any number of targets that look alike.

use pardalis::camera::Pose;
use pardalis::color::YuvEncoding;
use pardalis::filter::gaussian::GaussianStart;
use pardalis::tracker::{Origin, TargetSettings, TrackState};
use pardalis::view::View;
use pardalis::{CameraId, FrameSet, PixelFormat, TargetId, Tracker};

use crate::common::drawn::{Thing, settings_of, shown, view};
use crate::common::{FPS, detected_ball, fisheye_view, frame, open, set_of};

/// The frame sets of data/dioptric-two-balls.
fn sets() -> impl Iterator<Item = FrameSet> {
    (0..78).map(|index| {
        let picture = open(&format!("dioptric-two-balls/frames/{index:06}.jpg"));
        let time_s = index as f64 / FPS;
        let frame = frame(&picture, PixelFormat::Rgb8, YuvEncoding::default(), time_s);
        FrameSet::new([(CameraId::new(0), frame)]).unwrap()
    })
}

fn tracker(most: usize) -> (Tracker, TargetId) {
    let mut builder = Tracker::builder();
    let view: View = fisheye_view();
    builder.camera(view);
    let crowd = builder.target(TargetSettings::crowd(detected_ball(), most));
    (builder.build().unwrap(), crowd)
}

/// Returns the numbers of the members of each frame set and, with them, their states.
fn members(tracker: &mut Tracker, crowd: TargetId) -> Vec<Vec<(u32, TrackState)>> {
    let step = |set: FrameSet| {
        tracker.observe(&set).unwrap();
        let members = tracker.members_at(crowd, set.time_s()).unwrap();
        let members = members.map(|member| (member.number, member.estimate.state));
        let mut members: Vec<_> = members.collect();
        members.sort_by_key(|(number, _)| *number);
        members
    };
    sets().map(step).collect()
}

#[test]
fn two_balls_are_two_members_who_keep_their_numbers() {
    let (mut tracker, crowd) = tracker(10);
    let members = members(&mut tracker, crowd);
    for (index, of_set) in members.iter().enumerate().skip(3) {
        let numbers: Vec<u32> = of_set.iter().map(|(number, _)| *number).collect();
        assert_eq!(numbers, [1, 2], "{index}");
    }
    // The single estimate is that of the member with the greatest confidence.
    let estimate = tracker.estimate(crowd).unwrap();
    let time_s = tracker.time_s().unwrap();
    let all: Vec<_> = tracker.members_at(crowd, time_s).unwrap().collect();
    assert!(all.iter().any(|member| member.estimate == estimate));
    let most = all.iter().map(|member| member.estimate.confidence);
    assert_eq!(estimate.confidence, most.fold(0.0, f64::max));
    // Each has been measured.
    let measured: Vec<_> = tracker.measurements(crowd).unwrap().collect();
    assert!(all.iter().all(|member| measured[member.body].is_some()));
    assert_eq!(measured.iter().flatten().count(), 2);
}

#[test]
fn no_more_members_than_allowed_are_tracked() {
    let (mut tracker, crowd) = tracker(1);
    for of_set in members(&mut tracker, crowd) {
        assert!(of_set.len() <= 1, "{of_set:?}");
    }
}

#[test]
fn a_single_image_shows_all_members() {
    let (mut tracker, crowd) = tracker(10);
    let set = sets().nth(20).unwrap();
    let located = tracker.locate(&set, &[None; 10], &[0.1]).unwrap();
    assert_eq!((located.len(), located[0].state), (1, TrackState::Tracking));
    let time_s = set.time_s();
    assert_eq!(tracker.members_at(crowd, time_s).unwrap().count(), 2);
}

#[test]
fn a_crowd_cannot_be_started_and_other_targets_have_no_members() {
    let (mut tracker, crowd) = tracker(2);
    let start = GaussianStart::at([0.0; 3]);
    let error = tracker.reinitialize(crowd, &start, 0.0).unwrap_err();
    assert!(error.to_string().contains("a crowd"), "{error}");
    let mut builder = Tracker::builder();
    builder.camera(fisheye_view());
    let ball = builder.target(detected_ball());
    let tracker = builder.build().unwrap();
    assert_eq!(tracker.members_at(ball, 0.0).unwrap().count(), 0);
    let mut builder = Tracker::builder();
    builder.camera(fisheye_view());
    builder.target(TargetSettings::crowd(detected_ball(), 0));
    assert!(builder.build().is_err(), "a crowd of nobody");
}

/// Returns whether streaks of what moves near a member that has just been hidden, or far from it, were examined: a bar of this many pixels beside its place.
fn is_examined(beside_px: f64) -> bool {
    let ball = |middle_px: [f64; 2]| Thing {
        exponent: 2.0,
        radius_px: 14.0,
        middle_px,
    };
    let known = ball([80.0, 120.0]);
    let mut builder = Tracker::builder();
    builder.camera(view(Pose::identity()));
    let crowd = builder.target(TargetSettings::crowd(settings_of(known), 1));
    let mut tracker = builder.build().unwrap();
    let mut is_examined = false;
    for number in 0..14 {
        let bar = (0..6).map(|part| {
            let u = 80.0 + beside_px + 8.0 * f64::from(part) + 9.0 * f64::from(number - 12);
            ball([u, 120.0])
        });
        let things: Vec<Thing> = if number < 12 {
            vec![known]
        } else {
            bar.collect()
        };
        let time_s = 0.04 * f64::from(number);
        tracker
            .observe(&set_of(shown(&things, &[], time_s)))
            .unwrap();
        let members: Vec<_> = tracker.members_at(crowd, time_s).unwrap().collect();
        if (2..12).contains(&number) {
            assert_eq!(members.len(), 1, "{number}");
        }
        let mut candidates = tracker.candidates(crowd).unwrap().flatten();
        is_examined |= candidates.any(|one| matches!(one.origin, Origin::Motion(..)));
    }
    is_examined
}

/// The others of a crowd, and whatever else moves, are none of its business.
#[test]
fn streaks_of_a_member_are_looked_for_near_its_prediction() {
    assert!(is_examined(20.0));
    assert!(!is_examined(170.0));
}
