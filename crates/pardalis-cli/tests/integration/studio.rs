//! What `pardalis studio` says on the terminal.

use std::fs;
use std::io::{BufRead as _, BufReader, Read as _};
use std::process::{Command, Stdio};

use crate::common::{Run, SCENE, Workplace};

#[test]
fn mistakes_on_the_command_line_are_refused_with_a_remedy() {
    let place = Workplace::with_frames(2);
    for (arguments, wanted) in [
        (
            &["-o", "x.txt"][..],
            "-o x.txt: a scene is a TOML file; choose a name ending in .toml",
        ),
        (&["images", "./images"], "./images: is given twice"),
        (
            &["a.toml"],
            "a.toml: there is no such file; check the name, or give -o a.toml",
        ),
        (
            &["--listen", "localhost"],
            "an address of this computer in numbers, such as 192.168.1.7",
        ),
        (&["nothere"], "nothere"),
    ] {
        Run::pardalis(place.path(""), &[&["studio"], arguments].concat()).refused(&[wanted]);
    }
}

/// Runs the studio until it serves its page, ends it as Ctrl-C does, and returns what it said.
fn said(place: &Workplace, arguments: &[&str]) -> String {
    let mut running = Command::new(env!("CARGO_BIN_EXE_pardalis"))
        .current_dir(place.path(""))
        .arg("studio")
        .args(arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stderr = BufReader::new(running.stderr.take().unwrap());
    let mut text = String::new();
    while !text.contains("Open http://") {
        assert!(stderr.read_line(&mut text).unwrap() > 0, "{text}");
    }
    let id = running.id().to_string();
    Command::new("kill").args(["-INT", &id]).status().unwrap();
    stderr.read_to_string(&mut text).unwrap();
    assert!(running.wait().unwrap().success(), "{text}");
    text
}

#[test]
fn problems_of_a_scene_are_named_and_what_was_only_given_is_not_missed() {
    let place = Workplace::with_frames(2);
    place.write("broken.toml", "seed = \n");
    let text = said(&place, &["broken.toml"]);
    assert!(
        text.contains("broken.toml: a problem") && text.contains("line 1"),
        "{text}"
    );
    place.write("wrong.toml", SCENE.replace("fps", "fsp"));
    let text = said(&place, &["wrong.toml"]);
    assert!(
        text.contains("fsp") && text.contains("The page shows"),
        "{text}"
    );
    // The same command as yesterday.
    place.write("scene.toml", SCENE);
    let text = said(&place, &["./images"]);
    assert!(
        text.contains("./images is in scene.toml already."),
        "{text}"
    );
    fs::remove_file(place.path("scene.toml")).unwrap();
    for arguments in [&[][..], &["images"], &["-o", "new.toml"]] {
        let text = said(&place, arguments);
        assert!(!text.contains("warning"), "{arguments:?}: {text}");
        assert!(!place.path("scene.toml").exists());
    }
}
