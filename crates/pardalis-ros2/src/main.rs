//! `pardalis-ros2`: tracks the targets of a scene in the images of topics of ROS 2, and publishes where they are.
//!
//! It speaks ROS 2's protocol itself, so that no installation of ROS is needed.

mod clock;
mod discovery;
mod input;
mod messages;
mod output;
mod sets;
mod topics;

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Result, anyhow, bail};
use clap::Parser;
use nalgebra::{Quaternion, Translation3, UnitQuaternion};
use pardalis::platform::{PoseCovariance, StampedPose};
use pardalis::{FrameSet, TargetId, Tracker};
use pardalis_camera::Pose;
use pardalis_camera::formats::Lens;
use pardalis_cli::ros2::CameraInfo;
use pardalis_scene::calibration::{self, CalibrationFormat};
use pardalis_scene::is_rectified;
use ros2_client::qos::{Durability, History, WhenFull};
use ros2_client::{Context, ContextOptions, Node, NodeName, NodeOptions, QosProfile};
use rustdds::DomainParticipant;
use rustdds::mio1::{Events, Poll, Token};

use discovery::{CAMERA_INFO, Discovery, Kind, ODOMETRY};
use input::{Calibrations, Content, Received, next, subscribe};
use messages::{DiagnosticStatus, KeyValue, Odometry, Time};
use output::{OK, Output, WARN};
use sets::{Counts, Set, Sets};
use topics::{Carrier, Source};

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
/// Each camera CAMERA takes the topic /CAMERA/image_raw, or the one that is given. Topics called image_rect have rectified images.
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
    /// Takes the lens of a camera from a topic of CameraInfo, in place of a model or calibration in the scene; of rectified images, it is that of P
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

/// Whether the user has interrupted the program.
type Stop = Arc<AtomicBool>;

fn run(arguments: &Arguments) -> Result<()> {
    let stop: Stop = Arc::default();
    let set = Arc::clone(&stop);
    ctrlc::set_handler(move || set.store(true, Ordering::Relaxed))
        .map_err(|error| Failure(format!("interrupts cannot be noticed: {error}")))?;
    let (mut node, participant) = node(arguments.domain)?;
    let discovery = Discovery::new(participant, arguments.reliable);
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
        let mut infos = |qos: &QosProfile| subscribe(&mut node, topic, CAMERA_INFO, qos);
        let infos = [infos(&qos)?, infos(&kept)?];
        let reminder = Reminder::new(&discovery);
        let Some(info) = calibration_of(camera, topic, &infos, reminder, &stop) else {
            return Ok(());
        };
        let is_of_rectified = is_rectified(&topics::of_camera(camera, &arguments.topics));
        let lens = is_of_rectified.then_some(Lens::Rectified);
        set_model(&mut settings, camera, &info, lens)
            .map_err(|error| error.context(format!("topic {topic}")))?;
    }
    // All that can be wrong without an image, before the wait for images.
    let scene = pardalis_cli::scene_without_inputs(&arguments.scene, &settings)?;
    let classes = topics::classes(&scene, arguments)?;
    topics::check_results(&scene)?;
    let platforms = topics::platforms(&mut node, arguments, &scene, &qos)?;
    let mut sources = topics::images(&mut node, arguments, &scene, &qos)?;
    let detectors = topics::detectors(&mut node, arguments, &scene, &qos)?;
    let Some(firsts) = first_images(&sources, Reminder::new(&discovery), &stop) else {
        return Ok(());
    };
    let sizes = sizes(&sources, &firsts)?;
    for (source, first) in sources.iter_mut().zip(&firsts) {
        source.stamps.time_of(first.stamp());
    }
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
        discovery,
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

/// Joins a domain of ROS 2.
fn node(domain: Option<u16>) -> Result<(Node, DomainParticipant)> {
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
    let node = node.map_err(|error| Failure(format!("the node cannot be created: {error}")))?;
    Ok((node, context.domain_participant()))
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

/// Says now and then what the node waits for, and why it may not come.
struct Reminder<'a> {
    discovery: &'a Discovery,
    reminded: Instant,
}

impl<'a> Reminder<'a> {
    fn new(discovery: &'a Discovery) -> Self {
        let reminded = clock::instant();
        Self {
            discovery,
            reminded,
        }
    }

    /// Says what is awaited on the topics with messages of these kinds, if it is time.
    fn say<'t>(&mut self, what: &str, topics: impl Iterator<Item = (&'t str, Kind)>) {
        if self.reminded.elapsed() <= REMINDER {
            return;
        }
        self.reminded = clock::instant();
        for (topic, kind) in topics {
            let hint = self.discovery.hint(topic, kind);
            let hint = hint.map_or_else(String::new, |hint| format!(": {hint}"));
            eprintln!("waiting for {what} on {topic}{hint}");
        }
    }
}

/// Waits for the calibration of a camera; `None` if the user interrupts.
fn calibration_of(
    camera: &str,
    topic: &str,
    infos: &[Calibrations; 2],
    mut reminder: Reminder,
    stop: &Stop,
) -> Option<CameraInfo> {
    loop {
        if let Some(info) = infos.iter().find_map(next) {
            return Some(info);
        }
        if stop.load(Ordering::Relaxed) {
            return None;
        }
        let topics = std::iter::once((topic, CAMERA_INFO));
        reminder.say(&format!("a calibration of {camera}"), topics);
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Adds the calibration of a camera to the settings of the scene, of rectified images if the lens says so.
fn set_model(
    settings: &mut toml::Table,
    camera: &str,
    info: &CameraInfo,
    lens: Option<Lens>,
) -> Result<()> {
    let known = calibration::read(&info.text(camera), lens)?;
    let text = calibration::write(CalibrationFormat::Pardalis, &known)?;
    let table: toml::Table = text.parse()?;
    let found = table.get("cameras").and_then(|cameras| cameras.get(camera));
    for key in ["model", "size_px"] {
        if let Some(value) = found.and_then(|found| found.get(key)) {
            settings.insert(format!("cameras.{camera}.{key}"), value.clone());
        }
    }
    Ok(())
}

/// Waits for an image of each camera; `None` if the user interrupts.
fn first_images(sources: &[Source], mut reminder: Reminder, stop: &Stop) -> Option<Vec<Received>> {
    let mut firsts: Vec<Option<Received>> = sources.iter().map(|_| None).collect();
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
        let sources = sources.iter().zip(&firsts);
        let missing = sources.filter(|(_, first)| first.is_none());
        let topics = missing.map(|(source, _)| (&*source.topic, source.messages.kind()));
        reminder.say("images", topics);
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
    platforms: Vec<Carrier>,
    tracker: Tracker,
    sets: Sets<Received>,
    output: Output,
    /// The number of images that could not be decoded or tracked.
    unusable: usize,
    discovery: Discovery,
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
        let mut silent_until = Some(reported + REMINDER);
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
            if silent_until
                .take_if(|until| clock::instant() > *until)
                .is_some()
            {
                self.warn_of_silence();
            }
        }
        Ok(())
    }

    /// Takes all messages that have come.
    fn take(&mut self) {
        let now = clock::instant();
        let latest_ns = clock::now().nanoseconds() + MAX_AHEAD_NS;
        let mut ahead = None;
        for (number, source) in self.sources.iter_mut().enumerate() {
            while let Some(image) = source.messages.take() {
                let stamp_ns = source.stamps.time_of(image.stamp()).nanoseconds();
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
        for platform in &mut self.platforms {
            while let Some(odometry) = next(&platform.motion) {
                platform.has_moved = true;
                let observed = pose_of(&odometry)
                    .and_then(|pose| self.tracker.observe_pose(platform.id, &pose));
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

    /// Warns, once, of detections and odometry that have not come and, as it seems, will not.
    fn warn_of_silence(&self) {
        let sources = self.sources.iter().zip(self.sets.counts());
        let sources = sources.filter(|(_, counts)| counts.received == 0);
        let sources = sources.map(|(source, _)| (&*source.topic, source.messages.kind()));
        let platforms = self.platforms.iter().filter(|platform| !platform.has_moved);
        let platforms = platforms.map(|platform| (&*platform.topic, ODOMETRY));
        for (topic, kind) in sources.chain(platforms) {
            if let Some(hint) = self.discovery.hint(topic, kind) {
                eprintln!("warning: nothing comes on {topic}: {hint}");
            }
        }
    }

    /// Publishes how the cameras do; `seen` are the counts of each at the last report.
    fn report(&mut self, seen: &mut [Counts], elapsed_s: f64) {
        let sources = self.sources.iter().zip(self.sets.counts()).zip(seen);
        let status = sources.map(|((source, counts), seen)| {
            let rate_hz = (counts.received - seen.received) as f64 / elapsed_s;
            let is_late = counts.late > seen.late && counts.used == seen.used;
            *seen = *counts;
            let (level, message) = if rate_hz == 0.0 {
                let hint = self.discovery.hint(&source.topic, source.messages.kind());
                let hint = hint.map_or_else(String::new, |hint| format!(": {hint}"));
                (WARN, format!("nothing on {}{hint}", source.topic))
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
