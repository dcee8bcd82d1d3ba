//! Messages of ROS 2 (Humble and later), field by field.

use serde::{Deserialize, Serialize};

/// `builtin_interfaces/Time`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub(crate) struct Time {
    pub(crate) sec: i32,
    pub(crate) nanosec: u32,
}

/// `builtin_interfaces/Duration`.
#[derive(Clone, Copy, Serialize)]
pub(crate) struct Duration {
    pub(crate) sec: i32,
    pub(crate) nanosec: u32,
}

/// `std_msgs/Header`.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct Header {
    pub(crate) stamp: Time,
    pub(crate) frame_id: String,
}

/// `std_msgs/String`.
#[derive(Clone, Serialize)]
pub(crate) struct Text {
    pub(crate) data: String,
}

/// `std_msgs/ColorRGBA`.
#[derive(Clone, Copy, Serialize)]
pub(crate) struct Color {
    pub(crate) r: f32,
    pub(crate) g: f32,
    pub(crate) b: f32,
    pub(crate) a: f32,
}

/// `geometry_msgs/Point` and `geometry_msgs/Vector3`.
#[derive(Clone, Copy, Default, Serialize, Deserialize)]
pub(crate) struct Vector {
    pub(crate) x: f64,
    pub(crate) y: f64,
    pub(crate) z: f64,
}

impl From<[f64; 3]> for Vector {
    fn from([x, y, z]: [f64; 3]) -> Self {
        Self { x, y, z }
    }
}

/// `geometry_msgs/Quaternion`.
#[derive(Clone, Copy, Serialize, Deserialize)]
pub(crate) struct Quaternion {
    pub(crate) x: f64,
    pub(crate) y: f64,
    pub(crate) z: f64,
    pub(crate) w: f64,
}

/// `geometry_msgs/Pose`.
#[derive(Clone, Copy, Serialize, Deserialize)]
pub(crate) struct Pose {
    pub(crate) position: Vector,
    pub(crate) orientation: Quaternion,
}

/// A covariance of six numbers, row by row. `serde` reads arrays of up to 32.
pub(crate) type Covariance = [[f64; 6]; 6];

/// `geometry_msgs/PoseWithCovariance`.
#[derive(Clone, Copy, Serialize, Deserialize)]
pub(crate) struct PoseWithCovariance {
    pub(crate) pose: Pose,
    pub(crate) covariance: Covariance,
}

/// `geometry_msgs/PoseWithCovarianceStamped`.
#[derive(Clone, Serialize)]
pub(crate) struct PoseWithCovarianceStamped {
    pub(crate) header: Header,
    pub(crate) pose: PoseWithCovariance,
}

/// `geometry_msgs/Twist`.
#[derive(Clone, Copy, Serialize, Deserialize)]
pub(crate) struct Twist {
    pub(crate) linear: Vector,
    pub(crate) angular: Vector,
}

/// `geometry_msgs/TwistWithCovariance`.
#[derive(Clone, Copy, Serialize, Deserialize)]
pub(crate) struct TwistWithCovariance {
    pub(crate) twist: Twist,
    pub(crate) covariance: Covariance,
}

/// `nav_msgs/Odometry`.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct Odometry {
    pub(crate) header: Header,
    pub(crate) child_frame_id: String,
    pub(crate) pose: PoseWithCovariance,
    pub(crate) twist: TwistWithCovariance,
}

/// `vision_msgs/ObjectHypothesis`.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct ObjectHypothesis {
    pub(crate) class_id: String,
    pub(crate) score: f64,
}

/// `vision_msgs/ObjectHypothesisWithPose`.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct ObjectHypothesisWithPose {
    pub(crate) hypothesis: ObjectHypothesis,
    pub(crate) pose: PoseWithCovariance,
}

/// `vision_msgs/BoundingBox2D`, with its `Pose2D`.
#[derive(Clone, Copy, Deserialize)]
pub(crate) struct BoundingBox2D {
    pub(crate) center: [f64; 2],
    pub(crate) theta: f64,
    pub(crate) size: [f64; 2],
}

/// `vision_msgs/Detection2D`.
#[derive(Clone, Deserialize)]
pub(crate) struct Detection2D {
    _header: Header,
    pub(crate) results: Vec<ObjectHypothesisWithPose>,
    pub(crate) bbox: BoundingBox2D,
    _id: String,
}

/// `vision_msgs/Detection2DArray`.
#[derive(Clone, Deserialize)]
pub(crate) struct Detection2DArray {
    pub(crate) header: Header,
    pub(crate) detections: Vec<Detection2D>,
}

/// `vision_msgs/BoundingBox3D`.
#[derive(Clone, Copy, Serialize)]
pub(crate) struct BoundingBox3D {
    pub(crate) center: Pose,
    pub(crate) size: Vector,
}

/// `vision_msgs/Detection3D`.
#[derive(Clone, Serialize)]
pub(crate) struct Detection3D {
    pub(crate) header: Header,
    pub(crate) results: Vec<ObjectHypothesisWithPose>,
    pub(crate) bbox: BoundingBox3D,
    pub(crate) id: String,
}

/// `vision_msgs/Detection3DArray`.
#[derive(Clone, Serialize)]
pub(crate) struct Detection3DArray {
    pub(crate) header: Header,
    pub(crate) detections: Vec<Detection3D>,
}

/// `sensor_msgs/CompressedImage`, only as an empty texture.
#[derive(Clone, Serialize)]
pub(crate) struct Texture {
    pub(crate) header: Header,
    pub(crate) format: String,
    pub(crate) data: Vec<u8>,
}

/// `visualization_msgs/MeshFile`.
#[derive(Clone, Serialize)]
pub(crate) struct MeshFile {
    pub(crate) filename: String,
    pub(crate) data: Vec<u8>,
}

/// `visualization_msgs/Marker`.
#[derive(Clone, Serialize)]
pub(crate) struct Marker {
    pub(crate) header: Header,
    pub(crate) ns: String,
    pub(crate) id: i32,
    pub(crate) kind: i32,
    pub(crate) action: i32,
    pub(crate) pose: Pose,
    pub(crate) scale: Vector,
    pub(crate) color: Color,
    pub(crate) lifetime: Duration,
    pub(crate) frame_locked: bool,
    pub(crate) points: Vec<Vector>,
    pub(crate) colors: Vec<Color>,
    pub(crate) texture_resource: String,
    pub(crate) texture: Texture,
    pub(crate) uv_coordinates: Vec<[f32; 2]>,
    pub(crate) text: String,
    pub(crate) mesh_resource: String,
    pub(crate) mesh_file: MeshFile,
    pub(crate) mesh_use_embedded_materials: bool,
}

/// `visualization_msgs/MarkerArray`.
#[derive(Clone, Serialize)]
pub(crate) struct MarkerArray {
    pub(crate) markers: Vec<Marker>,
}

/// `diagnostic_msgs/KeyValue`.
#[derive(Clone, Serialize)]
pub(crate) struct KeyValue {
    pub(crate) key: String,
    pub(crate) value: String,
}

/// `diagnostic_msgs/DiagnosticStatus`.
#[derive(Clone, Serialize)]
pub(crate) struct DiagnosticStatus {
    pub(crate) level: u8,
    pub(crate) name: String,
    pub(crate) message: String,
    pub(crate) hardware_id: String,
    pub(crate) values: Vec<KeyValue>,
}

/// `diagnostic_msgs/DiagnosticArray`.
#[derive(Clone, Serialize)]
pub(crate) struct DiagnosticArray {
    pub(crate) header: Header,
    pub(crate) status: Vec<DiagnosticStatus>,
}
