//! What a target looks like: its shape, and the cues that compare it with the images.

use super::reader::Table;
use super::target::{CameraNames, kind_of};
use pardalis::color::{ChannelBins, ColorRanges};
use pardalis::likelihood::{
    ContourSettings, Cue, CueSettings, EdgeSettings, Overlap, PatchSettings, Sampling,
    ScaledSampling, SplineSampling, WindowSettings,
};
use pardalis::shape::{Flat, Section, Shape, Sphere, SphereOutline, Upright, UprightOutline};

/// The table `shape`. Cameras that are known by a plane alone do not see how high anything is.
pub(super) fn read_shape(table: &Table, cameras: &CameraNames) -> Option<Shape> {
    let shape = read_body(table)?;
    let is_on_plane = matches!(shape, Shape::Flat(flat) if flat.height_m == 0.0);
    if !is_on_plane && let Some(camera) = cameras.without_height.first() {
        table.problem(
            "shape",
            format!(
                "rises over the plane, but where camera \"{camera}\" stands is not known; give cameras.{camera}.model.plane.camera_center_m \
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
                "lies {} m over the plane, and camera \"{camera}\" stands {height_m} m over it; allowed: below the camera",
                flat.height_m
            ),
        );
        return None;
    }
    Some(shape)
}

fn read_body(table: &Table) -> Option<Shape> {
    let (kind, body) = kind_of(
        table,
        "shape",
        &["sphere", "cylinder", "prism", "disc", "rectangle"],
    )?;
    let shape = match kind {
        "sphere" => read_sphere(&body),
        "cylinder" => {
            let radius_m = body.required("radius_m");
            let section = radius_m.and_then(|radius_m| body.checked(Section::circle(radius_m)));
            read_upright(&body, section)
        }
        "disc" => {
            let radius_m = body.required("radius_m");
            let height_m = body.or("height_m", 0.0);
            let disc = radius_m.map(|radius_m| Flat::disc(radius_m, height_m));
            disc.and_then(|disc| body.checked(disc)).map(Shape::Flat)
        }
        "rectangle" => {
            let size_m = body.required("size_m");
            let height_m = body.or("height_m", 0.0);
            let rectangle = size_m.map(|size_m| Flat::rectangle(size_m, height_m));
            rectangle
                .and_then(|rectangle| body.checked(rectangle))
                .map(Shape::Flat)
        }
        _ => {
            let sides = body.or("sides", 8_usize);
            let across_flats_m = body.required("across_flats_m");
            let turn_deg: f64 = body.or("turn_deg", 0.0);
            let section = across_flats_m.and_then(|across_flats_m| {
                let polygon = Section::polygon(sides, across_flats_m, turn_deg.to_radians());
                body.checked(polygon)
            });
            read_upright(&body, section)
        }
    };
    body.finish();
    shape
}

fn read_sphere(sphere: &Table) -> Option<Shape> {
    let radius_m = sphere.required("radius_m");
    let outlines = [
        ("tangent", SphereOutline::Tangent),
        ("greatcircle", SphereOutline::Greatcircle),
    ];
    let outline = sphere.word("outline", &outlines, "tangent");
    sphere
        .checked(Sphere::new(radius_m?, outline?))
        .map(Shape::Sphere)
}

fn read_upright(body: &Table, section: Option<Section>) -> Option<Shape> {
    let height_m = body.required("height_m");
    let outlines = [
        ("exact", UprightOutline::Exact),
        ("facing", UprightOutline::Facing),
    ];
    let outline = body.word("outline", &outlines, "exact");
    body.checked(Upright::new(section?, height_m?, outline?))
        .map(Shape::Upright)
}

/// The keys of the published cues.
const PUBLISHED_CUES: [&str; 4] = ["contour", "window", "region", "difference"];

/// The cues of a target, which say in which way it is tracked.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum CuesConfig {
    /// The edge cue detects the target.
    Edge(EdgeSettings),
    /// These track it from a given start.
    Published(Vec<CueSettings>),
}

/// Reads the cues of a target: each that has a table. If none has, the edge cue, or the contour cue if the scene says where the target starts.
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
        "region" => read_patch(table, within, shape).map(Cue::Region),
        _ => read_patch(table, PatchSettings::around(), shape).map(Cue::Difference),
    };
    let (mut found, mut fine) = (false, true);
    let mut cues = Vec::new();
    for key in PUBLISHED_CUES {
        found |= table.has(key);
        let Some(cue_table) = table.table(key) else {
            fine &= !table.has(key);
            continue;
        };
        let cue = read(key, &cue_table);
        let cameras = read_cameras(&cue_table, cameras);
        cue_table.finish();
        match (cue, cameras) {
            (Some(cue), Ok(cameras)) => cues.push(CueSettings { cue, cameras }),
            _ => fine = false,
        }
    }
    let has_edge = table.has("edge");
    let edge = table.table("edge").map(|edge_table| {
        let edge = read_edge(&edge_table);
        edge_table.finish();
        edge
    });
    if has_edge && found {
        table.problem(
            "edge",
            "stands beside published cues, but detects its target by itself; keep it alone, or leave it out",
        );
        return None;
    }
    if has_edge {
        return edge.flatten().map(CuesConfig::Edge);
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
        if fine && !looked_at(camera) {
            table.problem_here(format!(
                "no cue looks at camera \"{name}\"; name it in the `cameras` of one"
            ));
            fine = false;
        }
    }
    (fine && !cues.is_empty()).then_some(CuesConfig::Published(cues))
}

/// The numbers of the cameras that a cue names; none where it names none, and an error, which the journal says, where it names wrong ones.
fn read_cameras(cue: &Table, cameras: &[String]) -> Result<Option<Vec<usize>>, ()> {
    let names = cue.optional::<Vec<String>>("cameras");
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
            "is empty; leave it out for all cameras, or leave out the cue",
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
        correspondence_lines: edge.or("correspondence_lines", default.correspondence_lines),
        likelihood_exponent: edge.or("likelihood_exponent", default.likelihood_exponent),
        shared_sigma_px: edge.or("shared_sigma_px", default.shared_sigma_px),
        learned_profile: edge.or("learned_profile", default.learned_profile),
        lit_and_shaded_profiles: edge
            .or("lit_and_shaded_profiles", default.lit_and_shaded_profiles),
        background_model: edge.or("background_model", default.background_model),
        color_evidence: edge.or("color_evidence", default.color_evidence),
        illumination_adaptation: edge
            .or("illumination_adaptation", default.illumination_adaptation),
    };
    edge.checked(settings.check())?;
    Some(settings)
}

fn read_patch(
    patch: &Table,
    default: PatchSettings,
    shape: Option<&Shape>,
) -> Option<PatchSettings> {
    let scale = patch.or("scale", default.scale);
    let samples = patch.or("samples", default.samples);
    let bins = ChannelBins::new(patch.or("bins", default.bins.count()));
    let sigma = patch.or("sigma", default.sigma);
    if shape.is_some_and(|shape| !matches!(shape, Shape::Flat(_))) {
        patch.problem_here(
            "looks at a flat region; give shape.disc or shape.rectangle, or leave it out",
        );
        return None;
    }
    let settings = PatchSettings {
        scale,
        samples,
        bins: patch.checked(bins)?,
        sigma,
    };
    patch.checked(settings.check().map(|()| settings))
}

fn read_window(window: &Table) -> Option<WindowSettings> {
    let size_px = window.or("size_px", WindowSettings::default().size_px);
    let default = WindowSettings::of_size(size_px);
    let floor = window.or("floor", default.floor);
    let outside = window.or("outside", default.outside);
    let hue_deg = window.optional("hue_deg");
    let saturation = window.optional("saturation");
    let ranges = if window.has("hue_deg") || window.has("saturation") {
        let intensity = window.or("intensity", ColorRanges::INTENSITY);
        for key in ["hue_deg", "saturation"] {
            if !window.has(key) {
                window.problem(key, "is missing; hue_deg and saturation go together");
            }
        }
        Some(ColorRanges {
            hue_deg: hue_deg?,
            saturation: saturation?,
            intensity,
        })
    } else {
        if window.knows("intensity") {
            let message = "stands without hue_deg and saturation; give these too, or leave it out: all are learnt with the colour model";
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

/// The defaults are those of the shape.
fn read_contour(contour: &Table, default: ContourSettings) -> Option<ContourSettings> {
    let points = contour.or("points", default.points);
    let sampling = if contour.has("spline") {
        for key in ["inner_scale", "outer_scale", "overlap"] {
            if contour.knows(key) {
                contour.problem(
                    key,
                    "stands beside spline, which does without it; remove one of them",
                );
            }
        }
        contour
            .table("spline")
            .and_then(|spline| read_spline(spline, points))
    } else {
        Some(read_scaled(contour, &default.sampling))
    };
    let kappa = contour.or("kappa", default.kappa);
    let b = contour.or("b", default.b);
    sampling.and_then(|sampling| {
        let settings = ContourSettings {
            points,
            sampling,
            kappa,
            b,
        };
        contour.checked(settings.check().map(|()| settings))
    })
}

fn read_scaled(contour: &Table, default: &Sampling) -> Sampling {
    let Sampling::Scaled(default) = default else {
        unreachable!("no shape's default is a spline")
    };
    Sampling::Scaled(ScaledSampling {
        inner_scale: contour.or("inner_scale", default.inner_scale),
        outer_scale: contour.or("outer_scale", default.outer_scale),
        overlap: contour.table("overlap").map(|table| {
            let default = Overlap::default();
            let overlap = Overlap {
                max_share: table.or("max_share", default.max_share),
                distance_px: table.or("distance_px", default.distance_px),
            };
            table.finish();
            overlap
        }),
    })
}

fn read_spline(spline: Table, points: usize) -> Option<Sampling> {
    let settings = Sampling::Spline(SplineSampling {
        control_points: spline.or("control_points", (points / 4).max(3)),
        reach_px: spline.or("reach_px", 2.0),
        steps: spline.or("steps", 2),
        middle: spline.or("middle", false),
    });
    let checked = spline.checked(settings.check(points).map(|()| settings));
    spline.finish();
    checked
}
