//! The exact mirror camera compared with rendered pixels, closed forms, the law of reflection and
//! its look-up table.

use crate::mirrors;
use crate::mirrors::{CENTER_PX, F_PX, camera_json, mirrors, table};
use nalgebra::{Point3, Vector3};
use pardalis_camera::CalibratedCamera;
use pardalis_camera::pose_from_matrix;
use pardalis_camera::{
    Camera, ConstantResolution, ExactMirror, MirrorProfile, Projection, Ray, Resolution, Unified,
};
use pardalis_scene::calibration;

fn at(ray: &Ray<f64>, range_m: f64) -> [f64; 3] {
    std::array::from_fn(|i| ray.origin[i] + range_m * ray.direction[i])
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).powi(2))
        .sum::<f64>()
        .sqrt()
}

/// Returns pixels throughout a mirror's image, except on the axis, and their rays.
fn rays(mirror: &ExactMirror<f64>) -> Vec<([f64; 2], Ray<f64>)> {
    let profile = mirror.profile();
    let [f, ..] = profile.at(profile.rim_m());
    let rim = profile.rim_m() / f;
    (0..=400)
        .filter_map(|i| {
            let rho = rim * (f64::from(i) + 0.01) / 400.02;
            let (sin, cos) = (f64::from(i) * 0.7).sin_cos();
            let pixel = [
                CENTER_PX[0] + F_PX[0] * rho * cos,
                CENTER_PX[1] + F_PX[1] * rho * sin,
            ];
            mirror.unproject(pixel).map(|ray| (pixel, ray))
        })
        .collect()
}

/// Returns distances from the mirror, from 0.01 mm to half a kilometre.
fn ranges_m() -> impl Iterator<Item = f64> {
    (0..24).map(|i| 1e-5 * 2.17_f64.powi(i))
}

#[test]
fn known_points_project_to_the_pixels_of_the_rendered_camera() {
    let json = camera_json();
    let camera = &json["perspective_camera"];
    let number = |key: &str| camera[key].as_f64().unwrap();
    let mirror = |profile: MirrorProfile| {
        ExactMirror::new(
            [number("fx"), number("fy")],
            [number("cx"), number("cy")],
            profile,
        )
        .unwrap()
    };
    let rows = table();
    let without_slopes: Vec<_> = rows.iter().map(|&[t, f, _]| [t, f]).collect();
    let mirrors = [
        mirror(MirrorProfile::from_rows_with_slopes(&rows).unwrap()),
        mirror(MirrorProfile::from_rows(&without_slopes).unwrap()),
    ];
    let pose: [[f64; 4]; 4] = serde_json::from_value(json["T_world_from_camera"].clone()).unwrap();
    let camera_from_world = pose_from_matrix(pose).unwrap().inverse();
    let text = std::fs::read_to_string(mirrors::folder().join("correspondences.csv")).unwrap();
    let mut checked = 0;
    for line in text.lines().skip(1) {
        let numbers: Vec<f64> = line.split(',').map(|v| v.parse().unwrap()).collect();
        let point = camera_from_world * Point3::new(numbers[1], numbers[2], numbers[3]);
        for mirror in &mirrors {
            let ([u, v], valid) = mirror.project(point.into());
            let error = (u - numbers[4]).hypot(v - numbers[5]);
            assert!(valid && error < 0.001, "{line}: {u} {v}");
        }
        checked += 1;
    }
    assert_eq!(checked, 40);
}

#[test]
fn rays_obey_the_law_of_reflection() {
    for (name, mirror) in mirrors() {
        for (pixel, ray) in rays(&mirror) {
            let [x, y, z] = ray.origin;
            let t = x.hypot(y);
            let [f, slope, _] = mirror.profile().at(t);
            assert!(
                (f - z).abs() < 1e-12,
                "{name}: {pixel:?} starts off the mirror"
            );
            let incoming = Vector3::from(ray.origin).normalize();
            let outgoing = Vector3::from(ray.direction);
            assert!((outgoing.norm() - 1.0).abs() < 1e-12, "{name}");
            let normal = Vector3::new(slope * x / t, slope * y / t, -1.0).normalize();
            let mirrored = incoming - 2.0 * normal * normal.dot(&incoming);
            assert!((mirrored - outgoing).norm() < 1e-9, "{name}: {pixel:?}");
        }
    }
}

#[test]
fn points_on_a_ray_project_to_its_pixel() {
    for (name, mirror) in mirrors() {
        let rays = rays(&mirror);
        assert!(rays.len() >= 400, "{name}: {} rays", rays.len());
        for (pixel, ray) in rays {
            for range_m in ranges_m() {
                let (seen, valid) = mirror.project(at(&ray, range_m));
                let error = distance(&seen, &pixel);
                assert!(
                    valid && error < 1e-9 * 1000.0,
                    "{name}: {error} px at {pixel:?}, {range_m} m"
                );
            }
            // Behind the surface the ray has no visible points, unless it passes through a tip.
            let behind_m = 1e-5_f64.min(0.1 * ray.origin[0].hypot(ray.origin[1]));
            let (_, valid) = mirror.project(at(&ray, -behind_m));
            assert!(!valid, "{name}: inside the mirror at {pixel:?}");
        }
    }
}

#[test]
fn visible_points_lie_on_the_ray_of_their_pixel() {
    for (name, mirror) in mirrors() {
        let (mut visible, mut hidden) = (0, 0);
        for [r, z] in mirrors::points(&mirror) {
            let point = [0.6 * r, 0.8 * r, z];
            let (pixel, valid) = mirror.project(point);
            if !valid {
                hidden += 1;
                continue;
            }
            visible += 1;
            let ray = mirror
                .unproject(pixel)
                .expect("a ray for a pixel in the domain");
            let range_m = distance(&ray.origin, &point);
            assert!(
                distance(&at(&ray, range_m), &point) < 1e-9 * (1.0 + range_m),
                "{name}: {point:?}"
            );
        }
        assert!(
            visible > 1000 && hidden > 1000,
            "{name}: {visible} {hidden}"
        );
    }
}

#[test]
fn hidden_and_non_finite_points_have_no_pixel() {
    for (name, mirror) in mirrors() {
        let camera = Camera::ExactMirror(mirror.clone());
        let profile = mirror.profile();
        let (rim_m, vertex_m) = (profile.rim_m(), profile.vertex_m());
        let inside_and_above = [
            [0.5 * rim_m, 0.0, profile.at(0.5 * rim_m)[0] + 1e-6],
            [0.0, 0.0, vertex_m + 0.01],
            [0.0, 0.0, 1e3],
            [0.0, 1e-3, 1e6],
        ];
        for point in inside_and_above {
            assert_eq!(camera.project(point), None, "{name}: {point:?}");
            assert!(
                !mirror.to_f32().project(point.map(|v| v as f32)).1,
                "{name}: {point:?}"
            );
        }
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            for point in [
                [bad, 0.1, -1.0],
                [0.1, bad, -1.0],
                [0.1, 0.2, bad],
                [bad; 3],
            ] {
                assert_eq!(camera.project(point), None, "{name}: {point:?}");
                assert!(
                    !mirror.to_f32().project(point.map(|v| v as f32)).1,
                    "{name}: {point:?}"
                );
            }
            assert_eq!(camera.unproject([bad, 240.0]), None, "{name}");
            assert_eq!(
                mirror.to_f32().unproject([bad as f32, 240.0]),
                None,
                "{name}"
            );
        }
        let beyond_rim = [
            CENTER_PX[0] + F_PX[0] * (rim_m / profile.at(rim_m)[0] + 1e-6),
            CENTER_PX[1],
        ];
        assert_eq!(camera.unproject(beyond_rim), None, "{name}");
    }
}

#[test]
fn the_axis_is_visible_at_the_centre_except_in_mirrors_with_a_tip() {
    for (name, mirror) in mirrors() {
        let tip = mirror.profile().at(0.0)[1] > 0.0;
        for z in [mirror.profile().vertex_m() - 1e-4, 0.0, -1.0, -1e3] {
            for r in [0.0, 1e-200, 1e-12] {
                let (pixel, valid) = mirror.project([r, 0.0, z]);
                assert_eq!(valid, !tip, "{name}: z = {z}, r = {r}");
                assert!(tip || distance(&pixel, &CENTER_PX) < 1e-7, "{name}");
            }
            let (pixel, valid) = mirror.to_f32().project([0.0, 0.0, z as f32]);
            assert_eq!(valid, !tip, "{name}: look-up, z = {z}");
            assert!(
                tip || distance(&pixel.map(f64::from), &CENTER_PX) < 1e-3,
                "{name}"
            );
        }
        let ray = mirror.unproject(CENTER_PX);
        assert_eq!(
            ray.map(|ray| ray.direction),
            (!tip).then_some([0.0, 0.0, -1.0]),
            "{name}"
        );
    }
}

#[test]
fn a_hyperboloid_with_the_pinhole_at_its_outer_focus_is_the_unified_model() {
    let (a, b) = (0.028_f64, 0.023_f64);
    let c = a.hypot(b);
    let profile = MirrorProfile::hyperboloid(a + c, [a, b], 0.035).unwrap();
    let mirror = ExactMirror::new(F_PX, CENTER_PX, profile).unwrap();
    let focus = [0.0, 0.0, 2.0 * c];
    for (pixel, ray) in rays(&mirror) {
        let range_m = distance(&ray.origin, &focus);
        assert!(distance(&at(&ray, -range_m), &focus) < 1e-12, "{pixel:?}");
    }
    // Around the inner focus, with eccentricity e: l = 2e/(1 + e²), f·(l + m) = f·(e² − 1)/(1 + e²)
    // (Geyer and Daniilidis 2000).
    let e2 = c * c / (a * a);
    let l = 2.0 * e2.sqrt() / (1.0 + e2);
    let unified = Unified::new(l, (e2 - 1.0) / (1.0 + e2) - l, F_PX[0], CENTER_PX).unwrap();
    let mut checked = 0;
    for [r, z] in mirrors::points(&mirror) {
        let ([_, v], valid) = mirror.project([0.0, r, z]);
        if valid {
            let ([_, expected], _) = unified.project([0.0, r, z - focus[2]]);
            let error = (v - CENTER_PX[1]) / F_PX[1] - (expected - CENTER_PX[1]) / F_PX[0];
            assert!(error.abs() < 1e-11, "{r} {z}: {error}");
            checked += 1;
        }
    }
    assert!(checked > 1000, "{checked}");
}

#[test]
fn the_look_up_is_accurate_to_a_fiftieth_of_a_pixel() {
    for (name, mirror) in mirrors() {
        let look_up = mirror.to_f32();
        let (mut worst, mut seen) = (0_f64, 0);
        for [r, z] in mirrors::points(&mirror) {
            let point = [0.6 * r, -0.8 * r, z].map(|v| v as f32);
            let (exact, valid) = mirror.project(point.map(f64::from));
            let (pixel, found) = look_up.project(point);
            if valid && found {
                worst = worst.max(distance(&pixel.map(f64::from), &exact));
                seen += 1;
            } else if valid != found {
                // Allowed within half a pixel of the image of the rim or vertex, and at the
                // mirror's surface.
                let rho = (exact[0] - CENTER_PX[0]).hypot(exact[1] - CENTER_PX[1]);
                let pixel_rho = f64::from(pixel[0] - CENTER_PX[0] as f32)
                    .hypot(f64::from(pixel[1]) - CENTER_PX[1]);
                let rho = if valid { rho } else { pixel_rho };
                let profile = mirror.profile();
                let rim_m = profile.rim_m();
                let rim = F_PX[1] * rim_m / profile.at(rim_m)[0];
                let in_front_m = if r <= rim_m {
                    profile.at(r)[0] - z
                } else {
                    f64::INFINITY
                };
                let at_border = rho > rim - 0.5 || rho < 0.5 || in_front_m.abs() < 5e-5;
                assert!(
                    at_border,
                    "{name}: {point:?} is seen at {exact:?}: {valid}, look-up {pixel:?}: {found}"
                );
            }
        }
        assert!(worst < 0.02, "{name}: {worst} px");
        assert!(seen > 10_000, "{name}: {seen}");
    }
}

#[test]
fn the_look_up_unprojects_like_the_exact_model() {
    for (name, mirror) in mirrors() {
        let look_up = mirror.to_f32();
        for (pixel, ray) in rays(&mirror) {
            let found = look_up.unproject(pixel.map(|v| v as f32)).expect("a ray");
            assert!(
                distance(&found.origin.map(f64::from), &ray.origin) < 1e-6,
                "{name}: {pixel:?} {found:?} {ray:?}"
            );
            assert!(
                distance(&found.direction.map(f64::from), &ray.direction) < 1e-4,
                "{name}: {pixel:?} {found:?} {ray:?}"
            );
        }
    }
}

#[test]
fn jacobians_agree_with_finite_differences() {
    for (name, mirror) in mirrors() {
        let camera = Camera::ExactMirror(mirror.clone());
        let values: Vec<f64> = camera.parameters().iter().map(|p| p.1).collect();
        let mut checked = 0;
        let on_axis = [[0.0, 0.0, -0.7], [0.0, 0.0, 0.01]];
        let beside = rays(&mirror)
            .into_iter()
            .step_by(7)
            .flat_map(|(_, ray)| [0.02, 0.9, 7.0].map(|range_m| at(&ray, range_m)));
        for point in on_axis.into_iter().chain(beside) {
            let Some(jacobian) = camera.project_with_jacobian(point) else {
                continue;
            };
            assert_eq!(Some(jacobian.pixel), camera.project(point), "{name}");
            let step = 1e-6;
            for axis in 0..3 {
                let shifted = |sign: f64| {
                    let mut p = point;
                    p[axis] += sign * step;
                    camera.project(p)
                };
                let (Some(after), Some(before)) = (shifted(1.0), shifted(-1.0)) else {
                    continue;
                };
                for c in 0..2 {
                    let numeric = (after[c] - before[c]) / (2.0 * step);
                    let slope = jacobian.by_point[c][axis];
                    assert!(
                        (slope - numeric).abs() < 1e-5 * (100.0 + numeric.abs()),
                        "{name}: {slope} {numeric} by axis {axis} at {point:?}"
                    );
                    checked += 1;
                }
            }
            for (i, slopes) in jacobian.by_parameters.iter().enumerate() {
                let step = 1e-6 * values[i];
                let shifted = |sign: f64| {
                    let mut values = values.clone();
                    values[i] += sign * step;
                    camera.with_parameters(&values).unwrap().project(point)
                };
                let (Some(after), Some(before)) = (shifted(1.0), shifted(-1.0)) else {
                    continue;
                };
                for c in 0..2 {
                    let numeric = (after[c] - before[c]) / (2.0 * step);
                    assert!(
                        (slopes[c] - numeric).abs() < 1e-5 * (100.0 + numeric.abs()),
                        "{name}: {} {numeric} by parameter {i} at {point:?}",
                        slopes[c]
                    );
                    checked += 1;
                }
            }
        }
        assert!(checked > 1000, "{name}: {checked}");
    }
}

#[test]
fn the_design_reproduces_the_rendered_mirror() {
    let json = camera_json();
    let number = |key: &str| json[key].as_f64().unwrap();
    let design = ConstantResolution {
        vertex_m: number("camera_to_mirror_vertex_m"),
        rim_m: number("mirror_radius_m"),
        plane_z_m: -number("camera_height_above_floor_m"),
        resolution: Resolution::PerMetre(number("a_per_m")),
        offset: number("b"),
    };
    let [t_rim, f_rim, _] = table()[200];
    let rho_rim = t_rim / f_rim;
    let by_range = ConstantResolution {
        // Slightly more than the r_max_m of the rendered mirror's design.
        resolution: Resolution::RimShows(rho_rim / number("a_per_m")),
        ..design
    };
    for design in [design, by_range] {
        let profile = design.design().unwrap();
        for [t, f, slope] in table() {
            let found = profile.at(t);
            assert!(
                (found[0] - f).abs() < 1e-7,
                "F({t}) is {} instead of {f}",
                found[0]
            );
            assert!(
                (found[1] - slope).abs() < 1e-5,
                "F'({t}) is {} instead of {slope}",
                found[1]
            );
        }
    }
}

#[test]
fn a_designed_mirror_has_constant_resolution_on_its_plane() {
    let design = ConstantResolution {
        vertex_m: 0.16,
        rim_m: 0.08,
        plane_z_m: -0.82,
        resolution: Resolution::PerMetre(0.08),
        offset: 0.0,
    };
    let designs = [
        design,
        // With a tip: points within 0.25 m are not shown.
        ConstantResolution {
            offset: -0.02,
            ..design
        },
        ConstantResolution {
            resolution: Resolution::RimShows(3.0),
            plane_z_m: -2.5,
            ..design
        },
        // A ceiling between camera and mirror.
        ConstantResolution {
            plane_z_m: 0.05,
            resolution: Resolution::RimShows(4.0),
            ..design
        },
    ];
    for design in designs {
        let mirror = ExactMirror::new([1.0; 2], [0.0; 2], design.design().unwrap()).unwrap();
        let rim = mirror.profile().at(design.rim_m);
        let rho_rim = design.rim_m / rim[0];
        let (a, r_max_m) = match design.resolution {
            Resolution::PerMetre(a) => (a, (rho_rim - design.offset) / a),
            Resolution::RimShows(r_m) => ((rho_rim - design.offset) / r_m, r_m),
        };
        let nearest_m = -design.offset / a;
        for i in 0..=1000 {
            let r = nearest_m + (r_max_m - nearest_m) * (f64::from(i) + 0.001) / 1000.002;
            let ([rho, _], valid) = mirror.project([r, 0.0, design.plane_z_m]);
            assert!(valid, "{design:?}: r = {r}");
            assert!(
                (rho - (a * r + design.offset)).abs() < 1e-6,
                "{design:?}: r = {r}, rho = {rho}"
            );
        }
        assert!(!mirror.project([r_max_m * 1.001, 0.0, design.plane_z_m]).1);
        assert!(nearest_m == 0.0 || !mirror.project([nearest_m * 0.999, 0.0, design.plane_z_m]).1);
    }
}

fn rejected(profile: Result<MirrorProfile, pardalis_core::Error>, reason: &str) {
    let error = profile.expect_err(reason).to_string();
    assert!(error.contains(reason), "{error} does not contain {reason}");
}

#[test]
fn impossible_mirrors_are_rejected_with_the_reason() {
    for bad in [f64::NAN, f64::INFINITY, 0.0, -1.0, 1e4] {
        rejected(MirrorProfile::sphere(bad, 0.05, 0.03), "vertex_m");
        rejected(
            MirrorProfile::sphere(0.1, bad, 0.03),
            if bad == 1e4 {
                "radius_m"
            } else {
                "radius_m is"
            },
        );
        rejected(MirrorProfile::cone(0.1, 0.8, bad), "rim_m");
        rejected(MirrorProfile::cone(0.1, bad, 0.03), "half_angle_rad");
        rejected(MirrorProfile::paraboloid(0.1, bad, 0.03), "focal_m");
        rejected(MirrorProfile::hyperboloid(0.1, [bad, 0.02], 0.03), "a_m");
        rejected(MirrorProfile::hyperboloid(0.1, [0.02, bad], 0.03), "b_m");
    }
    rejected(MirrorProfile::sphere(0.1, 0.05, 0.05), "rim_m");
    // The pinhole sees the sphere up to 0.0471 m from the axis, and at 87 degrees up to 0.0462 m.
    assert!(MirrorProfile::sphere(0.1, 0.05, 0.0462).is_ok());
    rejected(MirrorProfile::sphere(0.1, 0.05, 0.0463), "hidden by itself");
    assert!(MirrorProfile::cone(0.1, 0.2, 0.05).is_ok());
    rejected(MirrorProfile::cone(0.1, 0.2, 0.1), "hidden by itself");

    let rows = |f: &dyn Fn(f64) -> f64| -> Vec<[f64; 2]> {
        (0..=50)
            .map(|i| f64::from(i) * 0.001)
            .map(|t| [t, f(t)])
            .collect()
    };
    let table = |f: &dyn Fn(f64) -> f64| MirrorProfile::from_rows(&rows(f));
    assert!(table(&|t| 0.1 + 5.0 * t * t).is_ok());
    rejected(table(&|_| f64::NAN), "row 1");
    rejected(table(&|_| 1e300), "row 1");
    rejected(table(&|t| 5.0 * t * t - 0.001), "vertex_m");
    rejected(table(&|t| 0.1 - 10.0 * t * t), "folded");
    rejected(table(&|t| 0.1 + 100.0 * t * t), "hidden by itself");
    rejected(
        table(&|t| 0.1 + 5.0 * t * t + 1e-5 * (t * 3e3).sin()),
        "folded",
    );
    rejected(MirrorProfile::from_rows(&rows(&|_| 0.1)[..4]), "4 rows");
    rejected(MirrorProfile::from_rows(&[]), "0 rows");
    rejected(MirrorProfile::from_rows(&rows(&|_| 0.1)[1..]), "first row");
    let mut twice = rows(&|_| 0.1);
    twice[20] = twice[19];
    rejected(MirrorProfile::from_rows(&twice), "row 21");
    let with_slopes: Vec<_> = rows(&|_| 0.1).iter().map(|&[t, f]| [t, f, -0.1]).collect();
    rejected(MirrorProfile::from_rows_with_slopes(&with_slopes), "hollow");
}

#[test]
fn impossible_designs_are_rejected_with_the_reason() {
    let design = ConstantResolution {
        vertex_m: 0.16,
        rim_m: 0.08,
        plane_z_m: -0.82,
        resolution: Resolution::PerMetre(0.08),
        offset: 0.0,
    };
    for bad in [f64::NAN, f64::INFINITY, -1.0, 0.0] {
        rejected(
            ConstantResolution {
                vertex_m: bad,
                ..design
            }
            .design(),
            "vertex_m",
        );
        rejected(
            ConstantResolution {
                rim_m: bad,
                ..design
            }
            .design(),
            "rim_m",
        );
        rejected(
            ConstantResolution {
                resolution: Resolution::PerMetre(bad),
                ..design
            }
            .design(),
            "resolution_per_m",
        );
        rejected(
            ConstantResolution {
                resolution: Resolution::RimShows(bad),
                ..design
            }
            .design(),
            "rim_view_m",
        );
    }
    for bad in [f64::NAN, f64::NEG_INFINITY, 0.16, 1.0] {
        rejected(
            ConstantResolution {
                plane_z_m: bad,
                ..design
            }
            .design(),
            "plane_z_m",
        );
    }
    rejected(
        ConstantResolution {
            offset: 0.1,
            ..design
        }
        .design(),
        "offset",
    );
    // Such a small range requires a hollow mirror, such a large one a curvature beyond the
    // profile's resolution.
    for resolution in [
        Resolution::RimShows(0.05),
        Resolution::PerMetre(100.0),
        Resolution::PerMetre(1e-9),
    ] {
        let design = ConstantResolution {
            resolution,
            ..design
        };
        rejected(design.design(), "the mirror is folded");
    }
}

#[test]
fn calibration_files_preserve_the_mirror() {
    // Calibration moves the mirror.
    let moved = |(name, mirror): (&'static str, ExactMirror<f64>)| {
        let profile = mirror.profile();
        let profile = profile.at_vertex(profile.vertex_m() + 0.0003).unwrap();
        (name, ExactMirror::new(F_PX, CENTER_PX, profile).unwrap())
    };
    for (name, mirror) in mirrors()
        .into_iter()
        .chain(mirrors().into_iter().map(moved))
    {
        let written = CalibratedCamera {
            name: "mirror".to_owned(),
            camera: Camera::ExactMirror(mirror.clone()),
            size_px: Some((640, 480)),
            world_from_camera: None,
        };
        let text = calibration::write_toml(std::slice::from_ref(&written));
        let read = calibration::read_toml(&text).unwrap_or_else(|problems| panic!("{problems:?}"));
        let Camera::ExactMirror(found) = &read[0].camera else {
            panic!("{name}: {text}");
        };
        for (pixel, ray) in rays(&mirror) {
            let again = found.unproject(pixel).expect("a ray");
            assert!(distance(&again.origin, &ray.origin) < 1e-14, "{name}");
            assert!(distance(&again.direction, &ray.direction) < 1e-9, "{name}");
        }
    }
}

#[test]
fn invalid_cameras_are_rejected() {
    let profile = MirrorProfile::sphere(0.1, 0.05, 0.04).unwrap();
    for bad in [f64::NAN, f64::INFINITY, 0.0, -1.0] {
        assert!(ExactMirror::new([bad, 500.0], CENTER_PX, profile.clone()).is_err());
        assert!(ExactMirror::new([500.0, bad], CENTER_PX, profile.clone()).is_err());
    }
    assert!(ExactMirror::new(F_PX, [f64::NAN, 0.0], profile.clone()).is_err());
    let camera = Camera::ExactMirror(ExactMirror::new(F_PX, CENTER_PX, profile).unwrap());
    assert!(
        camera
            .with_parameters(&[500.0, 500.0, 320.0, 240.0, 0.09])
            .is_ok()
    );
    assert!(
        camera
            .with_parameters(&[500.0, 500.0, 320.0, 240.0, 0.01])
            .is_err()
    );
}
