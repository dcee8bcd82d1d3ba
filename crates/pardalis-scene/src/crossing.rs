//! The plane that a target in flight is predicted to cross.

use super::reader::Table;
use pardalis::filter::flight::{FlightSettings, Plane};

/// The plane that a target in flight crosses, and the priors of its flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CrossingConfig {
    /// The plane.
    pub plane: Plane,
    /// The priors of drag and spin.
    pub flight: FlightSettings,
}

/// Farther away, nothing is measured, metres.
const MAX_DISTANCE_M: f64 = 1e6;

/// Reads the table `crossing`.
pub(super) fn read_crossing(table: &Table) -> Option<CrossingConfig> {
    let about = "A plane that the target crosses when it flies, such as a table: `track` writes into `crossings.csv` when and where that will be. Only for targets with the edge cue that do not stay on the ground.";
    table.section("crossing", about, |crossing| {
        let point_m: Option<[f64; 3]> = crossing
            .key("point_m", "A point of the plane. The target crosses it with its centre: a ball lands on a floor at z = 0 when its centre is at the height of its radius.")
            .within(-MAX_DISTANCE_M..=MAX_DISTANCE_M)
            .required();
        let normal: [f64; 3] = crossing
            .key("normal", "A direction perpendicular to the plane, of any length.")
            .unit("")
            .within(-MAX_DISTANCE_M..=MAX_DISTANCE_M)
            .or([0.0, 0.0, 1.0]);
        let default = FlightSettings::default();
        let mut flight = default;
        flight.drag_per_m = crossing
            .key("drag_per_m", "Deceleration of the target in the air divided by the square of its speed: air density times drag coefficient times cross-section, divided by twice the mass. 0.13 for a table tennis ball, 0.02 for a basketball.")
            .within(0.0..=100.0)
            .or(default.drag_per_m);
        flight.drag_sigma_per_m = crossing
            .key("drag_sigma_per_m", "Standard deviation of that.")
            .within(0.0..=100.0)
            .or(default.drag_sigma_per_m);
        flight.spin_sigma_hz = crossing
            .key("spin_sigma_hz", "Standard deviation of the acceleration by spin (Magnus force) divided by the speed.")
            .within(0.0..=100.0)
            .or(default.spin_sigma_hz);
        let plane = crossing.checked(Plane::new(point_m?, normal))?;
        Some(CrossingConfig { plane, flight })
    })
}
