//! What another program's detector finds of a target that the tracker detects itself: its boxes are candidates, and evidence of which outline is the target's.
//! Where exactly it is, the edges tell.

use crate::likelihood::edge::{EdgeFrame, SizePrior};
use crate::shape::Shape;
use crate::tracker::CameraId;
use crate::tracker::box_model::{Body, Sight, log_ratio};
use crate::tracker::candidate::{Candidate, Origin, Verdict};
use crate::tracker::settings::DetectorSettings;
use crate::tracker::track::Instant;

use super::candidates::at;

/// The boxes of the latest instant.
pub(super) struct Boxes {
    /// The number of the target whose boxes these are.
    target: usize,
    settings: DetectorSettings,
    body: Body,
    sights: Vec<Sight>,
    /// The cameras in whose images the detector looked.
    looked: Vec<usize>,
}

impl Boxes {
    /// Those of the target with this number and shape, on the ground at this height (metres) if its motion is planar.
    pub(super) fn new(
        settings: DetectorSettings,
        target: usize,
        (shape, ground_z_m): (&Shape, Option<f64>),
    ) -> Self {
        Self {
            target,
            settings,
            body: Body::new(shape, ground_z_m),
            sights: Vec::new(),
            looked: Vec::new(),
        }
    }

    /// Takes the boxes of an instant.
    pub(super) fn see(&mut self, instant: &Instant) {
        self.sights.clear();
        self.looked.clear();
        for boxes in instant.boxes {
            if boxes.target == self.target {
                let view = &instant.views[boxes.camera];
                self.looked.push(boxes.camera);
                let sights = boxes.boxes.iter();
                let sights = sights
                    .filter_map(|found| Sight::new(boxes.camera, view, found, &self.settings));
                self.sights.extend(sights);
            }
        }
        for sight in &mut self.sights {
            sight.fit = self.body.fit_one(instant.views, sight);
        }
    }

    /// Returns a candidate for each box.
    pub(super) fn candidates(&self, size: &SizePrior) -> impl Iterator<Item = Candidate> {
        self.sights.iter().map(|sight| {
            let origin = Origin::Box(CameraId::new(sight.camera), sight.blob());
            match &sight.fit {
                Some(fit) => at(origin, fit.position_m.into(), size.log_scale),
                None => Candidate::new(origin, Verdict::TooFar),
            }
        })
    }

    /// Returns by how much likelier the boxes are if the target is at this position (metres) and visible than if it is not there, in nats.
    pub(super) fn nats(&self, frames: &[EdgeFrame], position_m: [f64; 3]) -> f64 {
        let looked = |frame: &&EdgeFrame| self.looked.contains(&frame.camera());
        let nats = frames.iter().filter(looked).map(|frame| {
            let view = frame.prepared().view();
            let sights = self.sights.iter();
            let sights = sights.filter(|sight| sight.camera == frame.camera());
            log_ratio(
                (&self.body.outline, view),
                position_m,
                sights,
                &self.settings,
            )
        });
        nats.sum()
    }
}
