//! The topics of a scene: which there are, and subscriptions to them.

use anyhow::{Result, bail};
use pardalis::tracker::PlatformId;
use pardalis::{CameraId, TargetId};
use pardalis_scene::Scene;
use ros2_client::{Node, QosProfile};

use crate::Arguments;
use crate::clock::Stamps;
use crate::discovery::ODOMETRY;
use crate::input::{Messages, Motion, subscribe};

/// A topic of images of a camera, or of what a detector found in them.
pub(crate) struct Source {
    /// The name of the camera, and what else it is, for messages.
    pub(crate) name: String,
    pub(crate) camera: CameraId,
    pub(crate) topic: String,
    pub(crate) messages: Messages,
    pub(crate) stamps: Stamps,
}

/// The motion of a platform.
pub(crate) struct Carrier {
    pub(crate) id: PlatformId,
    pub(crate) topic: String,
    pub(crate) motion: Motion,
    /// Whether a message has come.
    pub(crate) has_moved: bool,
}

/// Returns the topic of the images of a camera: the one that is given, or by its name. `robot-left` is the camera of `/robot/left`, as in recordings.
pub(crate) fn of_camera(camera: &str, given: &[(String, String)]) -> String {
    let given = given.iter().find(|(name, _)| name == camera);
    let default = || format!("/{}/image_raw", camera.replace('-', "/"));
    given.map_or_else(default, |(_, topic)| topic.clone())
}

/// Returns the name of a target as part of a topic, which has no hyphens.
pub(crate) fn of_target(target: &str) -> String {
    target.replace('-', "_")
}

/// Fails if two targets would be published on the same topics.
pub(crate) fn check_results(scene: &Scene) -> Result<()> {
    for (number, target) in scene.targets.iter().enumerate() {
        let topic = of_target(&target.name);
        let before = scene.targets[..number].iter();
        if let Some(other) = before
            .map(|t| &t.name)
            .find(|other| of_target(other) == topic)
        {
            bail!(
                "the targets {other} and {} would have the same topic {topic}; rename one of them",
                target.name
            );
        }
    }
    Ok(())
}

/// Subscribes to the images of all cameras, in the order of the scene, which the tracker has, too.
pub(crate) fn images(
    node: &mut Node,
    arguments: &Arguments,
    scene: &Scene,
    qos: &QosProfile,
) -> Result<Vec<Source>> {
    let cameras = scene.cameras.iter().enumerate();
    let sources = cameras.map(|(number, camera)| {
        let name = camera.name.clone();
        let topic = of_camera(&name, &arguments.topics);
        if topic.contains("//") || topic.contains('-') {
            bail!("cameras.{name}: no topic has this name; give {name}=/TOPIC");
        }
        let before = scene.cameras[..number].iter();
        if let Some(other) = before
            .map(|camera| &camera.name)
            .find(|other| of_camera(other, &arguments.topics) == topic)
        {
            bail!("the cameras {other} and {name} have the same topic {topic}; give each its own, as {name}=/TOPIC");
        }
        Ok(Source {
            stamps: Stamps::default(),
            messages: Messages::images(node, &topic, qos)?,
            camera: CameraId::new(number),
            name,
            topic,
        })
    });
    sources.collect()
}

/// Subscribes to what detectors find.
pub(crate) fn detectors(
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
            stamps: Stamps::default(),
            messages: Messages::boxes(node, topic, qos)?,
            camera,
            name: format!("{name}, detections"),
            topic: topic.clone(),
        })
    });
    sources.collect()
}

/// Returns the targets that detectors find, each with the class of its boxes. Fails if no topic has such boxes, or nothing needs those of a topic.
pub(crate) fn classes(scene: &Scene, arguments: &Arguments) -> Result<Vec<(TargetId, String)>> {
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
pub(crate) fn platforms(
    node: &mut Node,
    arguments: &Arguments,
    scene: &Scene,
    qos: &QosProfile,
) -> Result<Vec<Carrier>> {
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
        platforms.push(Carrier {
            id: PlatformId::new(number),
            topic: topic.clone(),
            motion: subscribe(node, topic, ODOMETRY, qos)?,
            has_moved: false,
        });
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
