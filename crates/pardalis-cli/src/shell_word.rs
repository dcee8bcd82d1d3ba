//! Paths in commands that are printed for pasting.

use std::path::Path;

use crate::output::in_line;

/// Formats a path as one word of a command, in quotes if a shell would take it apart.
pub(crate) fn shell_word(path: &Path) -> String {
    let text = path.to_string_lossy().into_owned();
    let is_plain = |c: char| c.is_alphanumeric() || "/\\:._-+,@%".contains(c);
    if !text.is_empty() && text.chars().all(is_plain) {
        text
    } else if cfg!(windows) {
        format!("\"{text}\"")
    } else if text.contains('\n') {
        // In one line, as Bash and others read it.
        let text = text.replace('\\', r"\\").replace('\'', r"\'");
        format!("$'{}'", in_line(&text))
    } else {
        format!("'{}'", text.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_that_a_shell_would_take_apart_are_quoted() {
        let word = |text: &str| shell_word(Path::new(text));
        assert_eq!(word("a/b-1_c.png"), "a/b-1_c.png");
        let quote = if cfg!(windows) { '"' } else { '\'' };
        assert_eq!(word("my ball.png"), format!("{quote}my ball.png{quote}"));
        if !cfg!(windows) {
            assert_eq!(word("it's $1.png"), r"'it'\''s $1.png'");
            assert_eq!(word("it's\n\\.png"), r"$'it\'s\n\\.png'");
        }
    }
}
