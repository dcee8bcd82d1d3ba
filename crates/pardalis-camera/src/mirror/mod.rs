//! Mirrors of revolution in front of a perspective camera: shapes, design and look-up tables.
//!
//! Everything happens in the meridian plane of the camera frame: t and r are distances from the
//! optical axis, z runs along it, and the pinhole is the origin. The ray at image radius ρ = t/F
//! (focal length 1) meets the mirror at (t, F(t)) and is reflected to the angle φ = atan(ρ) +
//! 2·atan(F'(t)) from −z, by the law of reflection.

mod design;
mod look_up;
mod meridian;
mod profile;
mod resolution;
mod table;

pub use look_up::MirrorLookUp;
pub(super) use look_up::ReflectedRays;
pub(super) use meridian::Meridian;
pub use profile::{MirrorForm, MirrorProfile};
pub use resolution::{ConstantResolution, Resolution};
