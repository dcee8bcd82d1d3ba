//! Names and passwords in addresses, such as of network cameras, which pages must not show: they are made to be shared.

use serde_json::Value;

/// Takes names and passwords out of all addresses in texts.
pub(super) fn remove(value: &mut Value) {
    match value {
        Value::String(text) => *text = without(text),
        Value::Array(values) => values.iter_mut().for_each(remove),
        Value::Object(map) => map.values_mut().for_each(remove),
        _ => {}
    }
}

/// Returns a text in which `scheme://name:password@host` is `scheme://***@host`.
fn without(text: &str) -> String {
    let mut parts = text.split("://");
    let mut clean = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        clean += "://";
        // The authority ends at the path, the query or the text around it; a password may hold an @.
        let end = part.find(|c: char| "/?#\"'<>".contains(c) || c.is_whitespace());
        let (authority, rest) = part.split_at(end.unwrap_or(part.len()));
        match authority.rsplit_once('@') {
            Some((_, host)) => clean += &["***@", host, rest].concat(),
            None => clean += part,
        }
    }
    clean
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn addresses_lose_names_and_passwords_and_nothing_else() {
        let mut value = json!({
            "video": "rtsp://user:p@ss@192.168.0.64:554/stream1",
            "list": ["rtsp://camera/a@b", "mail@example", 1, null],
            "error": "rtsp://a:b@x/1 and http://c@y: no answer",
        });
        remove(&mut value);
        let expected = json!({
            "video": "rtsp://***@192.168.0.64:554/stream1",
            "list": ["rtsp://camera/a@b", "mail@example", 1, null],
            "error": "rtsp://***@x/1 and http://***@y: no answer",
        });
        assert_eq!(value, expected);
    }
}
