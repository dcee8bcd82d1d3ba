//! The moving platforms of a world.

use super::super::description::{Presence, above};
use super::super::reader::Table;
use super::objects::{PATHS, read_path, sines_of};
use pardalis_simulate::{OdometrySettings, Platform, Sine};

/// Reads the platforms; invalid ones are left out and reported to the journal. Returns them with the names of all.
pub(super) fn read(table: &Table) -> (Vec<Platform>, Vec<String>) {
    let about = "Moving platforms that carry cameras, each by its name: robots, pan-tilt heads, arms. They are not visible.";
    let tables = table.named_tables("platforms", about, Presence::Optional(""));
    let names = tables.iter().map(|(name, _)| name.clone()).collect();
    let platforms = tables.into_iter();
    let platforms = platforms.filter_map(|(name, table)| read_platform(name, table));
    (platforms.collect(), names)
}

fn read_platform(name: String, table: Table) -> Option<Platform> {
    let about = "How the origin of the platform moves.";
    let path = table.choice("path", about, &PATHS, Presence::Required, |kind, path| {
        read_path(kind, path)
    });
    let heading_deg: Option<f64> = table
        .key(
            "heading_deg",
            "Fixed heading, counterclockwise from the x axis.",
        )
        .depends("the direction in which it moves")
        .optional();
    let sway = [
        read_angles(
            &table,
            "yaw",
            "What is added to the heading: rows of [amplitude in degrees, period in seconds, phase in degrees] of sines.",
        ),
        read_angles(
            &table,
            "pitch",
            "The same for its pitch; positive looks down.",
        ),
        read_angles(
            &table,
            "roll",
            "The same for its roll; positive leans to the right.",
        ),
    ];
    let about =
        "What its odometry says: the motion in the plane from one time to the next, with errors.";
    let odometry = table.section("odometry", about, |table| Some(read_odometry(table)));
    table.finish();
    let [yaw, pitch, roll] = sway;
    Some(Platform {
        name,
        path: path?,
        heading_rad: heading_deg.map(f64::to_radians),
        sway: [yaw?, pitch?, roll?],
        odometry: odometry.unwrap_or_default(),
    })
}

fn read_angles(table: &Table, key: &'static str, about: &'static str) -> Option<Vec<Sine>> {
    let rows: Vec<Vec<f64>> = table
        .key(key, about)
        .unit("degrees, s, degrees")
        .or(Vec::new());
    let mut sines = sines_of(table, key, &rows, "degrees")?;
    for sine in &mut sines {
        sine.amplitude_m = sine.amplitude_m.to_radians();
    }
    Some(sines)
}

fn read_odometry(table: &Table) -> OdometrySettings {
    let default = OdometrySettings::default();
    let rate_hz = table
        .key("rate_hz", "Increments per second.")
        .within(above(0.0, 10_000.0))
        .or(default.rate_hz);
    let scale_error = table
        .key(
            "scale_error",
            "Share by which distances and turns are too large.",
        )
        .within(-0.9..=0.9)
        .or(default.scale_error);
    let scale_error_sigma = table
        .key(
            "scale_error_sigma",
            "Standard deviation of an additional random share, which is constant for the platform.",
        )
        .within(0.0..=0.3)
        .or(default.scale_error_sigma);
    let drift_deg_per_m: f64 = table
        .key(
            "drift_deg_per_m",
            "Turn to the left that it adds per metre driven.",
        )
        .unit("degrees/m")
        .within(-90.0..=90.0)
        .or(default.drift_rad_per_m);
    let drift_sigma_deg_per_m: f64 = table
        .key(
            "drift_sigma_deg_per_m",
            "Standard deviation of an additional random turn per metre driven, which is constant for the platform.",
        )
        .unit("degrees/m")
        .within(0.0..=30.0)
        .or(default.drift_sigma_rad_per_m);
    let sigma = |key, about| table.key(key, about).within(0.0..=1.0).or(0.0);
    OdometrySettings {
        rate_hz,
        scale_error,
        scale_error_sigma,
        drift_rad_per_m: drift_deg_per_m.to_radians(),
        drift_sigma_rad_per_m: drift_sigma_deg_per_m.to_radians(),
        noise_m: sigma(
            "noise_m",
            "Standard deviation of each increment's own error along x and y.",
        ),
        noise_rad: sigma(
            "noise_rad",
            "Standard deviation of each increment's own error of the turn.",
        ),
    }
}
