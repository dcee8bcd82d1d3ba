//! Optional output of a run as an MCAP recording with Foxglove's messages: images, cameras, outlines, and targets in space.

use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io::{BufWriter, Read as _, Write as _};
use std::path::{Path, PathBuf};

use anyhow::Result;
use foxglove::Encode;
use foxglove::messages::{
    CameraCalibration, Color, CompressedImage, FrameTransform, ImageAnnotations, LinePrimitive,
    Odometry, Point2, Point3, PointsAnnotation, Pose, Quaternion, SceneEntity, SceneEntityDeletion,
    SceneUpdate, SpherePrimitive, TextPrimitive, Timestamp, Vector3, line_primitive,
    points_annotation, scene_entity_deletion,
};
use mcap::records::MessageHeader;
use mcap::{McapError, WriteOptions, Writer};
use nalgebra::{Matrix3, Rotation3, SymmetricEigen, UnitQuaternion};
use pardalis::filter::estimate::covariance_matrix;
use pardalis::shape::Shape;
use pardalis::tracker::TrackState;
use pardalis::view::View;
use pardalis::{Estimate, TargetId};
use pardalis_camera::CalibratedCamera;
use pardalis_camera::formats::CameraInfo;
use pardalis_filter::estimate::StateEstimate;
use pardalis_scene::{BodyConfig, CameraConfig, Scene, TargetConfig};
use serde_json::json;

use super::series::Key;
use super::{Instant, Sink, Tracked, marks};
use crate::draw::picture::{jpeg_of, picture_of};
use crate::files::{refuse_foreign, unwritable};
use crate::output::Shown;
use crate::source::decode::media_kind;
use crate::user_error::user_error;

/// The frame in which positions are.
const WORLD: &str = "world";
/// The number of past positions that are shown.
const TRAIL: usize = 50;
/// Ellipsoids show this many standard deviations.
const SHOWN_SIGMAS: f64 = 2.0;
/// The schema of a target's state: everything but its position.
const STATE_SCHEMA: &str = r#"{"type":"object","title":"pardalis.State","properties":{"state":{"type":"string"},"confidence":{"type":"number"},"sigma_m":{"type":["number","null"]},"heading_rad":{"type":["number","null"]},"radius_m":{"type":["number","null"]}}}"#;

/// The program that wrote a recording, which is stated at its beginning.
const LIBRARY: &str = concat!("pardalis ", env!("CARGO_PKG_VERSION"));

/// Fails if the file is another one than a recording of tracks, or an input of the scene: recordings of robots are not replaced.
pub(super) fn check_path(path: &Path, scene: &Scene, scene_path: &Path) -> Result<()> {
    refuse_foreign("--mcap", path, "recording of tracks", is_own)?;
    let folder = scene_path.parent().unwrap_or(Path::new(""));
    let real = path.canonicalize().ok();
    let is_input = |camera: &&CameraConfig| {
        let input = folder.join(&camera.input.place().value);
        real.is_some() && real == input.canonicalize().ok()
    };
    match scene.cameras.iter().find(is_input) {
        Some(camera) => Err(user_error!(
            "--mcap {}: is the input of cameras.{}; choose another name",
            path.shown(),
            camera.name
        )),
        None => Ok(()),
    }
}

/// Reports whether this program wrote a recording.
fn is_own(path: &Path) -> bool {
    let mut begin = Vec::new();
    let read = File::open(path).and_then(|file| file.take(256).read_to_end(&mut begin));
    let is_recording = media_kind(path) == Some("recording");
    let mut words = begin.windows(b"pardalis ".len());
    is_recording && read.is_ok() && words.any(|word| word == b"pardalis ")
}

/// Writes a recording.
pub(crate) struct Recorder {
    path: PathBuf,
    writer: Writer<BufWriter<File>>,
    /// The number of each topic.
    channels: BTreeMap<String, u16>,
    cameras: Vec<CalibratedCamera>,
    targets: Vec<TargetConfig>,
    /// The last positions of each target, and of each member of a crowd that is there.
    trails: BTreeMap<Key, VecDeque<[f64; 3]>>,
}

impl Recorder {
    /// Creates the file, or replaces an earlier recording.
    pub(super) fn create(path: &Path, scene: &Scene) -> Result<Self> {
        let file = File::create(path).map_err(|error| unwritable(path, error))?;
        let options = WriteOptions::new().library(LIBRARY);
        let writer = options.create(BufWriter::new(file));
        let cameras = scene.cameras.iter().map(|camera| CalibratedCamera {
            name: camera.name.clone(),
            camera: camera.camera.clone(),
            size_px: None,
            world_from_camera: None,
        });
        Ok(Self {
            path: path.to_owned(),
            writer: writer.map_err(|error| unwritten(path, error))?,
            channels: BTreeMap::new(),
            cameras: cameras.collect(),
            targets: scene.targets.clone(),
            trails: BTreeMap::new(),
        })
    }

    /// Writes the end of the recording.
    pub(super) fn finish(mut self) -> Result<()> {
        let finished = self.writer.finish();
        finished.map_err(|error| unwritten(&self.path, error))?;
        let flushed = self.writer.into_inner().flush();
        flushed.map_err(|error| unwritable(&self.path, error))
    }

    /// Writes one of Foxglove's messages.
    fn write<M: Encode>(&mut self, topic: &str, time: Time, message: &M) -> Result<()> {
        let mut data = Vec::new();
        message
            .encode(&mut data)
            .map_err(|error| anyhow::anyhow!("{error}"))?;
        let schema = M::get_schema();
        let schema = schema.as_ref().map(|s| (&*s.name, &*s.encoding, &*s.data));
        self.write_bytes(topic, time, schema, &M::get_message_encoding(), &data)
    }

    fn write_bytes(
        &mut self,
        topic: &str,
        time: Time,
        schema: Option<(&str, &str, &[u8])>,
        encoding: &str,
        data: &[u8],
    ) -> Result<()> {
        let Self {
            path,
            writer,
            channels,
            ..
        } = self;
        let mut write = || -> Result<(), McapError> {
            let channel_id = if let Some(channel) = channels.get(topic) {
                *channel
            } else {
                let schema = match schema {
                    Some((name, encoding, data)) => writer.add_schema(name, encoding, data)?,
                    None => 0,
                };
                let channel = writer.add_channel(schema, topic, encoding, &BTreeMap::new())?;
                channels.insert(topic.to_owned(), channel);
                channel
            };
            let header = MessageHeader {
                channel_id,
                sequence: 0,
                log_time: time.ns,
                publish_time: time.ns,
            };
            writer.write_to_known_channel(&header, data)
        };
        write().map_err(|error| unwritten(path, error))
    }

    fn time_of(&self, time_s: f64) -> Result<Time> {
        Time::of(time_s).map_err(|text| user_error!("--mcap {}: {text}", self.path.shown()))
    }

    /// Writes the image of a camera with its calibration, its place and the outlines of the targets.
    fn write_frame(
        &mut self,
        camera: usize,
        instant: &Instant,
        frame: &pardalis::Frame,
    ) -> Result<()> {
        let time = self.time_of(frame.time_s())?;
        let view = &instant.tracker.views()[camera];
        let name = self.cameras[camera].name.clone();
        let image = CompressedImage {
            timestamp: Some(time.stamp),
            frame_id: name.clone(),
            data: jpeg_of(&picture_of(frame))?.into(),
            format: "jpeg".to_owned(),
        };
        self.write(&format!("/{name}/image"), time, &image)?;
        // Models that Foxglove does not have are left out.
        if let Ok(info) = CameraInfo::of(&self.cameras[camera]) {
            let calibration = CameraCalibration {
                timestamp: Some(time.stamp),
                frame_id: name.clone(),
                width: frame.width() as u32,
                height: frame.height() as u32,
                distortion_model: match info.distortion_model {
                    "equidistant" => "kannala_brandt".to_owned(),
                    other => other.to_owned(),
                },
                d: info.d,
                k: info.k.to_vec(),
                r: info.r.to_vec(),
                p: info.p.to_vec(),
            };
            self.write(&format!("/{name}/calibration"), time, &calibration)?;
        }
        let world_from_camera = view.camera_from_world().inverse();
        let rotation = UnitQuaternion::from_rotation_matrix(&world_from_camera.rotation);
        let transform = FrameTransform {
            timestamp: Some(time.stamp),
            parent_frame_id: WORLD.to_owned(),
            child_frame_id: name.clone(),
            translation: Some(vector(world_from_camera.translation.vector.into())),
            rotation: Some(quaternion(&rotation)),
        };
        self.write("/tf", time, &transform)?;
        let annotations = ImageAnnotations {
            timestamp: Some(time.stamp),
            points: self.outlines(instant, view)?,
            ..ImageAnnotations::default()
        };
        self.write(&format!("/{name}/outlines"), time, &annotations)
    }

    /// Returns the outlines of all targets in a camera's image.
    fn outlines(&self, instant: &Instant, view: &View) -> Result<Vec<PointsAnnotation>> {
        let mut outlines = Vec::new();
        for (number, target) in self.targets.iter().enumerate() {
            let now = instant
                .tracker
                .bodies_at(TargetId::new(number), instant.time_s)?;
            for (place, body, member) in instant.bodies(number, target) {
                let points_px = outline_px(body, &now[place], view);
                // Foxglove counts from the corner of the first pixel.
                let point = |[x, y]: [f64; 2]| Point2 {
                    x: x + 0.5,
                    y: y + 0.5,
                };
                outlines.push(PointsAnnotation {
                    r#type: points_annotation::Type::LineLoop as i32,
                    points: points_px.into_iter().map(point).collect(),
                    outline_color: Some(color_of((number, member), 1.0)),
                    thickness: 1.5,
                    ..PointsAnnotation::default()
                });
            }
        }
        outlines.retain(|outline| !outline.points.is_empty());
        Ok(outlines)
    }

    /// Writes a target's state and, if it has a position, its odometry.
    fn write_target(&mut self, time: Time, one: &Tracked) -> Result<()> {
        let name = one.name(&self.targets);
        let estimate = &one.estimate;
        let known = estimate.kinematics.as_ref();
        let state = json!({
            "state": estimate.state.name(),
            "confidence": estimate.confidence,
            "sigma_m": known.map(|known| {
                let [xx, _, _, yy, _, zz] = known.covariance_m2;
                (xx + yy + zz).sqrt()
            }),
            "heading_rad": estimate.heading_rad,
            "radius_m": estimate.radius.map(|radius| radius.radius_m),
        });
        let schema = Some(("pardalis.State", "jsonschema", STATE_SCHEMA.as_bytes()));
        let text = state.to_string();
        self.write_bytes(
            &format!("/{name}/state"),
            time,
            schema,
            "json",
            text.as_bytes(),
        )?;
        if let Some(known) = known {
            let odometry = odometry(&name, time, known, estimate.heading_rad);
            self.write(&format!("/{name}/odometry"), time, &odometry)?;
        }
        Ok(())
    }

    /// Writes all targets in 3D.
    fn write_scene(&mut self, time: Time, instant: &Instant) -> Result<()> {
        let is_there = |key: &Key| instant.tracked.iter().any(|one| one.key() == *key);
        self.trails.retain(|key, _| is_there(key));
        let mut entities = Vec::new();
        for one in instant.tracked {
            let Some(known) = &one.estimate.kinematics else {
                self.trails.remove(&one.key());
                continue;
            };
            let trail = self.trails.entry(one.key()).or_default();
            trail.push_back(known.position_m);
            if trail.len() > TRAIL {
                trail.pop_front();
            }
            let name = one.name(&self.targets);
            let body = &self.targets[one.target].bodies[0];
            let shape = &body.shape;
            entities.push(entity(
                time,
                (one.key(), name),
                &one.estimate,
                known,
                shape,
                trail,
            ));
        }
        let update = SceneUpdate {
            // Whatever is not there any more.
            deletions: vec![SceneEntityDeletion {
                timestamp: Some(time.stamp),
                r#type: scene_entity_deletion::Type::All as i32,
                id: String::new(),
            }],
            entities,
        };
        self.write("/targets", time, &update)
    }
}

impl Sink for Recorder {
    fn take(&mut self, instant: &Instant) -> Result<()> {
        let time = self.time_of(instant.time_s)?;
        for (camera, frame) in instant.frames {
            self.write_frame(*camera, instant, frame)?;
        }
        for one in instant.tracked {
            self.write_target(time, one)?;
        }
        self.write_scene(time, instant)
    }
}

/// A time in both forms that recordings have.
#[derive(Clone, Copy)]
struct Time {
    ns: u64,
    stamp: Timestamp,
}

impl Time {
    fn of(time_s: f64) -> Result<Self, String> {
        let whole_s = libm::floor(time_s);
        let nsec = libm::round((time_s - whole_s) * 1e9).min(999_999_999.0) as u32;
        if !(0.0..=f64::from(u32::MAX)).contains(&whole_s) {
            return Err(format!(
                "the time is {time_s} s, and recordings have times from 0 to 4294967295; set time_offset_s of the cameras"
            ));
        }
        let sec = whole_s as u32;
        Ok(Self {
            ns: u64::from(sec) * 1_000_000_000 + u64::from(nsec),
            stamp: Timestamp::new(sec, nsec),
        })
    }
}

/// The pose of a target that faces in a direction, its velocity in its own frame, and how certain position and velocity are.
fn odometry(name: &str, time: Time, known: &StateEstimate, heading_rad: Option<f64>) -> Odometry {
    let yaw = yaw(heading_rad);
    let velocity_mps = known.velocity_mps.map(nalgebra::Vector3::from);
    let own_from_world = yaw.inverse().to_rotation_matrix();
    let velocity_covariance_m2ps2 = known.velocity_covariance_m2ps2.map(|entries| {
        let turn = own_from_world.matrix();
        turn * covariance_matrix(entries) * turn.transpose()
    });
    Odometry {
        timestamp: Some(time.stamp),
        frame_id: WORLD.to_owned(),
        body_frame_id: name.to_owned(),
        pose: Some(Pose {
            position: Some(vector(known.position_m)),
            orientation: Some(quaternion(&yaw)),
        }),
        linear_velocity: velocity_mps.map(|v| vector(yaw.inverse_transform_vector(&v).into())),
        pose_covariance: upper_left(&covariance_matrix(known.covariance_m2)),
        velocity_covariance: upper_left(&velocity_covariance_m2ps2.unwrap_or_default()),
        ..Odometry::default()
    }
}

/// The 36 numbers of a covariance of which that of rotations is unknown: row by row, with zeros for it.
fn upper_left(covariance: &Matrix3<f64>) -> Vec<f64> {
    let mut numbers = vec![0.0; 36];
    for row in 0..3 {
        for column in 0..3 {
            numbers[6 * row + column] = covariance[(row, column)];
        }
    }
    numbers
}

/// A target in space: its ball, the ellipsoid of its position's error, its trail and its name.
fn entity(
    time: Time,
    (key, name): (Key, String),
    estimate: &Estimate,
    known: &StateEstimate,
    shape: &Shape,
    trail: &VecDeque<[f64; 3]>,
) -> SceneEntity {
    let at = |orientation: Quaternion| {
        Some(Pose {
            position: Some(vector(known.position_m)),
            orientation: Some(orientation),
        })
    };
    let upright = quaternion(&UnitQuaternion::identity());
    let mut spheres = Vec::new();
    if let Shape::Sphere(sphere) = shape {
        let radius_m = estimate
            .radius
            .map_or(sphere.radius_m, |radius| radius.radius_m);
        let is_seen = estimate.state == TrackState::Tracking;
        spheres.push(SpherePrimitive {
            pose: at(upright),
            size: Some(vector([2.0 * radius_m; 3])),
            color: Some(color_of(key, if is_seen { 1.0 } else { 0.4 })),
        });
    }
    let axes = SymmetricEigen::new(covariance_matrix(known.covariance_m2));
    let mut rotation = axes.eigenvectors;
    if rotation.determinant() < 0.0 {
        rotation.set_column(0, &-rotation.column(0));
    }
    let rotation =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    let size_m = axes
        .eigenvalues
        .map(|m2| 2.0 * SHOWN_SIGMAS * m2.max(0.0).sqrt());
    spheres.push(SpherePrimitive {
        pose: at(quaternion(&rotation)),
        size: Some(vector(size_m.into())),
        color: Some(color_of(key, 0.3)),
    });
    let line = LinePrimitive {
        r#type: line_primitive::Type::LineStrip as i32,
        pose: Some(Pose {
            position: Some(vector([0.0; 3])),
            orientation: Some(upright),
        }),
        thickness: 2.0,
        scale_invariant: true,
        points: trail.iter().map(|&[x, y, z]| Point3 { x, y, z }).collect(),
        color: Some(color_of(key, 1.0)),
        ..LinePrimitive::default()
    };
    let text = TextPrimitive {
        pose: at(upright),
        billboard: true,
        font_size: 14.0,
        scale_invariant: true,
        color: Some(color_of(key, 1.0)),
        text: format!(
            "{name} {} {:.2}",
            estimate.state.name(),
            estimate.confidence
        ),
    };
    SceneEntity {
        timestamp: Some(time.stamp),
        frame_id: WORLD.to_owned(),
        id: name,
        spheres,
        lines: vec![line],
        texts: vec![text],
        ..SceneEntity::default()
    }
}

/// Returns the estimated outline of a body in a camera's image; nothing if there is no estimate, or it is out of view.
fn outline_px(body: &BodyConfig, now: &Estimate, view: &View) -> Vec<[f64; 2]> {
    let Some(known) = &now.kinematics else {
        return Vec::new();
    };
    let points_px = body.shape.outline_px(
        view.camera(),
        view.camera_from_world(),
        marks::in_rows_m(known, known.position_m, body, view),
        marks::stance_of(body, now),
        marks::CONTOUR_POINTS,
    );
    points_px.into_iter().flatten().collect()
}

fn yaw(heading_rad: Option<f64>) -> UnitQuaternion<f64> {
    let (sin, cos) = libm::sincos(0.5 * heading_rad.unwrap_or(0.0));
    UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(cos, 0.0, 0.0, sin))
}

fn vector([x, y, z]: [f64; 3]) -> Vector3 {
    Vector3 { x, y, z }
}

fn quaternion(rotation: &UnitQuaternion<f64>) -> Quaternion {
    let [x, y, z, w] = rotation.coords.into();
    Quaternion { x, y, z, w }
}

/// The colour of a target, or of a member of a crowd, as in annotated frames.
fn color_of(key: Key, a: f64) -> Color {
    let [r, g, b] = marks::color_of(key).map(|byte| f64::from(byte) / 255.0);
    Color { r, g, b, a }
}

/// The recording cannot be written.
fn unwritten(path: &Path, error: McapError) -> anyhow::Error {
    match error {
        McapError::Io(error) => unwritable(path, error),
        error => anyhow::anyhow!("{}: cannot be written: {error}", path.shown()),
    }
}
