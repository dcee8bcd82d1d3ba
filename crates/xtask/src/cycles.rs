//! Checks that modules do not import each other in a circle.
//!
//! Modules that share a parent must form a hierarchy: where `a` uses anything of `b`, nothing below `b` may use `a`. A name that the parent
//! re-exports (`pub use b::Name`) counts as use of `b`. A module may use its ancestors, and its tests anything.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::{Result, bail};

/// A module by its names from the crate's root.
type Module = Vec<String>;

/// The modules of one crate with their sources.
struct Modules {
    texts: BTreeMap<Module, String>,
    /// For each module, the names that it re-exports or imports from its children, and the child.
    re_exports: BTreeMap<Module, BTreeMap<String, String>>,
}

/// Runs the check on every crate.
pub(crate) fn run(root: &Path) -> Result<()> {
    let mut circles = Vec::new();
    for entry in std::fs::read_dir(root.join("crates"))? {
        let folder = entry?.path();
        let modules = Modules::read(&folder.join("src"))?;
        let name = folder.file_name().unwrap_or_default().to_string_lossy();
        circles.extend(
            modules
                .circles()
                .iter()
                .map(|circle| format!("{name}: {}", circle.join(" -> "))),
        );
    }
    if !circles.is_empty() {
        circles.sort();
        bail!(
            "modules that import each other in a circle:\n  {}\nmove what both need into a module below them",
            circles.join("\n  ")
        );
    }
    println!("no circles between modules");
    Ok(())
}

impl Modules {
    fn read(src: &Path) -> Result<Self> {
        let mut texts = BTreeMap::new();
        for path in crate::files(src, "rs")? {
            if path.to_string_lossy().ends_with("tests.rs") {
                continue;
            }
            let inside = path.strip_prefix(src)?.with_extension("");
            let mut module: Module = inside
                .iter()
                .map(|part| part.to_string_lossy().into_owned())
                .collect();
            if matches!(
                module.last().map(String::as_str),
                Some("mod" | "lib" | "main")
            ) {
                module.pop();
            }
            texts.insert(module, code(&std::fs::read_to_string(&path)?));
        }
        let mut modules = Self {
            texts,
            re_exports: BTreeMap::new(),
        };
        for (module, text) in &modules.texts {
            let mut names = BTreeMap::new();
            for path in paths(text) {
                let path = path.strip_prefix(&["self".to_owned()]).unwrap_or(&path);
                if let [child, .., name] = path
                    && modules.has(module, child)
                {
                    names.insert(name.clone(), child.clone());
                }
            }
            modules.re_exports.insert(module.clone(), names);
        }
        Ok(modules)
    }

    fn has(&self, parent: &Module, child: &str) -> bool {
        let mut module = parent.clone();
        module.push(child.to_owned());
        self.texts.contains_key(&module)
    }

    /// Returns the deepest module that a path written in `from` leads to.
    fn resolve(&self, from: &Module, path: &[String]) -> Option<Module> {
        let mut rest = path;
        let mut module = match rest.first()?.as_str() {
            "crate" => Module::new(),
            "self" | "super" => from.clone(),
            first if self.has(from, first) => from.clone(),
            _ => return None,
        };
        while let [first, after @ ..] = rest {
            match first.as_str() {
                "crate" | "self" => {}
                "super" => {
                    module.pop();
                }
                name if self.has(&module, name) => module.push(name.to_owned()),
                name => {
                    if let Some(child) = self.re_exports.get(&module).and_then(|n| n.get(name)) {
                        module.push(child.clone());
                    }
                    break;
                }
            }
            rest = after;
        }
        Some(module)
    }

    /// Returns each circle among the children of one parent once, as names of modules, the first again at the end.
    fn circles(&self) -> Vec<Vec<String>> {
        // For each parent, its children and which of them they use.
        let mut uses: BTreeMap<Module, BTreeMap<String, BTreeSet<String>>> = BTreeMap::new();
        for (from, text) in &self.texts {
            for path in paths(text) {
                let Some(to) = self.resolve(from, &path) else {
                    continue;
                };
                let shared = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
                if let (Some(user), Some(used)) = (from.get(shared), to.get(shared)) {
                    let of_parent = uses.entry(from[..shared].to_vec()).or_default();
                    of_parent
                        .entry(user.clone())
                        .or_default()
                        .insert(used.clone());
                }
            }
        }
        let mut circles = Vec::new();
        for (parent, uses) in &uses {
            for start in uses.keys() {
                // The shortest way back to the start through modules that come after it in order, so that each circle is found once.
                let mut ways = vec![vec![start.clone()]];
                let mut seen = BTreeSet::new();
                while !ways.is_empty() {
                    let mut longer = Vec::new();
                    for way in &ways {
                        for next in uses.get(&way[way.len() - 1]).into_iter().flatten() {
                            if next == start {
                                let names = way.iter().chain([start]);
                                let prefix = parent.iter().cloned();
                                let full = |name: &String| {
                                    prefix
                                        .clone()
                                        .chain([name.clone()])
                                        .collect::<Vec<_>>()
                                        .join("::")
                                };
                                circles.push(names.map(full).collect());
                            } else if next > start && seen.insert(next.clone()) {
                                longer.push([way.as_slice(), std::slice::from_ref(next)].concat());
                            }
                        }
                    }
                    ways = longer;
                }
            }
        }
        circles
    }
}

/// Drops line comments, so that links in documentation are no imports, and the tests at a file's end.
fn code(text: &str) -> String {
    let text = text
        .split("#[cfg(test)]\nmod tests {")
        .next()
        .unwrap_or(text);
    let code = |line: &&str| !line.trim_start().starts_with("//");
    text.lines().filter(code).collect::<Vec<_>>().join("\n")
}

/// Returns every path `a::b::c` in a text, with groups `a::{b, c::d}` multiplied out.
fn paths(text: &str) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    let bytes = text.as_bytes();
    let is_word = |c: u8| c.is_ascii_alphanumeric() || c == b'_';
    let mut at = 0;
    while at < bytes.len() {
        let begins = is_word(bytes[at])
            && (at == 0 || !is_word(bytes[at - 1]))
            && (at < 2 || &bytes[at - 2..at] != b"::");
        if begins {
            at = read_path(bytes, at, &mut Vec::new(), &mut found);
        } else {
            at += 1;
        }
    }
    found
}

/// Reads a path from `at` on, behind what was read of it before; returns where it ends.
fn read_path(
    bytes: &[u8],
    mut at: usize,
    path: &mut Vec<String>,
    found: &mut Vec<Vec<String>>,
) -> usize {
    let is_word = |c: &u8| c.is_ascii_alphanumeric() || *c == b'_';
    let depth = path.len();
    loop {
        let length = bytes[at..].iter().take_while(|c| is_word(c)).count();
        path.push(String::from_utf8_lossy(&bytes[at..at + length]).into_owned());
        at += length;
        if !bytes[at..].starts_with(b"::") {
            break;
        }
        at += 2;
        if bytes.get(at) == Some(&b'{') {
            at += 1;
            while at < bytes.len() && bytes[at] != b'}' {
                if is_word(&bytes[at]) {
                    at = read_path(bytes, at, path, found);
                } else {
                    at += 1;
                }
            }
            path.truncate(depth);
            return at + 1;
        }
        if !bytes.get(at).is_some_and(is_word) {
            break;
        }
    }
    if path.len() > 1 {
        found.push(path.clone());
    }
    path.truncate(depth);
    at
}

#[cfg(test)]
mod tests {
    use super::*;

    fn circles(files: &[(&str, &str)]) -> Vec<String> {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in files {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        }
        let circles = Modules::read(folder.path()).unwrap().circles();
        circles.iter().map(|circle| circle.join(" ")).collect()
    }

    #[test]
    fn siblings_in_a_circle_are_found_and_hierarchies_are_not() {
        let files = [
            ("lib.rs", "mod a; mod b; pub use b::Thing;"),
            (
                "a.rs",
                "use crate::b::{self, inner::Deep};\n// crate::c::No",
            ),
            ("b/mod.rs", "mod inner;\nuse super::Error;"),
            ("b/inner.rs", "use super::Up;"),
        ];
        assert!(circles(&files).is_empty());
        let mut back = files.to_vec();
        back[3].1 = "fn f() { crate::a::g() }";
        assert_eq!(circles(&back), ["a b a"]);
        // Through a name that the parent re-exports.
        let hidden = [
            (
                "lib.rs",
                "mod a; mod b; pub use a::First; pub use b::Second;",
            ),
            ("a.rs", "use crate::Second;"),
            ("b.rs", "use super::First;"),
        ];
        assert_eq!(circles(&hidden), ["a b a"]);
    }

    #[test]
    fn longer_circles_are_found_once() {
        let files = [
            ("lib.rs", ""),
            ("a.rs", "use crate::c::C;"),
            ("b.rs", "use crate::a::A;"),
            ("c.rs", "use crate::b::B;"),
        ];
        assert_eq!(circles(&files), ["a c b a"]);
    }
}
