//! How likely a sighting is the target, rather than something that looks like it: by its outline, its colours, and where it is.

use nalgebra::{Matrix3, Vector3};

use super::Seeker;
use super::alike::Alike;
use crate::color::PixelKind;
use crate::likelihood::edge::Sighting;
use pardalis_filter::bernoulli::Peak;

/// Things that look like a target are so many in a frame, on average, over all places where targets appear.
const ALIKE_A_FRAME: f64 = 0.1;
/// ln of how much likelier a sighting is the target than such a thing: the least, and the most, ...
const LIKENESS_NATS: [f64; 2] = [-5.0, 15.0];
/// ... from one to the other by one for so much of a sighting's log ratio.
const LIKENESS_SCALE: f64 = 1.5;
/// By how many nats a sighting is less likely the target where none of what is within its outline has the target's colours: a part, then, may be hidden, but most
/// things whose colours are like the target's are so in part.
const UNLIKE_NATS: f64 = 12.0;
/// The standard deviation along any axis of a sighting at most, in diameters: what its outline does not tell.
const MAX_SIGMA_DIAMETERS: f64 = 5.0;
/// The landmarks of one target lie within so many of their diameters from one another, ...
const APART_DIAMETERS: f64 = 10.0;
/// ... and by so many nats a sighting farther off from another landmark is less likely one of them.
const APART_NATS: f64 = 8.0;

impl Seeker {
    /// A peak for each sighting. Which is which of targets that look the same nobody can say: the first that looks for one takes what is likeliest, and leaves the other
    /// sightings to those after it.
    pub(super) fn peaks(&self, sightings: &mut Vec<Sighting>, alike: &Alike) -> Vec<Peak> {
        let mut peaks: Vec<Peak> = Vec::new();
        sightings.retain_mut(|sighting| {
            let peak = self.peak(sighting, alike);
            peaks.extend(peak);
            peak.is_some()
        });
        if !self.is_found()
            && alike.leaves_some_to_others()
            && let Some(likeliest) = self.likeliest(&peaks)
        {
            peaks = vec![peaks[likeliest]];
            *sightings = vec![sightings.swap_remove(likeliest)];
        }
        peaks
    }

    /// The Gaussian that a sighting is, and its sighting weighed against what else may look like the target: things of its colours and form, of which so many are in a
    /// frame, anywhere. The sharper a sighting, the less likely that one of them is just there.
    fn peak(&self, sighting: &mut Sighting, alike: &Alike) -> Option<Peak> {
        let widest_m = MAX_SIGMA_DIAMETERS * self.shape.diameter_m();
        let mut information =
            sighting.information + Matrix3::from_diagonal_element(widest_m.powi(-2));
        if self.is_planar {
            for axis in 0..3 {
                information[(axis, 2)] = 0.0;
                information[(2, axis)] = 0.0;
            }
            information[(2, 2)] = 1.0;
        }
        let inverse = information.cholesky()?.inverse();
        let log_volume = self.log_volume(&inverse);
        let cameras = sighting.camera_count() as f64;
        let [least, greatest] = LIKENESS_NATS;
        let colors = self.color_nats(sighting) - self.apart_nats(sighting);
        let likeness = (sighting.log_ratio / cameras / LIKENESS_SCALE + least).min(greatest)
            - UNLIKE_NATS * (1.0 - sighting.seen_share())
            + colors;
        let anywhere = ALIKE_A_FRAME * self.birth_density;
        let place = (sighting.position_m, &inverse);
        let taken = self.taken_nats(alike, place, likeness, anywhere);
        let log_evidence = likeness - libm::log(anywhere) - taken;
        sighting.existence_nats = self.existence_nats(sighting, &inverse, likeness, colors) - taken;
        sighting.offset = ((log_evidence - log_volume - sighting.log_ratio) / cameras) as f32;
        Some(Peak {
            position_m: sighting.position_m,
            covariance_m2: [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|at| inverse[at]),
            log_evidence,
        })
    }

    /// ln of how much likelier a sighting makes it that there is a target. What has been followed may be but a thing that looks like the target, and then is there again: that
    /// it stayed where it was does not make it the target; nor is it something else because a part of it is hidden.
    fn existence_nats(
        &self,
        sighting: &Sighting,
        covariance_m2: &Matrix3<f64>,
        likeness: f64,
        colors: f64,
    ) -> f64 {
        let anywhere = ALIKE_A_FRAME * self.birth_density;
        let followed = self
            .filter
            .predicted_density(sighting.position_m, covariance_m2);
        let alike = anywhere + followed;
        let as_new = likeness + libm::log(self.birth_density / alike);
        let as_followed = likeness.max(colors.min(0.0)) + libm::log(followed / alike);
        as_new.max(as_followed)
    }

    /// The number of the peak that most likely is the target: where it was expected, or else where the images speak for it most.
    fn likeliest(&self, peaks: &[Peak]) -> Option<usize> {
        let score = |peak: &Peak| {
            let [xx, xy, xz, yy, yz, zz] = peak.covariance_m2;
            let covariance_m2 = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
            let expected = self.density(peak.position_m, &covariance_m2) + self.birth_density;
            peak.log_evidence + libm::log(expected)
        };
        let scores = peaks.iter().map(score).enumerate();
        // Of two alike the first.
        let best = scores.reduce(|best, next| if next.1 > best.1 { next } else { best });
        best.map(|(number, _)| number)
    }

    /// ln of √|2πΣ| of a covariance Σ, m³, or m² on the ground.
    fn log_volume(&self, covariance_m2: &Matrix3<f64>) -> f64 {
        let (axes, determinant) = if self.is_planar {
            (2.0, covariance_m2.fixed_view::<2, 2>(0, 0).determinant())
        } else {
            (3.0, covariance_m2.determinant())
        };
        0.5 * (axes * libm::log(std::f64::consts::TAU) + libm::log(determinant))
    }

    /// ln of how much likelier the colours of a sighting, as a whole, are the target's: in the camera where they are least so.
    fn color_nats(&self, sighting: &Sighting) -> f64 {
        let weighs = self.edge.settings().color_evidence;
        let Some(known) = self.colors.body().filter(|_| weighs) else {
            return 0.0;
        };
        let of_cameras = sighting.bodies().map(|(camera, body)| {
            let relight = self.lighting[camera].relight(PixelKind::FULL_RANGE_YUV);
            known.log_ratio(relight.color(body))
        });
        of_cameras.reduce(f64::min).unwrap_or(0.0)
    }

    /// By how many nats a sighting is less likely a landmark that belongs to the others.
    fn apart_nats(&self, sighting: &Sighting) -> f64 {
        let here = Vector3::from(sighting.position_m);
        let reach_m = APART_DIAMETERS * self.shape.diameter_m();
        let is_apart = |other: &[f64; 3]| (here - Vector3::from(*other)).norm() > reach_m;
        if self.others_m.iter().any(is_apart) {
            APART_NATS
        } else {
            0.0
        }
    }
}
