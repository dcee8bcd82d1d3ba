//! The shape of a target.

use super::camera_names::CameraNames;
use super::description::{Presence, above};
use super::reader::{Kind, Table};
use super::setting::{Length, Word};
use pardalis::shape::{Flat, Section, Shape, Sphere, SphereOutline, Upright, UprightOutline};
use pardalis::tracker::SizeTolerance;

/// A shape, and how well its size is known.
#[derive(Debug, Clone, Copy)]
pub(super) struct ShapeConfig {
    pub(super) shape: Shape,
    pub(super) size: SizeTolerance,
    /// Whether the scene gives the tolerance.
    pub(super) gives_tolerance: bool,
    /// Whether its yaw is estimated, if the scene says so.
    pub(super) turns: Option<bool>,
}

impl From<Shape> for ShapeConfig {
    fn from(shape: Shape) -> Self {
        Self {
            shape,
            size: SizeTolerance::default(),
            gives_tolerance: false,
            turns: None,
        }
    }
}

/// Reads the table `shape`. A camera of a plane with unknown position cannot measure heights.
pub(super) fn read_shape(table: &Table, cameras: &CameraNames) -> Option<ShapeConfig> {
    let config = read_body(table)?;
    let shape = config.shape;
    let is_on_plane = matches!(shape, Shape::Flat(flat) if flat.height_m == 0.0);
    if !is_on_plane && let Some(camera) = cameras.without_height.first() {
        table.problem(
            "shape",
            format!(
                "rises above the plane, but the position of camera \"{camera}\" is unknown; give cameras.{camera}.model.plane.camera_center_m \
                 or its f_px and center_px (model.image has no heights at all), or a disc or rectangle without height_m"
            ),
        );
        return None;
    }
    if let (Shape::Flat(flat), Some((camera, height_m))) = (shape, &cameras.lowest)
        && flat.height_m >= *height_m
    {
        table.problem(
            "shape",
            format!(
                "is {} m above the plane, and camera \"{camera}\" is {height_m} m above it; allowed: below the camera",
                flat.height_m
            ),
        );
        return None;
    }
    Some(config)
}

const SHAPES: [Kind; 6] = [
    ("sphere", "A ball."),
    ("cylinder", "An upright cylinder that stands on its base."),
    ("prism", "An upright regular prism that stands on its base."),
    ("box", "A box that stands on one of its sides."),
    ("disc", "A horizontal disc."),
    ("rectangle", "A horizontal rectangle."),
];

fn read_body(table: &Table) -> Option<ShapeConfig> {
    let about = "The shape and size of the target.";
    let presence =
        Presence::RequiredIf("unless each landmark has its own shape, or the target has one");
    let shape = table.choice("shape", about, &SHAPES, presence, |kind, body| match kind {
        "sphere" => read_sphere(body),
        "cylinder" => {
            let radius_m = length(body, "radius_m", "Radius.", MAX_SIZE_M);
            let section = radius_m.and_then(|radius_m| body.checked(Section::circle(radius_m)));
            read_upright(body, section).map(ShapeConfig::from)
        }
        "disc" => {
            let radius_m = length(body, "radius_m", "Radius.", MAX_FLAT_SIZE);
            let height_m = read_height_over_ground(body);
            let disc = radius_m.map(|radius_m| Flat::disc(radius_m, height_m));
            let disc = disc.and_then(|disc| body.checked(disc));
            disc.map(|disc| Shape::Flat(disc).into())
        }
        "rectangle" => {
            let size_m = body
                .key("size_m", "Sizes: along the heading and across it, or along the world's x and y axes if it does not turn.")
                .within(above(0.0, MAX_FLAT_SIZE))
                .required();
            let height_m = read_height_over_ground(body);
            let rectangle = size_m.map(|size_m| Flat::rectangle(size_m, height_m));
            let rectangle = rectangle.and_then(|rectangle| body.checked(rectangle));
            let turns = read_turns(body);
            let rectangle = rectangle.map(|rectangle| Shape::Flat(rectangle).into());
            rectangle.map(|config: ShapeConfig| config.turning(turns))
        }
        "box" => {
            let size_m: Option<[f64; 3]> = body
                .key("size_m", "Sizes: along the heading and across it, or along the world's x and y axes if it does not turn, and the height.")
                .within(above(0.0, MAX_SIZE_M))
                .required();
            let turns = read_turns(body);
            let [x, y, height_m] = size_m?;
            let section = body.checked(Section::rectangle([x, y]))?;
            let upright = Upright::new(section, height_m, UprightOutline::Exact);
            let upright = body.checked(upright).map(Shape::Upright);
            upright.map(|upright| ShapeConfig::from(upright).turning(turns))
        }
        _ => {
            let sides = body
                .key("sides", "Number of sides.")
                .within(3.0..=100.0)
                .or(Section::DEFAULT_SIDES);
            let across_flats_m = length(
                body,
                "across_flats_m",
                "Width from one side to the opposite side: twice the distance of the sides from the axis.",
                MAX_SIZE_M,
            );
            let rotation_deg: f64 = body
                .key(
                    "rotation_deg",
                    "Angle of a corner from the heading, or from the world's x axis if it does not turn, counterclockwise from above.",
                )
                .within(-360.0..=360.0)
                .or(0.0);
            let section = across_flats_m.and_then(|across_flats_m| {
                let polygon = Section::polygon(sides, across_flats_m, rotation_deg.to_radians());
                body.checked(polygon)
            });
            let turns = read_turns(body);
            let prism = read_upright(body, section);
            prism.map(|prism| ShapeConfig::from(prism).turning(turns))
        }
    });
    if !table.has("shape") {
        table.missing_choice("shape", &SHAPES);
    }
    shape
}

impl ShapeConfig {
    fn turning(self, turns: Option<bool>) -> Self {
        Self { turns, ..self }
    }
}

/// Reads whether a body turns; `None` if the scene does not say so.
fn read_turns(body: &Table) -> Option<bool> {
    let turns = body
        .key("turns", "Whether the body turns: its yaw is estimated, and its heading from where it moves first. Only for targets with the edge cue; the published cues take it as it stands here.")
        .or(true);
    body.has("turns").then_some(turns)
}

/// Maximum size of a body, in metres.
const MAX_SIZE_M: f64 = 1000.0;
/// Maximum size of a flat shape, in metres, or in pixels for a camera without calibration.
const MAX_FLAT_SIZE: f64 = 1e5;

fn length(table: &Table, name: &'static str, about: &'static str, greatest: f64) -> Option<f64> {
    table
        .key(name, about)
        .within(above(0.0, greatest))
        .required()
}

fn read_height_over_ground(body: &Table) -> f64 {
    body.key("height_m", "Height above the ground z = 0.")
        .within(0.0..=MAX_FLAT_SIZE)
        .or(0.0)
}

impl Word for SphereOutline {
    const WORDS: &'static [(&'static str, Self)] = &[
        ("tangent", Self::Tangent),
        ("greatcircle", Self::Greatcircle),
    ];
}

impl Word for UprightOutline {
    const WORDS: &'static [(&'static str, Self)] =
        &[("exact", Self::Exact), ("facing", Self::Facing)];
}

/// With this radius in metres the search for a ball of unknown size begins. Hand-set: between a table tennis ball and a football.
const GUESSED_RADIUS_M: f64 = 0.05;

fn read_sphere(sphere: &Table) -> Option<ShapeConfig> {
    let radius: Option<Length> = sphere
        .key("radius_m", "Radius. If it is `unknown`, several cameras, or one if the ball stays on the ground, determine it; only for targets with the edge cue.")
        .within(above(0.0, MAX_SIZE_M))
        .required();
    let tolerance = sphere
        .key("radius_tolerance", "Standard deviation of the radius, as a share of it; 0 for an exact one. Several cameras, or one if the ball stays on the ground, determine the radius better, also if it is wrong by more. With one camera it counts in the covariance of the distance. Only for targets with the edge cue.")
        .within(0.0..=1.0);
    let gives_tolerance = sphere.has("radius_tolerance");
    let (radius_m, size) = match radius {
        Some(Length::Unknown) => {
            if sphere.knows("radius_tolerance") {
                let message =
                    "has no meaning for a radius that is unknown; remove it, or give the radius";
                sphere.problem("radius_tolerance", message);
            }
            (Some(GUESSED_RADIUS_M), SizeTolerance::Unknown)
        }
        Some(Length::Metres(radius_m)) => (
            Some(radius_m),
            SizeTolerance::Share(tolerance.or(SizeTolerance::DEFAULT_SHARE)),
        ),
        None => {
            tolerance.or(SizeTolerance::DEFAULT_SHARE);
            (None, SizeTolerance::default())
        }
    };
    let outline = sphere
        .key(
            "outline",
            "The circle that is projected: the true outline (`tangent`), or the great circle across the viewing ray, as published.",
        )
        .word(SphereOutline::default());
    let ball = sphere.checked(Sphere::new(radius_m?, outline?))?;
    Some(ShapeConfig {
        shape: Shape::Sphere(ball),
        size,
        gives_tolerance,
        turns: None,
    })
}

fn read_upright(body: &Table, section: Option<Section>) -> Option<Shape> {
    let height_m = length(body, "height_m", "Height of the body.", MAX_SIZE_M);
    let outline = body
        .key(
            "outline",
            "The line that is projected: the true outline (`exact`), or a rectangle that faces the camera, as published.",
        )
        .word(UprightOutline::default());
    body.checked(Upright::new(section?, height_m?, outline?))
        .map(Shape::Upright)
}
