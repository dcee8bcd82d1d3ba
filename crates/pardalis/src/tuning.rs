//! Tuned constants of detected targets, for studies of their sensitivity.
//!
//! They are no settings: names, meanings and defaults may change in any release. "Hand-set" constants were chosen by hand and not fitted. How much
//! results depend on each is recorded in `experiments/sensitivity`. Constants that fix the layout of tables, guard numbers, or must agree with what
//! colour models have learnt stand beside their use.
//!
//! ```
//! use pardalis::tuning::Tuning;
//!
//! let mut tuning = Tuning::default();
//! tuning.edge.rounds = 2;
//! assert!(tuning.check().is_ok());
//! ```

use pardalis_core::{Error, tuned};
pub use pardalis_filter::bernoulli::ProposalTuning;

/// All tuned constants of a detected target.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub struct Tuning {
    /// Blobs of the target's colours.
    pub blobs: BlobTuning,
    /// What cameras at rest show without what moves.
    pub background: BackgroundTuning,
    /// The edge cue.
    pub edge: EdgeTuning,
    /// Detection.
    pub detection: DetectionTuning,
    /// Data association.
    pub association: AssociationTuning,
    /// Existence, and the state of the track.
    pub existence: ExistenceTuning,
    /// Adaptation.
    pub adaptation: AdaptationTuning,
    /// The size of balls.
    pub size: SizeTuning,
    /// The heading of bodies that turn.
    pub heading: HeadingTuning,
    /// The agreement of cameras.
    pub agreement: AgreementTuning,
    /// The proposal of the Bernoulli filter.
    pub proposal: ProposalTuning,
}

impl Tuning {
    /// Calls `visit` with each constant's name, such as `edge.rounds`, its unit and its value, which it may change. Counts are rounded down.
    pub fn visit(&mut self, visit: &mut dyn FnMut(&str, &'static str, &mut f64)) {
        macro_rules! visit_parts {
            ($($part:ident),*) => {$(
                self.$part.visit(&mut |name, unit, value| {
                    visit(&format!("{}.{name}", stringify!($part)), unit, value);
                });
            )*};
        }
        visit_parts!(blobs, background, edge, detection, association);
        visit_parts!(existence, adaptation, size, heading, agreement, proposal);
    }

    /// Returns an error unless every constant is above 0 and at most 10 000, or 1 for shares.
    pub fn check(&self) -> Result<(), Error> {
        self.blobs.check()?;
        self.background.check()?;
        self.edge.check()?;
        self.detection.check()?;
        self.association.check()?;
        self.existence.check()?;
        self.adaptation.check()?;
        self.size.check()?;
        self.heading.check()?;
        self.agreement.check()?;
        self.proposal.check()
    }
}

tuned! {
    /// Tuned constants of blob detection.
    BlobTuning {
        /// From this colour posterior on a pixel counts as the target's.
        min_posterior: f64 = 2.0 / 3.0, "share", "hand-set: its colour is twice as frequent among the target's pixels as in the image";
        /// Blobs with fewer pixels count as noise.
        min_area_px: usize = 9, "pixels", "hand-set: a disc of this area has a radius of 1.7 px";
        /// The number of blobs kept per image, largest first.
        max_blobs: usize = 8, "blobs", "hand-set: bounds the time of the candidate search";
    }
}

tuned! {
    /// Tuned constants of what cameras at rest show without what moves.
    BackgroundTuning {
        /// The least weight of one image in the running mean of images.
        rate: f32 = 0.1, "share", "hand-set: a second at ten images a second";
        /// From this difference to the mean on a block of pixels has changed, ...
        min_change: f32 = 8.0, "grey levels, weighted Y, U and V", "hand-set: compressed images differ by 2 to 4";
        /// ... and from this many times the median difference on.
        noise_factor: f32 = 5.0, "ratio", "hand-set: three standard deviations and more";
        /// If more has changed, the camera moves or the light changes.
        max_changed_share: f64 = 0.3, "share", "hand-set: a person in front of the camera";
    }
}

tuned! {
    /// Tuned constants of the edge cue.
    EdgeTuning {
        /// By how much a pixel in the target's colours speaks against lying outside of the outline.
        target_outside_nats: f64 = 1.95, "nats", "derivation: ln 0.7/0.1, the probabilities of \
            the target's colours inside and outside; highlights, prints, fingers and bags cover part of most bodies";
        /// By how much a pixel in other colours speaks against lying inside of the outline.
        other_inside_nats: f64 = 1.1, "nats", "derivation: ln 0.9/0.3, the probabilities of other colours outside and inside";
        /// Pixels nearer to the outline say nothing by their colours alone, which are mixed there: in the frame's own pixels.
        mixed_px: f64 = 2.0, "pixels", "hand-set";
        /// The same in coarser octaves, whose edges are sharper.
        coarse_mixed_px: f64 = 1.0, "pixels", "hand-set";
        /// Of longer outlines every second pixel is used, as on a chessboard.
        thinned_from_px: f32 = 150.0, "pixels", "hand-set: halves the time for large bodies";
        /// The least share of correspondence lines inside the image.
        min_inside_share: f32 = 0.5, "share", "hand-set";
        /// By how much a correspondence line speaks against shifts beyond its reach.
        beyond_reach_nats: f32 = 10.0, "nats", "hand-set";
        /// What surrounds a sector is unchanged up to this difference of colours.
        unchanged_color: f32 = 18.0, "grey levels, weighted Y, U and V", "hand-set";
        /// From this difference of colours on something else has come.
        changed_color: f32 = 36.0, "grey levels, weighted Y, U and V", "hand-set: twice as much misses what occludes the target";
        /// If more of the sectors have changed, the body itself has moved on to other surroundings.
        moved_share: f32 = 0.6, "share", "hand-set";
        /// The least probability that a sector is visible, and that it is occluded.
        min_uncertainty: f32 = 0.02, "share", "hand-set";
        /// A camera in which less of the outline is visible does not see the target.
        min_visible_share: f32 = 0.2, "share", "hand-set";
        /// A finer octave agrees if it moves the position no farther than this, in standard deviations of the coarser one, ...
        max_refined_sigmas: f64 = 3.0, "standard deviations", "hand-set";
        /// ... and if its log-likelihood ratio is at least this share of the coarser one's.
        min_refined_share: f64 = 0.5, "share", "hand-set";
        /// How often correspondence lines are placed again, around the position that those before found.
        rounds: usize = 4, "rounds", "hand-set: two are too few, eight are more accurate while the target is partly occluded";
        /// The number of Newton steps per round.
        steps: usize = 4, "steps", "hand-set: as for rounds";
        /// Half the width over which the lines' log-likelihoods are differentiated.
        span_px: f32 = 0.5, "pixels", "hand-set: pixels make them rough below";
        /// No step moves the outline farther than this.
        max_shift_px: f64 = 3.5, "pixels", "hand-set: lines reach 5 px";
        /// Steps that move the outline less end a round.
        min_shift_px: f64 = 0.01, "pixels", "hand-set: far below the noise of edges";
        /// When an outline is judged, each sector may deviate from it by up to this.
        judged_tolerance_px: f32 = 0.5, "pixels", "hand-set: larger ones excuse the corners of boxes";
        /// By how much it is less likely that an outline is a rectangle than that it is anything else but the ball.
        rectangle_rarity_nats: f64 = 5.0, "nats", "experiment: judges real balls as without rectangles";
        /// The scale of the logistic curve that the edge of a body at rest is, in the octave of a streak.
        streak_edge_px: f32 = 0.55, "pixels", "experiment: learnt edge profiles";
        /// Displacements shorter than this, in the octave, make no streak.
        min_streak_px: f32 = 1.5, "pixels", "hand-set: within the width of edges";
        /// Longer streaks, in lengths of the outline, are too pale to be seen.
        max_streak_outlines: f32 = 1.25, "lengths of the outline", "hand-set: about four diameters; also bounds time and memory";
        /// Mixtures with less of the body do not show its colours.
        min_mixture: f32 = 0.35, "share", "hand-set: noise is multiplied by the inverse";
        /// The curvature that lines have at least, before the likelihood exponent.
        min_curvature: f32 = 0.02, "1/pixel²", "hand-set: keeps steps finite where a line is flat";
    }
}

tuned! {
    /// Tuned constants of detection.
    DetectionTuning {
        /// The nearest candidate along a ray.
        nearest_diameters: f64 = 0.75, "diameters", "hand-set: the camera is outside of the target";
        /// The farthest candidate along a ray.
        farthest_diameters: f64 = 200.0, "diameters", "hand-set: an image of 1000 pixels per radian shows it 5 pixels wide";
        /// The rays of two cameras meet if they pass each other within this distance.
        meeting_diameters: f64 = 1.0, "diameters", "hand-set";
        /// The number of detections kept per instant.
        max_detections: usize = 6, "detections", "hand-set: bounds the time of the update";
        /// Detections with a smaller log-likelihood ratio are dropped: an outline anywhere nearby would do as well.
        min_log_ratio: f64 = 0.5, "nats", "hand-set";
        /// Detections closer than this are one.
        distinct_diameters: f64 = 0.25, "diameters", "hand-set";
        /// Candidates as close to a sure detection that differ from it in size by less than this factor are not fitted.
        same_size_factor: f64 = 1.2, "ratio", "hand-set: highlights and shadows take a third of a ball's area";
        /// Whole images are searched at least once in this many frame sets.
        frames_between_searches: u32 = 10, "frame sets", "hand-set: bounds how long a wrong track goes unchallenged";
        /// A detection near the prediction with a greater log-likelihood ratio makes the search unnecessary.
        sure_log_ratio: f64 = 12.0, "nats", "hand-set";
        /// One with a greater log-likelihood ratio than this makes the search for what moves unnecessary.
        likely_log_ratio: f64 = 5.0, "nats", "hand-set: as for `association.min_moving_nats`";
        /// Above this probability of existence the search may be skipped.
        sure_existence: f64 = 0.9, "share", "hand-set";
        /// Above this probability of existence the target is looked for near its prediction.
        min_predicted_existence: f64 = 0.1, "share", "hand-set";
        /// The least streak that is looked for where the target is predicted.
        min_streak_diameters: f64 = 0.2, "diameters", "hand-set: outlines at rest fit shorter ones";
        /// The least ratio of length to width of a blob that may be a streak.
        min_streak_elongation: f64 = 1.1, "ratio", "hand-set: only the core of a short streak has the target's colours";
        /// The least width of the blob of a streak, as a standard deviation.
        min_streak_sigma_px: f64 = 1.5, "pixels", "hand-set: narrower ones have no form";
        /// The standard deviation of the size of an outline of which nothing shows the target's colours, or all that surrounds it; in proportion to the squares of
        /// smaller shares.
        contradicted_sigma: f64 = 1.2, "ln of scale", "experiment: real clips";
        /// A predicted position, used as prior of a fit, has at least this standard deviation.
        min_sigma_diameters: f64 = 0.01, "diameters", "hand-set: keeps the prior's covariance invertible";
    }
}

tuned! {
    /// Tuned constants of data association.
    AssociationTuning {
        /// Clutter (things that look like the target) per frame, over all places where targets appear, besides what is seen of it.
        clutter_per_frame: f64 = 0.1, "things", "hand-set";
        /// The weight of one search of whole images in the running mean of the clutter that is seen.
        clutter_rate: f64 = 0.1, "share", "experiment: real clips, between 0.05 and 0.2";
        /// By how much rarer it is that a thing of clutter lies just where an occluded target is tracked, than that it lies anywhere; and that each camera beyond the third shows clutter just where the others do.
        coincidence_nats: f64 = 2.0, "nats", "experiment: real clips; with less, more frames that show the target count as occluded, with more, fewer that show clutter";
        /// A detection's log-likelihood ratio of target against clutter rises by one per this many nats of the edge cue's per camera, ...
        log_ratio_scale: f64 = 1.5, "nats", "hand-set: pixels are not independent";
        /// ... from minus this, ...
        clutter_nats: f64 = 5.0, "nats", "hand-set: between more wrong frames (half) and more missed ones (twice) on real footage";
        /// ... to at most this.
        max_log_ratio: f64 = 8.0, "nats", "experiment: more would let a perfect outline outweigh any colour";
        /// By how much a detection is less likely the target if none of its outline shows the target's colours, in proportion for parts.
        occluded_color_nats: f64 = 12.0, "nats", "hand-set: as for `clutter_nats`";
        /// By how much a detection is less likely the target if the colours on both sides of its outline hardly differ: a patch of something larger ...
        faint_nats: f64 = 7.0, "nats", "hand-set: as for `existence.missed_nats`";
        /// ... by up to this, ...
        faint_contrast: f64 = 15.0, "grey levels, weighted Y, U and V", "experiment: patches of skin and walls";
        /// ... and no less likely from this on.
        clear_contrast: f64 = 30.0, "grey levels, weighted Y, U and V", "experiment: balls on real clips have 40 and more";
        /// By how much a streak that was not predicted is less likely the target: long things at rest look like it.
        new_streak_nats: f64 = 1.5, "nats", "hand-set: there are several times as many as round ones";
        /// What moves is no streak of the target if its judged outline has less than this: of many fits, one is always good.
        min_moving_nats: f64 = 5.0, "nats", "experiment: streaks on real clips have 6 to 17";
        /// The greatest log-ratio by which such a streak speaks for the target's existence in one frame.
        max_new_streak_nats: f64 = 2.5, "nats", "hand-set: two frames must agree";
        /// A streak must have come at least this share of its length since the frame before.
        min_way_share: f64 = 0.7, "share", "derivation: the shutter is open for no longer than from frame to frame; lengths are certain to a third";
        /// The greatest standard deviation of a detection along any axis: the depth of a small body is measured no worse.
        max_sigma_diameters: f64 = 5.0, "diameters", "hand-set";
        /// The landmarks of one target lie within this distance of one another, ...
        landmark_reach_diameters: f64 = 10.0, "diameters", "hand-set";
        /// ... and a detection farther from another landmark is less likely one of them by this much.
        stray_landmark_nats: f64 = 8.0, "nats", "hand-set";
    }
}

tuned! {
    /// Tuned constants of existence and of the track's state.
    ExistenceTuning {
        /// Targets appear anywhere in a cube with sides of this length: the birth density is one over its volume.
        birth_diameters: f64 = 50.0, "diameters", "hand-set: a 0.2 m ball within 10 m";
        /// The standard deviation of a new target's velocity on each axis.
        birth_velocity_sigma_mps: f64 = 1.5, "m/s", "hand-set: walking pace to a slow throw";
        /// Before the first frames a target may have appeared for this long.
        time_before_start_s: f64 = 2.0, "seconds", "hand-set";
        /// How much a frame in which a visible target is nowhere near a detection speaks against it: the target's colours were not recognised.
        missed_nats: f32 = 7.0, "nats", "hand-set: once in a thousand frames";
        /// The detection within this distance of the estimate is the target.
        near_diameters: f64 = 1.0, "diameters", "hand-set: as for confidence";
        /// The confidence from which a target is found.
        found_confidence: f64 = 0.25, "share", "hand-set: its distance may be less certain than a diameter";
        /// From this share of the particles at one of the detections on, a target is found there: it may be another that looks alike.
        found_share: f64 = 0.8, "share", "hand-set";
        /// Up to this many standard deviations between them, detections are at one place, ...
        same_place_sigmas: f64 = 3.0, "standard deviations", "hand-set";
        /// ... and up to this distance across the rays on which all cameras see them.
        same_place_diameters: f64 = 0.5, "diameters", "hand-set: outlines of one ball that is partly hidden";
        /// Below this confidence a target is lost.
        lost_confidence: f64 = 0.01, "share", "hand-set";
    }
}

tuned! {
    /// Tuned constants of adaptation to illumination and surroundings.
    AdaptationTuning {
        /// From this confidence on a target is certain enough to learn from.
        certain_confidence: f64 = 0.9, "share", "hand-set";
        /// The detection to learn from lies within this distance of the estimate.
        certain_diameters: f64 = 0.5, "diameters", "hand-set: a radius";
        /// From this visible share on a body counts as unoccluded.
        unoccluded_share: f32 = 0.75, "share", "hand-set";
        /// The weight of one frame in the running mean of the colours around the target.
        surrounding_rate: f32 = 0.1, "share", "hand-set";
        /// The time constant of adaptation to illumination.
        illumination_s: f64 = 0.5, "seconds", "hand-set: lamps change faster, clouds slower";
        /// The time constant with which illumination is forgotten while the target is not seen.
        forgetting_s: f64 = 10.0, "seconds", "hand-set";
        /// How far brightness may differ from that in which the colours were learnt.
        max_brightness: f64 = 1.2, "ln of brightness", "hand-set: a factor of 3.3";
        /// How far warmth may differ from that in which the colours were learnt.
        max_warmth: f64 = 0.4, "warmth", "hand-set";
        /// How far the target's brightness may differ from that of its whole image, by shadows and lamps. Any further change of the target alone is not
        /// illumination.
        max_local_brightness: f64 = 0.2, "ln of brightness", "hand-set";
        /// The same for warmth.
        max_local_warmth: f64 = 0.05, "warmth", "hand-set";
    }
}

tuned! {
    /// Tuned constants of the heading of bodies that turn.
    HeadingTuning {
        /// The spectral density of the angular acceleration.
        turn_noise: f64 = 4.0, "rad²/s³", "hand-set: 3 rad/s² for half a second";
        /// The standard deviation of the rate of turn of a body that has just been found.
        max_rate_radps: f64 = 3.0, "rad/s", "hand-set: half a turn in a second";
        /// The least standard deviation of the predicted yaw with which an outline is fitted.
        min_sigma_rad: f64 = 0.02, "rad", "hand-set: a degree";
        /// From this many standard deviations between prediction and frames on, the yaw begins anew.
        max_sigmas: f64 = 5.0, "standard deviations", "hand-set";
        /// Outlines are sought in steps of at most this angle where the yaw is unknown.
        search_step_rad: f64 = 0.8, "rad", "hand-set: half of it is within the reach of lines in the octave in which outlines are judged";
        /// How much a way of one diameter in a direction says that the front is there.
        front_nats: f64 = 10.0, "nats", "hand-set: half a diameter decides between front and rear";
        /// If the outlines of yaws a quarter of the symmetry apart are on average closer to each other than this, they do not tell the yaw.
        min_apart_px: f64 = 2.0, "pixels", "hand-set: the outlines of small octagons look alike";
        /// By how much the direction in which a body faces differs from that in which it moves.
        course_sigma_rad: f64 = 0.17, "rad", "hand-set: ten degrees";
        /// The standard deviation of velocities.
        velocity_sigma: f64 = 0.2, "diameters/s", "hand-set: of a robot that a mirror camera sees";
        /// A side is taken for the front from this probability on, ...
        likely_front_share: f64 = 0.9, "share", "hand-set";
        /// ... and the front is known from this one on.
        front_share: f64 = 0.99, "share", "hand-set";
    }
}

tuned! {
    /// Tuned constants of the size of balls.
    SizeTuning {
        /// The number of frames after which what they said of the size has faded to a third.
        memory_frames: f64 = 250.0, "frame sets", "hand-set: ten seconds";
        /// From this standard deviation of its logarithm on a size is unknown, and one camera alone does not determine a position.
        unknown_sigma: f64 = 0.2, "ln of scale", "hand-set";
    }
}

tuned! {
    /// Tuned constants of the agreement of cameras.
    AgreementTuning {
        /// The least standard deviation of the error of a camera's pose, focal length and clock.
        sigma_px: f64 = 0.15, "pixels", "hand-set: as `edge.shared_sigma_px`";
        /// The number of comparisons after which what they said of it has faded to a third.
        memory_frames: f64 = 12.0, "comparisons", "hand-set: half a second";
        /// The greatest factor by which one comparison's variance exceeds the one known before.
        max_growth: f64 = 10.0, "ratio", "hand-set: a single outlier changes little";
        /// How far variances tend to those of the other cameras.
        shared_share: f64 = 0.1, "share", "hand-set: two cameras do not tell whose error it is";
        /// Outlines are compared with those that other cameras showed up to this long ago.
        max_age_s: f64 = 0.25, "seconds", "hand-set: cameras with 5 frames per second are compared, too; between frames motion is known for as long";
        /// Innovations beyond this count less when causes are compared.
        outlier_sigmas: f64 = 3.0, "standard deviations", "hand-set: as in statistics";
        /// The number of comparisons after which what they said of the cause has faded to a third.
        cause_frames: f64 = 1000.0, "comparisons", "hand-set: 40 seconds";
        /// From this on an error of a camera is systematic.
        systematic_px: f64 = 0.2, "pixels", "experiment: below 0.1 if all cameras are right";
        /// It explains at least this share of the squares of what the cameras disagree by.
        systematic_share: f64 = 0.5, "share", "hand-set";
        /// Fewer comparisons say nothing.
        min_comparisons: f64 = 25.0, "comparisons", "hand-set: a second";
        /// Errors of other cameras that explain this share of what the likeliest one explains are likely, too.
        ambiguous_share: f64 = 0.8, "share", "hand-set";
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_constant_is_visited_once_and_its_default_is_valid() {
        let mut tuning = Tuning::default();
        assert!(tuning.check().is_ok());
        let mut names = Vec::new();
        tuning.visit(&mut |name, _, _| names.push(name.to_owned()));
        for name in ["proposal.birth_share", "edge.rounds"] {
            assert!(names.iter().any(|found| found == name), "{name}");
        }
        let count = names.len();
        names.sort();
        names.dedup();
        assert_eq!((names.len(), tuning), (count, Tuning::default()));
        tuning.edge.moved_share = 1.5;
        let error = tuning.check().unwrap_err().to_string();
        assert!(error.contains("moved_share"), "{error}");
    }
}
