//! What a target looks like: its shape, and how its outline is compared with the image.

use super::reader::Table;
use super::target::kind_of;
use crate::likelihood::{ContourSettings, Overlap, Sampling, ScaledSampling, SplineSampling};
use crate::shape::{Section, Shape, Sphere, SphereOutline, Upright, UprightOutline};

pub(super) fn read_shape(table: &Table) -> Option<Shape> {
    let (kind, body) = kind_of(table, "shape", &["sphere", "cylinder", "prism"])?;
    let shape = match kind {
        "sphere" => read_sphere(&body),
        "cylinder" => {
            let radius_m = body.required("radius_m");
            let section = radius_m.and_then(|radius_m| body.checked(Section::circle(radius_m)));
            read_upright(&body, section)
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

/// The defaults are those of the shape; where it could not be read, those of a ball.
pub(super) fn read_contour(table: &Table, shape: Option<&Shape>) -> Option<ContourSettings> {
    let default = shape.map_or_else(ContourSettings::default, ContourSettings::of_shape);
    let Some(contour) = table.table("contour") else {
        return Some(default);
    };
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
        Some(read_scaled(&contour, &default.sampling))
    };
    let kappa = contour.or("kappa", default.kappa);
    let b = contour.or("b", default.b);
    let checked = sampling.and_then(|sampling| {
        let settings = ContourSettings {
            points,
            sampling,
            kappa,
            b,
        };
        contour.checked(settings.check().map(|()| settings))
    });
    contour.finish();
    checked
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
