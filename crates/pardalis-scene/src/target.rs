//! The targets of a scene.

use super::appearance::read_cues;
use super::body::BodyConfig;
use super::camera_names::CameraNames;
use super::crossing::{CrossingConfig, read_crossing};
use super::description::Presence;
use super::detector::read_detector;
use super::reader::{Located, Table};
use super::setting::Word;
use super::shape::{ShapeConfig, read_shape};
use super::shared::{Shared, WITHOUT_DETECTOR, read_boxed, read_shared};
use super::start::{StartConfig, read_start};
use pardalis::shape::Shape;
use pardalis::tracker::{BodySettings, TargetSettings};

/// One target of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct TargetConfig {
    /// Its name.
    pub name: String,
    /// Its single body, which has its name, or its landmarks.
    pub bodies: Vec<BodyConfig>,
    /// The indices of its landmarks `front` and `rear`, if it has both.
    pub heading: Option<[usize; 2]>,
    /// If there may be any number of them, the most that are tracked at once.
    pub crowd: Option<usize>,
    /// The plane that it is predicted to cross when it flies.
    pub crossing: Option<CrossingConfig>,
    /// The file with what other sensors measure of it.
    pub measurements: Option<Located<String>>,
}

/// How many targets of a kind there are.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Count {
    One,
    Any,
}

impl Word for Count {
    const WORDS: &'static [(&'static str, Self)] = &[("one", Self::One), ("any", Self::Any)];
}

impl TargetConfig {
    /// Reads one target. Returns `None` after reporting a problem to the journal.
    #[allow(clippy::too_many_lines)] // one table, read from top to bottom
    pub(super) fn read(name: String, table: Table, cameras: &CameraNames) -> Option<Self> {
        let about = "Landmarks on the target, two or more, each with its own `colors`, `start` and optionally `shape`. Landmarks named `front` and `rear` determine the heading of the target.";
        let landmarks = table.named_tables("landmarks", about, Presence::Optional(""));
        let has_landmarks = table.has("landmarks") || table.is_describing();
        // Each landmark may have its own shape.
        let shape = (!has_landmarks || table.has("shape") || table.is_describing())
            .then(|| read_shape(&table, cameras))
            .flatten();
        let own_shapes: Vec<_> = landmarks
            .iter()
            .map(|(_, landmark)| {
                let is_own = landmark.knows("shape") || !table.has("shape");
                if is_own {
                    read_shape(landmark, cameras)
                } else {
                    shape
                }
            })
            .collect();
        let typical = shape.or_else(|| own_shapes.iter().copied().flatten().next());
        let typical = typical.map(|config| config.shape);
        let has_start =
            table.has("start") || landmarks.iter().any(|(_, landmark)| landmark.has("start"));
        let cues = read_cues(&table, typical.as_ref(), &cameras.all, has_start);
        let detector = read_detector(&table);
        let has_detector = table.has("detector") && !table.is_describing();
        // With colours, it is beside the tracker's own cue.
        let is_boxed = has_detector && !table.has("colors");
        if has_detector {
            let without_colors = is_boxed.then_some("edge");
            for key in WITHOUT_DETECTOR.into_iter().chain(without_colors) {
                if table.knows(key) {
                    table.conflict(key, "detector");
                }
            }
        }
        let shared = if is_boxed {
            Some(read_boxed(&table, typical.as_ref(), detector))
        } else {
            read_shared(&table, typical.as_ref(), cues, detector)
        };
        let motion = match &shared {
            Some(Shared::Detected { motion, .. } | Shared::Boxed { motion, .. }) => *motion,
            Some(Shared::Initialized { filter, .. }) => filter.map(|filter| filter.motion),
            None => None,
        };
        if matches!(typical, Some(Shape::Flat(_)))
            && motion.is_some_and(|motion| !motion.is_planar())
        {
            let message = "lets a flat shape leave the ground; give planar_constant_velocity, planar_random_walk or planar_constant_acceleration";
            table.problem("motion", message);
        }
        let body = |name: String, table: &Table, config: Option<ShapeConfig>| {
            let shape = config.map(|config| config.shape);
            if let (Some(config), Some(shared)) = (&config, &shared) {
                shared.check_size(table, config, cameras.all.len());
            }
            let colors = table
                .key("colors", "Colour model of the target, made by `pardalis learn`. Relative to this file.")
                .depends("unless the target has a detector, only the difference cue, or the window cue with `hue_deg`")
                .located_conditional();
            // Invalid cues report their own problems.
            let needs_colors = shared.as_ref().is_some_and(Shared::needs_colors);
            if !table.has("colors") && needs_colors {
                let message = "is missing; give a colour model, made by `pardalis learn`, or, for the window cue alone, window.hue_deg and window.saturation";
                table.problem("colors", message);
            }
            // If the landmarks share a shape, the cue's own table reports it.
            let has_form = matches!(shape, Some(Shape::Sphere(_) | Shape::Upright(_)));
            let needs_flat_shape = shared.as_ref().is_some_and(Shared::needs_flat_shape);
            if has_form && needs_flat_shape {
                let message = "is not flat, but the cues region and difference apply to flat targets only; give shape.disc or shape.rectangle, or remove these cues";
                table.problem("shape", message);
            }
            let tracking = match &shared {
                Some(shared) => shared.with_start(table, &name, &cameras.all),
                // The start is read anyway, to report its problems.
                None => read_start(table, &name, &cameras.all).and(None),
            };
            Some(BodyConfig {
                name,
                shape: shape?,
                size: config?.size,
                turns: config?.turns.unwrap_or(true),
                colors,
                tracking: tracking?,
            })
        };
        if table.is_describing() {
            body(name.clone(), &table, shape);
        }
        let (bodies, heading) = if has_landmarks {
            for key in ["colors", "start"] {
                if table.knows(key) {
                    table.problem(
                        key,
                        "cannot be combined with landmarks; move it into each landmark",
                    );
                }
            }
            let names: Vec<String> = landmarks.iter().map(|(name, _)| name.clone()).collect();
            if names.len() == 1 {
                let message =
                    "has one; give two or more, or move its settings into the target itself";
                table.problem("landmarks", message);
            }
            let mut bodies = Vec::new();
            for ((name, landmark), shape) in landmarks.into_iter().zip(own_shapes) {
                bodies.push(body(name, &landmark, shape));
                let start = bodies.last().and_then(|body| body.as_ref()?.start());
                if start.is_some_and(|start| matches!(start.value, StartConfig::Track(_))) {
                    let message = "is a track, which does not contain the positions of landmarks; give start.gaussian or start.pixel";
                    landmark.problem("start", message);
                }
                landmark.finish();
            }
            (bodies, read_heading(&table, &names))
        } else {
            (vec![body(name.clone(), &table, shape)], None)
        };
        let crowd = read_crowd(&table, has_landmarks, shared.as_ref());
        let crossing = read_crossing(&table);
        if crossing.is_some() && !table.is_describing() {
            check_crossing(&table, has_landmarks, shared.as_ref());
        }
        let measurements =
            read_measurements(&table, has_landmarks || crowd.is_some(), shared.as_ref());
        table.finish();
        Some(Self {
            name,
            bodies: bodies.into_iter().collect::<Option<_>>()?,
            heading,
            crowd,
            crossing,
            measurements,
        })
    }

    /// Returns its settings, given those of its bodies.
    pub fn settings(&self, bodies: Vec<BodySettings>) -> TargetSettings {
        match (&bodies[..], self.crowd) {
            ([BodySettings::Detected(body)], Some(most)) => {
                return TargetSettings::crowd(body.clone(), most);
            }
            ([BodySettings::Boxed(body)], Some(most)) => {
                return TargetSettings::boxed_crowd(body.clone(), most);
            }
            _ => {}
        }
        let mut settings = TargetSettings::of_landmarks(bodies);
        settings.heading = self.heading;
        settings
    }
}

/// Reports targets of which no flight is measured.
fn check_crossing(table: &Table, has_landmarks: bool, shared: Option<&Shared>) {
    let message = match shared {
        _ if has_landmarks => "is given, but a target with landmarks does not fly; remove it",
        Some(Shared::Initialized { .. }) => {
            "is given, but the published cues, which a start selects, measure no single positions; remove them and the start, or add edge = {}, or remove this"
        }
        Some(
            Shared::Detected {
                motion: Some(motion),
                ..
            }
            | Shared::Boxed {
                motion: Some(motion),
                ..
            },
        ) if motion.is_planar() => {
            "is given, but the target stays on the ground; give a motion in space, or remove this"
        }
        _ => return,
    };
    table.problem("crossing", message);
}

/// Reads the file of what other sensors measure. A target of several bodies has none.
fn read_measurements(
    table: &Table,
    has_bodies: bool,
    shared: Option<&Shared>,
) -> Option<Located<String>> {
    let measurements = table
        .key("measurements", "File of what other sensors measure of the target: positions, velocities, ranges and bearings in the world, each at a time of its own. Relative to this file.")
        .depends("none")
        .located()?;
    let message = match shared {
        _ if has_bodies => {
            "does not say which landmark or member of a crowd is measured; remove it, or give one target for each"
        }
        Some(Shared::Initialized { .. }) => {
            "needs a target that is searched for; remove the published cues and the start, or add edge = {}, or remove this"
        }
        _ => return Some(measurements),
    };
    table.problem("measurements", message);
    None
}

/// Reads how many of the target there are; if any number, returns the most at once.
fn read_crowd(table: &Table, has_landmarks: bool, shared: Option<&Shared>) -> Option<usize> {
    let count = table
        .key("count", "How many there are: one, or any number that look alike, a crowd; for a known number, give one target for each. Each member of a crowd has rows of its own while it is there: `NAME-1`, `NAME-2` and so on, in the order in which they are found.")
        .word(Count::One);
    let most = table
        .key("max_count", "The most members of a crowd at once. More cost time, if there are as many things that look like the target.")
        .within(1.0..=1000.0)
        .or(TargetSettings::MOST);
    if count != Some(Count::Any) {
        if table.has("max_count") && !table.is_describing() {
            table.problem(
                "max_count",
                "is only for count = \"any\"; add that, or remove it",
            );
        }
        return None;
    }
    if has_landmarks && !table.is_describing() {
        table.problem("count", "is \"any\", but a crowd has no landmarks; give count = \"one\", or a target without landmarks");
    }
    match shared {
        _ if table.has("start") && !table.is_describing() => {
            table.problem("count", "is \"any\", but a start is that of one target; remove start, or give one target for each");
        }
        Some(Shared::Detected {
            detector: Some(_), ..
        }) => {
            let message = "is \"any\", but boxes beside colours are those of one target; remove the detector, or the colours";
            table.problem("count", message);
        }
        Some(Shared::Initialized { .. }) => {
            let message = "is \"any\", but the published cues follow one target from its start; remove them, so that the targets are detected";
            table.problem("count", message);
        }
        _ => {}
    }
    Some(most)
}

/// Returns the landmarks `front` and `rear`, which a heading needs.
fn read_heading(table: &Table, landmarks: &[String]) -> Option<[usize; 2]> {
    let [front, rear] = ["front", "rear"].map(|name| landmarks.iter().position(|l| l == name));
    if front.is_some() != rear.is_some() {
        let message = "has one of `front` and `rear`; a heading needs both, so there is none";
        table.warn("landmarks", message);
    }
    Some([front?, rear?])
}
