//! The cues that compare a target with the images.

use super::description::{above, between};
use super::reader::{Kind, Table};
use pardalis::color::{ChannelBins, ColorRanges};
use pardalis::likelihood::{
    ContourSettings, Cue, CueSettings, EdgeSettings, PatchSettings, Sampling, ScaledSampling,
    SharedPixels, SplineSampling, WindowSettings,
};
use pardalis::shape::Shape;

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

/// Description of the edge cue.
const ABOUT_EDGE: &str = "Edge cue: detects the target itself, needs no start and stands alone. The default of targets without cues and start.";

/// The cues of a target, which determine how it is tracked.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum CuesConfig {
    /// The edge cue detects the target.
    Edge(EdgeSettings),
    /// Cues that track it from a given start.
    Published(Vec<CueSettings>),
}

/// Reads the cues of a target: each cue that has a table. Without any, the target has the edge cue, which detects it,
/// or, if the scene states a start, the contour cue.
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
            let mut settings = CueSettings::from(cue);
            settings.cameras = cameras;
            Some(settings)
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

/// Returns the indices of the cameras that a cue names, `None` if it names none, or an error after reporting a problem.
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
    let mut settings = EdgeSettings::default();
    settings.correspondence_lines = edge
        .key(
            "correspondence_lines",
            "Number of correspondence lines across the outline.",
        )
        .within(16.0..=1000.0)
        .or(settings.correspondence_lines);
    settings.likelihood_exponent = edge
        .key(
            "likelihood_exponent",
            "Exponent of each pixel's likelihood; below 1 because neighbouring pixels are correlated.",
        )
        .within(above(0.0, 1.0))
        .or(settings.likelihood_exponent);
    settings.shared_sigma_px = edge
        .key(
            "shared_sigma_px",
            "Standard deviation of errors that all lines of an outline share, such as shading.",
        )
        .within(0.0..=10.0)
        .or(settings.shared_sigma_px);
    settings.learned_profile = edge
        .key(
            "learned_profile",
            "Whether the profile of edges is the learned one; otherwise it is a smooth step.",
        )
        .or(settings.learned_profile);
    settings.lit_and_shaded_profiles = edge
        .key(
            "lit_and_shaded_profiles",
            "Whether the lit and the shaded side have profiles of their own.",
        )
        .or(settings.lit_and_shaded_profiles);
    settings.background_model = edge
        .key(
            "background_model",
            "Whether parts of the outline that something else covers are ignored.",
        )
        .or(settings.background_model);
    settings.color_evidence = edge
        .key(
            "color_evidence",
            "Whether the mean colour within the outline contributes to the log-likelihood ratio of a detection.",
        )
        .or(settings.color_evidence);
    settings.illumination_adaptation = edge
        .key(
            "illumination_adaptation",
            "Whether colours are corrected for the present illumination.",
        )
        .or(settings.illumination_adaptation);
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
    let mut settings = default;
    settings.scale = scale;
    settings.samples = samples;
    settings.bins = patch.checked(ChannelBins::new(bins))?;
    settings.sigma = sigma;
    patch.checked(settings.check().map(|()| settings))
}

fn read_window(window: &Table) -> Option<WindowSettings> {
    let size_px = window
        .key("size_px", "Width and height of the window; odd.")
        .within(1.0..=101.0)
        .or(WindowSettings::default().size_px);
    let default = WindowSettings::of_size(size_px);
    let floor = window
        .key("floor", "Minimum likelihood of a window inside the image.")
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
            "Minimum and maximum hue of the target's colours; [340, 20] contains 0. Together with `saturation`.",
        )
        .within(0.0..=360.0)
        .depends("learned with the colour model")
        .optional();
    let saturation = window
        .key(
            "saturation",
            "Minimum and maximum saturation. Together with `hue_deg`.",
        )
        .within(0.0..=1.0)
        .depends("learned with the colour model")
        .optional();
    let intensity = window
        .key(
            "intensity",
            "Minimum and maximum intensity. Only with `hue_deg` and `saturation`.",
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
    let mut settings = default;
    settings.floor = floor;
    settings.outside = outside;
    settings.ranges = ranges;
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
        Some(scaled)
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
    let mut settings = default;
    settings.points = points;
    settings.sampling = sampling?;
    settings.kappa = kappa;
    settings.b = b;
    contour.checked(settings.check().map(|()| settings))
}

fn read_scaled(contour: &Table, default: &Sampling) -> Sampling {
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
    Sampling::Scaled(ScaledSampling {
        inner_scale,
        outer_scale,
        shared_pixels,
    })
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
