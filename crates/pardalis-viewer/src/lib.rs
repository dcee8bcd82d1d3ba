//! A web page that shows tracks: in 3D, over time, in numbers and with images. Plain ES modules without a build step.
//!
//! [`page`] returns one self-contained file; [`ASSETS`] and [`import_map`] are for servers with live data. The interface of the modules, with
//! the form of the data, is described at the top of `web/viewer.js`.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

/// A file of the viewer.
#[derive(Debug, Clone, Copy)]
pub struct Asset {
    /// Its path relative to where a server puts the viewer.
    pub path: &'static str,
    /// Its media type.
    pub content_type: &'static str,
    /// Its contents.
    pub bytes: &'static [u8],
    /// By which name modules import it, if it is one.
    specifier: Option<&'static str>,
}

const fn module(path: &'static str, specifier: &'static str, bytes: &'static [u8]) -> Asset {
    Asset {
        path,
        content_type: "text/javascript; charset=utf-8",
        bytes,
        specifier: Some(specifier),
    }
}

const fn style(path: &'static str, bytes: &'static [u8]) -> Asset {
    Asset {
        path,
        content_type: "text/css; charset=utf-8",
        bytes,
        specifier: None,
    }
}

/// Modules of our own, imported as `pardalis/NAME`.
macro_rules! own {
    ($name:literal) => {
        module(
            $name,
            concat!("pardalis/", $name),
            include_bytes!(concat!("../web/", $name)),
        )
    };
}

/// All files of the viewer: its modules, those of others under `vendor/`, and the style sheets.
pub const ASSETS: &[Asset] = &[
    own!("body.js"),
    own!("cameras.js"),
    own!("colors.js"),
    own!("comparison.js"),
    own!("dom.js"),
    own!("ellipsoid.js"),
    own!("extent.js"),
    own!("format.js"),
    own!("ground.js"),
    own!("page.js"),
    own!("pictures.js"),
    own!("plots.js"),
    own!("shapes.js"),
    own!("stage.js"),
    own!("strip.js"),
    own!("summary.js"),
    own!("timeline.js"),
    own!("tracks.js"),
    own!("trail.js"),
    own!("values.js"),
    own!("viewer.js"),
    module(
        "vendor/three.js",
        "three",
        include_bytes!("../web/vendor/three.js"),
    ),
    module(
        "vendor/uPlot.js",
        "uplot",
        include_bytes!("../web/vendor/uPlot.js"),
    ),
    style(
        "vendor/uPlot.css",
        include_bytes!("../web/vendor/uPlot.css"),
    ),
    style("viewer.css", include_bytes!("../web/viewer.css")),
];

/// The licences of what [`ASSETS`] contains of others, each with the name of the library. They must accompany copies.
pub const LICENSES: &[(&str, &str)] = &[
    ("three.js", include_str!("../web/vendor/three.LICENSE")),
    ("uPlot", include_str!("../web/vendor/uPlot.LICENSE")),
];

/// Returns the import map with which a page finds the modules, as JSON for `<script type="importmap">`.
///
/// `folder` is the address under which a server has the files, such as `/viewer/`.
pub fn import_map(folder: &str) -> String {
    import_map_of(|asset| format!("{folder}{}", asset.path))
}

fn import_map_of(address: impl Fn(&Asset) -> String) -> String {
    let mut text = String::from("{\"imports\": {");
    let modules = ASSETS
        .iter()
        .filter_map(|asset| Some((asset.specifier?, asset)));
    for (number, (specifier, asset)) in modules.enumerate() {
        let separator = if number > 0 { ", " } else { "" };
        let _ = write!(text, "{separator}\"{specifier}\": \"{}\"", address(asset));
    }
    text + "}}"
}

/// Returns bytes as an address that contains them, such as of an image.
pub fn data_address(content_type: &str, bytes: &[u8]) -> String {
    format!("data:{content_type};base64,{}", STANDARD.encode(bytes))
}

/// Returns the self-contained page. It loads nothing from elsewhere, and opens without a server.
///
/// `data_json` is an object with `scene` and `tracks`, as at the top of `web/viewer.js`, and optionally `summary` (the contents of `summary.json`) and
/// `notes` (texts about the page). Whatever texts it and `title` contain, they stay texts.
pub fn page(data_json: &str, title: &str) -> String {
    let template = include_str!("../web/page.html");
    let imports = import_map_of(|asset| data_address("text/javascript", asset.bytes));
    let sheets = ASSETS
        .iter()
        .filter(|asset| asset.specifier.is_none())
        .map(|asset| String::from_utf8_lossy(asset.bytes));
    let sheets: String = sheets.collect();
    let mut page = String::with_capacity(data_json.len() + imports.len() + (1 << 16));
    // One pass: what is inserted may contain names of places.
    for part in template.split("{{") {
        match part.split_once("}}") {
            None => page += part,
            Some((place, rest)) => {
                match place {
                    "title" => push_escaped(&mut page, title),
                    "style" => page += &sheets,
                    "imports" => page += &imports,
                    "licenses" => {
                        for (name, text) in LICENSES {
                            let _ = write!(page, "\n{name}\n\n{text}");
                        }
                    }
                    // JSON has `<` only in texts, where an escape means the same and ends no element.
                    _ => page += &data_json.replace('<', "\\u003c"),
                }
                page += rest;
            }
        }
    }
    page
}

/// Adds a text to HTML.
fn push_escaped(html: &mut String, text: &str) {
    for character in text.chars() {
        match character {
            '&' => html.push_str("&amp;"),
            '<' => html.push_str("&lt;"),
            '>' => html.push_str("&gt;"),
            other => html.push(other),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOSTILE: &str = "</script><script>alert(1)</script><!--{{data}}";

    #[test]
    fn hostile_texts_stay_texts() {
        let data = format!("{{\"scene\": {{\"title\": \"{HOSTILE}\"}}}}");
        let plain = page("{}", "plain");
        let page = page(&data, HOSTILE);
        for tag in ["<script", "</script", "<!--"] {
            let count = |text: &str| text.matches(tag).count();
            assert_eq!(count(&page), count(&plain), "{tag}");
        }
        assert!(page.contains(
            "<title>&lt;/script&gt;&lt;script&gt;alert(1)&lt;/script&gt;&lt;!--{{data}}</title>"
        ));
        assert!(page.contains(r#"{"scene": {"title": "\u003c/script>\u003cscript>alert(1)"#));
    }

    #[test]
    fn every_file_is_an_asset_and_every_import_leads_to_one() {
        let web = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("web");
        let names = |folder: &str| -> Vec<String> {
            let entries = std::fs::read_dir(web.join(folder)).unwrap();
            let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
            names
                .filter(|name| [".js", ".css"].iter().any(|ending| name.ends_with(ending)))
                .map(|name| format!("{folder}{name}"))
                .collect()
        };
        let mut files = names("");
        files.extend(names("vendor/"));
        files.sort();
        let mut paths: Vec<&str> = ASSETS.iter().map(|asset| asset.path).collect();
        paths.sort_unstable();
        assert_eq!(files, paths);
        let specifiers: Vec<&str> = ASSETS.iter().filter_map(|asset| asset.specifier).collect();
        for asset in ASSETS.iter().filter(|asset| !asset.path.contains('/')) {
            let text = std::str::from_utf8(asset.bytes).unwrap();
            for line in text.lines().filter(|line| line.starts_with("import ")) {
                let imported = line.split('"').nth(1).unwrap();
                assert!(specifiers.contains(&imported), "{}: {line}", asset.path);
            }
        }
    }

    #[test]
    fn pages_contain_the_licences_of_others() {
        let page = page("{}", "plain");
        for (name, text) in LICENSES {
            assert!(text.contains("Permission is hereby granted"), "{name}");
            assert!(page.contains(text) && !text.contains("-->"), "{name}");
        }
    }

    #[test]
    fn the_import_map_of_a_server_names_its_folder() {
        let map = import_map("/viewer/");
        assert!(map.starts_with("{\"imports\": {\"pardalis/body.js\": \"/viewer/body.js\", "));
        assert!(map.contains("\"three\": \"/viewer/vendor/three.js\""));
        assert!(map.ends_with("}}"));
    }
}
