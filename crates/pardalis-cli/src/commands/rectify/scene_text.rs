//! The scene that tracks on the maps: the given scene with the maps instead of one camera's images.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use anyhow::Result;
use pardalis::rectify::{Rectifier, point_on_plane_m};
use pardalis::view::View;
use pardalis_camera::Projection as _;
use toml::de::{DeTable, DeValue};

use crate::output::{Shown, warn};
use crate::scene_files::read_text;
use crate::user_error::user_error;

/// Formats the text of the scene in the file at `path`. Every table has its own header, in the order of the
/// text, and values are kept verbatim, except for the given camera, clicks in its image, and paths, which
/// become absolute.
pub(super) fn of(
    path: &Path,
    camera: &str,
    is_masked: bool,
    view: &View,
    rectifier: &Rectifier,
) -> Result<String> {
    let text = read_text(path)?;
    // The scene was parsed before; this only fails if the file has changed since.
    let root = DeTable::parse(&text).map_err(|error| user_error!("{}: {error}", path.shown()))?;
    let mut writer = Writer {
        text: &text,
        folder: path.parent().unwrap_or(Path::new("")),
        camera,
        is_masked,
        view,
        rectifier,
        written: format!(
            "# Written by pardalis rectify from {}: the images of cameras.{camera} are now maps.\n",
            path.shown()
        ),
    };
    writer.push_table(&[], root.get_ref());
    Ok(writer.written)
}

struct Writer<'a> {
    text: &'a str,
    /// The folder of the given scene.
    folder: &'a Path,
    camera: &'a str,
    is_masked: bool,
    view: &'a View,
    rectifier: &'a Rectifier,
    written: String,
}

impl Writer<'_> {
    /// Appends the table at a key; its own values come before the tables in it.
    fn push_table(&mut self, key: &[&str], table: &DeTable) {
        if let ["cameras", name] = key
            && *name == self.camera
        {
            let mask = if self.is_masked {
                "mask = \"mask.png\"\n"
            } else {
                ""
            };
            // Writing to a String cannot fail.
            let _ = write!(
                self.written,
                "\n[cameras.{name}]\nimages = \"frames\"\ncalibration = \"camera.toml\"\n{mask}"
            );
            return;
        }
        let mut entries: Vec<_> = table.iter().collect();
        entries.sort_by_key(|(name, _)| name.span().start);
        let is_table = |value: &DeValue| matches!(value, DeValue::Table(_));
        let has_values = entries.iter().any(|(_, value)| !is_table(value.get_ref()));
        if !key.is_empty() && (has_values || entries.is_empty()) {
            let _ = writeln!(self.written, "\n[{}]", key.join("."));
        }
        for (name, value) in &entries {
            if !is_table(value.get_ref()) {
                let path = [key, &[name.get_ref()]].concat();
                let new = self.replaced(&path, table, value.get_ref());
                let shown = new.unwrap_or_else(|| self.text[value.span()].to_owned());
                let _ = writeln!(self.written, "{} = {shown}", name.get_ref());
            }
        }
        for (name, value) in &entries {
            if let DeValue::Table(inner) = value.get_ref() {
                self.push_table(&[key, &[name.get_ref()]].concat(), inner);
            }
        }
    }

    /// Returns the replacement of a value, if it needs one.
    fn replaced(&self, key: &[&str], table: &DeTable, value: &DeValue) -> Option<String> {
        match key {
            ["cameras", _, "images" | "video" | "calibration" | "mask"]
            | ["targets", .., "colors"]
            | ["targets", .., "start", "track", "file"] => self.path(value.as_str()?),
            ["targets", .., "start", "pixel", "pixel_px"] => {
                let camera = table
                    .get("camera")
                    .and_then(|camera| camera.get_ref().as_str());
                let is_ours = camera.is_none_or(|camera| camera == self.camera);
                is_ours.then(|| self.click(&key.join("."), value)).flatten()
            }
            _ => None,
        }
    }

    /// Makes a path absolute; `None` if there is no such file or folder, because videos may be URLs.
    fn path(&self, path: &str) -> Option<String> {
        let absolute = fs::canonicalize(self.folder.join(path)).ok()?;
        Some(toml::Value::from(absolute.to_str()?).to_string())
    }

    /// Converts a click to the map.
    fn click(&self, key: &str, value: &DeValue) -> Option<String> {
        let number = |value: &DeValue| match value {
            DeValue::Float(float) => float.as_str().replace('_', "").parse().ok(),
            DeValue::Integer(integer) => integer.as_str().replace('_', "").parse().ok(),
            _ => None,
        };
        let pixel: Vec<f64> = value
            .as_array()?
            .iter()
            .filter_map(|v| number(v.get_ref()))
            .collect();
        let [u, v] = pixel[..] else { return None };
        let on_map = point_on_plane_m(self.view, [u, v])
            .map(|[x, y]| self.rectifier.camera().project([x, y, 0.0]).0);
        let (width, height) = self.rectifier.size_px();
        let inside = |[u, v]: &[f64; 2]| {
            *u > -0.5 && *u < width as f64 - 0.5 && *v > -0.5 && *v < height as f64 - 0.5
        };
        if !on_map.is_some_and(|pixel| inside(&pixel)) {
            warn(format!(
                "{key}: this pixel shows a point outside the map; set the start of the target again in the new scene"
            ));
        }
        on_map.map(|[u, v]| format!("[{u:.2}, {v:.2}]"))
    }
}
