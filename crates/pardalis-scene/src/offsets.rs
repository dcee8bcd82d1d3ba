//! Insertion of time offsets into a scene's text, which is otherwise unchanged.

use std::ops::Range;

use toml::de::{DeTable, DeValue};

/// Returns the scene's text with `time_offset_s` of these cameras (name, seconds) replaced or added; `None` if the
/// layout of the text does not allow this without other changes.
pub fn with_time_offsets(text: &str, offsets_s: &[(&str, f64)]) -> Option<String> {
    let root = DeTable::parse(text).ok()?;
    let cameras = table(root.get_ref().get("cameras")?.get_ref())?;
    let mut edits: Vec<(Range<usize>, String)> = Vec::new();
    for (name, offset_s) in offsets_s {
        let camera = table(cameras.get(*name)?.get_ref())?;
        let edit = if let Some(given) = camera.get("time_offset_s") {
            (given.span(), format!("{offset_s:?}"))
        } else {
            let input = |key: &str| camera.get_key_value(key).map(|(key, _)| key.span());
            let key = input("images").or_else(|| input("video"))?;
            insertion(text, key.start, *offset_s)
        };
        edits.push(edit);
    }
    edits.sort_by_key(|(place, _)| place.start);
    let mut edited = text.to_owned();
    for (place, new) in edits.iter().rev() {
        edited.replace_range(place.clone(), new);
    }
    is_equivalent(text, &edited, offsets_s).then_some(edited)
}

fn table<'a, 't>(value: &'a DeValue<'t>) -> Option<&'a DeTable<'t>> {
    match value {
        DeValue::Table(table) => Some(table),
        _ => None,
    }
}

/// Returns the insertion of an offset before the key that begins here, in the same table: as the previous line, or
/// before the key in a table in braces.
fn insertion(text: &str, key_start: usize, offset_s: f64) -> (Range<usize>, String) {
    let line_start = text[..key_start].rfind('\n').map_or(0, |at| at + 1);
    let before = &text[line_start..key_start];
    let setting = format!("time_offset_s = {offset_s:?}");
    if before.contains('{') {
        return (key_start..key_start, format!("{setting}, "));
    }
    let line_end = if text.contains("\r\n") { "\r\n" } else { "\n" };
    (
        line_start..line_start,
        format!("{before}{setting}{line_end}"),
    )
}

/// Reports whether the edited text has the settings of the original text and these offsets.
fn is_equivalent(text: &str, edited: &str, offsets_s: &[(&str, f64)]) -> bool {
    let (Ok(mut wanted), Ok(edited)) = (text.parse::<toml::Table>(), edited.parse::<toml::Table>())
    else {
        return false;
    };
    for (name, offset_s) in offsets_s {
        let camera = wanted
            .get_mut("cameras")
            .and_then(|cameras| cameras.get_mut(*name))
            .and_then(toml::Value::as_table_mut);
        if let Some(camera) = camera {
            camera.insert("time_offset_s".to_owned(), (*offset_s).into());
        }
    }
    wanted == edited
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
