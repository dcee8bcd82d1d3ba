//! Checks that relative links in Markdown pages lead to files, links to headings to headings, and that the files and tests that
//! [`NAMING_PAGES`] name exist.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};

/// The pages that name files and tests of the repository.
const NAMING_PAGES: [&str; 2] = ["ARCHITECTURE.md", "docs/faults.md"];

/// Runs the check on every page of the repository.
pub(crate) fn run(root: &Path) -> Result<()> {
    let mut broken = Vec::new();
    let pages = crate::files(root, "md")?;
    for page in &pages {
        let text = std::fs::read_to_string(page)?;
        for link in links(&text) {
            if let Some(reason) = reason_broken(page, &link) {
                let shown = page.strip_prefix(root)?.display();
                broken.push(format!("{shown}: ({link}): {reason}"));
            }
        }
    }
    broken.extend(missing_names(root)?);
    if !broken.is_empty() {
        bail!("links that lead nowhere:\n  {}", broken.join("\n  "));
    }
    println!("all links of {} pages lead somewhere", pages.len());
    Ok(())
}

/// Returns why a link of a page leads nowhere; `None` for links that do and for other sites.
fn reason_broken(page: &Path, link: &str) -> Option<String> {
    if link.contains("://") || link.starts_with("mailto:") {
        return None;
    }
    let (file, heading) = link.split_once('#').unwrap_or((link, ""));
    let target: PathBuf = if file.is_empty() {
        page.to_owned()
    } else {
        page.parent().unwrap_or(Path::new(".")).join(file)
    };
    if !target.exists() {
        return Some("there is no such file".to_owned());
    }
    if heading.is_empty() || target.extension().is_none_or(|e| e != "md") {
        return None;
    }
    let text = std::fs::read_to_string(&target).ok()?;
    (!anchors(&text).contains(heading)).then(|| "there is no such heading".to_owned())
}

/// Returns the paths `crates/...` and the tests that [`NAMING_PAGES`] name and that do not exist.
fn missing_names(root: &Path) -> Result<Vec<String>> {
    let mut sources = String::new();
    for file in crate::files(&root.join("crates"), "rs").unwrap_or_default() {
        sources.push_str(&std::fs::read_to_string(file)?);
    }
    let is_missing = |name: &&str| {
        let is_word = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
        // The names of tests are sentences.
        let is_test = is_word && name.matches('_').count() >= 4;
        let is_path = name.starts_with("crates/") && !name.contains(' ');
        is_test && !sources.contains(&format!("fn {name}(")) || is_path && !root.join(name).exists()
    };
    let mut missing = Vec::new();
    for page in NAMING_PAGES {
        let text = std::fs::read_to_string(root.join(page)).unwrap_or_default();
        let names = prose(&text).flat_map(|line| line.split('`').skip(1).step_by(2));
        missing.extend(
            names
                .filter(is_missing)
                .map(|name| format!("{page}: `{name}` does not exist")),
        );
    }
    Ok(missing)
}

/// Returns the lines of a page outside of code blocks.
fn prose(text: &str) -> impl Iterator<Item = &str> {
    let mut in_code = false;
    text.lines().filter(move |line| {
        let fence = line.trim_start().starts_with("```");
        in_code ^= fence;
        !in_code && !fence
    })
}

/// Returns the targets of all links `[text](target)`.
fn links(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    for line in prose(text) {
        let mut rest = line;
        while let Some((_, after)) = rest.split_once("](") {
            if let Some((target, _)) = after.split_once(')') {
                let target = target.split_whitespace().next().unwrap_or_default();
                found.push(target.trim_matches(['<', '>']).to_owned());
            }
            rest = after;
        }
    }
    found
}

/// Returns the anchors of a page's headings, as GitHub and mdBook make them.
fn anchors(text: &str) -> BTreeSet<String> {
    let mut anchors = BTreeSet::new();
    for line in prose(text) {
        let heading = line.trim_start_matches('#');
        if heading.len() == line.len() || !heading.starts_with(' ') {
            continue;
        }
        let keep = |c: char| c.is_alphanumeric() || c == ' ' || c == '-' || c == '_';
        let anchor: String = heading
            .trim()
            .to_lowercase()
            .chars()
            .filter(|&c| keep(c))
            .collect();
        anchors.insert(anchor.replace(' ', "-"));
    }
    anchors
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn broken_links_and_headings_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let page = folder.path().join("a.md");
        let text = "# One, two!\n[x](b.md) ![y](c.png) [z](#one-two)\n```\n[no](none.md)\n```\n[w](b.md#there) [v](https://a.b/c)";
        std::fs::write(&page, text).unwrap();
        std::fs::write(folder.path().join("b.md"), "## Here\n").unwrap();
        let broken: Vec<_> = links(text)
            .into_iter()
            .filter(|link| reason_broken(&page, link).is_some())
            .collect();
        assert_eq!(broken, ["c.png", "b.md#there"]);
        assert!(run(folder.path()).is_err());
        std::fs::write(folder.path().join("c.png"), "").unwrap();
        std::fs::write(folder.path().join("b.md"), "## There\n").unwrap();
        assert!(run(folder.path()).is_ok());

        let page = folder.path().join("ARCHITECTURE.md");
        let text = "`crates/a.rs`: `a_test_of_something_or_other` is not `a_word`";
        std::fs::write(page, text).unwrap();
        let missing = missing_names(folder.path()).unwrap();
        assert!(missing[0].contains("crates/a.rs") && missing[1].contains("something"));
        std::fs::create_dir(folder.path().join("crates")).unwrap();
        let source = "fn a_test_of_something_or_other() {}";
        std::fs::write(folder.path().join("crates/a.rs"), source).unwrap();
        assert_eq!(missing_names(folder.path()).unwrap(), [""; 0]);
    }
}
