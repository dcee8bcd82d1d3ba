//! Why nothing comes on a topic: who publishes there, and how.

use rustdds::DomainParticipant;
use rustdds::policy::Reliability;

/// The package and the name of a type of messages.
pub(crate) type Kind = (&'static str, &'static str);

pub(crate) const IMAGE: Kind = ("sensor_msgs", "Image");
pub(crate) const COMPRESSED_IMAGE: Kind = ("sensor_msgs", "CompressedImage");
pub(crate) const CAMERA_INFO: Kind = ("sensor_msgs", "CameraInfo");
pub(crate) const DETECTIONS: Kind = ("vision_msgs", "Detection2DArray");
pub(crate) const ODOMETRY: Kind = ("nav_msgs", "Odometry");

/// The most topics that a hint names.
const MAX_NAMED: usize = 5;

/// What other nodes publish.
pub(crate) struct Discovery {
    participant: DomainParticipant,
    /// Whether the node asks for reliable publishers.
    is_reliable: bool,
}

/// A publisher of another node.
struct Publisher {
    topic: String,
    /// The type of its messages, such as `sensor_msgs/msg/Image`.
    kind: String,
    is_best_effort: bool,
}

impl Discovery {
    pub(crate) fn new(participant: DomainParticipant, is_reliable: bool) -> Self {
        Self {
            participant,
            is_reliable,
        }
    }

    /// Says why nothing comes on a topic; `None` if a publisher there suits, and is only silent.
    pub(crate) fn hint(&self, topic: &str, kind: Kind) -> Option<String> {
        let writers = self.participant.discovered_writers();
        let publishers = writers.iter().filter_map(|writer| {
            let about = &writer.publication_topic_data;
            Some(Publisher {
                topic: about.topic_name.strip_prefix("rt")?.to_owned(),
                kind: ros_kind(&about.type_name),
                is_best_effort: about.reliability == Some(Reliability::BestEffort),
            })
        });
        hint(
            &publishers.collect::<Vec<_>>(),
            topic,
            kind,
            self.is_reliable,
        )
    }
}

/// Returns `sensor_msgs/msg/Image` for `sensor_msgs::msg::dds_::Image_`.
fn ros_kind(dds: &str) -> String {
    dds.trim_end_matches('_')
        .replace("::dds_::", "::")
        .replace("::", "/")
}

fn name_of((package, message): Kind) -> String {
    format!("{package}/msg/{message}")
}

fn hint(publishers: &[Publisher], topic: &str, kind: Kind, is_reliable: bool) -> Option<String> {
    let wanted = name_of(kind);
    let here: Vec<&Publisher> = publishers.iter().filter(|p| p.topic == topic).collect();
    if here.is_empty() {
        return Some(elsewhere(publishers, kind));
    }
    let of_kind: Vec<_> = here.iter().filter(|p| p.kind == wanted).collect();
    if of_kind.is_empty() {
        let found = &here[0].kind;
        let remedy = match kind {
            IMAGE if *found == name_of(COMPRESSED_IMAGE) => {
                "; publish it on a topic that ends with /compressed"
            }
            COMPRESSED_IMAGE if *found == name_of(IMAGE) => {
                "; publish it on a topic that does not end with /compressed"
            }
            _ => "",
        };
        return Some(format!("it has {found}, and {wanted} is needed{remedy}"));
    }
    let is_refused = is_reliable && of_kind.iter().all(|p| p.is_best_effort);
    is_refused.then(|| "its publisher is best effort (QoS); leave out --reliable".to_owned())
}

/// Says that nobody publishes on a topic, and where there are messages of its kind.
fn elsewhere(publishers: &[Publisher], kind: Kind) -> String {
    if publishers.is_empty() {
        return "no node publishes anything; check --domain or ROS_DOMAIN_ID, and the network"
            .to_owned();
    }
    let suits = |publisher: &&Publisher| match kind {
        IMAGE | COMPRESSED_IMAGE => [IMAGE, COMPRESSED_IMAGE]
            .map(name_of)
            .contains(&publisher.kind),
        kind => publisher.kind == name_of(kind),
    };
    let mut topics: Vec<&str> = publishers.iter().filter(suits).map(|p| &*p.topic).collect();
    topics.sort_unstable();
    topics.dedup();
    let more = if topics.len() > MAX_NAMED {
        ", ..."
    } else {
        ""
    };
    topics.truncate(MAX_NAMED);
    match &topics[..] {
        [] => format!("nobody publishes there, nor {} elsewhere", name_of(kind)),
        topics => format!("nobody publishes there, but on {}{more}", topics.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn publisher(topic: &str, dds_kind: &str, is_best_effort: bool) -> Publisher {
        Publisher {
            topic: topic.to_owned(),
            kind: ros_kind(dds_kind),
            is_best_effort,
        }
    }

    #[test]
    fn hints_say_what_is_published_instead() {
        let publishers = [
            publisher("/left/image_raw", "sensor_msgs::msg::dds_::Image_", true),
            publisher(
                "/left/image_raw/compressed",
                "sensor_msgs::msg::dds_::CompressedImage_",
                false,
            ),
            publisher(
                "/right/image",
                "sensor_msgs::msg::dds_::CompressedImage_",
                false,
            ),
            publisher("/odom", "geometry_msgs::msg::dds_::PoseStamped_", false),
        ];
        let of = |topic: &str, kind, is_reliable| hint(&publishers, topic, kind, is_reliable);
        assert_eq!(of("/left/image_raw", IMAGE, false), None);
        assert_eq!(
            of("/left/image_raw/compressed", COMPRESSED_IMAGE, true),
            None
        );
        assert_eq!(
            of("/left/image_raw", IMAGE, true).unwrap(),
            "its publisher is best effort (QoS); leave out --reliable"
        );
        assert_eq!(
            of("/right/image", IMAGE, false).unwrap(),
            "it has sensor_msgs/msg/CompressedImage, and sensor_msgs/msg/Image is needed; publish it on a topic that ends with /compressed"
        );
        assert_eq!(
            of("/odom", ODOMETRY, false).unwrap(),
            "it has geometry_msgs/msg/PoseStamped, and nav_msgs/msg/Odometry is needed"
        );
        assert_eq!(
            of("/cam1/image_raw", IMAGE, false).unwrap(),
            "nobody publishes there, but on /left/image_raw, /left/image_raw/compressed, /right/image"
        );
        assert_eq!(
            of("/yolo", DETECTIONS, false).unwrap(),
            "nobody publishes there, nor vision_msgs/msg/Detection2DArray elsewhere"
        );
        assert!(
            hint(&[], "/odom", ODOMETRY, false)
                .unwrap()
                .contains("ROS_DOMAIN_ID")
        );
    }
}
