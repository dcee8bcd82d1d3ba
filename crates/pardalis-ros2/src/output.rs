//! What the node publishes.

use anyhow::Result;
use nalgebra::{UnitQuaternion, Vector3};
use pardalis::filter::estimate::{StateEstimate, covariance_matrix};
use pardalis::shape::Shape;
use pardalis::tracker::TrackState;
use pardalis::{Estimate, TargetId, Tracker};

use pardalis_scene::TargetConfig;
use ros2_client::{MessageTypeName, Name, Node, Publisher, QosProfile};
use serde::Serialize;

use crate::messages::{
    BoundingBox3D, Color, Covariance, Detection3D, Detection3DArray, DiagnosticArray,
    DiagnosticStatus, Duration, Header, Marker, MarkerArray, MeshFile, ObjectHypothesis,
    ObjectHypothesisWithPose, Odometry, Pose, PoseWithCovariance, PoseWithCovarianceStamped,
    Quaternion, Text, Texture, Time, Twist, TwistWithCovariance, Vector,
};
use crate::topics;

/// Variance of what is not estimated, as ROS's own nodes have it: large enough for a filter to ignore it.
const UNKNOWN: f64 = 1e6;
/// Ellipsoids show this many standard deviations.
const SHOWN_SIGMAS: f64 = 2.0;
/// The kinds of markers, and deleting all of them.
const SPHERE: i32 = 2;
const TEXT: i32 = 9;
const DELETE_ALL: i32 = 3;

/// The levels of diagnostics.
pub(crate) const OK: u8 = 0;
pub(crate) const WARN: u8 = 1;

/// The publishers of one target.
struct TargetOutput {
    config: TargetConfig,
    /// None for a crowd, whose members are only among the detections and markers.
    own: Option<Own>,
}

struct Own {
    pose: Publisher<PoseWithCovarianceStamped>,
    odometry: Publisher<Odometry>,
    state: Publisher<Text>,
}

/// All publishers.
pub(crate) struct Output {
    frame_id: String,
    targets: Vec<TargetOutput>,
    detections: Publisher<Detection3DArray>,
    markers: Publisher<MarkerArray>,
    diagnostics: Publisher<DiagnosticArray>,
    /// Messages that a full queue did not take.
    pub(crate) unsent: usize,
}

/// Creates a publisher of a type such as `nav_msgs/Odometry`.
fn publisher<M: Serialize>(
    node: &mut Node,
    (namespace, name): (&str, &str),
    (package, message): (&str, &str),
    qos: &QosProfile,
) -> Result<Publisher<M>> {
    let topic = Name::new(namespace, name)?;
    let topic = node.create_topic(&topic, MessageTypeName::new(package, message), qos)?;
    Ok(node.create_publisher(&topic, None)?)
}

impl Output {
    /// Creates the publishers below a namespace such as `/pardalis`.
    pub(crate) fn create(
        node: &mut Node,
        namespace: &str,
        frame_id: &str,
        targets: &[TargetConfig],
        qos: &QosProfile,
    ) -> Result<Self> {
        let mut outputs = Vec::new();
        for target in targets {
            let below = format!("{namespace}/{}", topics::of_target(&target.name));
            let own = if target.crowd.is_some() {
                None
            } else {
                let kind = ("geometry_msgs", "PoseWithCovarianceStamped");
                Some(Own {
                    pose: publisher(node, (&below, "pose"), kind, qos)?,
                    odometry: publisher(node, (&below, "odometry"), ("nav_msgs", "Odometry"), qos)?,
                    state: publisher(node, (&below, "state"), ("std_msgs", "String"), qos)?,
                })
            };
            outputs.push(TargetOutput {
                config: target.clone(),
                own,
            });
        }
        let detections = ("vision_msgs", "Detection3DArray");
        let markers = ("visualization_msgs", "MarkerArray");
        let diagnostics = ("diagnostic_msgs", "DiagnosticArray");
        Ok(Self {
            frame_id: frame_id.to_owned(),
            targets: outputs,
            detections: publisher(node, (namespace, "detections"), detections, qos)?,
            markers: publisher(node, (namespace, "markers"), markers, qos)?,
            diagnostics: publisher(node, ("/", "diagnostics"), diagnostics, qos)?,
            unsent: 0,
        })
    }

    /// Publishes the estimates of all targets at the time of the latest images, which have this stamp.
    pub(crate) fn publish(&mut self, tracker: &Tracker, stamp: Time, time_s: f64) -> Result<()> {
        let header = Header {
            stamp,
            frame_id: self.frame_id.clone(),
        };
        let mut detections = Vec::new();
        let mut markers = vec![Marker {
            action: DELETE_ALL,
            ..marker(&header, "", 0, identity())
        }];
        let mut unsent = 0;
        let mut count = |is_sent: bool| unsent += usize::from(!is_sent);
        for (number, target) in self.targets.iter().enumerate() {
            let id = TargetId::new(number);
            let name = &target.config.name;
            let shape = &target.config.bodies[0].shape;
            let Some(own) = &target.own else {
                for member in tracker.members_at(id, time_s)? {
                    let name = format!("{name}-{}", member.number);
                    let found = found(&header, &target.config.name, name, &member.estimate, shape);
                    push(
                        &mut detections,
                        &mut markers,
                        found,
                        &member.estimate,
                        number,
                    );
                }
                continue;
            };
            let estimate = tracker.estimate_at(id, time_s)?;
            let state = Text {
                data: estimate.state.name().to_owned(),
            };
            count(own.state.publish(state).is_ok());
            let found = found(&header, name, name.clone(), &estimate, shape);
            if let Some(found) = &found {
                let pose = found.results[0].pose;
                let stamped = PoseWithCovarianceStamped {
                    header: header.clone(),
                    pose,
                };
                count(own.pose.publish(stamped).is_ok());
                let odometry = Odometry {
                    header: header.clone(),
                    child_frame_id: name.clone(),
                    pose,
                    twist: twist(estimate.kinematics.as_ref(), estimate.heading_rad),
                };
                count(own.odometry.publish(odometry).is_ok());
            }
            push(&mut detections, &mut markers, found, &estimate, number);
        }
        let detections = Detection3DArray { header, detections };
        count(self.detections.publish(detections).is_ok());
        count(self.markers.publish(MarkerArray { markers }).is_ok());
        self.unsent += unsent;
        Ok(())
    }

    /// Publishes how the node does.
    pub(crate) fn publish_diagnostics(&mut self, stamp: Time, status: Vec<DiagnosticStatus>) {
        let header = Header {
            stamp,
            frame_id: String::new(),
        };
        let sent = self.diagnostics.publish(DiagnosticArray { header, status });
        self.unsent += usize::from(sent.is_err());
    }
}

/// Adds what was found of a target, and its markers.
fn push(
    detections: &mut Vec<Detection3D>,
    markers: &mut Vec<Marker>,
    found: Option<Detection3D>,
    estimate: &Estimate,
    number: usize,
) {
    let Some(found) = found else {
        return;
    };
    let is_seen = estimate.state == TrackState::Tracking;
    let id = markers.len() as i32;
    let pose = found.bbox.center;
    let covariance = found.results[0].pose.covariance;
    let sigmas_m = [0, 1, 2].map(|axis| covariance[axis][axis].max(0.0).sqrt());
    markers.push(Marker {
        kind: SPHERE,
        scale: found.bbox.size,
        color: color_of(number, if is_seen { 1.0 } else { 0.4 }),
        ..marker(&found.header, "targets", id, pose)
    });
    markers.push(Marker {
        kind: SPHERE,
        scale: sigmas_m.map(|sigma_m| 2.0 * SHOWN_SIGMAS * sigma_m).into(),
        color: color_of(number, 0.3),
        ..marker(&found.header, "uncertainty", id, pose)
    });
    let mut above = pose;
    above.position.z += found.bbox.size.z;
    markers.push(Marker {
        kind: TEXT,
        // The height of capitals.
        scale: [0.0, 0.0, 0.5 * found.bbox.size.z].into(),
        color: color_of(number, 1.0),
        text: format!(
            "{} {} {:.2}",
            found.id,
            estimate.state.name(),
            estimate.confidence
        ),
        ..marker(&found.header, "names", id, above)
    });
    detections.push(found);
}

/// Returns the detection of a target; `None` while it has no position.
fn found(
    header: &Header,
    class: &str,
    id: String,
    estimate: &Estimate,
    shape: &Shape,
) -> Option<Detection3D> {
    let known = estimate.kinematics.as_ref()?;
    let pose = Pose {
        position: known.position_m.into(),
        orientation: quaternion(&yaw(estimate.heading_rad)),
    };
    let yaw_m2 = estimate
        .heading_sigma_rad
        .map_or(UNKNOWN, |sigma| sigma * sigma);
    let [xx, xy, xz, yy, yz, zz] = known.covariance_m2;
    let covariance: Covariance = [
        [xx, xy, xz, 0.0, 0.0, 0.0],
        [xy, yy, yz, 0.0, 0.0, 0.0],
        [xz, yz, zz, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, UNKNOWN, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, UNKNOWN, 0.0],
        [0.0, 0.0, 0.0, 0.0, 0.0, yaw_m2],
    ];
    let diameter_m = estimate
        .radius
        .map_or_else(|| shape.diameter_m(), |radius| 2.0 * radius.radius_m);
    Some(Detection3D {
        header: header.clone(),
        results: vec![ObjectHypothesisWithPose {
            hypothesis: ObjectHypothesis {
                class_id: class.to_owned(),
                score: estimate.confidence,
            },
            pose: PoseWithCovariance { pose, covariance },
        }],
        bbox: BoundingBox3D {
            center: pose,
            size: [diameter_m; 3].into(),
        },
        id,
    })
}

/// The velocity in the target's own frame, with its covariance.
fn twist(known: Option<&StateEstimate>, heading_rad: Option<f64>) -> TwistWithCovariance {
    let velocity_mps = known.and_then(|known| known.velocity_mps);
    let velocity_mps = Vector3::from(velocity_mps.unwrap_or_default());
    let own_from_world = yaw(heading_rad).inverse().to_rotation_matrix();
    let own_mps: [f64; 3] = (own_from_world * velocity_mps).into();
    let mut covariance = [[0.0; 6]; 6];
    for (axis, row) in covariance.iter_mut().enumerate() {
        row[axis] = UNKNOWN;
    }
    let stated = known.and_then(|known| known.velocity_covariance_m2ps2);
    if let Some(entries) = stated {
        let turn = own_from_world.matrix();
        let own = turn * covariance_matrix(entries) * turn.transpose();
        for (row, values) in covariance.iter_mut().take(3).enumerate() {
            for (column, value) in values.iter_mut().take(3).enumerate() {
                *value = own[(row, column)];
            }
        }
    }
    TwistWithCovariance {
        twist: Twist {
            linear: own_mps.into(),
            angular: Vector::default(),
        },
        covariance,
    }
}

fn yaw(heading_rad: Option<f64>) -> UnitQuaternion<f64> {
    let (sin, cos) = libm::sincos(0.5 * heading_rad.unwrap_or(0.0));
    UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(cos, 0.0, 0.0, sin))
}

fn quaternion(rotation: &UnitQuaternion<f64>) -> Quaternion {
    let [x, y, z, w] = rotation.coords.into();
    Quaternion { x, y, z, w }
}

fn identity() -> Pose {
    Pose {
        position: Vector::default(),
        orientation: quaternion(&UnitQuaternion::identity()),
    }
}

/// A marker of nothing yet.
fn marker(header: &Header, ns: &str, id: i32, pose: Pose) -> Marker {
    Marker {
        header: header.clone(),
        ns: ns.to_owned(),
        id,
        kind: 0,
        action: 0,
        pose,
        scale: Vector::default(),
        color: color_of(0, 0.0),
        lifetime: Duration { sec: 0, nanosec: 0 },
        frame_locked: false,
        points: Vec::new(),
        colors: Vec::new(),
        texture_resource: String::new(),
        texture: Texture {
            header: Header {
                stamp: Time { sec: 0, nanosec: 0 },
                frame_id: String::new(),
            },
            format: String::new(),
            data: Vec::new(),
        },
        uv_coordinates: Vec::new(),
        text: String::new(),
        mesh_resource: String::new(),
        mesh_file: MeshFile {
            filename: String::new(),
            data: Vec::new(),
        },
        mesh_use_embedded_materials: false,
    }
}

/// The colour of the markers of a target.
fn color_of(number: usize, a: f32) -> Color {
    const COLORS: [[f32; 3]; 4] = [
        [0.9, 0.4, 0.0],
        [0.0, 0.45, 0.7],
        [0.0, 0.6, 0.45],
        [0.8, 0.5, 0.7],
    ];
    let [r, g, b] = COLORS[number % COLORS.len()];
    Color { r, g, b, a }
}
