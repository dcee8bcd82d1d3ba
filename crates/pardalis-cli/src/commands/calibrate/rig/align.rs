//! Where the world of a calibrated rig is: as in the scene, by known points, by places of the ball, or by a board.

use std::path::{Path, PathBuf};

use anyhow::Result;
use nalgebra::Point3;
use pardalis_calibrate::board::{Board, detect};
use pardalis_calibrate::{
    BallRigCalibration, Correspondence, RigAlignment, RigSight, align_to_places, align_to_points,
};
use pardalis_camera::Pose;
use pardalis_scene::Scene;

use super::super::observations::{self, Columns};
use crate::draw::picture::picture_of;
use crate::output::Shown;
use crate::source::{Delivery, Source};
use crate::tables::Table;
use crate::user_error::user_error;

/// Number of frames of each camera that are searched for a board.
const BOARD_FRAMES: usize = 10;

/// A known point this far from where it should be in an image, in pixels, may be wrong. Hand-set: points are read by hand to a pixel or two.
const FAR_PX: f64 = 3.0;

/// Standard deviation of all lengths from errors that the outlines of the ball share, as a share of them.
const OUTLINE_SIGMA: f64 = 0.005;

/// The ball.
pub(super) struct Ball {
    pub(super) radius_m: f64,
    /// Standard deviation of its radius, as a share of it.
    pub(super) tolerance: f64,
}

/// What says where the world is.
pub(in crate::commands) enum Known {
    /// The poses in the scene, if there are any.
    Scene,
    /// Points or places in a table.
    File(PathBuf),
    /// Points that cameras see, by their names.
    #[cfg(feature = "studio")]
    Points(Vec<(String, Vec<Correspondence>)>),
    /// A board at rest in view.
    Board(Board),
}

/// How the world frame is defined.
pub(super) enum Alignment {
    /// What the scene says.
    Scene,
    /// Points that each camera sees, and where they are described.
    Points(String, Vec<Vec<Correspondence>>),
    /// Times in seconds and places of the ball's centre in metres, and where they are described.
    Places(String, Vec<(f64, [f64; 3])>),
}

/// The world of a rig.
pub(super) struct World {
    pub(super) aligned: RigAlignment,
    /// What says where the world is.
    pub(super) because: String,
    /// A known point that may be wrong, and why.
    pub(super) doubt: Option<String>,
    /// The number of the camera whose guessed pose it follows from.
    pub(super) guess: Option<usize>,
}

impl Alignment {
    /// Returns what is known before the cameras are open.
    pub(super) fn known(known: &Known, scene: &Scene) -> Result<Self> {
        match known {
            Known::Scene | Known::Board(_) => Ok(Self::Scene),
            Known::File(path) => Self::read(path, scene),
            #[cfg(feature = "studio")]
            Known::Points(all) => {
                let of = |name: &String| all.iter().find(|(camera, _)| camera == name);
                let names = scene.cameras.iter().map(|camera| &camera.name);
                let points = names.map(|name| of(name).map_or(Vec::new(), |(_, p)| p.clone()));
                Ok(Self::Points(
                    "the known points".to_owned(),
                    points.collect(),
                ))
            }
        }
    }

    /// Reads known points.
    fn read(path: &Path, scene: &Scene) -> Result<Self> {
        let table = Table::read(path)?;
        if table.optional_column("time_s").is_some() {
            let columns = table.columns(["time_s", "x_m", "y_m", "z_m"])?;
            let place = |row: crate::tables::Row| {
                let [time_s, x, y, z] = row.numbers(columns)?;
                anyhow::Ok((time_s, [x, y, z]))
            };
            let places = table.rows().map(place).collect::<Result<_>>()?;
            return Ok(Self::Places(path.shown(), places));
        }
        table.column("view")?;
        let seen = observations::read_table(&table, &Columns::default())?;
        let mut points = vec![Vec::new(); scene.cameras.len()];
        for view in seen.views {
            let camera = scene.cameras.iter().position(|c| c.name == view.name);
            let Some(camera) = camera else {
                let names: Vec<&str> = scene.cameras.iter().map(|c| &*c.name).collect();
                return Err(user_error!(
                    "{}: view {:?} is no camera of the scene; allowed: {}",
                    path.shown(),
                    view.name,
                    names.join(", ")
                ));
            };
            points[camera] = view.correspondences;
        }
        Ok(Self::Points(path.shown(), points))
    }

    /// Searches the first frames of each camera for a board.
    pub(super) fn on_board(sources: &mut [Source], board: &Board) -> Result<Self> {
        let mut points = Vec::new();
        let mut last = String::new();
        for source in sources {
            let mut corners = Vec::new();
            for delivery in source.take(BOARD_FRAMES) {
                let Delivery::Frame { frame, .. } = delivery? else {
                    continue;
                };
                match detect(board, &picture_of(&frame).to_grey()) {
                    Ok(found) => {
                        corners = found;
                        break;
                    }
                    Err(reason) => last = reason.to_string(),
                }
            }
            let correspondences = corners.iter().map(|corner| Correspondence {
                point_m: corner.board_m,
                pixel: corner.pixel,
            });
            points.push(correspondences.collect::<Vec<_>>());
        }
        if points.iter().all(Vec::is_empty) {
            return Err(user_error!(
                "no camera shows the board in its first {BOARD_FRAMES} images ({last}); lay it where one of them sees it wholly before the recording begins, or check its description (--board)"
            ));
        }
        Ok(Self::Points("the board".to_owned(), points))
    }

    /// Returns where the world of a rig is.
    pub(super) fn world(
        &self,
        scene: &Scene,
        found: &BallRigCalibration,
        ball: &Ball,
    ) -> Result<World> {
        let of = |place: &str, aligned: RigAlignment, rms: String, doubt| World {
            aligned,
            because: format!("{place} says where the world is; {rms} remain (root mean square)"),
            doubt,
            guess: None,
        };
        let scale_sigma = libm::hypot(ball.tolerance, OUTLINE_SIGMA);
        match self {
            Self::Scene => Ok(world_of_scene(scene, found)),
            Self::Points(place, points) => {
                let sights = found.cameras.iter().zip(points);
                let sights: Vec<RigSight> = sights
                    .map(|(camera, points)| RigSight {
                        camera: &camera.camera,
                        rig_from_camera: camera.world_from_camera,
                        correspondences: points.clone(),
                    })
                    .collect();
                let aligned = align_to_points(&sights, scale_sigma)
                    .map_err(|refusal| user_error!("{place}: {refusal}"))?;
                let names = scene.cameras.iter().map(|camera| &*camera.name);
                let doubt = farthest(names.zip(&sights), &aligned)
                    .filter(|(off_px, _)| *off_px > FAR_PX)
                    .map(|(_, what)| format!("{place}: {what}; check it, and the points near it"));
                Ok(of(place, aligned, format!("{:.2} px", aligned.rms), doubt))
            }
            Self::Places(place, places) => {
                let aligned = align_to_places(&found.path_m, ball.radius_m, places, scale_sigma)
                    .map_err(|refusal| user_error!("{place}: {refusal}"))?;
                Ok(of(
                    place,
                    aligned,
                    format!("{:.1} mm", 1e3 * aligned.rms),
                    None,
                ))
            }
        }
    }
}

/// Returns the known point that is farthest from where a camera should show it: by how many pixels, and which it is.
fn farthest<'s>(
    sights: impl Iterator<Item = (&'s str, &'s RigSight<'s>)>,
    aligned: &RigAlignment,
) -> Option<(f64, String)> {
    let points = sights.flat_map(|(name, sight)| {
        let camera_from_world = aligned.in_world(&sight.rig_from_camera).inverse();
        sight.correspondences.iter().filter_map(move |known| {
            let [u, v] = known.pixel;
            let [x, y, z] = known.point_m;
            let at = sight
                .camera
                .project((camera_from_world * Point3::new(x, y, z)).into())?;
            let off_px = libm::hypot(at[0] - u, at[1] - v);
            let what =
                format!("{name} should show the point {x}, {y}, {z} {off_px:.1} px from {u}, {v}");
            Some((off_px, what))
        })
    });
    points.reduce(|farthest, next| if next.0 > farthest.0 { next } else { farthest })
}

/// Returns the world in which the first camera with a pose has it; without one, the first with a guess has that, or else the frame of the first camera.
fn world_of_scene(scene: &Scene, found: &BallRigCalibration) -> World {
    let posed = scene.cameras.iter().zip(&found.cameras);
    let posed: Vec<(&pardalis_scene::CameraConfig, Pose)> = posed
        .filter(|(config, _)| config.has_pose)
        .map(|(config, camera)| (config, camera.world_from_camera))
        .collect();
    let Some((first, rig_from_camera)) = posed.first() else {
        let is_guess = |config: &pardalis_scene::CameraConfig| {
            let key = format!("cameras.{}.world_from_camera", config.name);
            scene.guesses.contains(&key)
        };
        if let Some(guess) = scene.cameras.iter().position(is_guess) {
            let config = &scene.cameras[guess];
            let rig_from_camera = found.cameras[guess].world_from_camera;
            return World {
                aligned: rigid(config.world_from_camera * rig_from_camera.inverse(), None),
                because: format!(
                    "{name} keeps the guess of its pose, because nothing says where the world is: replace it by a pose, or give known points (--points) or a board (--board)",
                    name = config.name
                ),
                doubt: None,
                guess: Some(guess),
            };
        }
        let name = &scene.cameras[0].name;
        return World {
            aligned: rigid(Pose::identity(), None),
            because: format!(
                "the frame of {name} is the world (x right, y down, z forward), because nothing says where else it is: give {name} a pose, known points (--points) or a board (--board)"
            ),
            doubt: None,
            guess: None,
        };
    };
    // The cameras' distances from their middle tell the scale.
    let spread_m = |of: &dyn Fn(&(&pardalis_scene::CameraConfig, Pose)) -> Pose| {
        let places = posed.iter().map(|camera| of(camera).translation.vector);
        let middle = places.clone().sum::<nalgebra::Vector3<f64>>() / posed.len() as f64;
        places
            .map(|place| (place - middle).norm_squared())
            .sum::<f64>()
            .sqrt()
    };
    let (given_m, found_m) = (
        spread_m(&|(config, _)| config.world_from_camera),
        spread_m(&|(_, pose)| *pose),
    );
    World {
        aligned: rigid(
            first.world_from_camera * rig_from_camera.inverse(),
            (posed.len() > 1).then(|| [given_m / found_m, 0.0]),
        ),
        because: format!("{} keeps the pose that it has in the scene", first.name),
        doubt: None,
        guess: None,
    }
}

/// Returns an alignment that keeps the lengths of the rig.
fn rigid(world_from_rig: Pose, scale: Option<[f64; 2]>) -> RigAlignment {
    RigAlignment {
        world_from_rig,
        rms: 0.0,
        scale,
        is_scaled: false,
    }
}
