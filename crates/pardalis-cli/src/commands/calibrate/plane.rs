//! `pardalis calibrate plane`: the plane that a camera sees, from a detected rectangle or from points.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis_calibrate::plane::{OUTLIER_PX, PlaneFit, PointPair, Rectangle, camera_center_m, fit};
use pardalis_calibrate::rectangle::{DetectedRectangle, detect};
use pardalis_camera::CalibratedCamera;
use pardalis_camera::{Camera, Plane};
use pardalis_images::RgbImage;
use pardalis_scene::{FrameRange, VideoInput, calibration};

use super::model::read_camera;
use super::output;
use crate::draw::PALETTE;
use crate::draw::grid::{Label, drawn_over};
use crate::draw::overlay::{Mark, Shape};
use crate::draw::picture::write_picture;
use crate::files::write_file;
use crate::numbers::fixed;
use crate::output::{Shown, print};
use crate::rectangle::{EdgeArgument, first_images};
use crate::source::{SourceConfig, SourceKind, Timing};
use crate::tables::Table;
use crate::user_error::user_error;

/// Finds the plane that an uncalibrated camera sees, from a rectangle that it detects or from points
///
/// The rectangle is tape or a patch that is brighter or darker than the floor and completely in view; the
/// camera must not move. Check corners.png, which shows the detected corners. The camera's position, which is
/// needed for objects above the plane, follows from a known focal length or can be given.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  pardalis calibrate plane images --size 2.0x1.5 -o floor
  pardalis calibrate plane floor.mp4 --corners \"0,0 2,0 2,1.5 0,1.5\" --first 2 --focal 560
  pardalis calibrate plane images --points points.csv --camera-height 3.0 --camera-foot 0,-3.2

A scene takes the result with calibration = \"floor/camera.toml\".")]
pub(crate) struct Arguments {
    /// A folder of images, or a video
    #[arg(value_name = "IMAGES", required_unless_present = "points")]
    images: Option<PathBuf>,
    /// Number of images to use, beginning with the first
    #[arg(long, value_name = "COUNT", default_value_t = 10, value_parser = parse_count)]
    frames: usize,
    /// In place of a rectangle: a table of four or more points with the columns u_px,v_px,x_m,y_m; wrong
    /// points are reported and ignored
    #[arg(long, value_name = "FILE.csv", conflicts_with_all = ["size", "corners", "first", "edge"])]
    points: Option<PathBuf>,
    /// Side lengths of the rectangle in metres. The origin is its corner nearest to the image's bottom left;
    /// x runs along the first side, counter-clockwise from there
    #[arg(long, value_name = "METRESxMETRES", value_parser = parse_sides, required_unless_present_any = ["points", "corners"])]
    size: Option<[f64; 2]>,
    /// In place of --size: the rectangle's corners in the world in metres, counter-clockwise as seen from above
    #[arg(long, value_name = "X,Y X,Y X,Y X,Y", value_parser = parse_corners, conflicts_with = "size", allow_hyphen_values = true)]
    corners: Option<[[f64; 2]; 4]>,
    /// Which of --corners, counted from 1, is nearest to the image's bottom left
    #[arg(long, value_name = "NUMBER", default_value_t = 1, conflicts_with = "size", value_parser = parse_first)]
    first: usize,
    /// Which edge of a tape was measured
    #[arg(long, value_name = "EDGE", default_value = "outer")]
    edge: EdgeArgument,
    /// Focal length in pixels, if known; it determines the camera's position. The lens must hardly bend
    /// straight lines
    #[arg(long, value_name = "PX", value_parser = parse_length, conflicts_with_all = ["camera", "camera_height"])]
    focal: Option<f64>,
    /// In place of --focal: a calibration file with the camera's pinhole model
    #[arg(long, value_name = "FILE", conflicts_with = "camera_height")]
    camera: Option<PathBuf>,
    /// Measured height of the camera above the plane in metres
    #[arg(long, value_name = "METRES", value_parser = parse_length, requires = "camera_foot")]
    camera_height: Option<f64>,
    /// Point of the plane directly below the camera, in metres
    #[arg(long, value_name = "X,Y", value_parser = parse_point, requires = "camera_height", allow_hyphen_values = true)]
    camera_foot: Option<[f64; 2]>,
    /// The folder for the results [default: in the current directory, the input's name with -plane]
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
}

/// Points of a plane, and their origin.
struct Known {
    pairs: Vec<PointPair>,
    /// Line of each point in its table; empty for a rectangle.
    lines: Vec<u64>,
    found: Option<DetectedRectangle>,
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let input = [&arguments.points, &arguments.images];
    let Some(input) = input.into_iter().flatten().next() else {
        return Err(user_error!("give images or --points FILE.csv"));
    };
    let images = match &arguments.images {
        Some(images) => read_images(images, arguments.frames)?,
        None => Vec::new(),
    };
    let known = match &arguments.points {
        Some(table) => read_points(table)?,
        None => find_corners(arguments, input, &images)?,
    };
    let fitted = fit(&known.pairs).map_err(|error| match known.found {
        Some(_) => user_error!("{}: {error}", input.shown()),
        None => user_error!(
            "{}: {error} (points are counted from the first row)",
            input.shown()
        ),
    })?;
    let size_px = images.first().map(RgbImage::size_px);
    let center_m = center_m(arguments, &fitted, size_px)?;
    let camera = CalibratedCamera {
        name: "camera".to_owned(),
        camera: Camera::Plane(Plane::new(&fitted.homography, center_m)?),
        size_px,
        world_from_camera: None,
    };
    let folder = output::folder(arguments.output.as_deref(), input, "plane");
    output::make_folder(&folder)?;
    let mut written = vec![folder.join("camera.toml")];
    write_file(&written[0], calibration::write_toml(&[camera]).as_bytes())?;
    if let Some(image) = images.first() {
        written.push(folder.join("corners.png"));
        write_picture(&written[1], &drawn(image, &known, &fitted))?;
    }
    print(report(&known, &fitted, center_m)?);
    output::print_written(&written);
    Ok(())
}

/// Reads the first images of a folder of images or of a video.
fn read_images(images: &Path, count: usize) -> Result<Vec<RgbImage>> {
    let kind = if images.is_dir() {
        SourceKind::Images {
            folder: images.to_owned(),
            timing: Timing::Fps(1.0),
        }
    } else {
        SourceKind::Video {
            video: VideoInput::of_path(&images.to_string_lossy()),
            encoding: None,
        }
    };
    first_images(&SourceConfig {
        kind,
        time_offset_s: 0.0,
        frames: FrameRange {
            limit: Some(count),
            ..FrameRange::ALL
        },
    })
}

/// Finds the rectangle's corners in the images and assigns their world positions.
fn find_corners(arguments: &Arguments, input: &Path, images: &[RgbImage]) -> Result<Known> {
    let found = detect(images, arguments.edge.into())
        .map_err(|error| user_error!("{}: {error}", input.shown()))?;
    let of_corners = |corners_m: [[f64; 2]; 4]| Rectangle {
        corners_m,
        nearest: arguments.first - 1,
    };
    let rectangle = arguments.corners.map(of_corners);
    let Some(rectangle) = rectangle.or(arguments.size.map(Rectangle::of_size)) else {
        return Err(user_error!(
            "give the rectangle's --size or its --corners in the world"
        ));
    };
    Ok(Known {
        pairs: rectangle.pairs(found.corners_px).into(),
        lines: Vec::new(),
        found: Some(found),
    })
}

fn read_points(path: &Path) -> Result<Known> {
    let table = Table::read(path)?;
    let columns = table.columns(["u_px", "v_px", "x_m", "y_m"])?;
    let mut known = Known {
        pairs: Vec::new(),
        lines: Vec::new(),
        found: None,
    };
    for row in table.rows() {
        let [u, v, x, y] = row.numbers(columns)?;
        known.pairs.push(PointPair {
            pixel: [u, v],
            plane_m: [x, y],
        });
        known.lines.push(row.line);
    }
    Ok(known)
}

/// Returns the camera's position if it is given or follows from the focal length.
fn center_m(
    arguments: &Arguments,
    fitted: &PlaneFit,
    size_px: Option<(usize, usize)>,
) -> Result<Option<[f64; 3]>> {
    if let (Some(height_m), Some([x, y])) = (arguments.camera_height, arguments.camera_foot) {
        return Ok(Some([x, y, height_m]));
    }
    let (option, f_px, center_px) = if let Some(focal_px) = arguments.focal {
        let Some((width, height)) = size_px else {
            return Err(user_error!(
                "--focal {focal_px}: also needs the image size; give images in addition to --points, or --camera FILE"
            ));
        };
        let middle_px = [width, height].map(|side| (side - 1) as f64 / 2.0);
        (format!("--focal {focal_px}"), [focal_px; 2], middle_px)
    } else if let Some(path) = &arguments.camera {
        let remedy = "extract one with pardalis camera convert --camera NAME";
        let known = read_camera(path, None, remedy)?;
        let option = format!("--camera {}", path.shown());
        if let (Some(file), Some(images)) = (known.size_px, size_px)
            && file != images
        {
            return Err(user_error!(
                "{option}: is for images of {} x {} pixels, but these have {} x {}; give the calibration of these images",
                file.0,
                file.1,
                images.0,
                images.1
            ));
        }
        let values: Vec<f64> = known.camera.parameters().iter().map(|p| p.1).collect();
        match (&known.camera, values.as_slice()) {
            (Camera::Pinhole(_), [fx, fy, cx, cy, distortion @ ..])
                if distortion.iter().all(|k| *k == 0.0) =>
            {
                (option, [*fx, *fy], [*cx, *cy])
            }
            _ => {
                return Err(user_error!(
                    "{option}: is a {} that bends straight lines, and a plane alone knows no lens; allowed: pinhole without distortion; \
                     with this lens, pardalis calibrate pose finds the pose from points of the plane",
                    known.camera.kind()
                ));
            }
        }
    } else {
        return Ok(None);
    };
    let center_m = camera_center_m(&fitted.homography, f_px, center_px);
    Ok(Some(
        center_m.map_err(|error| user_error!("{option}: {error}"))?,
    ))
}

/// Draws the points in order over an image: connected if they form a rectangle, outliers in another colour.
fn drawn(image: &RgbImage, known: &Known, fitted: &PlaneFit) -> RgbImage {
    let [_, outlier_color, color, ..] = PALETTE;
    let mut marks = Vec::new();
    if known.found.is_some() {
        marks.push(Mark {
            shape: Shape::Contour,
            points_px: known.pairs.iter().map(|pair| Some(pair.pixel)).collect(),
            color,
        });
    }
    let mut labels = Vec::new();
    for (i, pair) in known.pairs.iter().enumerate() {
        let color = if fitted.outliers.contains(&i) {
            outlier_color
        } else {
            color
        };
        let [u, v] = pair.pixel;
        let line = |du: f64, dv: f64| Mark {
            shape: Shape::Line,
            points_px: [-4.0, 4.0].map(|s| Some([u + s * du, v + s * dv])).into(),
            color,
        };
        marks.extend([line(1.0, 0.0), line(0.0, 1.0)]);
        let [x, y] = pair.plane_m.map(|c| (c * 1e3).round() / 1e3);
        labels.push(Label {
            text: format!("{}: ({x}, {y}) m", i + 1),
            at_px: pair.pixel,
            color,
        });
    }
    drawn_over(image, marks, &labels)
}

/// Describes the result for the terminal.
fn report(known: &Known, fitted: &PlaneFit, center_m: Option<[f64; 3]>) -> Result<String> {
    let mut text = String::new();
    if let Some(found) = &known.found {
        let kind = match (found.is_bright, found.is_tape) {
            (true, true) => "bright tape",
            (true, false) => "a bright patch",
            (false, true) => "dark tape",
            (false, false) => "a dark patch",
        };
        writeln!(
            text,
            "A rectangle of {kind}; its corners counter-clockwise from the one nearest to the image's bottom left:"
        )?;
        for (i, (pair, support)) in known.pairs.iter().zip(found.support).enumerate() {
            let ([u, v], [x, y]) = (pair.pixel, pair.plane_m);
            writeln!(
                text,
                "  {}: ({u:.2}, {v:.2}) px, ({x}, {y}) m; {:.0} % of the side to the next one is visible",
                i + 1,
                100.0 * support
            )?;
        }
        write!(
            text,
            "The edges lie within {:.2} px (RMS) of straight lines",
            found.line_rms_px
        )?;
        match found.scatter_px {
            Some(scatter_px) => writeln!(
                text,
                ", the corners of single images within {scatter_px:.2} px of these."
            )?,
            None => writeln!(text, ".")?,
        }
        writeln!(
            text,
            "Check whether corners.png shows the intended rectangle."
        )?;
    } else {
        let kept = known.pairs.len() - fitted.outliers.len();
        writeln!(
            text,
            "{kept} of {} points, within {:.2} px (RMS)",
            known.pairs.len(),
            fitted.rms_px
        )?;
        for &outlier in &fitted.outliers {
            let distance = fitted.residuals_px[outlier].map_or_else(
                || "behind the camera".to_owned(),
                |[du, dv]| format!("{:.1} px away", libm::hypot(du, dv)),
            );
            writeln!(
                text,
                "  line {}: ignored, because the other points place it {distance} (more than {OUTLIER_PX} px)",
                known.lines[outlier]
            )?;
        }
    }
    match center_m {
        Some([x, y, z]) => write!(
            text,
            "The camera is {z:.3} m above the plane, over ({}, {}) m.",
            fixed(x, 3),
            fixed(y, 3)
        )?,
        None => write!(
            text,
            "The camera's position is unknown: objects above the plane will seem farther away than they are. Give --focal, --camera or --camera-height."
        )?,
    }
    Ok(text)
}

/// Parses numbers with a separator.
fn parse_numbers<const N: usize>(text: &str, separator: char) -> Option<[f64; N]> {
    let numbers = text.split(separator).map(|n| n.trim().parse().ok());
    let numbers: Option<Vec<f64>> = numbers.collect();
    let numbers = <[f64; N]>::try_from(numbers?).ok()?;
    numbers.iter().all(|n| n.is_finite()).then_some(numbers)
}

/// Parses `2.0x1.5`.
fn parse_sides(text: &str) -> Result<[f64; 2], String> {
    parse_numbers(text, 'x')
        .filter(|sides: &[f64; 2]| sides.iter().all(|side| *side > 0.0))
        .ok_or_else(|| "allowed: two positive lengths in metres, such as 2.0x1.5".to_owned())
}

/// Parses `0,0 2,0 2,1.5 0,1.5`.
fn parse_corners(text: &str) -> Result<[[f64; 2]; 4], String> {
    let corners = text.split_whitespace().map(|pair| parse_numbers(pair, ','));
    let corners: Option<Vec<[f64; 2]>> = corners.collect();
    corners
        .and_then(|corners| <[[f64; 2]; 4]>::try_from(corners).ok())
        .ok_or_else(|| "allowed: four points in metres, such as \"0,0 2,0 2,1.5 0,1.5\"".to_owned())
}

/// Parses a position on the plane.
fn parse_point(text: &str) -> Result<[f64; 2], String> {
    parse_numbers(text, ',')
        .ok_or_else(|| "allowed: two coordinates in metres, such as 0,-3.2".to_owned())
}

/// Parses a positive length.
fn parse_length(text: &str) -> Result<f64, String> {
    let length = text.parse().ok();
    let length = length.filter(|length: &f64| *length > 0.0 && length.is_finite());
    length.ok_or_else(|| "allowed: a positive number".to_owned())
}

/// Parses the number of images.
fn parse_count(text: &str) -> Result<usize, String> {
    let count = text.parse().ok().filter(|count| (1..=100).contains(count));
    count.ok_or_else(|| "allowed: 1 to 100".to_owned())
}

/// Parses the number of a corner.
fn parse_first(text: &str) -> Result<usize, String> {
    let first = text.parse().ok().filter(|first| (1..=4).contains(first));
    first.ok_or_else(|| "allowed: 1 to 4".to_owned())
}
