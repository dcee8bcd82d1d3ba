//! The plane that an uncalibrated camera sees, from points with known positions on it.
//!
//! Plane frame: metres, z = 0 on the plane, z towards the viewer. Seen from above, y lies to the left of x.

mod camera_center;
mod fit;
mod rectangle;

pub use camera_center::camera_center_m;
pub use fit::{OUTLIER_PX, PlaneFit, PointPair, fit};
pub use rectangle::Rectangle;

#[cfg(test)]
mod tests;
