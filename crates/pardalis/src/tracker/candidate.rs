//! Candidates: what the tracker examined in the latest frames of a target that it searches for, and what ruled each out.

use super::CameraId;
use crate::detect::Blob;

/// Something in the latest frames that was examined, and what became of it. The tracker does not read it again.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Candidate {
    /// Why it was examined.
    pub origin: Origin,
    /// The position in the world, metres: where its outline was fitted, or else where the fit was to begin; `None` if it was ruled out before.
    pub position_m: Option<[f64; 3]>,
    /// The logarithm of its scale there relative to the target's shape.
    pub(super) log_scale: f64,
    /// Where the rays of two blobs meet, the numbers of their candidates.
    pub(super) blobs: Option<[usize; 2]>,
    /// How far its outline as a whole is the target's, in nats: the judged log-likelihood ratio, summed over the cameras that see it.
    pub outline_nats: Option<f64>,
    /// The log-likelihood ratio of its mean colour, in nats, of the camera in which it is least.
    pub color_nats: Option<f64>,
    /// The share of its outline along which the target's colours are visible, 0 to 1.
    pub visible_share: Option<f64>,
    /// What became of it.
    pub verdict: Verdict,
}

/// Why a candidate was examined.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Origin {
    /// The whole image of a camera, in which nothing has the target's colours.
    Image(CameraId),
    /// A connected part of a camera's image has the target's colours.
    Blob(CameraId, Blob),
    /// The largest circle inside such a part, which may be a ball that has grown together with something else. Only single images are searched for them
    /// ([`Tracker::locate`](crate::Tracker::locate)).
    Circle(CameraId, Blob),
    /// Something that moves in front of a camera at rest may be a streak of the target's colours.
    Motion(CameraId, Blob),
    /// Another program's detector found a box around it, given as the blob that fills it.
    Box(CameraId, Blob),
    /// The rays of blobs in two cameras meet there.
    Rays,
    /// The target was predicted there.
    Prediction,
}

impl Origin {
    /// Returns its name in files.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Image(_) => "image",
            Self::Blob(..) => "blob",
            Self::Circle(..) => "circle",
            Self::Motion(..) => "motion",
            Self::Box(..) => "box",
            Self::Rays => "rays",
            Self::Prediction => "prediction",
        }
    }

    /// Returns the camera; `None` for candidates that belong to all.
    pub fn camera(&self) -> Option<CameraId> {
        match self {
            Self::Image(camera)
            | Self::Blob(camera, _)
            | Self::Circle(camera, _)
            | Self::Motion(camera, _)
            | Self::Box(camera, _) => Some(*camera),
            Self::Rays | Self::Prediction => None,
        }
    }

    /// Returns the blob from which the candidate came.
    pub fn blob(&self) -> Option<&Blob> {
        match self {
            Self::Blob(_, blob)
            | Self::Circle(_, blob)
            | Self::Motion(_, blob)
            | Self::Box(_, blob) => Some(blob),
            _ => None,
        }
    }
}

/// The test that ruled out a candidate, in the order of the tests: the later, the closer it came to being the target.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Verdict {
    /// The image has no blob of the target's colours that is large enough. The candidate is the largest smaller one, if there is one.
    NoColors,
    /// It was not examined, because larger blobs or likelier candidates were.
    Surplus,
    /// The fit led to the position of another candidate, or to another outline that is seen at the same place, or there was none because the target had surely been detected there, or in one of the blobs whose rays meet
    /// there.
    SamePlace,
    /// Its pixel, or most of its outline, lies outside the image, the mask or the domain of the camera model.
    OutOfView,
    /// Its ray does not meet the ground on which the target stays.
    OffGround,
    /// A target with the blob's area would be too near to the camera.
    TooNear,
    /// A target with the blob's area would be too far from the camera.
    TooFar,
    /// Inside and outside of its outline have the same colours, or the edges determine no position.
    NoEdges,
    /// Too little of its outline shows the target's colours.
    Covered,
    /// Its outline differs from that of the target.
    OtherOutline,
    /// Its mean colour differs from that of the target.
    OtherColor,
    /// A detector that looked at the image has no box there.
    NoBox,
    /// It is where the target cannot be.
    OutsideRegion,
    /// It is too far from the target's other landmarks.
    Stray,
    /// It is another target that looks the same.
    LookAlike,
    /// Another candidate, seen elsewhere, is as likely the target, or likelier.
    Rival,
    /// It may be the target, but is not certain enough yet.
    Unconfirmed,
    /// It is the target.
    Target,
}

impl Verdict {
    /// All verdicts.
    pub const ALL: [Self; 18] = [
        Self::NoColors,
        Self::Surplus,
        Self::SamePlace,
        Self::OutOfView,
        Self::OffGround,
        Self::TooNear,
        Self::TooFar,
        Self::NoEdges,
        Self::Covered,
        Self::OtherOutline,
        Self::OtherColor,
        Self::NoBox,
        Self::OutsideRegion,
        Self::Stray,
        Self::LookAlike,
        Self::Rival,
        Self::Unconfirmed,
        Self::Target,
    ];

    /// Returns its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::NoColors => "no-colors",
            Self::Surplus => "surplus",
            Self::SamePlace => "same-place",
            Self::OutOfView => "out-of-view",
            Self::OffGround => "off-ground",
            Self::TooNear => "too-near",
            Self::TooFar => "too-far",
            Self::NoEdges => "no-edges",
            Self::Covered => "covered",
            Self::OtherOutline => "other-outline",
            Self::OtherColor => "other-color",
            Self::NoBox => "no-box",
            Self::OutsideRegion => "outside-region",
            Self::Stray => "stray",
            Self::LookAlike => "look-alike",
            Self::Rival => "rival",
            Self::Unconfirmed => "unconfirmed",
            Self::Target => "target",
        }
    }
}

impl Candidate {
    /// Returns its scale relative to the target's shape: 1 unless the size is estimated.
    pub fn scale(&self) -> f64 {
        libm::exp(self.log_scale)
    }

    /// A candidate that is ruled out so far by this verdict.
    pub(super) fn new(origin: Origin, verdict: Verdict) -> Self {
        Self {
            origin,
            position_m: None,
            log_scale: 0.0,
            blobs: None,
            outline_nats: None,
            color_nats: None,
            visible_share: None,
            verdict,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_verdicts_are_listed_in_their_order_with_names_of_their_own() {
        assert!(Verdict::ALL.is_sorted_by(|a, b| a < b && a.name() != b.name()));
        assert_eq!(Verdict::ALL.last(), Some(&Verdict::Target));
    }
}
