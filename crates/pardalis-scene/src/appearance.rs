//! What a target looks like: its shape, and the cues that compare it with the images.

use super::description::{Presence, above, between};
use super::reader::{Kind, Table};
use super::setting::Word;
use super::target::CameraNames;
use pardalis::color::{ChannelBins, ColorRanges};
use pardalis::likelihood::{
    ContourSettings, Cue, CueSettings, EdgeSettings, PatchSettings, Sampling, ScaledSampling,
    SharedPixels, SplineSampling, WindowSettings,
};
use pardalis::shape::{Flat, Section, Shape, Sphere, SphereOutline, Upright, UprightOutline};

/// Reads the table `shape`. A camera known by a plane alone cannot tell the height of anything.
pub(super) fn read_shape(table: &Table, cameras: &CameraNames) -> Option<Shape> {
    let shape = read_body(table)?;
    let is_on_plane = matches!(shape, Shape::Flat(flat) if flat.height_m == 0.0);
    if !is_on_plane && let Some(camera) = cameras.without_height.first() {
        table.problem(
            "shape",
            format!(
                "rises over the plane, but the place of camera \"{camera}\" is not known; give cameras.{camera}.model.plane.camera_center_m \
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
                "is {} m over the plane, and camera \"{camera}\" is {height_m} m over it; allowed: below the camera",
                flat.height_m
            ),
        );
        return None;
    }
    Some(shape)
}

const SHAPES: [Kind; 5] = [
    ("sphere", "A ball."),
    ("cylinder", "An upright cylinder that stands on its base."),
    ("prism", "An upright regular prism that stands on its base."),
    ("disc", "A horizontal disc."),
    (
        "rectangle",
        "A horizontal rectangle along the world's axes.",
    ),
];

fn read_body(table: &Table) -> Option<Shape> {
    let about = "The shape and size of the target.";
    let presence =
        Presence::RequiredIf("unless each landmark has a shape of its own, or the target has one");
    let shape = table.choice("shape", about, &SHAPES, presence, |kind, body| match kind {
        "sphere" => read_sphere(body),
        "cylinder" => {
            let radius_m = length(body, "radius_m", "Radius.", MAX_SIZE_M);
            let section = radius_m.and_then(|radius_m| body.checked(Section::circle(radius_m)));
            read_upright(body, section)
        }
        "disc" => {
            let radius_m = length(body, "radius_m", "Radius.", MAX_FLAT_SIZE);
            let height_m = read_height_over_ground(body);
            let disc = radius_m.map(|radius_m| Flat::disc(radius_m, height_m));
            disc.and_then(|disc| body.checked(disc)).map(Shape::Flat)
        }
        "rectangle" => {
            let size_m = body
                .key("size_m", "Size along x and y.")
                .within(above(0.0, MAX_FLAT_SIZE))
                .required();
            let height_m = read_height_over_ground(body);
            let rectangle = size_m.map(|size_m| Flat::rectangle(size_m, height_m));
            rectangle
                .and_then(|rectangle| body.checked(rectangle))
                .map(Shape::Flat)
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
                    "Angle of a corner from the world's x axis, counterclockwise from above.",
                )
                .within(-360.0..=360.0)
                .or(0.0);
            let section = across_flats_m.and_then(|across_flats_m| {
                let polygon = Section::polygon(sides, across_flats_m, rotation_deg.to_radians());
                body.checked(polygon)
            });
            read_upright(body, section)
        }
    });
    if !table.has("shape") {
        table.missing_choice("shape", &SHAPES);
    }
    shape
}

/// The largest size of a body, in metres.
const MAX_SIZE_M: f64 = 1000.0;
/// The largest size of a flat shape, in metres, or in pixels for a camera without calibration.
const MAX_FLAT_SIZE: f64 = 1e5;

fn length(table: &Table, name: &'static str, about: &'static str, greatest: f64) -> Option<f64> {
    table
        .key(name, about)
        .within(above(0.0, greatest))
        .required()
}

fn read_height_over_ground(body: &Table) -> f64 {
    body.key("height_m", "Height over the ground z = 0.")
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

fn read_sphere(sphere: &Table) -> Option<Shape> {
    let radius_m = length(sphere, "radius_m", "Radius.", MAX_SIZE_M);
    let outline = sphere
        .key(
            "outline",
            "The circle that is projected: the true outline (`tangent`), or the great circle across the viewing ray, as published.",
        )
        .word(SphereOutline::default());
    sphere
        .checked(Sphere::new(radius_m?, outline?))
        .map(Shape::Sphere)
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

/// The published cues.
const PUBLISHED_CUES: [Kind; 4] = [
    (
        "contour",
        "Contour cue (Taiana et al.): compares the colours on the inner and the outer side of the outline with the target's.",
    ),
    (
        "window",
        "Window cue (Barrera 2005): the share of pixels in a small window that have the target's colours.",
    ),
    (
        "region",
        "Region cue (Campos 2009): compares the histogram of a flat target's region with the one in the first frame.",
    ),
    (
        "difference",
        "Difference cue (Campos 2009): compares the change between frames in a flat target's region.",
    ),
];

/// What the edge cue does.
const ABOUT_EDGE: &str = "Edge cue: detects the target itself, needs no start and stands alone. The default of targets without cues and start.";

/// The cues of a target, which decide how it is tracked.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum CuesConfig {
    /// The edge cue detects the target.
    Edge(EdgeSettings),
    /// These track it from a given start.
    Published(Vec<CueSettings>),
}

/// Reads the cues of a target: each that has a table. Without any, the target has the edge cue, which detects it, or, if the scene states a start, the contour
/// cue.
pub(super) fn read_cues(
    table: &Table,
    shape: Option<&Shape>,
    cameras: &[String],
    has_start: bool,
) -> Option<CuesConfig> {
    let default = shape.map_or_else(ContourSettings::default, ContourSettings::of_shape);
    let within = shape.map_or_else(PatchSettings::around, PatchSettings::within);
    let read = |key: &'static str, table: &Table| match key {
        "contour" => read_contour(table, default).map(Cue::Contour),
        "window" => read_window(table).map(Cue::Window),
        "region" => read_patch(
            table,
            within,
            shape,
            "1; 0.7071 for a disc, whose inner square is compared",
        )
        .map(Cue::Region),
        _ => read_patch(table, PatchSettings::around(), shape, "").map(Cue::Difference),
    };
    let (mut found, mut valid) = (false, true);
    let mut cues = Vec::new();
    for (key, about) in PUBLISHED_CUES {
        let cue = table.section(key, about, |cue_table| {
            let cue = read(key, cue_table);
            let cameras = read_cameras(cue_table, cameras);
            let (cue, cameras) = (cue?, cameras.ok()?);
            Some(CueSettings { cue, cameras })
        });
        found |= table.has(key);
        valid &= cue.is_some() || !table.has(key);
        cues.extend(cue);
    }
    let has_edge = table.has("edge");
    let edge = table.section("edge", ABOUT_EDGE, read_edge);
    if has_edge && found {
        table.problem(
            "edge",
            "cannot be combined with other cues, since it detects the target itself; remove it or the others",
        );
        return None;
    }
    if has_edge {
        return edge.map(CuesConfig::Edge);
    }
    if !found {
        return Some(if has_start {
            CuesConfig::Published(vec![Cue::Contour(default).into()])
        } else {
            CuesConfig::Edge(EdgeSettings::default())
        });
    }
    let looked_at = |camera: usize| {
        let looks = |cue: &CueSettings| cue.cameras.as_ref().is_none_or(|c| c.contains(&camera));
        cues.iter().any(looks)
    };
    for (camera, name) in cameras.iter().enumerate() {
        if valid && !looked_at(camera) {
            table.problem_here(format!(
                "no cue uses camera \"{name}\"; add it to the `cameras` of one"
            ));
            valid = false;
        }
    }
    (valid && !cues.is_empty()).then_some(CuesConfig::Published(cues))
}

/// Returns the numbers of the cameras that a cue names, `None` if it names none, or an error after reporting a problem.
fn read_cameras(cue: &Table, cameras: &[String]) -> Result<Option<Vec<usize>>, ()> {
    let names = cue
        .key("cameras", "Names of the cameras that the cue uses.")
        .depends("all cameras")
        .optional::<Vec<String>>();
    let Some(names) = names else {
        return if cue.has("cameras") {
            Err(())
        } else {
            Ok(None)
        };
    };
    if names.is_empty() {
        cue.problem(
            "cameras",
            "is empty; remove it to use all cameras, or remove the cue",
        );
        return Err(());
    }
    let number = |name: &String| {
        let found = cameras.iter().position(|camera| camera == name);
        found.ok_or_else(|| {
            let allowed = cameras.join(", ");
            cue.problem("cameras", format!("names \"{name}\"; allowed: {allowed}"));
        })
    };
    names
        .iter()
        .map(number)
        .collect::<Result<_, ()>>()
        .map(Some)
}

fn read_edge(edge: &Table) -> Option<EdgeSettings> {
    let default = EdgeSettings::default();
    let settings = EdgeSettings {
        correspondence_lines: edge
            .key("correspondence_lines", "Number of correspondence lines across the outline.")
            .within(16.0..=1000.0)
            .or(default.correspondence_lines),
        likelihood_exponent: edge
            .key(
                "likelihood_exponent",
                "Exponent of each pixel's likelihood; below 1 because neighbouring pixels are correlated.",
            )
            .within(above(0.0, 1.0))
            .or(default.likelihood_exponent),
        shared_sigma_px: edge
            .key(
                "shared_sigma_px",
                "Standard deviation of errors that all lines of an outline share, such as shading.",
            )
            .within(0.0..=10.0)
            .or(default.shared_sigma_px),
        learned_profile: edge
            .key(
                "learned_profile",
                "Whether the profile of edges is the learned one; otherwise it is a smooth step.",
            )
            .or(default.learned_profile),
        lit_and_shaded_profiles: edge
            .key(
                "lit_and_shaded_profiles",
                "Whether the lit and the shaded side have profiles of their own.",
            )
            .or(default.lit_and_shaded_profiles),
        background_model: edge
            .key(
                "background_model",
                "Whether parts of the outline that something else covers are ignored.",
            )
            .or(default.background_model),
        color_evidence: edge
            .key(
                "color_evidence",
                "Whether the mean colour within the outline contributes to the log-likelihood ratio of a detection.",
            )
            .or(default.color_evidence),
        illumination_adaptation: edge
            .key(
                "illumination_adaptation",
                "Whether colours are corrected for the present illumination.",
            )
            .or(default.illumination_adaptation),
    };
    edge.checked(settings.check())?;
    Some(settings)
}

fn read_patch(
    patch: &Table,
    default: PatchSettings,
    shape: Option<&Shape>,
    default_scale: &'static str,
) -> Option<PatchSettings> {
    let scale = patch
        .key("scale", "Size of the region in sizes of the target.")
        .within(above(0.0, 100.0))
        .depends(default_scale)
        .or(default.scale);
    let samples = patch
        .key("samples", "Samples along each side of the region.")
        .within(1.0..=64.0)
        .depends(if default_scale.is_empty() { "" } else { "10" })
        .or(default.samples);
    let bins = patch
        .key("bins", "Bins per colour channel: 2, 4, 8, 16, 32 or 64.")
        .within(2.0..=64.0)
        .or(default.bins.count());
    let sigma = patch
        .key(
            "sigma",
            "Standard deviation σ of the likelihood exp(−D²/2σ²).",
        )
        .within(above(0.0, 1000.0))
        .or(default.sigma);
    if shape.is_some_and(|shape| !matches!(shape, Shape::Flat(_))) {
        patch.problem_here(
            "applies to flat targets only; give shape.disc or shape.rectangle, or remove it",
        );
        return None;
    }
    let settings = PatchSettings {
        scale,
        samples,
        bins: patch.checked(ChannelBins::new(bins))?,
        sigma,
    };
    patch.checked(settings.check().map(|()| settings))
}

fn read_window(window: &Table) -> Option<WindowSettings> {
    let size_px = window
        .key("size_px", "Width and height of the window; odd.")
        .within(1.0..=101.0)
        .or(WindowSettings::default().size_px);
    let default = WindowSettings::of_size(size_px);
    let floor = window
        .key("floor", "Least likelihood of a window inside the image.")
        .within(above(0.0, 1.0))
        .depends("one pixel: 1 / size_px²")
        .or(default.floor);
    let outside = window
        .key(
            "outside",
            "Likelihood of a window outside the image or masked.",
        )
        .within(above(0.0, 1.0))
        .depends("one pixel: 1 / size_px²")
        .or(default.outside);
    let hue_deg = window
        .key(
            "hue_deg",
            "Least and greatest hue of the target's colours; [340, 20] contains 0. Together with `saturation`.",
        )
        .within(0.0..=360.0)
        .depends("learned with the colour model")
        .optional();
    let saturation = window
        .key(
            "saturation",
            "Least and greatest saturation. Together with `hue_deg`.",
        )
        .within(0.0..=1.0)
        .depends("learned with the colour model")
        .optional();
    let intensity = window
        .key(
            "intensity",
            "Least and greatest intensity. Only with `hue_deg` and `saturation`.",
        )
        .within(0.0..=1.0)
        .depends("[0.1, 0.9] with `hue_deg` and `saturation`; else learned with the colour model")
        .optional();
    let ranges = if window.has("hue_deg") || window.has("saturation") {
        for key in ["hue_deg", "saturation"] {
            if !window.has(key) {
                window.problem(key, "is missing; hue_deg and saturation go together");
            }
        }
        Some(ColorRanges {
            hue_deg: hue_deg?,
            saturation: saturation?,
            intensity: intensity.unwrap_or(ColorRanges::INTENSITY),
        })
    } else {
        if window.has("intensity") {
            let message = "needs hue_deg and saturation; add them, or remove it: all are learned with the colour model";
            window.problem("intensity", message);
        }
        None
    };
    let settings = WindowSettings {
        size_px,
        floor,
        outside,
        ranges,
    };
    window.checked(settings.check().map(|()| settings))
}

/// Reads the contour cue. The defaults are those of the shape.
fn read_contour(contour: &Table, default: ContourSettings) -> Option<ContourSettings> {
    let points = contour
        .key("points", "Number of points on the outline.")
        .within(3.0..=10_000.0)
        .depends("50; 120 for upright shapes")
        .or(default.points);
    let scaled = read_scaled(contour, &default.sampling);
    let about = "Samples the image along the normals of a spline through the outline (Taiana 2007, equations 4.1 to 4.6), in place of `inner_scale`, `outer_scale` and `shared_pixels`.";
    let spline = contour.section("spline", about, |spline| read_spline(spline, points));
    let sampling = if contour.has("spline") {
        for key in ["inner_scale", "outer_scale", "shared_pixels"] {
            if contour.has(key) {
                contour.conflict(key, "spline");
            }
        }
        spline
    } else {
        scaled
    };
    let kappa = contour
        .key(
            "kappa",
            "Weight κ of the difference between inside and outside, relative to the similarity of inside and model.",
        )
        .within(0.0..=1e6)
        .or(default.kappa);
    let b = contour
        .key("b", "Width b of the likelihood exp(−D/b).")
        .within(above(0.0, 1e6))
        .or(default.b);
    let settings = ContourSettings {
        points,
        sampling: sampling?,
        kappa,
        b,
    };
    contour.checked(settings.check().map(|()| settings))
}

fn read_scaled(contour: &Table, default: &Sampling) -> Option<Sampling> {
    let Sampling::Scaled(default) = default else {
        unreachable!("no shape's default is a spline")
    };
    let inner_scale = contour
        .key(
            "inner_scale",
            "Scale of the shape whose outline is the inner contour.",
        )
        .within(between(0.0, 1.0))
        .depends("0.9; 0.75 for upright shapes")
        .or(default.inner_scale);
    let outer_scale = contour
        .key(
            "outer_scale",
            "Scale of the shape whose outline is the outer contour; above 1.",
        )
        .within(above(1.0, 10.0))
        .depends("1.1; 1.25 for upright shapes")
        .or(default.outer_scale);
    let about = "Remedy for small projections: where the inner and outer contour share too many pixels, both are sampled at a fixed distance from the outline.";
    let shared_pixels = contour.section("shared_pixels", about, |table| {
        let default = SharedPixels::default();
        Some(SharedPixels {
            max_share: table
                .key(
                    "max_share",
                    "Share of the inner contour's pixels that may be shared.",
                )
                .within(0.0..1.0)
                .or(default.max_share),
            distance_px: table
                .key(
                    "distance_px",
                    "Distance of the samples from the outline otherwise.",
                )
                .within(above(0.0, 100.0))
                .or(default.distance_px),
        })
    });
    Some(Sampling::Scaled(ScaledSampling {
        inner_scale,
        outer_scale,
        shared_pixels,
    }))
}

fn read_spline(spline: &Table, points: usize) -> Option<Sampling> {
    let default = SplineSampling::of_points(points);
    let settings = Sampling::Spline(SplineSampling {
        control_points: spline
            .key(
                "control_points",
                "Number of control points; at most half of `points`.",
            )
            .within(3.0..=5000.0)
            .depends("a quarter of `points`, at least 3")
            .or(default.control_points),
        reach_px: spline
            .key("reach_px", "How far along the normals the samples reach.")
            .within(above(0.0, 100.0))
            .or(default.reach_px),
        steps: spline
            .key("steps", "Samples along each normal on either side.")
            .within(1.0..=10.0)
            .or(default.steps),
        middle: spline
            .key(
                "middle",
                "Whether the sample on the outline itself counts on both sides.",
            )
            .or(default.middle),
    });
    spline.checked(settings.check(points).map(|()| settings))
}
