//! Edits of the text of a scene that keep what people wrote in it.

use anyhow::Result;
use toml_edit::{Array, DocumentMut, Item, Table, Value};

use crate::commands::init::text::{ABOUT_GUESSES, guesses};
use crate::user_error::user_error;

/// The keys of a camera's table that describe its lens.
const LENS_KEYS: [&str; 5] = [
    "calibration",
    "calibration_camera",
    "calibration_lens",
    "size_px",
    "model",
];

/// Parses the text of a scene.
///
/// Errors: its syntax is wrong.
pub(super) fn parsed(text: &str) -> Result<DocumentMut> {
    text.parse().map_err(|error| {
        user_error!("the scene is no TOML, correct it in an editor first: {error}")
    })
}

/// Returns the text with this table at its end.
pub(super) fn with_table(text: &str, table: &str) -> Result<String> {
    let mut all = text.trim_end().to_owned();
    all.push_str("\n\n");
    all.push_str(table.trim_end());
    all.push('\n');
    // It may have the name of another.
    parsed(&all)?;
    Ok(with_guesses(&all))
}

/// Returns the text without a camera or a target.
pub(super) fn without(text: &str, kind: &str, name: &str) -> Result<String> {
    let mut document = parsed(text)?;
    let removed = document
        .get_mut(kind)
        .and_then(Item::as_table_like_mut)
        .and_then(|tables| tables.remove(name));
    if removed.is_none() {
        return Err(user_error!("{kind}.{name}: is not in the scene"));
    }
    Ok(with_guesses(&document.to_string()))
}

/// Returns the text with another name of a camera. Its tables stay where they are.
pub(super) fn with_camera_name(text: &str, name: &str, new: &str) -> Result<String> {
    let mut document = parsed(text)?;
    let cameras = document
        .get_mut("cameras")
        .and_then(Item::as_table_like_mut);
    let cameras = cameras.filter(|cameras| cameras.contains_key(name));
    let cameras = cameras.ok_or_else(|| user_error!("cameras.{name}: is not in the scene"))?;
    if cameras.contains_key(new) {
        return Err(user_error!(
            "cameras.{new}: is in the scene already; choose another name"
        ));
    }
    // In the order in which they are: that of tables of one line is not theirs.
    let names: Vec<String> = cameras.iter().map(|(key, _)| key.to_owned()).collect();
    for key in names {
        let (Some(decor), Some(item)) = (
            cameras.key(&key).map(|key| key.leaf_decor().clone()),
            cameras.remove(&key),
        ) else {
            continue;
        };
        let key = if key == name { new } else { &key };
        cameras.insert(key, item);
        if let Some(mut key) = cameras.key_mut(key) {
            *key.leaf_decor_mut() = decor;
        }
    }
    Ok(with_guesses(&document.to_string()))
}

/// Returns the text with a value under a path of keys. A mark that says that the value before was a guess is removed, and tables that are missing are
/// added.
pub(super) fn with_value(text: &str, path: &[&str], value: impl Into<Value>) -> Result<String> {
    let mut document = parsed(text)?;
    let (last, tables) = path
        .split_last()
        .ok_or_else(|| user_error!("no key is given"))?;
    let mut table: &mut dyn toml_edit::TableLike = document.as_table_mut();
    for (depth, key) in tables.iter().enumerate() {
        let is_header = depth < 2;
        let next = table.entry(key).or_insert_with(|| {
            let mut new = Table::new();
            new.set_dotted(!is_header);
            Item::Table(new)
        });
        table = next
            .as_table_like_mut()
            .ok_or_else(|| user_error!("{}: is no table", path[..=depth].join(".")))?;
    }
    table.insert(last, Item::Value(value.into()));
    Ok(with_guesses(&document.to_string()))
}

/// The keys of a camera's table that describe its input.
const INPUT_KEYS: [&str; 10] = [
    "images",
    "video",
    "mcap",
    "topic",
    "fps",
    "input",
    "yuv",
    "first_frame",
    "frame_step",
    "frame_limit",
];

/// Returns the text with a folder of images, whose times are in it, in place of the input of a camera.
pub(super) fn with_images(text: &str, camera: &str, folder: &str) -> Result<String> {
    let mut document = parsed(text)?;
    let table = document
        .get_mut("cameras")
        .and_then(|cameras| cameras.get_mut(camera)?.as_table_like_mut())
        .ok_or_else(|| user_error!("cameras.{camera}: is not in the scene any more"))?;
    for key in INPUT_KEYS {
        table.remove(key);
    }
    with_value(
        &document.to_string(),
        &["cameras", camera, "images"],
        folder,
    )
}

/// Returns the text with these sizes of a target's shape. Other keys of the shape stay, unless its kind changes.
pub(super) fn with_shape(
    text: &str,
    target: &str,
    kind: &str,
    sizes: &[(&str, Value)],
) -> Result<String> {
    let mut document = parsed(text)?;
    let table = document
        .get_mut("targets")
        .and_then(|targets| targets.get_mut(target)?.as_table_like_mut())
        .ok_or_else(|| user_error!("targets.{target}: is not in the scene; add it first"))?;
    let is_same = table
        .get("shape")
        .is_some_and(|shape| shape.get(kind).is_some());
    if !is_same {
        table.remove("shape");
    }
    let mut text = document.to_string();
    for (key, size) in sizes {
        let path = ["targets", target, "shape", kind, key];
        text = with_value(&text, &path, size.clone())?;
    }
    Ok(text)
}

/// Returns the text with the lens of the camera in `camera`, the text of a table `[cameras.NAME]`, in place of that of the scene's camera of this
/// name. Its pose takes the place of a guess.
pub(super) fn with_lens(text: &str, name: &str, camera: &str) -> Result<String> {
    let pose = format!("cameras.{name}.world_from_camera");
    let is_guess = guesses(text).contains(&pose);
    let mut document = parsed(text)?;
    let mut other = parsed(camera)?;
    let table_of = |document: &mut DocumentMut| {
        let camera = document
            .get_mut("cameras")
            .and_then(|all| all.get_mut(name));
        camera.and_then(Item::as_table_mut).map(std::mem::take)
    };
    let missing = || user_error!("cameras.{name}: has no table of its own in the scene");
    let mut new = table_of(&mut other).ok_or_else(missing)?;
    let slot = document
        .get_mut("cameras")
        .and_then(|all| all.get_mut(name));
    let old = slot.and_then(Item::as_table_mut).ok_or_else(missing)?;
    let has_pose = old.contains_key("world_from_camera");
    let mut keys = LENS_KEYS.to_vec();
    if is_guess || !has_pose {
        keys.push("world_from_camera");
    }
    for key in keys {
        let before = old.remove(key);
        // Said of it in another table, which is not needed where it stands already.
        let is_said = key == "world_from_camera" && before.is_some();
        if let Some((own, mut item)) = new.remove_entry(key) {
            if let Item::Table(table) = &mut item {
                table.set_position(None);
                table.iter_mut().for_each(|(_, item)| {
                    if let Item::Table(table) = item {
                        table.set_position(None);
                    }
                });
            }
            if is_said || item.is_value() {
                old.insert_formatted(&own, item);
            } else {
                old.insert(key, item);
            }
        }
    }
    Ok(with_guesses(&document.to_string()))
}

/// Returns the text with the list of its guesses, which are the lines that are marked.
fn with_guesses(text: &str) -> String {
    let Ok(mut document) = text.parse::<DocumentMut>() else {
        return text.to_owned();
    };
    let keys = guesses(text);
    if keys.is_empty() {
        document.remove("guessed");
        return document.to_string();
    }
    let mut list = Array::new();
    for key in keys {
        let mut value = Value::from(key);
        value.decor_mut().set_prefix("\n    ");
        list.push_formatted(value);
    }
    list.set_trailing("\n");
    list.set_trailing_comma(true);
    let is_new = !document.contains_key("guessed");
    document["guessed"] = toml_edit::value(list);
    if let (true, Some(mut key)) = (is_new, document.key_mut("guessed")) {
        key.leaf_decor_mut().set_prefix(ABOUT_GUESSES);
    }
    document.to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCENE: &str = "# Mine.
seed = 3  # lucky

[cameras.left] # over the door
video = \"a.mp4\"
size_px = [640, 480]
# The pose.
world_from_camera = [  # CHANGE: a guess
    [1.0, 0.0, 0.0, 0.0],
    [0.0, 1.0, 0.0, 0.0],
    [0.0, 0.0, 1.0, 0.0],
    [0.0, 0.0, 0.0, 1.0],
]

[cameras.left.model.pinhole]
f_px = [500.0, 500.0]  # CHANGE: typical
center_px = [319.5, 239.5]

[targets.ball]
shape.sphere.radius_m = 0.11  # CHANGE: the ball's radius
colors = \"ball.colors.toml\"  # orange
";

    #[test]
    fn values_are_replaced_and_their_marks_removed_and_all_else_kept() {
        let path = ["targets", "ball", "shape", "sphere", "radius_m"];
        let text = with_value(SCENE, &path, 0.05).unwrap();
        assert!(text.contains("shape.sphere.radius_m = 0.05\n"), "{text}");
        for kept in [
            "# Mine.",
            "# lucky",
            "# over the door",
            "# The pose.",
            "# orange",
        ] {
            assert!(text.contains(kept), "{text}");
        }
        let listed = "guessed = [\n    \"cameras.left.world_from_camera\",\n    \"cameras.left.model.pinhole.f_px\",\n]\n";
        assert!(text.contains(&format!("{ABOUT_GUESSES}{listed}")), "{text}");
        // Once more, the list is not repeated.
        let text = with_value(&text, &path, 0.06).unwrap();
        assert_eq!(text.matches("guessed = [").count(), 1, "{text}");
        assert!(
            parsed(
                &with_value(SCENE, &["seed", "x"], 1)
                    .unwrap_err()
                    .to_string()
            )
            .is_err()
        );
    }

    #[test]
    fn tables_are_added_and_removed() {
        let text = with_table(SCENE, "[targets.robot]\ncolors = \"r.colors.toml\"").unwrap();
        assert!(
            text.ends_with("\n\n[targets.robot]\ncolors = \"r.colors.toml\"\n"),
            "{text}"
        );
        assert!(with_table(&text, "[targets.ball]").is_err());
        let text = without(&text, "targets", "ball").unwrap();
        assert!(
            !text.contains("ball") && text.contains("targets.robot"),
            "{text}"
        );
        let error = without(&text, "targets", "ball").unwrap_err();
        assert_eq!(error.to_string(), "targets.ball: is not in the scene");
    }

    #[test]
    fn a_camera_gets_another_name_and_all_else_stays() {
        let two = format!("{SCENE}\n# The other.\n[cameras.right]\nvideo = \"b.mp4\"\n");
        let text = with_camera_name(&two, "left", "door").unwrap();
        let without_list = text.split("guessed = [").next().unwrap().len();
        let end = text.find("[cameras.door]").unwrap();
        let expected = two
            .replace("cameras.left", "cameras.door")
            .split_off(two.find("[cameras.left]").unwrap());
        assert!(without_list < end && text[end..] == expected, "{text}");
        assert!(
            text.contains("\"cameras.door.model.pinhole.f_px\""),
            "{text}"
        );
        let dotted = "cameras.a.fps = 5  # slow\ncameras.b.fps = 6\n";
        assert_eq!(
            with_camera_name(dotted, "a", "c").unwrap(),
            "cameras.c.fps = 5  # slow\ncameras.b.fps = 6\n"
        );
        for (old, new, expected) in [("up", "new", "is not in"), ("left", "right", "already")] {
            let error = with_camera_name(&two, old, new).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }

    #[test]
    fn a_lens_takes_the_place_of_another_and_of_a_guessed_pose() {
        let calibrated = "[cameras.left]\nvideo = \"b.mp4\"\ncalibration = \"c.toml\"  # the lens and the pose\n";
        let text = with_lens(SCENE, "left", calibrated).unwrap();
        assert!(
            text.contains("video = \"a.mp4\"\ncalibration = \"c.toml\""),
            "{text}"
        );
        for gone in ["pinhole", "size_px", "world_from_camera", "b.mp4"] {
            assert!(!text.contains(gone), "{gone} in {text}");
        }
        // Back to a guess, with a pose that somebody gave.
        let guess = "[cameras.left]\nsize_px = [640, 480]\nworld_from_camera = [  # CHANGE: a guess\n    [9.0],\n]\n\n\
                     [cameras.left.model.pinhole]\nf_px = [700.0, 700.0]\n";
        let again = with_lens(&text, "left", guess).unwrap();
        assert!(
            again.contains("[[9.0]") || again.contains("[9.0]"),
            "{again}"
        );
        assert!(
            again.contains("[cameras.left.model.pinhole]\nf_px = [700.0, 700.0]"),
            "{again}"
        );
        let given = SCENE.replace("[  # CHANGE: a guess", "[");
        let kept = with_lens(&given, "left", guess).unwrap();
        assert!(
            kept.contains("[1.0, 0.0, 0.0, 0.0]") && !kept.contains("9.0"),
            "{kept}"
        );
        assert!(
            kept.contains("f_px = [700.0, 700.0]") && !kept.contains("500"),
            "{kept}"
        );
    }

    #[test]
    fn a_recording_takes_the_place_of_whatever_a_camera_was() {
        let live = "[cameras.left] # over the door\nvideo = \"rtsp://host/1\"  # the stream\nsize_px = [640, 480]\ninput.reopen_s = 5\nfps = 30\n\n\
                    [cameras.left.yuv]\nmatrix = \"bt709\"\n\n[targets.ball]\ncolors = \"a.toml\"\n";
        let text = with_images(live, "left", "scene-recording/1/left").unwrap();
        let read: toml::Table = text.parse().unwrap();
        let expected: toml::Table = "size_px = [640, 480]\nimages = \"scene-recording/1/left\""
            .parse()
            .unwrap();
        assert_eq!(
            read["cameras"]["left"].as_table(),
            Some(&expected),
            "{text}"
        );
        assert_eq!(read["targets"]["ball"]["colors"].as_str(), Some("a.toml"));
        assert!(text.contains("# over the door"), "{text}");
        let error = with_images(live, "right", "a").unwrap_err().to_string();
        assert!(
            error.contains("cameras.right: is not in the scene"),
            "{error}"
        );
    }

    #[test]
    fn shapes_keep_what_is_said_of_them_until_they_become_others() {
        let forms = [
            "[targets.ball]\nshape.sphere.radius_m = 0.1  # CHANGE: the ball's radius\nshape.sphere.radius_tolerance = 0.05\ncolors = \"a.toml\"\n",
            "[targets.ball]\nshape = { sphere = { radius_m = 0.1, radius_tolerance = 0.05 } }\ncolors = \"a.toml\"\n",
            "[targets.ball]\ncolors = \"a.toml\"\n\n[targets.ball.shape.sphere]\nradius_m = 0.1\nradius_tolerance = 0.05\n",
        ];
        for form in forms {
            let read = |text: &str| {
                let table: toml::Table = text.parse().unwrap();
                let target = &table["targets"]["ball"];
                assert_eq!(target["colors"].as_str(), Some("a.toml"), "{text}");
                target["shape"].clone()
            };
            let same = with_shape(form, "ball", "sphere", &[("radius_m", 0.2.into())]).unwrap();
            let sphere = read(&same)["sphere"].clone();
            assert_eq!(sphere["radius_m"].as_float(), Some(0.2), "{same}");
            assert_eq!(sphere["radius_tolerance"].as_float(), Some(0.05), "{same}");
            assert!(!same.contains("CHANGE"), "{same}");
            let sizes: Array = [0.3, 0.2, 0.1].into_iter().collect();
            let other = with_shape(&same, "ball", "box", &[("size_m", sizes.into())]).unwrap();
            let shape = read(&other);
            assert_eq!(shape.as_table().unwrap().len(), 1, "{other}");
            assert_eq!(
                shape["box"]["size_m"].as_array().unwrap().len(),
                3,
                "{other}"
            );
        }
        let error = with_shape(forms[0], "none", "box", &[]).unwrap_err();
        assert!(error.to_string().contains("is not in the scene"), "{error}");
    }
}
