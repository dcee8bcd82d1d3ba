//! The licences and copyright notices of others that must accompany the program.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

use super::packages::Package;

/// What is in the program but no package, with the file of its licence below the root.
const OTHER: [(&str, &str); 4] = [
    ("musl, the C library", "crates/xtask/src/contents/musl.txt"),
    (
        "DejaVu Sans, the font of plots",
        "crates/pardalis-cli/assets/DejaVuSans-LICENSE.txt",
    ),
    (
        "three.js, of pages that show tracks",
        "crates/pardalis-viewer/web/vendor/three.LICENSE",
    ),
    (
        "uPlot, of pages that show tracks",
        "crates/pardalis-viewer/web/vendor/uPlot.LICENSE",
    ),
];

/// A package whose archive lacks the text of its licence.
const WITHOUT_TEXT: [(&str, &str); 1] = [(
    "chess-corners-core",
    "crates/xtask/src/contents/chess-corners-core.txt",
)];

/// What is said first. The licence of the encoder of JPEG images demands the last sentence.
const INTRODUCTION: &str = "\
The program contains code and data of others under the following licences.
Where several are joined by OR, any one of them applies. The licences of
Rust's standard library are in RUST-LICENSES.html.

This software is based in part on the work of the Independent JPEG Group.
";

/// How the names of files and folders with licences begin, in lower case.
const NAMES: [&str; 7] = [
    "license",
    ".license",
    "licence",
    "unlicense",
    "copying",
    "copyright",
    "notice",
];

/// Returns all of them as one text, in which each licence occurs once, after what it applies to.
pub(crate) fn of(root: &Path, packages: &[Package]) -> Result<String> {
    let mut users: BTreeMap<String, Vec<String>> = BTreeMap::new();
    let mut add = |path: &Path, user: String| -> Result<()> {
        let text = fs::read_to_string(path).with_context(|| path.display().to_string())?;
        // Line ends and margins differ among copies of the same licence.
        let lines: Vec<&str> = text.lines().map(str::trim_end).collect();
        users
            .entry(lines.join("\n").trim_matches('\n').to_owned())
            .or_default()
            .push(user);
        Ok(())
    };
    for (what, path) in OTHER {
        add(&root.join(path), what.to_owned())?;
    }
    // Those of this workspace have the licence of the program.
    for package in packages.iter().filter(|p| p.checksum.is_some()) {
        let mut files = license_files(&package.folder)?;
        files.extend(
            WITHOUT_TEXT
                .iter()
                .filter(|(name, _)| *name == package.name)
                .map(|(_, path)| root.join(path)),
        );
        if files.is_empty() {
            bail!(
                "{}: {} {} has no file with the text of its licence; add one to WITHOUT_TEXT",
                package.folder.display(),
                package.name,
                package.version
            );
        }
        for file in files {
            add(
                &file,
                format!("{} {} ({})", package.name, package.version, package.license),
            )?;
        }
    }

    let mut parts: Vec<(String, String)> = users
        .into_iter()
        .map(|(text, mut users)| {
            users.dedup();
            (users.join("\n"), text)
        })
        .collect();
    parts.sort();
    let mut all = INTRODUCTION.to_owned();
    for (users, text) in parts {
        let _ = write!(
            all,
            "\n{}\n{users}\n{}\n\n{text}\n",
            "=".repeat(80),
            "-".repeat(80)
        );
    }
    Ok(all)
}

/// Returns the files with licences of a package, sorted: in its folder, and in folders that are named after them.
fn license_files(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).with_context(|| folder.display().to_string())? {
        let path = entry?.path();
        let name = path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .to_lowercase();
        if !NAMES.iter().any(|start| name.starts_with(start)) {
            continue;
        }
        if path.is_dir() {
            for entry in fs::read_dir(&path)? {
                found.push(entry?.path());
            }
        } else {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// Returns the file with the licences of Rust's standard library, which comes with the compiler.
pub(crate) fn of_rust() -> Result<PathBuf> {
    let file = Path::new(super::rustc("--print sysroot")?.trim())
        .join("share/doc/rust/COPYRIGHT-library.html");
    if !file.is_file() {
        bail!(
            "{}: missing; install the compiler by rustup",
            file.display()
        );
    }
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_notices_of_the_program_name_every_package_and_hold_each_licence_once() {
        let root = crate::root();
        let packages =
            super::super::packages::in_the_program(&root, "x86_64-unknown-linux-musl").unwrap();
        let text = of(&root, &packages).unwrap();
        for package in packages.iter().filter(|p| p.checksum.is_some()) {
            let title = format!("{} {} (", package.name, package.version);
            assert!(text.contains(&title), "{title}");
        }
        for holder in [
            "Rich Felker",
            "Bitstream",
            "Independent JPEG Group",
            "Chen Yuheng",
            "three.js authors",
            "Leon Sorokin",
        ] {
            assert!(text.contains(holder), "{holder}");
        }
        let apache = "TERMS AND CONDITIONS FOR USE, REPRODUCTION, AND DISTRIBUTION";
        let copies = text.matches(apache).count();
        assert!(copies < packages.len() / 4, "{copies} copies");
    }
}
