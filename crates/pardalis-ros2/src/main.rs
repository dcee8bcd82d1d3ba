//! `pardalis-ros2`: tracks the targets of a scene in the images of topics of ROS 2, and publishes where they are.
//!
//! It speaks ROS 2's protocol itself, so that no installation of ROS is needed.

mod clock;
mod input;
mod messages;
mod output;
mod sets;

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Result, anyhow, bail};
use clap::Parser;
use nalgebra::{Quaternion, Translation3, UnitQuaternion};
use pardalis::platform::{PoseCovariance, StampedPose};
use pardalis::tracker::PlatformId;
use pardalis::{CameraId, FrameSet, TargetId, Tracker};
use pardalis_camera::Pose;
use pardalis_scene::Scene;
use pardalis_scene::calibration::{self, CalibrationFormat};
use ros2_client::qos::{Durability, History, WhenFull};
use ros2_client::{Context, ContextOptions, Node, NodeName, NodeOptions, QosProfile};
use rustdds::mio1::{Events, Poll, Token};

use input::{Calibrations, Content, Messages, Motion, Received, next, subscribe};
use messages::{DiagnosticStatus, KeyValue, Odometry, Time};
use output::{OK, Output, WARN};
use sets::{Counts, Set, Sets};

/// How often the node reports how it does.
const DIAGNOSTICS: Duration = Duration::from_secs(1);
/// How often it says what it waits for.
const REMINDER: Duration = Duration::from_secs(5);
/// The longest wait for messages, after which an interrupt is noticed.
const POLL: Duration = Duration::from_millis(100);
/// After an image with a wrong stamp from the future, all others would be too late.
const MAX_AHEAD_NS: i64 = 10_000_000_000;
/// Number of images that may wait in a subscription.
const DEPTH: usize = 5;
/// Number of images of a camera that may wait for those of others, and for what a detector, which takes its time, found in them.
const MAX_WAITING: usize = 3;
const MAX_WAITING_FOR_DETECTORS: usize = 30;

/// Tracks the targets of a scene in images of ROS 2, and publishes where they are
///
/// The scene has the cameras with their poses, and the targets, as for `pardalis track`; its images and videos are not used.
/// Each camera CAMERA takes the topic /CAMERA/image_raw, or the one that is given.
///
/// Published are, below --namespace: TARGET/pose, TARGET/odometry and TARGET/state, detections, and markers for RViz; and /diagnostics.
#[derive(Debug, Parser)]
#[command(
    version,
    after_help = "Examples:
  pardalis-ros2 scene.toml                                   cam1 of the scene is /cam1/image_raw
  pardalis-ros2 scene.toml left=/stereo/left/image_raw right=/stereo/right/image_raw/compressed
  pardalis-ros2 scene.toml --camera-info cam1=/cam1/camera_info
  pardalis-ros2 scene.toml --detections cam1=/yolo/detections
  pardalis-ros2 scene.toml --odometry robot=/odom --frame odom"
)]
struct Arguments {
    /// The scene file
    #[arg(value_name = "SCENE.toml")]
    scene: PathBuf,
    /// The topics of cameras; those that end with /compressed have CompressedImage, all others Image
    #[arg(value_name = "CAMERA=TOPIC", value_parser = pair)]
    topics: Vec<(String, String)>,
    /// Takes the lens of a camera from a topic of CameraInfo, in place of a model or calibration in the scene
    #[arg(long, value_name = "CAMERA=TOPIC", value_parser = pair)]
    camera_info: Vec<(String, String)>,
    /// Takes what a detector found in the images of a camera from a topic of Detection2DArray, for targets with a `detector`
    #[arg(long, value_name = "CAMERA=TOPIC", value_parser = pair)]
    detections: Vec<(String, String)>,
    /// Takes the motion of a platform of the scene from a topic of Odometry
    #[arg(long, value_name = "PLATFORM=TOPIC", value_parser = pair)]
    odometry: Vec<(String, String)>,
    /// Where the results are published
    #[arg(long, default_value = "/pardalis", value_parser = namespace)]
    namespace: String,
    /// The frame of the scene's world in the results
    #[arg(long, default_value = "world")]
    frame: String,
    /// The domain of ROS 2 [default: ROS_DOMAIN_ID, else 0]
    #[arg(long)]
    domain: Option<u16>,
    /// Asks cameras for every image again that was lost, in place of taking those that come (the QoS for sensors)
    #[arg(long)]
    reliable: bool,
    /// Overrides the scene's seed
    #[arg(long)]
    seed: Option<u32>,
}

/// Parses NAME=TOPIC.
fn pair(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, topic)) if !name.is_empty() && is_topic(topic) => {
            Ok((name.to_owned(), topic.to_owned()))
        }
        _ => {
            Err("allowed: a name of the scene and a topic, such as cam1=/cam1/image_raw".to_owned())
        }
    }
}

/// Parses a namespace.
fn namespace(text: &str) -> Result<String, String> {
    let is_valid = is_topic(text);
    is_valid
        .then(|| text.trim_end_matches('/').to_owned())
        .ok_or_else(|| "allowed: a name that begins with /, such as /pardalis".to_owned())
}

/// Returns a name of a scene as part of a topic, which has no hyphens.
fn in_topic(name: &str) -> String {
    name.replace('-', "_")
}

fn is_topic(text: &str) -> bool {
    let allowed = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '/';
    text.len() > 1 && text.starts_with('/') && text.chars().all(allowed)
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(if error.is::<Failure>() { 1 } else { 2 })
        }
    }
}

/// An error that is not the user's.
#[derive(Debug)]
struct Failure(String);

impl std::fmt::Display for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Failure {}

/// A topic of images of a camera, or of what a detector found in them.
struct Source {
    /// The name of the camera, and what else it is, for messages.
    name: String,
    camera: CameraId,
    topic: String,
    messages: Messages,
}

/// Whether the user has interrupted the program.
type Stop = Arc<AtomicBool>;

fn run(arguments: &Arguments) -> Result<()> {
    let stop: Stop = Arc::default();
    let set = Arc::clone(&stop);
    ctrlc::set_handler(move || set.store(true, Ordering::Relaxed))
        .map_err(|error| Failure(format!("interrupts cannot be noticed: {error}")))?;
    let mut node = node(arguments.domain)?;
    let qos = QosProfile::subscription_default()
        .durability(Durability::Volatile)
        .history(History::KeepLast { depth: DEPTH });
    let qos = if arguments.reliable {
        qos.reliability_reliable(WhenFull::Fail)
    } else {
        qos.reliability_best_effort()
    };

    check_cameras(arguments)?;
    let mut settings = toml::Table::new();
    if let Some(seed) = arguments.seed {
        settings.insert("seed".to_owned(), toml::Value::Integer(seed.into()));
    }
    // Calibrations that were published once and are kept for those who come later ("latched"), and those that are published again and again.
    let kept = qos
        .clone()
        .durability(Durability::TransientLocal)
        .reliability_reliable(WhenFull::Fail);
    for (camera, topic) in &arguments.camera_info {
        let mut infos =
            |qos: &QosProfile| subscribe(&mut node, topic, ("sensor_msgs", "CameraInfo"), qos);
        let infos = [infos(&qos)?, infos(&kept)?];
        if !set_model(&mut settings, camera, topic, &infos, &stop)? {
            return Ok(());
        }
    }
    // All that can be wrong without an image, before the wait for images.
    let scene = pardalis_cli::scene_without_inputs(&arguments.scene, &settings)?;
    let classes = classes(&scene, arguments)?;
    let platforms = platforms(&mut node, arguments, &scene, &qos)?;
    let mut sources = images(&mut node, arguments, &scene, &qos)?;
    let detectors = detectors(&mut node, arguments, &scene, &qos)?;
    let Some(firsts) = first_images(&sources, &stop) else {
        return Ok(());
    };
    let sizes = sizes(&sources, &firsts)?;
    sources.extend(detectors);
    let opened = pardalis_cli::tracker_of_scene(Some(&arguments.scene), &settings, &sizes);
    let (scene, tracker) = opened?;
    for warning in &scene.warnings {
        eprintln!("warning: {}: {warning}", arguments.scene.display());
    }
    // A subscriber that does not keep up must not delay the others.
    let results = QosProfile::publisher_default()
        .reliability_reliable(WhenFull::Fail)
        .durability(Durability::Volatile)
        .history(History::KeepLast { depth: 10 });
    let (namespace, frame) = (&arguments.namespace, &arguments.frame);
    let output = Output::create(&mut node, namespace, frame, &scene.targets, &results)?;
    let max_delay = Duration::from_secs_f64(scene.max_delay_s);
    eprintln!(
        "tracking {}; results below {namespace}",
        scene
            .targets
            .iter()
            .map(|target| &*target.name)
            .collect::<Vec<_>>()
            .join(", ")
    );
    let max_waiting = if arguments.detections.is_empty() {
        MAX_WAITING
    } else {
        MAX_WAITING_FOR_DETECTORS
    };
    let mut tracking = Tracking {
        sets: Sets::new(sources.len(), max_delay, max_waiting),
        sources,
        classes,
        platforms,
        tracker,
        output,
        unusable: 0,
        has_warned_of_clock: false,
        has_warned_of_images: false,
        latency_s: 0.0,
    };
    tracking.run(&stop)?;
    for (source, counts) in tracking.sources.iter().zip(tracking.sets.counts()) {
        eprintln!(
            "{}: {} images received, {} used, {} late, {} dropped because tracking was too slow",
            source.name, counts.received, counts.used, counts.late, counts.dropped
        );
    }
    Ok(())
}

/// Subscribes to the images of all cameras, in the order of the scene, which the tracker has, too.
fn images(
    node: &mut Node,
    arguments: &Arguments,
    scene: &Scene,
    qos: &QosProfile,
) -> Result<Vec<Source>> {
    let cameras = scene.cameras.iter().enumerate();
    let sources = cameras.map(|(number, camera)| {
        let name = camera.name.clone();
        let given = arguments.topics.iter().find(|(camera, _)| *camera == name);
        let default = || format!("/{}/image_raw", in_topic(&name));
        let topic = given.map_or_else(default, |(_, topic)| topic.clone());
        Ok(Source {
            messages: Messages::images(node, &topic, qos)?,
            camera: CameraId::new(number),
            name,
            topic,
        })
    });
    sources.collect()
}

/// Subscribes to what detectors find.
fn detectors(
    node: &mut Node,
    arguments: &Arguments,
    scene: &Scene,
    qos: &QosProfile,
) -> Result<Vec<Source>> {
    let cameras = scene.cameras.iter().enumerate();
    let with_topics = cameras.flat_map(|(number, camera)| {
        let topics = arguments.detections.iter();
        let topics = topics.filter(|(name, _)| *name == camera.name);
        topics.map(move |(name, topic)| (CameraId::new(number), name, topic))
    });
    let sources = with_topics.map(|(camera, name, topic)| {
        Ok(Source {
            messages: Messages::boxes(node, topic, qos)?,
            camera,
            name: format!("{name}, detections"),
            topic: topic.clone(),
        })
    });
    sources.collect()
}

/// Returns the targets that detectors find, each with the class of its boxes. Fails if no topic has such boxes, or nothing needs those of a topic.
fn classes(scene: &Scene, arguments: &Arguments) -> Result<Vec<(TargetId, String)>> {
    let mut classes = Vec::new();
    for (number, target) in scene.targets.iter().enumerate() {
        for class in target.bodies.iter().filter_map(|body| body.class()) {
            classes.push((TargetId::new(number), class.to_owned()));
        }
    }
    match (classes.first(), arguments.detections.first()) {
        (Some((target, _)), None) => bail!(
            "targets.{}.detector: no topic has its boxes; give --detections {}=/TOPIC",
            scene.targets[target.index()].name,
            scene.cameras[0].name
        ),
        (None, Some((camera, topic))) => bail!(
            "--detections {camera}={topic}: no target of the scene has a detector; give one `detector = {{}}`, in place of its colors or beside them"
        ),
        _ => {}
    }
    for (number, (camera, _)) in arguments.detections.iter().enumerate() {
        if arguments.detections[..number]
            .iter()
            .any(|(other, _)| other == camera)
        {
            bail!("--detections: {camera} is given twice; give it one topic");
        }
    }
    Ok(classes)
}

/// Subscribes to the motion of platforms.
fn platforms(
    node: &mut Node,
    arguments: &Arguments,
    scene: &Scene,
    qos: &QosProfile,
) -> Result<Vec<(PlatformId, Motion)>> {
    let mut platforms = Vec::new();
    for (platform, topic) in &arguments.odometry {
        let known = scene.platforms.iter();
        let Some(number) = known.clone().position(|known| known.name == *platform) else {
            let names: Vec<&str> = known.map(|known| &*known.name).collect();
            bail!(
                "--odometry: {platform} is no platform of the scene; allowed: {}",
                names.join(", ")
            );
        };
        let motion = subscribe(node, topic, ("nav_msgs", "Odometry"), qos)?;
        platforms.push((PlatformId::new(number), motion));
    }
    for platform in &scene.platforms {
        if !arguments
            .odometry
            .iter()
            .any(|(name, _)| *name == platform.name)
        {
            bail!(
                "platforms.{0}: nothing says how it moves; give --odometry {0}=/odom, or remove it from the scene",
                platform.name
            );
        }
    }
    Ok(platforms)
}

/// Joins a domain of ROS 2.
fn node(domain: Option<u16>) -> Result<Node> {
    let domain = match (domain, std::env::var("ROS_DOMAIN_ID")) {
        (Some(domain), _) => domain,
        (None, Ok(text)) if !text.is_empty() => text
            .parse()
            .map_err(|_| anyhow!("ROS_DOMAIN_ID is {text}; allowed: 0 to 232"))?,
        (None, _) => 0,
    };
    if domain > 232 {
        bail!("the domain is {domain}; allowed: 0 to 232");
    }
    let options = ContextOptions::new().domain_id(domain);
    let context = Context::with_options(options)
        .map_err(|error| Failure(format!("the network cannot be used: {error}")))?;
    let name = NodeName::new("/", "pardalis")?;
    let node = context.new_node(name, NodeOptions::new());
    node.map_err(|error| Failure(format!("the node cannot be created: {error}")).into())
}

/// Fails if the command line names a camera that is not in the scene. Problems of the scene itself are reported when it is read, after the
/// calibrations that it lacks have come.
fn check_cameras(arguments: &Arguments) -> Result<()> {
    let text = std::fs::read_to_string(&arguments.scene).unwrap_or_default();
    let table: toml::Table = text.parse().unwrap_or_default();
    let Some(cameras) = table.get("cameras").and_then(toml::Value::as_table) else {
        // With a scene that cannot be read, there is nothing to wait for.
        pardalis_cli::scene_without_inputs(&arguments.scene, &toml::Table::new())?;
        return Ok(());
    };
    let given = [
        &arguments.topics,
        &arguments.camera_info,
        &arguments.detections,
    ];
    for (camera, _) in given.into_iter().flatten() {
        if !cameras.contains_key(camera) {
            let names: Vec<&str> = cameras.keys().map(String::as_str).collect();
            bail!(
                "{camera}: is no camera of the scene; allowed: {}",
                names.join(", ")
            );
        }
    }
    Ok(())
}

/// Waits for the calibration of a camera, and adds it to the settings of the scene. Returns whether it came before an interrupt.
fn set_model(
    settings: &mut toml::Table,
    camera: &str,
    topic: &str,
    infos: &[Calibrations; 2],
    stop: &Stop,
) -> Result<bool> {
    let mut reminded = clock::instant();
    let info = loop {
        if let Some(info) = infos.iter().find_map(next) {
            break info;
        }
        if stop.load(Ordering::Relaxed) {
            return Ok(false);
        }
        if reminded.elapsed() > REMINDER {
            eprintln!("waiting for a calibration of {camera} on {topic}");
            reminded = clock::instant();
        }
        std::thread::sleep(Duration::from_millis(10));
    };
    let in_topic = |error: pardalis::Error| anyhow!("topic {topic}: {error}");
    let known = calibration::read(&info.text(camera), None).map_err(in_topic)?;
    let text = calibration::write(CalibrationFormat::Pardalis, &known).map_err(in_topic)?;
    let table: toml::Table = text.parse()?;
    let found = table.get("cameras").and_then(|cameras| cameras.get(camera));
    for key in ["model", "size_px"] {
        if let Some(value) = found.and_then(|found| found.get(key)) {
            settings.insert(format!("cameras.{camera}.{key}"), value.clone());
        }
    }
    Ok(true)
}

/// Waits for an image of each camera; `None` if the user interrupts.
fn first_images(sources: &[Source], stop: &Stop) -> Option<Vec<Received>> {
    let mut firsts: Vec<Option<Received>> = sources.iter().map(|_| None).collect();
    let mut reminded = clock::instant();
    loop {
        for (source, first) in sources.iter().zip(&mut firsts) {
            *first = source.messages.take().or(first.take());
        }
        if firsts.iter().all(Option::is_some) {
            return firsts.into_iter().collect();
        }
        if stop.load(Ordering::Relaxed) {
            return None;
        }
        if reminded.elapsed() > REMINDER {
            let missing = sources
                .iter()
                .zip(&firsts)
                .filter(|(_, first)| first.is_none());
            let topics: Vec<&str> = missing.map(|(source, _)| &*source.topic).collect();
            eprintln!("waiting for images on {}", topics.join(", "));
            reminded = clock::instant();
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Returns the size of the images of each camera.
fn sizes(sources: &[Source], firsts: &[Received]) -> Result<Vec<(String, (usize, usize))>> {
    let mut sizes = Vec::new();
    for (source, first) in sources.iter().zip(firsts) {
        let content = first.content(0.0);
        let content = content.map_err(|error| anyhow!("{}: {error}", source.topic))?;
        if let Content::Frame(frame) = content {
            sizes.push((source.name.clone(), (frame.width(), frame.height())));
        }
    }
    Ok(sizes)
}

/// The node at work.
struct Tracking {
    sources: Vec<Source>,
    /// The targets that detectors find, and the classes of their boxes.
    classes: Vec<(TargetId, String)>,
    platforms: Vec<(PlatformId, Motion)>,
    tracker: Tracker,
    sets: Sets<Received>,
    output: Output,
    /// The number of images that could not be decoded or tracked.
    unusable: usize,
    has_warned_of_clock: bool,
    has_warned_of_images: bool,
    /// From the last image to its estimates, in seconds.
    latency_s: f64,
}

impl Tracking {
    /// Tracks until an interrupt.
    fn run(&mut self, stop: &Stop) -> Result<()> {
        let mut poll = Poll::new()?;
        for (number, source) in self.sources.iter_mut().enumerate() {
            source.messages.register(poll.registry(), Token(number))?;
        }
        let mut events = Events::with_capacity(16);
        let mut reported = clock::instant();
        let mut seen = vec![Counts::default(); self.sources.len()];
        while !stop.load(Ordering::Relaxed) {
            let due = self
                .sets
                .due()
                .map(|due| due.saturating_duration_since(clock::instant()));
            let wait = due.map_or(POLL, |due| due.min(POLL));
            match poll.poll(&mut events, Some(wait)) {
                Err(error) if error.kind() != std::io::ErrorKind::Interrupted => {
                    return Err(Failure(format!("messages cannot be awaited: {error}")).into());
                }
                _ => {}
            }
            self.take();
            let now = clock::instant();
            while let Some(set) = self.sets.next(now) {
                self.track(&set, now)?;
            }
            if reported.elapsed() >= DIAGNOSTICS {
                let elapsed_s = reported.elapsed().as_secs_f64();
                reported = clock::instant();
                self.report(&mut seen, elapsed_s);
            }
        }
        Ok(())
    }

    /// Takes all messages that have come.
    fn take(&mut self) {
        let now = clock::instant();
        let latest_ns = clock::now().nanoseconds() + MAX_AHEAD_NS;
        let mut ahead = None;
        for (number, source) in self.sources.iter().enumerate() {
            while let Some(image) = source.messages.take() {
                let stamp_ns = image.stamp().nanoseconds();
                if stamp_ns > latest_ns {
                    ahead = Some(&*source.topic);
                    self.unusable += 1;
                    continue;
                }
                self.sets.take(number, stamp_ns, image, now);
            }
        }
        if let (Some(topic), false) = (ahead, self.has_warned_of_clock) {
            eprintln!(
                "warning: {topic}: stamps are more than 10 s ahead of the clock of this computer, and such images are not used; set the clocks"
            );
            self.has_warned_of_clock = true;
        }
        for (platform, motion) in &self.platforms {
            while let Some(odometry) = next(motion) {
                let observed =
                    pose_of(&odometry).and_then(|pose| self.tracker.observe_pose(*platform, &pose));
                if let Err(error) = observed {
                    eprintln!("warning: odometry left out: {error}");
                }
            }
        }
    }

    /// Tracks the images of one instant, and publishes the estimates.
    fn track(&mut self, set: &Set<Received>, now: Instant) -> Result<()> {
        let stamp = Time::of_nanoseconds(set.stamp_ns);
        let time_s = stamp.seconds();
        let (mut frames, mut boxes) = (Vec::new(), Vec::new());
        for (number, received) in &set.images {
            let Source { camera, topic, .. } = &self.sources[*number];
            match received.content(time_s) {
                Ok(Content::Frame(frame)) => frames.push((*camera, frame)),
                Ok(Content::Boxes(found)) => boxes.push((*camera, found)),
                Err(error) => {
                    let error = format!("{topic}: {error}");
                    self.refuse(1, &error);
                }
            }
        }
        let mut frames = if frames.is_empty() {
            FrameSet::without_frames(time_s)?
        } else {
            FrameSet::new(frames)?
        };
        for (camera, found) in &boxes {
            for (target, class) in &self.classes {
                let own = found.iter().filter(|found| found.class == *class);
                let own = own.map(|found| found.image_box).collect();
                frames = frames.with_boxes(*camera, *target, own)?;
            }
        }
        // Such as images of another size than the first.
        if let Err(error) = self.tracker.observe(&frames) {
            self.refuse(frames.frames().len(), &error.to_string());
            return Ok(());
        }
        self.output.publish(&self.tracker, stamp, time_s)?;
        self.latency_s = now.elapsed().as_secs_f64();
        Ok(())
    }

    /// Counts images that cannot be used, and warns of the first.
    fn refuse(&mut self, count: usize, error: &str) {
        if !self.has_warned_of_images {
            eprintln!("warning: images that are not used: {error}");
            self.has_warned_of_images = true;
        }
        self.unusable += count;
    }

    /// Publishes how the cameras do; `seen` are the counts of each at the last report.
    fn report(&mut self, seen: &mut [Counts], elapsed_s: f64) {
        let sources = self.sources.iter().zip(self.sets.counts()).zip(seen);
        let status = sources.map(|((source, counts), seen)| {
            let rate_hz = (counts.received - seen.received) as f64 / elapsed_s;
            let is_late = counts.late > seen.late && counts.used == seen.used;
            *seen = *counts;
            let (level, message) = if rate_hz == 0.0 {
                (WARN, format!("nothing on {}", source.topic))
            } else if is_late {
                let message = "all images are older than those that were tracked; if a clock was set back, start the node again";
                (WARN, message.to_owned())
            } else {
                (OK, format!("{rate_hz:.1} images a second"))
            };
            let values = [
                ("received", counts.received.to_string()),
                ("used", counts.used.to_string()),
                ("late", counts.late.to_string()),
                ("dropped", counts.dropped.to_string()),
                ("unusable", self.unusable.to_string()),
                ("unsent", self.output.unsent.to_string()),
                ("latency_ms", format!("{:.1}", 1e3 * self.latency_s)),
            ];
            let values = values.into_iter().map(|(key, value)| KeyValue {
                key: key.to_owned(),
                value,
            });
            DiagnosticStatus {
                level,
                name: format!("pardalis: {}", source.name),
                message,
                hardware_id: source.name.clone(),
                values: values.collect(),
            }
        });
        let status = status.collect();
        self.output.publish_diagnostics(clock::now(), status);
    }
}

/// Returns the pose of a platform.
fn pose_of(odometry: &Odometry) -> Result<StampedPose, pardalis::Error> {
    let pose = odometry.pose.pose;
    let (place, turn) = (pose.position, pose.orientation);
    let turn = UnitQuaternion::from_quaternion(Quaternion::new(turn.w, turn.x, turn.y, turn.z));
    let place = Translation3::new(place.x, place.y, place.z);
    Ok(StampedPose {
        time_s: odometry.header.stamp.seconds(),
        world_from_platform: Pose::from_parts(place, turn.to_rotation_matrix()),
        covariance: PoseCovariance::from_matrix(odometry.pose.covariance)?,
    })
}
