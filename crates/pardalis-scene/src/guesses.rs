//! The list of the values that are guesses.

use super::reader::Table;

/// Returns the keys of values that are guesses, and warns of them. Every key must be given in the text.
pub(super) fn read_guesses(root: &Table) -> Vec<String> {
    let about = "Full keys of values that are guesses, such as `targets.ball.shape.sphere.radius_m`. The program warns of them.";
    let keys: Vec<String> = root.key("guessed", about).or(Vec::new());
    let mut named = Vec::new();
    for key in &keys {
        match root.given(key) {
            // Replaced by the caller.
            Some(0) => {}
            Some(line) => {
                let name = key.rsplit('.').next().unwrap_or_default();
                named.push(format!("{name} (line {line})"));
            }
            None => root.problem(
                "guessed",
                format!("names {key}, which is not given in this scene; remove it from the list, or correct it"),
            ),
        }
    }
    if !named.is_empty() {
        let message = format!(
            "positions are only as right as these guesses: {}. Replace each and remove it from this list",
            named.join(", ")
        );
        root.warn("guessed", message);
    }
    keys
}
