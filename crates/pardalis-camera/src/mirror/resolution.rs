//! What a mirror of constant resolution is designed for.

/// A mirror that shows the plane z = `plane_z_m` at the image radius ρ = a·r + b (focal length 1), r the distance from the axis: shapes on the
/// floor keep their shape and size in the image (Hicks and Bajcsy 1999; Gaspar et al. 2002).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConstantResolution {
    /// Distance of the vertex from the pinhole, metres.
    pub vertex_m: f64,
    /// Radius of the rim, metres.
    pub rim_m: f64,
    /// Where the plane lies in the camera's frame, metres: negative for a floor below a camera that looks up.
    pub plane_z_m: f64,
    /// How fine the image is.
    pub resolution: Resolution,
    /// b, at most 0: what lies within −b/a of the axis is not shown, and the mirror has a tip. 0 for a smooth mirror.
    pub offset: f64,
}

/// How fine the image of a designed mirror is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Resolution {
    /// a, in units of the image radius a metre.
    PerMetre(f64),
    /// The distance from the axis that the rim shows, in metres.
    RimShows(f64),
}
