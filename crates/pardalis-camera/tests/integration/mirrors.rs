//! Mirror cameras of every kind, and points throughout the space around them.

use std::path::PathBuf;

use pardalis_camera::{ConstantResolution, ExactMirror, MirrorProfile, Resolution};

pub(crate) const F_PX: [f64; 2] = [579.4, 571.2];
pub(crate) const CENTER_PX: [f64; 2] = [321.3, 238.7];

pub(crate) fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../data/calibration/catadioptric")
}

/// Returns the description of the rendered camera.
pub(crate) fn camera_json() -> serde_json::Value {
    let text = std::fs::read_to_string(folder().join("camera.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}

/// Returns the rendered mirror as rows t, F, F'.
pub(crate) fn table() -> Vec<[f64; 3]> {
    let json = camera_json();
    let column = |key: &str| -> Vec<f64> {
        serde_json::from_value(json["mirror_profile"][key].clone()).unwrap()
    };
    let (t, f, slope) = (column("t_m"), column("F_m"), column("dF"));
    (0..t.len()).map(|i| [t[i], f[i], slope[i]]).collect()
}

/// Returns cameras with mirrors of every kind.
pub(crate) fn mirrors() -> Vec<(&'static str, ExactMirror<f64>)> {
    let tip = ConstantResolution {
        vertex_m: 0.16,
        rim_m: 0.08,
        plane_z_m: -0.82,
        resolution: Resolution::PerMetre(0.08),
        offset: -0.02,
    };
    let c = 0.028_f64.hypot(0.023);
    [
        ("table", MirrorProfile::from_rows_with_slopes(&table())),
        ("sphere", MirrorProfile::sphere(0.1, 0.05, 0.04)),
        // Almost as far around as the pinhole can see.
        ("wide sphere", MirrorProfile::sphere(0.1, 0.05, 0.0462)),
        ("slight sphere", MirrorProfile::sphere(0.3, 2.0, 0.1)),
        ("paraboloid", MirrorProfile::paraboloid(0.12, 0.02, 0.04)),
        (
            "hyperboloid",
            MirrorProfile::hyperboloid(0.028 + c, [0.028, 0.023], 0.035),
        ),
        (
            "hyperboloid out of focus",
            MirrorProfile::hyperboloid(0.1, [0.02, 0.02], 0.04),
        ),
        ("cone", MirrorProfile::cone(0.1, 0.9, 0.04)),
        ("sharp cone", MirrorProfile::cone(0.1, 0.6, 0.04)),
        ("constant resolution with a tip", tip.design()),
    ]
    .map(|(name, profile)| {
        let profile = profile.unwrap_or_else(|error| panic!("{name}: {error}"));
        (name, ExactMirror::new(F_PX, CENTER_PX, profile).unwrap())
    })
    .into()
}

/// Returns points (r, z) throughout the half plane, where r is the distance from the axis: around
/// the vertex, at all distances from the mirror's surface, inside the mirror, and on both sides of
/// the rim.
pub(crate) fn points(mirror: &ExactMirror<f64>) -> Vec<[f64; 2]> {
    let profile = mirror.profile();
    let rim_m = profile.rim_m();
    let mut points = Vec::new();
    let mut add = |r: f64, z: f64| points.push([r, z]);
    for i in 0..=180 {
        // All directions around the centre of the mirror.
        let (sin, cos) = f64::from(i).to_radians().sin_cos();
        for j in 0..120 {
            let range_m = 1e-4 * 1.15_f64.powi(j);
            add(range_m * sin, profile.vertex_m() - range_m * cos);
            add(range_m * sin, profile.at(rim_m)[0] - range_m * cos);
        }
        // Around points of the mirror, including the rim.
        let t = rim_m * f64::from(i) / 180.0;
        let f = profile.at(t)[0];
        for j in -5..60 {
            let down_m = 1e-5 * 1.25_f64.powi(j);
            add(t, f - down_m);
            add(t, f + down_m);
            for k in 1..12 {
                let (sin, cos) = (f64::from(k) * 0.25).sin_cos();
                add(t + down_m * sin, f - down_m * cos);
            }
        }
    }
    points
}
