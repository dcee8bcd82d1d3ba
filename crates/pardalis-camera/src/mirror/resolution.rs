//! Specification of mirrors of constant resolution.

/// A mirror that shows the plane z = `plane_z_m` at the image radius ρ = a·r + b (focal length 1),
/// where r is the distance from the axis. Shapes on the floor keep their shape and size in the
/// image (Hicks and Bajcsy 2000, "Catadioptric sensors that approximate wide-angle perspective projections"; Gaspar et al.
/// 2002, "Constant resolution omnidirectional cameras").
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConstantResolution {
    /// Distance of the vertex from the pinhole, in metres.
    pub vertex_m: f64,
    /// Radius of the rim, in metres.
    pub rim_m: f64,
    /// Position of the plane in the camera frame, in metres: negative for a floor below a camera
    /// that looks up.
    pub plane_z_m: f64,
    /// Resolution of the image.
    pub resolution: Resolution,
    /// b, at most 0. Points within −b/a of the axis are not shown, and the mirror has a tip. 0 for
    /// a smooth mirror.
    pub offset: f64,
}

/// Resolution of the image of a designed mirror.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Resolution {
    /// a, in image radius (focal length 1) per metre.
    PerMetre(f64),
    /// Distance from the axis that the rim shows, in metres.
    RimShows(f64),
}
