//! The place where outlines fit best: Newton's method on the log-likelihoods of lines, over all cameras at once.

use nalgebra::{Matrix3, Vector3};

use super::lines::{Lines, SECTORS};
use super::{Around, Coordinates, EdgeCue, LANES, Look};

/// Where a target is seen, by the frames of one instant alone.
#[derive(Debug, Clone, Default)]
pub(crate) struct Sighting {
    /// Its position in the world, metres.
    pub(crate) position_m: [f64; 3],
    /// The curvature of the log-likelihood there, 1/m²: the inverse of the position's covariance.
    pub(crate) information: Matrix3<f64>,
    /// ln of the likelihood ratio there, summed over the cameras that see it.
    pub(crate) log_ratio: f64,
    /// What is added to ln of the ratio, a camera, to compare it with what else may look like the target.
    pub(crate) offset: f32,
    /// ln of how much likelier it makes it that there is a target.
    pub(crate) existence_nats: f64,
    /// One for each camera that sees it.
    lines: Vec<Lines>,
}

impl Sighting {
    /// The share of the outline that is seen in the target's colours, the mean over the cameras that see it.
    pub(crate) fn seen_share(&self) -> f64 {
        let sum: f32 = self.lines.iter().map(|lines| lines.seen_share).sum();
        f64::from(sum) / self.lines.len() as f64
    }

    /// The same of one camera, if it sees it.
    pub(crate) fn seen_share_by(&self, camera: usize) -> Option<f64> {
        let lines = self.lines_of(camera).next()?;
        Some(f64::from(lines.seen_share))
    }

    /// What is seen of it in the target's colours, a camera: mean Y, U and V.
    pub(crate) fn bodies(&self) -> impl Iterator<Item = (usize, [f32; 3])> {
        self.lines.iter().map(|lines| (lines.camera, lines.body))
    }

    /// The same of one camera, if nothing hides any of it there.
    pub(crate) fn whole_body(&self, camera: usize) -> Option<[f32; 3]> {
        let lines = self.lines_of(camera).next()?;
        (lines.seen_share >= WHOLE).then_some(lines.body)
    }

    /// How many cameras see it.
    pub(crate) fn camera_count(&self) -> usize {
        self.lines.len()
    }

    /// Learns what surrounds the target in a camera's image, beside what was known: slowly, and not of sectors into which something else has come.
    pub(crate) fn learn_around(&self, camera: usize, known: &mut Option<Around>) {
        let Some(lines) = self.lines_of(camera).next() else {
            return;
        };
        let known = known.get_or_insert(lines.around);
        let is_new = |sector: usize| known[sector].iter().any(|value| value.is_nan());
        let rates: [f32; SECTORS] = std::array::from_fn(|sector| {
            if is_new(sector) {
                1.0
            } else {
                0.1 * lines.familiar[sector]
            }
        });
        for ((known, around), rate) in known.iter_mut().zip(&lines.around).zip(rates) {
            if around.iter().all(|value| value.is_finite()) {
                for (known, value) in known.iter_mut().zip(around) {
                    *known = if rate == 1.0 {
                        *value
                    } else {
                        *known + rate * (value - *known)
                    };
                }
            }
        }
    }

    pub(super) fn lines_of(&self, camera: usize) -> impl Iterator<Item = &Lines> {
        self.lines
            .iter()
            .filter(move |lines| lines.camera == camera)
    }
}

/// Sums of the lines' log ratios over each sector, of a block of outlines.
pub(super) struct Sums([[f32; LANES]; SECTORS]);

impl Sums {
    #[inline(always)]
    pub(super) fn of(lines: &Lines, outlines: &[Coordinates]) -> Self {
        let mut sums = [[0_f32; LANES]; SECTORS];
        for (k, [u, v]) in outlines.iter().enumerate() {
            let sum = &mut sums[lines.sector(k)];
            for lane in 0..LANES {
                sum[lane] += lines.tempered(k, lines.shift_px(k, [u[lane], v[lane]]));
            }
        }
        Self(sums)
    }

    pub(super) fn lane(&self, lane: usize) -> [f32; SECTORS] {
        std::array::from_fn(|sector| self.0[sector][lane])
    }
}

/// Where at least this share of its pixels has the target's colours, nothing hides a body.
const WHOLE: f32 = 0.75;
/// Times that lines are looked along anew, around what the ones before made of it.
const ROUNDS: usize = 4;
/// Newton steps a round.
const STEPS: usize = 4;
/// Half the width over which the lines' log-likelihoods are differentiated, in pixels: pixels make them rough below.
const SPAN_PX: f32 = 0.5;
/// No step moves the outline farther than this, in pixels: lines know no more.
const MOST_SHIFT_PX: f64 = 3.5;
/// Steps that move the outline less end a round, in pixels.
const LEAST_SHIFT_PX: f64 = 0.01;
/// A camera that sees less of the outline in the target's colours does not see the target.
const LEAST_SEEN_SHARE: f32 = 0.2;
/// The curvature that lines have at least, 1/px² before tempering: keeps steps finite where a line is flat.
const LEAST_CURVATURE: f32 = 0.02;

/// What lines say of a small step: gradient, curvature and value.
struct Slope {
    gradient: Vector3<f64>,
    curvature: Matrix3<f64>,
}

impl EdgeCue {
    /// The best place near a position; `None` where no camera sees the target's colours there. `prior` is a Gaussian that is fitted along with the lines: mean and
    /// inverse covariance. Flat motion (`is_planar`) keeps the height.
    pub(crate) fn fit(
        &mut self,
        looks: &[Look],
        position_m: [f64; 3],
        prior: Option<(&Vector3<f64>, &Matrix3<f64>)>,
        is_planar: bool,
    ) -> Option<Sighting> {
        let mut sighting = Sighting {
            position_m,
            ..Sighting::default()
        };
        for round in 0..=ROUNDS {
            self.look(looks, &mut sighting);
            if sighting.lines.is_empty() {
                return None;
            }
            if round == ROUNDS {
                break;
            }
            let before = Vector3::from(sighting.position_m);
            let mut damping = 1e-3;
            let mut value = self.value(looks, &sighting, before, prior);
            let mut moved_px = 0.0_f64;
            for _ in 0..STEPS {
                let here = Vector3::from(sighting.position_m);
                let (slope, shift_px) = self.slope(looks, &sighting, here, prior);
                let Some((step, size_px)) = solve(&slope, damping, is_planar, &shift_px) else {
                    break;
                };
                let there = here + step;
                let new_value = self.value(looks, &sighting, there, prior);
                if new_value > value {
                    value = new_value;
                    sighting.position_m = there.into();
                    damping *= 0.1;
                    moved_px += size_px;
                } else {
                    damping = (damping * 30.0).max(1e-2);
                }
                if size_px < LEAST_SHIFT_PX {
                    break;
                }
            }
            if moved_px < LEAST_SHIFT_PX && round > 0 {
                break;
            }
        }
        let here = Vector3::from(sighting.position_m);
        let (slope, _) = self.slope(looks, &sighting, here, None);
        sighting.information = slope.curvature;
        sighting.log_ratio = self.value(looks, &sighting, here, None);
        sighting.log_ratio.is_finite().then_some(sighting)
    }

    /// Looks along lines around the sighting's position, in each camera that shows the target's colours there.
    fn look(&mut self, looks: &[Look], sighting: &mut Sighting) {
        let mut count = 0;
        for look in looks {
            self.project(look, &sighting.position_m.map(|v| [v as f32; LANES]));
            if sighting.lines.len() == count {
                sighting.lines.push(Lines::default());
            }
            let lines = &mut sighting.lines[count];
            let looked = lines.look(
                look,
                &self.coordinates,
                &self.table,
                &self.settings,
                &mut self.scratch,
            );
            count += usize::from(looked && lines.seen_share >= LEAST_SEEN_SHARE);
        }
        sighting.lines.truncate(count);
    }

    /// ln of the likelihood ratio at a position, and of the prior there.
    fn value(
        &mut self,
        looks: &[Look],
        sighting: &Sighting,
        position: Vector3<f64>,
        prior: Option<(&Vector3<f64>, &Matrix3<f64>)>,
    ) -> f64 {
        let mut value = prior.map_or(0.0, |(mean, information)| {
            let off = position - mean;
            -0.5 * (off.transpose() * information * off)[0]
        });
        for lines in &sighting.lines {
            let Some(look) = looks.iter().find(|look| look.camera == lines.camera) else {
                continue;
            };
            let single: [f64; 3] = position.into();
            self.project(look, &single.map(|v| [v as f32; LANES]));
            let sums = Sums::of(lines, &self.coordinates).lane(0);
            value += f64::from(lines.log_ratio(&sums));
        }
        value
    }

    /// Gradient and curvature at a position, and how many pixels the outline moves a metre along each axis.
    fn slope(
        &mut self,
        looks: &[Look],
        sighting: &Sighting,
        position: Vector3<f64>,
        prior: Option<(&Vector3<f64>, &Matrix3<f64>)>,
    ) -> (Slope, [f64; 3]) {
        let mut slope = Slope {
            gradient: Vector3::zeros(),
            curvature: Matrix3::zeros(),
        };
        let mut most = [0.0_f64; 3];
        // Either way along each axis, so far that single precision still tells the difference.
        let step_m = 0.02 * self.diameter_m;
        let mut positions = [[0_f32; LANES]; 3];
        for lane in 0..LANES {
            for axis in 0..3 {
                let sign = [(1 + 2 * axis, 1.0), (2 + 2 * axis, -1.0)]
                    .into_iter()
                    .find_map(|(at, sign)| (at == lane).then_some(sign));
                positions[axis][lane] = (position[axis] + sign.unwrap_or(0.0) * step_m) as f32;
            }
        }
        let width_m: [f32; 3] = std::array::from_fn(|axis| {
            positions[axis][1 + 2 * axis] - positions[axis][2 + 2 * axis]
        });
        for lines in &sighting.lines {
            let Some(look) = looks.iter().find(|look| look.camera == lines.camera) else {
                continue;
            };
            self.project(look, &positions);
            let sums = Sums::of(lines, &self.coordinates).lane(0);
            let seen = lines.seen_given(&sums);
            for k in 0..lines.line_count() {
                let [u, v] = &self.coordinates[k];
                let [nu, nv] = lines.normal(k);
                let along = Vector3::from_fn(|axis, _| {
                    let [plus, minus] = [1 + 2 * axis, 2 + 2 * axis];
                    let moved = (u[plus] - u[minus]) * nu + (v[plus] - v[minus]) * nv;
                    f64::from(moved / width_m[axis])
                });
                // The outline has no pixel here.
                if along.iter().any(|v| v.is_nan()) {
                    continue;
                }
                for axis in 0..3 {
                    most[axis] = most[axis].max(along[axis].abs());
                }
                let shift_px = lines.shift_px(k, [u[0], v[0]]);
                let at = |d: f32| lines.tempered(k, shift_px + d);
                let [less, here, more] = [-SPAN_PX, 0.0, SPAN_PX].map(at);
                let gradient = (more - less) / (2.0 * SPAN_PX);
                let least = LEAST_CURVATURE * lines.likelihood_exponent;
                let curvature = ((2.0 * here - less - more) / (SPAN_PX * SPAN_PX)).max(least);
                let weight = f64::from(seen[lines.sector(k)]);
                slope.gradient += along * (weight * f64::from(gradient));
                slope.curvature += along * along.transpose() * (weight * f64::from(curvature));
            }
        }
        if let Some((mean, information)) = prior {
            slope.gradient -= information * (position - mean);
            slope.curvature += information;
        }
        (slope, most)
    }
}

/// The step up a slope, and by how many pixels it moves the outline at most: no farther than lines know.
fn solve(
    slope: &Slope,
    damping: f64,
    is_planar: bool,
    px_a_metre: &[f64; 3],
) -> Option<(Vector3<f64>, f64)> {
    let mut curvature = slope.curvature;
    let mut gradient = slope.gradient;
    for axis in 0..3 {
        curvature[(axis, axis)] *= 1.0 + damping;
    }
    if is_planar {
        for axis in 0..3 {
            curvature[(axis, 2)] = 0.0;
            curvature[(2, axis)] = 0.0;
        }
        curvature[(2, 2)] = 1.0;
        gradient[2] = 0.0;
    }
    let step = curvature.cholesky()?.solve(&gradient);
    let size_px: f64 = (0..3)
        .map(|axis| step[axis].abs() * px_a_metre[axis])
        .fold(0.0, f64::max);
    if !size_px.is_finite() {
        return None;
    }
    let shrink = (MOST_SHIFT_PX / size_px).min(1.0);
    Some((step * shrink, size_px * shrink))
}
