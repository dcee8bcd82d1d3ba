//! The clips of `data/real-balls`: their images at a scale, and their labels.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};
use serde::Deserialize;

/// A clip as `data/real-balls/clips.toml` describes it.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Clip {
    /// Width and height at full size.
    pub(crate) size_px: [u32; 2],
    pub(crate) fps: f64,
    /// Assumed, because nobody measured it.
    pub(crate) radius_m: f64,
}

/// Reads the descriptions of all clips by name.
pub(crate) fn read_clips(data: &Path) -> Result<BTreeMap<String, Clip>> {
    let path = data.join("clips.toml");
    let text = fs::read_to_string(&path).with_context(|| path.display().to_string())?;
    toml::from_str(&text).with_context(|| path.display().to_string())
}

/// The images of a clip at a scale.
#[derive(Debug)]
pub(crate) struct Images {
    /// A video file or a folder of JPEG files `NNNNNN.jpg`.
    pub(crate) source: PathBuf,
    /// Size of the images over the full size, across and down.
    pub(crate) factor: [f64; 2],
}

impl Images {
    /// Scales a clip's video to a lossy but fine video in `work`; at scale 1 the images are those of the clip itself.
    pub(crate) fn of_video(clip: &Clip, video: &Path, scale: f64, work: &Path) -> Result<Self> {
        let (size, factor) = scaled_size(clip, scale);
        if scale == 1.0 {
            return Ok(Self {
                source: video.to_owned(),
                factor,
            });
        }
        let source = work.join("scaled.mkv");
        let filter = format!("scale={}:{}:flags=area", size[0], size[1]);
        let encoding = ["-c:v", "libx264", "-qp", "4", "-preset", "veryfast", "-an"];
        let mut command = ffmpeg(video);
        command.args(["-vf", &filter, "-fps_mode", "passthrough"]);
        call(command.args(encoding).arg(&source))?;
        Ok(Self { source, factor })
    }

    /// Takes a folder of images that were scaled before.
    pub(crate) fn of_folder(clip: &Clip, folder: PathBuf, scale: f64) -> Result<Self> {
        if !folder.is_dir() {
            bail!("{}: no folder of images", folder.display());
        }
        let (_, factor) = scaled_size(clip, scale);
        Ok(Self {
            source: folder,
            factor,
        })
    }

    pub(crate) fn is_folder(&self) -> bool {
        self.source.is_dir()
    }

    /// Returns an image file of one frame, extracted from the video into `work` if need be.
    pub(crate) fn frame(&self, frame: u32, work: &Path) -> Result<PathBuf> {
        if self.is_folder() {
            return Ok(self.source.join(format!("{frame:06}.jpg")));
        }
        let image = work.join(format!("{frame:06}.png"));
        let select = format!("select=eq(n\\,{frame})");
        let mut command = ffmpeg(&self.source);
        command.args(["-vf", &select, "-fps_mode", "passthrough"]);
        call(command.args(["-frames:v", "1"]).arg(&image))?;
        Ok(image)
    }

    /// Maps a pixel of the full size to these images. Pixel centres are at integers.
    pub(crate) fn scaled(&self, pixel: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|i| (pixel[i] + 0.5) * self.factor[i] - 0.5)
    }

    /// Maps a pixel of these images to the full size.
    pub(crate) fn unscaled(&self, pixel: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|i| (pixel[i] + 0.5) / self.factor[i] - 0.5)
    }
}

/// Returns the size of a clip's images at a scale, in even numbers for the video encoder, and the exact factors.
fn scaled_size(clip: &Clip, scale: f64) -> ([u32; 2], [f64; 2]) {
    let size = clip
        .size_px
        .map(|full| ((f64::from(full) * scale / 2.0).round_ties_even() * 2.0) as u32);
    let factor = [0, 1].map(|i| f64::from(size[i]) / f64::from(clip.size_px[i]));
    (size, factor)
}

fn ffmpeg(input: &Path) -> Command {
    let mut command = Command::new("ffmpeg");
    command
        .args(["-v", "error", "-y", "-nostdin", "-i"])
        .arg(input);
    command
}

/// Runs a command; its messages become the error if it fails. Returns what it printed.
pub(crate) fn call(command: &mut Command) -> Result<String> {
    let program = command.get_program().display().to_string();
    let output = command
        .output()
        .with_context(|| format!("cannot start {program}"))?;
    if !output.status.success() {
        bail!("{command:?}\n{}", String::from_utf8_lossy(&output.stderr));
    }
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

/// A circle around a whole, sharp ball in one frame, in pixels of the full size.
#[derive(Debug, Clone, Copy, Deserialize)]
pub(crate) struct Label {
    pub(crate) frame: u32,
    pub(crate) u_px: f64,
    pub(crate) v_px: f64,
    pub(crate) radius_px: f64,
}

/// Reads `labels.csv`.
pub(crate) fn read_labels(path: &Path) -> Result<Vec<Label>> {
    let mut reader = csv::Reader::from_path(path).with_context(|| path.display().to_string())?;
    let labels: Result<Vec<Label>, _> = reader.deserialize().collect();
    labels.with_context(|| path.display().to_string())
}

impl Label {
    /// The circle as a polygon with 24 corners in pixels of the images.
    pub(crate) fn polygon(&self, images: &Images) -> String {
        let [u_px, v_px] = images.scaled([self.u_px, self.v_px]);
        let radius_px = self.radius_px * images.factor[0];
        let corner = |k: i32| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / 24.0).sin_cos();
            format!(
                "{:.2},{:.2}",
                u_px + radius_px * cos,
                v_px + radius_px * sin
            )
        };
        (0..24).map(corner).collect::<Vec<_>>().join(",")
    }

    /// The least rectangle of whole pixels of the images around the circle, cut at the left and upper border.
    pub(crate) fn rectangle(&self, images: &Images) -> String {
        let [u_px, v_px] = images.scaled([self.u_px, self.v_px]);
        let radius_px = self.radius_px * images.factor[0];
        let side = |centre: f64| {
            let low = (centre + 0.5 - radius_px).floor().max(0.0);
            (low, (centre + 0.5 + radius_px).ceil() - low)
        };
        let ((x, width), (y, height)) = (side(u_px), side(v_px));
        format!("{x},{y},{width},{height}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_scale_with_the_images() {
        let clip = Clip {
            size_px: [360, 641],
            fps: 30.0,
            radius_m: 0.02,
        };
        let folder = tempfile::tempdir().unwrap();
        let images = Images::of_folder(&clip, folder.path().to_owned(), 0.5).unwrap();
        // 641 rows become 320: not exactly half as many.
        assert_eq!(images.factor, [0.5, 320.0 / 641.0]);
        let pixel = images.scaled([100.5, 32.1 * 2.0 - 0.5]);
        assert!((pixel[0] - 50.0).abs() < 1e-9 && (pixel[1] - 31.549_921_996_88).abs() < 1e-9);
        let back = images.unscaled(pixel);
        assert!((back[0] - 100.5).abs() < 1e-9 && (back[1] - 63.7).abs() < 1e-9);
        let label = Label {
            frame: 3,
            u_px: 100.5,
            v_px: 4.0,
            radius_px: 20.0,
        };
        assert_eq!(label.rectangle(&images), "40,0,21,13");
        assert!(label.polygon(&images).starts_with("60.00,1.75,59.66,"));
        assert_eq!(label.polygon(&images).split(',').count(), 48);
        let image = images.frame(3, folder.path()).unwrap();
        assert_eq!(image, folder.path().join("000003.jpg"));
    }
}
