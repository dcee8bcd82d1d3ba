//! Changes of cameras' settings in a scene's text, which is otherwise unchanged.

use std::ops::Range;

use toml::de::{DeTable, DeValue};

/// A setting of a camera in a scene's text.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraSetting<'a> {
    /// The camera's name.
    pub camera: &'a str,
    /// The key in the camera's table, such as `time_offset_s`. A key with dots, such as `model.pinhole.f_px`, must be given in the
    /// text already.
    pub key: &'a str,
    /// Its value.
    pub value: toml::Value,
    /// Whether it remains a guess, if the text lists it as one.
    pub is_guess: bool,
}

/// Returns the scene's text with these settings replaced or added, and no longer listed as guesses unless they remain such; `None` if the layout of
/// the text does not allow this without other changes.
pub fn with_camera_settings(text: &str, settings: &[CameraSetting]) -> Option<String> {
    let root = DeTable::parse(text).ok()?;
    let cameras = table(root.get_ref().get("cameras")?.get_ref())?;
    let mut edits: Vec<(Range<usize>, String)> = Vec::new();
    for setting in settings {
        let camera = table(cameras.get(setting.camera)?.get_ref())?;
        let value = setting.value.to_string();
        let mut given = Some(camera);
        let (inner, key) = setting.key.rsplit_once('.').unwrap_or(("", setting.key));
        for part in inner.split('.').filter(|part| !part.is_empty()) {
            given = given.and_then(|outer| table(outer.get(part)?.get_ref()));
        }
        let edit = if let Some(given) = given.and_then(|table| table.get(key)) {
            let mark = mark(text, given.span()).filter(|_| setting.is_guess);
            (given.span(), format!("{value}{}", mark.unwrap_or_default()))
        } else if inner.is_empty() {
            let input = |key: &str| camera.get_key_value(key).map(|(key, _)| key.span());
            let inputs = ["images", "video", "mcap"];
            let place = inputs.into_iter().find_map(input)?;
            insertion(text, place.start, &format!("{key} = {value}"))
        } else {
            return None;
        };
        edits.push(edit);
    }
    let guesses = root.get_ref().get("guessed");
    if let Some((place, rest)) = guesses.and_then(|guesses| {
        let rest = without_guesses(guesses.get_ref(), settings)?;
        Some((guesses.span(), toml::Value::Array(rest).to_string()))
    }) {
        edits.push((place, rest));
    }
    edits.sort_by_key(|(place, _)| place.start);
    let mut edited = text.to_owned();
    for (place, new) in edits.iter().rev() {
        edited.replace_range(place.clone(), new);
    }
    is_equivalent(text, &edited, settings).then_some(edited)
}

fn table<'a, 't>(value: &'a DeValue<'t>) -> Option<&'a DeTable<'t>> {
    match value {
        DeValue::Table(table) => Some(table),
        _ => None,
    }
}

/// Returns the comment in the first line of a value of several lines, such as that it is a guess, if it can stand behind the value as well.
fn mark(text: &str, value: Range<usize>) -> Option<String> {
    let rest = text[value.end..].lines().next().unwrap_or_default();
    let (first, _) = text[value].split_once('\n')?;
    let (_, comment) = first.split_once('#')?;
    rest.trim()
        .is_empty()
        .then(|| format!("  #{}", comment.trim_end()))
}

/// Returns the list of guesses without these settings; `None` if it has none of them.
fn without_guesses(guesses: &DeValue, settings: &[CameraSetting]) -> Option<Vec<toml::Value>> {
    let keys: Vec<&str> = guesses
        .as_array()?
        .iter()
        .map(|key| key.get_ref().as_str())
        .collect::<Option<_>>()?;
    let rest = keys.iter().filter(|key| !is_set(key, settings));
    let rest: Vec<toml::Value> = rest.map(|key| (*key).into()).collect();
    (rest.len() < keys.len()).then_some(rest)
}

/// Reports whether a full key is among the settings.
fn is_set(key: &str, settings: &[CameraSetting]) -> bool {
    let full = |setting: &CameraSetting| format!("cameras.{}.{}", setting.camera, setting.key);
    settings
        .iter()
        .any(|setting| !setting.is_guess && full(setting) == key)
}

/// Returns the insertion of a setting before the key that begins here, in the same table: as the previous line, or
/// before the key in a table in braces.
fn insertion(text: &str, key_start: usize, setting: &str) -> (Range<usize>, String) {
    let line_start = text[..key_start].rfind('\n').map_or(0, |at| at + 1);
    let before = &text[line_start..key_start];
    if before.contains('{') {
        return (key_start..key_start, format!("{setting}, "));
    }
    let line_end = if text.contains("\r\n") { "\r\n" } else { "\n" };
    (
        line_start..line_start,
        format!("{before}{setting}{line_end}"),
    )
}

/// Reports whether the edited text has the settings of the original text and these.
fn is_equivalent(text: &str, edited: &str, settings: &[CameraSetting]) -> bool {
    let (Ok(mut wanted), Ok(edited)) = (text.parse::<toml::Table>(), edited.parse::<toml::Table>())
    else {
        return false;
    };
    for setting in settings {
        let mut place = wanted
            .get_mut("cameras")
            .and_then(|cameras| cameras.get_mut(setting.camera));
        let (inner, key) = setting.key.rsplit_once('.').unwrap_or(("", setting.key));
        for part in inner.split('.').filter(|part| !part.is_empty()) {
            place = place.and_then(|table| table.get_mut(part));
        }
        if let Some(table) = place.and_then(toml::Value::as_table_mut) {
            table.insert(key.to_owned(), setting.value.clone());
        }
    }
    if let Some(guesses) = wanted
        .get_mut("guessed")
        .and_then(toml::Value::as_array_mut)
    {
        guesses.retain(|key| key.as_str().is_none_or(|key| !is_set(key, settings)));
    }
    wanted == edited
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with_time_offsets(text: &str, offsets_s: &[(&str, f64)]) -> Option<String> {
        let settings: Vec<CameraSetting> = offsets_s
            .iter()
            .map(|(camera, offset_s)| CameraSetting {
                camera,
                key: "time_offset_s",
                value: (*offset_s).into(),
                is_guess: false,
            })
            .collect();
        with_camera_settings(text, &settings)
    }

    #[test]
    fn offsets_are_replaced_or_added_and_everything_else_stays() {
        let text = "# my scene\nseed = 3\n[cameras.left] # first\nimages = \"l\"\nfps = 25\n\n[cameras.right]\n  # theirs\n  video = \"r.mp4\" # loud\n  \
                    time_offset_s = 1e-3   # guessed\n[cameras.top]\nfps = 25\nimages = 't' # top\n";
        let edited = with_time_offsets(text, &[("right", -0.125), ("top", 0.04)]).unwrap();
        let wanted = text
            .replace("1e-3", "-0.125")
            .replace("images = 't'", "time_offset_s = 0.04\nimages = 't'");
        assert_eq!(edited, wanted);
    }

    #[test]
    fn tables_may_have_any_layout() {
        for (text, wanted) in [
            (
                "cameras.a = { images = \"x\" }\n",
                "cameras.a = { time_offset_s = 0.5, images = \"x\" }\n",
            ),
            (
                "cameras.a.images = \"x\"\r\ncameras.a.fps = 25\r\n",
                "cameras.a.time_offset_s = 0.5\r\ncameras.a.images = \"x\"\r\ncameras.a.fps = 25\r\n",
            ),
            (
                "[cameras]\n\t\"a\".\"images\" = \"x\"\n",
                "[cameras]\n\t\"a\".time_offset_s = 0.5\n\t\"a\".\"images\" = \"x\"\n",
            ),
        ] {
            assert_eq!(
                with_time_offsets(text, &[("a", 0.5)]).as_deref(),
                Some(wanted)
            );
        }
    }

    #[test]
    fn unsupported_layouts_are_not_edited() {
        // After the brace on the previous line, the new line would need a comma.
        let text = "cameras.a = {\n  images = \"x\",\n}\n";
        assert_eq!(with_time_offsets(text, &[("a", 0.5)]), None);
        assert_eq!(with_time_offsets("cameras = 3", &[("a", 0.5)]), None);
        assert_eq!(
            with_time_offsets("[cameras.a]\nfps = 1", &[("a", 0.5)]),
            None
        );
        assert_eq!(
            with_time_offsets("[cameras.b]\nimages = ''", &[("a", 0.5)]),
            None
        );
    }

    #[test]
    fn values_in_tables_are_replaced_and_are_no_longer_guesses() {
        let text = "guessed = [\n  \"cameras.a.model.pinhole.f_px\", # wide\n  \"targets.ball.x\"]\n\
                    [cameras.a]\nmcap = \"a.mcap\"\n[cameras.a.model.pinhole]\nf_px = [1.0, 2.0] # px\ncenter_px = [1, 2]\n";
        let setting = |key, value: Vec<f64>| CameraSetting {
            camera: "a",
            key,
            value: value.into(),
            is_guess: false,
        };
        let settings = [
            setting("model.pinhole.f_px", vec![3.0, 4.5]),
            setting("world", vec![1.0]),
        ];
        let wanted = "guessed = [\"targets.ball.x\"]\n\
                      [cameras.a]\nworld = [1.0]\nmcap = \"a.mcap\"\n[cameras.a.model.pinhole]\nf_px = [3.0, 4.5] # px\ncenter_px = [1, 2]\n";
        assert_eq!(
            with_camera_settings(text, &settings).as_deref(),
            Some(wanted)
        );
        // What remains a guess stays in the list.
        let guess = CameraSetting {
            is_guess: true,
            ..setting("model.pinhole.f_px", vec![3.0, 4.5])
        };
        let kept = text.replace("[1.0, 2.0]", "[3.0, 4.5]");
        assert_eq!(
            with_camera_settings(text, std::slice::from_ref(&guess)),
            Some(kept)
        );
        // With its mark.
        let marked = text.replace("[1.0, 2.0] # px", "[  # a guess\n  1.0,\n  2.0,\n]");
        let kept = text.replace("[1.0, 2.0] # px", "[3.0, 4.5]  # a guess");
        assert_eq!(with_camera_settings(&marked, &[guess]), Some(kept));
        // A table that is not there is not added.
        let missing = [setting("model.unified.f_px", vec![1.0])];
        assert_eq!(with_camera_settings(text, &missing), None);
    }
}
