//! Sources of examples in Markdown pages, so that no page shows code that does not compile.
//!
//! A page marks the place of a file with the lines `<!-- example PATH -->` and `<!-- end example -->`; PATH is relative to the root.
//! `<!-- main of PATH -->` stands for the file up to the end of its first function.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail};

const END: &str = "<!-- end example -->";

/// Puts the examples into all pages; with `check`, fails if any is out of date instead.
pub(crate) fn run(root: &Path, check: bool) -> Result<()> {
    for page in crate::files(root, "md")? {
        let text = fs::read_to_string(&page)?;
        let spliced = splice(&text, |path| {
            let source = fs::read_to_string(root.join(path));
            source.with_context(|| format!("example {path}"))
        });
        let spliced = spliced.with_context(|| page.display().to_string())?;
        if spliced != text {
            if check {
                bail!(
                    "{}: an example is not what its file says; run `cargo xtask tables`",
                    page.display()
                );
            }
            fs::write(&page, spliced)?;
        }
    }
    Ok(())
}

/// Returns the text with each marked place holding the source of its file.
fn splice(text: &str, source: impl Fn(&str) -> Result<String>) -> Result<String> {
    let mut spliced = String::new();
    let mut rest = text;
    while let Some((line, after)) = rest.split_once('\n') {
        spliced.push_str(line);
        spliced.push('\n');
        rest = after;
        let mark = line.strip_prefix("<!-- ");
        let mark = mark.and_then(|mark| mark.strip_suffix(" -->"));
        let whole = mark.and_then(|mark| mark.strip_prefix("example "));
        let main = mark.and_then(|mark| mark.strip_prefix("main of "));
        if let Some(path) = whole.or(main) {
            let end = after
                .find(END)
                .ok_or_else(|| anyhow!("example {path} has no line {END}"))?;
            let source = source(path)?;
            let shown = match source.split_once("\n}\n") {
                Some((function, _)) if main.is_some() => format!("{function}\n}}\n"),
                _ => source,
            };
            let _ = write!(spliced, "\n```rust\n{shown}```\n\n");
            rest = &after[end..];
        }
    }
    spliced.push_str(rest);
    Ok(spliced)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn examples_are_put_between_their_marks() {
        let source = |path: &str| Ok(format!("// {path}\n"));
        let page = "a\n<!-- example x.rs -->\nold\n<!-- end example -->\nb\n";
        let spliced = splice(page, source).unwrap();
        let expected =
            "a\n<!-- example x.rs -->\n\n```rust\n// x.rs\n```\n\n<!-- end example -->\nb\n";
        assert_eq!(spliced, expected);
        assert_eq!(splice(&spliced, source).unwrap(), spliced);
        assert!(splice("<!-- example x.rs -->\n", source).is_err());
        let source = |_: &str| Ok("fn main() {\n    a();\n}\n\nfn a() {}\n".to_owned());
        let main = splice("<!-- main of x.rs -->\n<!-- end example -->\n", source).unwrap();
        assert!(
            main.contains("```rust\nfn main() {\n    a();\n}\n```\n"),
            "{main}"
        );
    }
}
