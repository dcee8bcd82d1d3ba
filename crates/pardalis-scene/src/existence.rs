//! How often a target appears, disappears and becomes occluded, and where it can be.

use super::description::above;
use super::reader::Table;
use pardalis::tracker::{ExistenceSettings, Region};

/// Reads where a detected target can be.
fn read_region(existence: &Table) -> Option<Region> {
    let about = "Where the target can be: the range of its position along each axis of the world. Candidates outside it are ruled out.";
    existence.section("region", about, |table| {
        let mut region = Region::default();
        let about = [
            "Least and greatest x.",
            "Least and greatest y.",
            "Least and greatest z: [0, 3] is above the floor and below the ceiling.",
        ];
        for (axis, name) in ["x_m", "y_m", "z_m"].into_iter().enumerate() {
            let key = table.key(name, about[axis]).depends("anywhere");
            if let Some([least, greatest]) = key.optional::<[f64; 2]>() {
                (region.min_m[axis], region.max_m[axis]) = (least, greatest);
            }
        }
        table.checked(region.check())?;
        Some(region)
    })
}

/// Reads how a detected target appears, disappears and becomes occluded.
pub(super) fn read_existence(
    table: &Table,
    default: ExistenceSettings,
) -> Option<ExistenceSettings> {
    let about = "How often the target appears, disappears and is occluded. Only for targets with the edge cue or a detector.";
    let settings = table.section("existence", about, |existence| {
        let rate = |name, about, default| {
            let key = existence.key(name, about).within(0.0..=1000.0);
            key.or(default)
        };
        let mut settings = default;
        settings.birth_rate_hz = rate(
            "birth_rate_hz",
            "Rate at which an absent target appears.",
            default.birth_rate_hz,
        );
        settings.death_rate_hz = rate(
            "death_rate_hz",
            "Rate at which a present target disappears.",
            default.death_rate_hz,
        );
        settings.relocation_rate_hz = rate(
            "relocation_rate_hz",
            "Rate at which the target is moved to an arbitrary position.",
            default.relocation_rate_hz,
        );
        settings.velocity_jump_rate_hz = rate(
            "velocity_jump_rate_hz",
            "Rate of velocity jumps, such as bounces and kicks; 0 by default for targets with a detector that are no balls. Reported velocities expect a fifth of it.",
            default.velocity_jump_rate_hz,
        );
        settings.velocity_jump_sigma_mps = rate(
            "velocity_jump_sigma_mps",
            "Standard deviation of the change of velocity in a jump, on each axis. Reported velocities expect three quarters of it.",
            default.velocity_jump_sigma_mps,
        );
        settings.motion_modes = existence
            .key(
                "motion_modes",
                "Whether the velocity is estimated from how the target moves: rolling or at rest, moved by somebody, in free flight, or hit. If not, it is that of the motion model, as always for targets that a detector finds without colours or that other sensors measure.",
            )
            .or(default.motion_modes);
        settings.occlusion.occlusion_hz = rate(
            "occlusion_rate_hz",
            "Rate at which a visible target becomes occluded in a camera.",
            default.occlusion.occlusion_hz,
        );
        settings.occlusion.reappearance_hz = existence
            .key(
                "reappearance_rate_hz",
                "Rate at which an occluded target becomes visible again.",
            )
            .within(above(0.0, 1000.0))
            .or(default.occlusion.reappearance_hz);
        settings.ground_z_m = existence
            .key(
                "ground_z_m",
                "Height of the ground in the world, for targets with planar motion, which stay on it. Of a ball, the height of its centre, and by default its radius.",
            )
            .within(-1e6..=1e6)
            .or(default.ground_z_m);
        if let Some(region) = read_region(existence) {
            settings.region = region;
        }
        existence.checked(settings.check())?;
        Some(settings)
    });
    if table.has("existence") {
        settings
    } else {
        Some(default)
    }
}
