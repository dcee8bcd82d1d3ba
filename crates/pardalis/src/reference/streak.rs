//! Naive implementation of the streak that a disc leaves while the shutter is open.

/// A disc that moves evenly.
pub struct StreakOfDisc {
    /// Its centre at mid-exposure, pixels.
    pub middle: [f64; 2],
    /// Its radius, pixels.
    pub radius_px: f64,
    /// How far it moves during the exposure, pixels.
    pub displacement: [f64; 2],
    /// The scale of the logistic curve that its edge is at rest, pixels.
    pub edge_px: f64,
}

/// Number of instants of the exposure.
const INSTANTS: usize = 2000;

impl StreakOfDisc {
    /// Returns the signed distances to the disc during the exposure, pixels.
    fn distances_px(&self, [u, v]: [f64; 2]) -> impl Iterator<Item = f64> {
        (0..INSTANTS).map(move |instant| {
            let time = (instant as f64 + 0.5) / INSTANTS as f64 - 0.5;
            let du = u - self.middle[0] - time * self.displacement[0];
            let dv = v - self.middle[1] - time * self.displacement[1];
            du.hypot(dv) - self.radius_px
        })
    }

    /// Returns the share of the disc in a pixel.
    pub fn share(&self, pixel: [f64; 2]) -> f64 {
        let memberships = self
            .distances_px(pixel)
            .map(|distance_px| 1.0 / (1.0 + libm::exp(distance_px / self.edge_px)));
        memberships.sum::<f64>() / INSTANTS as f64
    }

    /// Returns the share in the middle, where it is greatest.
    pub fn greatest_share(&self) -> f64 {
        self.share(self.middle)
    }

    /// Returns the signed distance to the hull of the disc during the exposure, pixels.
    pub fn hull_px(&self, pixel: [f64; 2]) -> f64 {
        self.distances_px(pixel).fold(f64::INFINITY, f64::min)
    }

    /// Returns the signed distance from a disc at rest with the same share as a pixel that is mixed, relative to the middle's.
    pub fn at_rest_px(&self, pixel: [f64; 2]) -> f64 {
        let share = self.share(pixel) / self.greatest_share();
        self.edge_px * libm::log((1.0 - share) / share)
    }
}
