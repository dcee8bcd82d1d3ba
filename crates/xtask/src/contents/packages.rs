//! The packages of which code is in the program: no tools of the build, no dependencies of tests.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};
use serde::Deserialize;

/// A package of which code is in the program.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Package {
    pub(crate) name: String,
    pub(crate) version: String,
    /// An SPDX expression.
    pub(crate) license: String,
    pub(crate) repository: Option<String>,
    /// The folder of its source code.
    pub(crate) folder: PathBuf,
    /// SHA-256 of its archive in the registry; none for the packages of this workspace.
    pub(crate) checksum: Option<String>,
    /// The packages that it uses directly, as indices.
    pub(crate) dependencies: Vec<usize>,
}

/// Name and version.
type Id = (String, String);

/// Returns the packages of the program for a target, the program itself first, the others by name.
pub(crate) fn in_the_program(root: &Path, target: &str) -> Result<Vec<Package>> {
    let cargo = |arguments: &[&str]| {
        output(
            Command::new(env!("CARGO"))
                .args(arguments)
                .current_dir(root),
        )
    };
    // The list of metadata alone would have what only tests and tools of the build use.
    let tree = cargo(&[
        "tree",
        "--locked",
        "--package",
        "pardalis-cli",
        "--edges",
        "normal,no-proc-macro",
        "--target",
        target,
        "--prefix",
        "depth",
        "--format",
        " {p}",
    ])?;
    let metadata = cargo(&[
        "metadata",
        "--locked",
        "--format-version",
        "1",
        "--filter-platform",
        target,
    ])?;
    let metadata: Metadata = serde_json::from_str(&metadata).context("cargo metadata")?;
    let lock: Lock = toml::from_str(&std::fs::read_to_string(root.join("Cargo.lock"))?)?;

    let edges = edges(&tree).with_context(|| format!("cargo tree printed\n{tree}"))?;
    let program = edges
        .first()
        .context("cargo tree printed nothing")?
        .0
        .clone();
    let mut uses: BTreeMap<Id, Vec<Id>> = BTreeMap::new();
    for (id, user) in edges {
        uses.entry(id.clone()).or_default();
        if let Some(user) = user {
            uses.entry(user).or_default().push(id);
        }
    }
    let mut order: Vec<Id> = uses.keys().cloned().collect();
    order.sort_by_key(|id| *id != program);
    let index = |id: &Id| order.iter().position(|other| other == id);
    order
        .iter()
        .map(|id| {
            let (name, version) = id.clone();
            let about = metadata
                .packages
                .iter()
                .find(|p| p.name == name && p.version == version);
            let about =
                about.with_context(|| format!("cargo metadata does not know {name} {version}"))?;
            let locked = lock
                .package
                .iter()
                .find(|p| p.name == name && p.version == version);
            let mut dependencies: Vec<usize> = uses[id].iter().filter_map(index).collect();
            dependencies.sort_unstable();
            dependencies.dedup();
            Ok(Package {
                license: about
                    .license
                    .clone()
                    .with_context(|| format!("{name} states no licence"))?
                    .replace('/', " OR "),
                repository: about.repository.clone(),
                folder: about
                    .manifest_path
                    .parent()
                    .context("a manifest is in a folder")?
                    .to_owned(),
                checksum: locked.and_then(|p| p.checksum.clone()),
                dependencies,
                name,
                version,
            })
        })
        .collect()
}

/// Returns name and version of each library of others in the pages of `pardalis-viewer`.
pub(crate) fn of_web_pages(root: &Path) -> Result<Vec<(String, String)>> {
    let path = root.join("crates/pardalis-viewer/vendor/package.json");
    let text = std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
    let pinned: Pinned = serde_json::from_str(&text)?;
    Ok(pinned.dependencies.into_iter().collect())
}

/// Returns each package of a tree with the package that uses it, from lines such as `1 anyhow v1.0.103 (*)`.
fn edges(tree: &str) -> Option<Vec<(Id, Option<Id>)>> {
    let mut edges = Vec::new();
    // The package of this line, its user, and so on upwards, last to first.
    let mut users: Vec<Id> = Vec::new();
    for line in tree.lines() {
        let mut words = line.split(' ');
        let depth: usize = words.next()?.parse().ok()?;
        let id = (
            words.next()?.to_owned(),
            words.next()?.strip_prefix('v')?.to_owned(),
        );
        users.truncate(depth);
        edges.push((id.clone(), users.last().cloned()));
        users.push(id);
    }
    Some(edges)
}

/// Returns what a command prints, as text.
pub(crate) fn output(command: &mut Command) -> Result<String> {
    let output = command.output().with_context(|| format!("{command:?}"))?;
    let complaint = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "{command:?}: {complaint}");
    Ok(String::from_utf8(output.stdout)?)
}

#[derive(Deserialize)]
struct Metadata {
    packages: Vec<About>,
}

#[derive(Deserialize)]
struct About {
    name: String,
    version: String,
    license: Option<String>,
    repository: Option<String>,
    manifest_path: PathBuf,
}

#[derive(Deserialize)]
struct Pinned {
    dependencies: BTreeMap<String, String>,
}

#[derive(Deserialize)]
struct Lock {
    package: Vec<Locked>,
}

#[derive(Deserialize)]
struct Locked {
    name: String,
    version: String,
    checksum: Option<String>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn users_of_packages_follow_from_the_depth_of_lines() {
        let tree = "0 a v1.0.0 (/somewhere)\n1 b v2.0.0\n2 c v3.0.0\n1 c v3.0.0 (*)\n";
        let id = |name: &str, version: &str| (name.to_owned(), version.to_owned());
        let (a, b, c) = (id("a", "1.0.0"), id("b", "2.0.0"), id("c", "3.0.0"));
        let expected = vec![
            (a.clone(), None),
            (b.clone(), Some(a.clone())),
            (c.clone(), Some(b)),
            (c, Some(a)),
        ];
        assert_eq!(edges(tree), Some(expected));
    }
}
