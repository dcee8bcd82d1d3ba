//! Evaluation of confidences and states.

use std::fmt::Write as _;

use serde_json::Value;

use super::{Folder, assert_near, error_message, evaluate, figures};

#[test]
fn states_are_compared_with_the_truth() {
    let folder = Folder::new("states");
    // The ball is occluded in frames 3 to 5; the track reports it one frame late, and needs two frames to find it
    // again, the first of them at a wrong position.
    let words = ["tracking", "tracking", "tracking", "tracking", "occluded"];
    let words = [&words[..], &["lost", "tracking", "tracking"]].concat();
    let mut truth_text = "time_s,object,x_m,y_m,z_m,visible_fraction\n".to_owned();
    let mut tracks_text = "time_s,target,state,x_m,y_m,z_m\n".to_owned();
    for (frame, word) in words.iter().enumerate() {
        let share = u8::from(!(3..6).contains(&frame));
        writeln!(truth_text, "{frame},ball,1,2,3,{share}").unwrap();
        let position = match frame {
            5 => ",,",
            6 => "1.3,2,3",
            _ => "1,2,3",
        };
        writeln!(tracks_text, "{frame},ball,{word},{position}").unwrap();
    }
    let tracks = folder.write("tracks.csv", &tracks_text);
    let truth = folder.write("truth.csv", truth_text);
    let found = &figures(&tracks, &truth, &["--diameter-m", "0.22"])["targets"][0];
    assert_eq!(found["frames_to_occluded"], 2);
    assert_eq!(found["frames_to_tracking"], 2);
    assert_eq!(found["elsewhere_frames"], 1);
    // Without a known diameter, states are not evaluated.
    let none = &figures(&tracks, &truth, &[])["targets"][0];
    assert_eq!(none["elsewhere_frames"], Value::Null);

    folder.write("tracks.csv", tracks_text.replace("lost", "hidden"));
    let message = error_message(&tracks, &truth, &[]);
    assert!(
        message.contains("line 7, column state") && message.contains("occluded"),
        "{message}"
    );
}

#[test]
fn confidences_are_compared_with_the_truth() {
    let folder = Folder::new("confidence");
    // Ten frames; the ball is occluded in the last two and has no row in the last one, in which the robot has one.
    let mut truth_text = "time_s,object,x_m,y_m,z_m,visible_fraction\n".to_owned();
    let mut tracks_text = "time_s,target,x_m,y_m,z_m,confidence\n".to_owned();
    for frame in 0..10 {
        let share = if frame < 8 { 1.0 } else { 0.05 };
        writeln!(truth_text, "{frame},robot,5,5,0,1").unwrap();
        if frame < 9 {
            writeln!(truth_text, "{frame},ball,1,2,3,{share}").unwrap();
        }
        let (position, confidence) = match frame {
            0 | 8 => (",,", 0.5),        // in view, and not
            1 => ("1.21,2,3", 0.97),     // near
            6 | 7 => ("1,2.23,3", 0.97), // too far
            9 => ("1,2,3", 0.27),        // not there at all
            _ => ("1,2,3", 0.97),
        };
        writeln!(tracks_text, "{frame},ball,{position},{confidence}").unwrap();
    }
    let tracks = folder.write("tracks.csv", tracks_text);
    let truth = folder.write("truth.csv", truth_text);
    let none = &figures(&tracks, &truth, &[])["targets"][0];
    assert_eq!(none["reliability"], Value::Null);
    assert_near(&none["confidence_max"], 0.97);

    let check = |options: &[&str]| {
        let found = &figures(&tracks, &truth, options)["targets"][0];
        let reliability = &found["reliability"];
        assert_eq!(reliability["rows"], 10);
        let bins: Vec<_> = reliability["bins"].as_array().unwrap().iter().collect();
        let [low, middle, high] = bins[..] else {
            panic!("{} bins instead of three", bins.len())
        };
        assert_near(&low["share_right"], 0.0);
        assert_near(&middle["share_right"], 0.5);
        assert_eq!(high["rows"], 7);
        assert_near(&high["share_right"], 5.0 / 7.0);
        let error = (0.27 + 7.0 * (0.97 - 5.0 / 7.0)) / 10.0;
        assert_near(&reliability["calibration_error"], error);
        assert_eq!(found["frames_to_find"], 2);
    };
    check(&["--diameter-m", "0.22"]);
    // The diameter in the summary gives the same result.
    folder.write(
        "summary.json",
        r#"{"targets": {"ball": {"diameter_m": 0.22}}}"#,
    );
    check(&[]);
    let output = evaluate(&tracks, &truth, &[]);
    let table = String::from_utf8(output.stdout).unwrap();
    assert!(table.contains("confidence, calibration error"), "{table}");
    assert!(table.contains("within 0.22 m"), "{table}");

    folder.write(
        "tracks.csv",
        "time_s,target,x_m,y_m,z_m,confidence\n0,ball,1,2,3,1.5\n",
    );
    let message = error_message(&tracks, &truth, &[]);
    assert!(
        message.contains("line 2, column confidence") && message.contains("0 to 1"),
        "{message}"
    );
}
