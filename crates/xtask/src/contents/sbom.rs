//! The software bill of materials, in CycloneDX 1.6: <https://cyclonedx.org/docs/1.6/json/>.

use serde_json::{Value, json};

use super::packages::Package;

/// Returns it as JSON, with the libraries of web pages as names and versions. It has no time and no serial number, so that the same build has the same list.
pub(crate) fn of(packages: &[Package], web: &[(String, String)], rust_version: &str) -> String {
    let (program, libraries) = packages.split_first().expect("the program is the first");
    let mut components: Vec<Value> = libraries.iter().map(|p| component(p, "library")).collect();
    components.push(json!({
        "type": "library",
        "bom-ref": RUST,
        "name": "rust-std",
        "version": rust_version,
        "description": "The standard library of Rust, with compiler-builtins and libunwind",
        "licenses": [{ "expression": "(MIT OR Apache-2.0) AND Apache-2.0 WITH LLVM-exception" }],
        "externalReferences": [{ "type": "vcs", "url": "https://github.com/rust-lang/rust" }],
    }));
    components.push(json!({
        "type": "library",
        "bom-ref": MUSL,
        "name": "musl",
        "description": "The C library that comes with the standard library of Rust",
        "licenses": [{ "license": { "id": "MIT" } }],
        "externalReferences": [{ "type": "website", "url": "https://musl.libc.org/" }],
    }));
    components.extend(web.iter().map(|(name, version)| {
        json!({
            "type": "library",
            "bom-ref": format!("pkg:npm/{name}@{version}"),
            "name": name,
            "version": version,
            "purl": format!("pkg:npm/{name}@{version}"),
            "description": "Part of the pages that show tracks",
            "licenses": [{ "license": { "id": "MIT" } }],
        })
    }));
    let mut dependencies: Vec<Value> = packages
        .iter()
        .map(|package| {
            let used = package.dependencies.iter().map(|&i| purl(&packages[i]));
            json!({ "ref": purl(package), "dependsOn": used.chain([RUST.to_owned()]).collect::<Vec<_>>() })
        })
        .collect();
    dependencies.push(json!({ "ref": RUST, "dependsOn": [MUSL] }));
    dependencies.push(json!({ "ref": MUSL, "dependsOn": [] }));
    let sbom = json!({
        "$schema": "http://cyclonedx.org/schema/bom-1.6.schema.json",
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {
            "lifecycles": [{ "phase": "build" }],
            "component": component(program, "application"),
        },
        "components": components,
        "dependencies": dependencies,
    });
    format!("{sbom:#}\n")
}

const RUST: &str = "rust-std";
const MUSL: &str = "musl";

fn component(package: &Package, kind: &str) -> Value {
    let mut component = json!({
        "type": kind,
        "bom-ref": purl(package),
        "name": package.name,
        "version": package.version,
        "purl": purl(package),
        "licenses": [{ "expression": package.license }],
    });
    if let Some(checksum) = &package.checksum {
        component["hashes"] = json!([{ "alg": "SHA-256", "content": checksum }]);
    }
    if let Some(repository) = &package.repository {
        component["externalReferences"] = json!([{ "type": "vcs", "url": repository }]);
    }
    component
}

/// Returns the package URL, which also identifies a package within the list.
fn purl(package: &Package) -> String {
    format!("pkg:cargo/{}@{}", package.name, package.version)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    /// The fields that the specification requires, and references that lead somewhere, for the real program.
    #[test]
    fn the_list_of_the_program_is_valid_and_complete() {
        let packages =
            super::super::packages::in_the_program(&crate::root(), "x86_64-unknown-linux-musl");
        let web = super::super::packages::of_web_pages(&crate::root()).unwrap();
        let sbom: Value = serde_json::from_str(&of(&packages.unwrap(), &web, "1.95.0")).unwrap();
        assert_eq!(sbom["bomFormat"], "CycloneDX");
        assert_eq!(sbom["specVersion"], "1.6");
        assert_eq!(sbom["metadata"]["component"]["name"], "pardalis-cli");
        let components = sbom["components"].as_array().unwrap();
        let all = components.iter().chain([&sbom["metadata"]["component"]]);
        let mut references = BTreeSet::new();
        for component in all {
            let name = component["name"].as_str().unwrap();
            assert!(component["type"].is_string(), "{name}");
            assert!(component["licenses"][0].is_object(), "{name}");
            assert!(
                references.insert(component["bom-ref"].as_str().unwrap()),
                "{name} twice"
            );
            let is_web = web.iter().any(|(of_web, _)| of_web == name);
            let is_ours = name.starts_with("pardalis") || [RUST, MUSL].contains(&name) || is_web;
            let checksum = component["hashes"][0]["content"].as_str();
            assert!(
                is_ours || checksum.is_some_and(|sum| sum.len() == 64),
                "{name}"
            );
        }
        for dependency in sbom["dependencies"].as_array().unwrap() {
            assert!(references.contains(dependency["ref"].as_str().unwrap()));
            for used in dependency["dependsOn"].as_array().unwrap() {
                assert!(references.contains(used.as_str().unwrap()), "{used}");
            }
        }
        let names: BTreeSet<_> = components
            .iter()
            .map(|c| c["name"].as_str().unwrap())
            .collect();
        for (name, is_shipped) in [
            ("nalgebra", true),
            ("pardalis-filter", true),
            ("three", true),
            ("uplot", true),
            ("esbuild", false),
            ("serde_derive", false),
            ("proptest", false),
        ] {
            assert_eq!(names.contains(name), is_shipped, "{name}");
        }
    }
}
