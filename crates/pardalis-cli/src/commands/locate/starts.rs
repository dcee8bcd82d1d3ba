//! Where the targets are looked for in each image.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis::Tracker;
use pardalis::start::{PixelStart, Start};
use pardalis_filter::gaussian::GaussianStart;
use pardalis_scene::Scene;

use crate::tables::{Column, Row, Table};
use crate::user_error::user_error;

/// Where starts come from.
#[derive(Debug, Clone)]
pub(crate) enum StartsFrom {
    /// The scene.
    Scene,
    /// One pixel for all images.
    Pixel([f64; 2]),
    /// A table of positions, and whose rows count; the target's where nothing is said.
    Positions(PathBuf, Option<String>),
    /// A table of pixels, and whose rows count.
    Clicks(PathBuf, Option<String>),
}

impl StartsFrom {
    /// Key and value for the summary.
    pub(super) fn written(&self) -> (&'static str, toml::Value) {
        match self {
            Self::Scene => ("starts", "scene".into()),
            Self::Pixel(pixel) => ("at_px", pixel.to_vec().into()),
            Self::Positions(file, _) => ("starts", file.display().to_string().into()),
            Self::Clicks(file, _) => ("clicks", file.display().to_string().into()),
        }
    }
}

/// Two numbers with a comma between them.
pub(super) fn parse_pixel(text: &str) -> Result<[f64; 2], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    numbers
        .and_then(|numbers| <[f64; 2]>::try_from(numbers).ok())
        .filter(|pixel| pixel.iter().all(|v| v.is_finite()))
        .ok_or_else(|| "allowed: two numbers of pixels, such as 412,96.5".to_owned())
}

/// Where one target is in one image, roughly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Place {
    /// In metres.
    Position([f64; 3]),
    /// In pixels of the camera of this number.
    Pixel(usize, [f64; 2]),
}

impl Place {
    /// The start there. A pixel's ray is searched as the scene says where it starts by a pixel too.
    fn start(self, of_scene: &Start) -> Start {
        match (self, of_scene) {
            (Self::Position(position_m), _) => Start::Gaussian(GaussianStart {
                position_m,
                ..GaussianStart::default()
            }),
            (Self::Pixel(camera, pixel), Start::Pixel(start)) => Start::Pixel(PixelStart {
                camera,
                pixel,
                ..*start
            }),
            (Self::Pixel(camera, pixel), Start::Gaussian(_) | Start::Anywhere) => {
                Start::Pixel(PixelStart::at(camera, pixel))
            }
        }
    }
}

/// A frame's place in a table, with its line.
pub(super) type Listed = BTreeMap<usize, (Place, u64)>;

/// The starts of all images.
pub(super) enum Starts {
    /// As the scene says.
    Scene,
    /// One place for all.
    Everywhere(Place),
    /// A table: for each target, what it says of each frame.
    Listed {
        file: PathBuf,
        targets: Vec<(String, Listed)>,
    },
}

impl Starts {
    /// Reads what there is to read.
    ///
    /// Errors: the table does not fit the scene, or a pixel alone does not tell whose it is.
    pub(super) fn read(from: &StartsFrom, scene: &Scene, scene_path: &Path) -> Result<Self> {
        let several = scene.targets.iter().find(|target| target.bodies.len() > 1);
        if let (Some(target), false) = (several, matches!(from, StartsFrom::Scene)) {
            return Err(user_error!(
                "{}: targets.{} has several landmarks, and a place does not say where each is; leave out --at, --from and --clicks: they start where the scene says",
                scene_path.display(),
                target.name
            ));
        }
        match from {
            StartsFrom::Scene => Ok(Self::Scene),
            StartsFrom::Pixel(pixel) => match (&scene.cameras[..], &scene.targets[..]) {
                ([_], [_]) => Ok(Self::Everywhere(Place::Pixel(0, *pixel))),
                (cameras, targets) => Err(user_error!(
                    "--at: {} has {} cameras and {} targets, and a pixel does not say whose it is; give --clicks FILE.csv with the columns camera and object",
                    scene_path.display(),
                    cameras.len(),
                    targets.len()
                )),
            },
            StartsFrom::Positions(file, object) => {
                let table = Table::read(file)?;
                let columns = table.columns(["x_m", "y_m", "z_m"])?;
                Self::listed(file, &table, object.as_deref(), scene, |row| {
                    Ok(row.all_or_none(Some(columns))?.map(Place::Position))
                })
            }
            StartsFrom::Clicks(file, object) => {
                let table = Table::read(file)?;
                let columns = table.columns(["u_px", "v_px"])?;
                let camera = camera_column(&table, scene)?;
                Self::listed(file, &table, object.as_deref(), scene, |row| {
                    let Some(pixel) = row.all_or_none(Some(columns))? else {
                        return Ok(None);
                    };
                    let number =
                        camera.map_or(Ok(0), |camera| camera_number(row, camera, scene))?;
                    Ok(Some(Place::Pixel(number, pixel)))
                })
            }
        }
    }

    /// The table's rows, each target's.
    fn listed(
        file: &Path,
        table: &Table,
        object: Option<&str>,
        scene: &Scene,
        place_of: impl Fn(&Row) -> Result<Option<Place>>,
    ) -> Result<Self> {
        let frame_column = table.column("frame")?;
        let whose = Whose::read(table, object, scene.targets.len())?;
        let mut targets = Vec::new();
        for target in &scene.targets {
            let wanted = whose.rows_of(file, object.unwrap_or(&target.name))?;
            let mut listed = Listed::new();
            for row in table.rows() {
                if let Some((column, name)) = wanted
                    && row.text(column)? != name
                {
                    continue;
                }
                let frame = row.count(frame_column)?;
                let Some(place) = place_of(&row)? else {
                    continue;
                };
                let (first, line) = *listed.entry(frame).or_insert((place, row.line));
                if first.contradicts(&place) {
                    return Err(user_error!(
                        "{}: frame {frame} has another place in line {line}; allowed: one place a frame",
                        row.place()
                    ));
                }
            }
            targets.push((target.name.clone(), listed));
        }
        Ok(Self::Listed {
            file: file.to_owned(),
            targets,
        })
    }

    /// The start of each body in the image of this number, target by target.
    ///
    /// Errors: the table has none.
    pub(super) fn of_frame(&self, tracker: &Tracker, frame: usize) -> Result<Vec<Start>> {
        let of_body = |(target, of_scene): (usize, &Start)| match self {
            Self::Scene => Ok(*of_scene),
            Self::Everywhere(place) => Ok(place.start(of_scene)),
            Self::Listed { file, targets } => {
                let (name, listed) = &targets[target];
                let Some((place, _)) = listed.get(&frame) else {
                    return Err(user_error!(
                        "{}: has no place of {name} in frame {frame}; give each image a row, or take fewer images (first_frame, frame_limit)",
                        file.display()
                    ));
                };
                Ok(place.start(of_scene))
            }
        };
        let bodies = |target: usize| tracker.starts(target).map(move |start| (target, start));
        (0..tracker.target_count())
            .flat_map(bodies)
            .map(of_body)
            .collect()
    }

    /// What to name when a start of this frame turns out to be faulty.
    pub(super) fn place_of_frame(&self, frame: usize) -> String {
        match self {
            Self::Scene => format!("frame {frame}"),
            Self::Everywhere(_) => "--at".to_owned(),
            Self::Listed { file, .. } => format!("{}, frame {frame}", file.display()),
        }
    }
}

impl Place {
    /// Whether two rows of a frame cannot both hold. Pixels of several cameras can: the first counts.
    fn contradicts(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Pixel(camera, _), Self::Pixel(others, _)) if camera != others => false,
            _ => self != other,
        }
    }
}

/// How a table says whose rows are whose.
enum Whose<'t> {
    /// Not at all: there is one target.
    OneTarget,
    /// By its column `object`, which holds these names.
    Column(Column<'t>, Vec<String>),
}

impl<'t> Whose<'t> {
    fn read(table: &'t Table, object: Option<&str>, target_count: usize) -> Result<Self> {
        if target_count > 1 && object.is_some() {
            return Err(user_error!(
                "--object: the scene has {target_count} targets; leave it out: each target takes the rows of its own name"
            ));
        }
        let Some(column) = table.optional_column("object") else {
            if target_count > 1 || object.is_some() {
                table.column("object")?;
            }
            return Ok(Self::OneTarget);
        };
        let mut names = Vec::new();
        for row in table.rows() {
            names.push(row.text(column)?.to_owned());
        }
        names.sort_unstable();
        names.dedup();
        if let ([_], None, 1) = (&names[..], object, target_count) {
            return Ok(Self::OneTarget);
        }
        Ok(Self::Column(column, names))
    }

    /// The column and what it must hold; nothing where all rows count.
    fn rows_of<'n>(&self, file: &Path, wanted: &'n str) -> Result<Option<(Column<'t>, &'n str)>> {
        match self {
            Self::OneTarget => Ok(None),
            Self::Column(column, names) if names.iter().any(|name| name == wanted) => {
                Ok(Some((*column, wanted)))
            }
            Self::Column(_, names) => Err(user_error!(
                "{}, column object: nothing is named \"{wanted}\"; say by --object which of these it is: {}",
                file.display(),
                names.join(", ")
            )),
        }
    }
}

/// The column that says which camera a pixel is of; none is needed where there is one camera.
fn camera_column<'t>(table: &'t Table, scene: &Scene) -> Result<Option<Column<'t>>> {
    match scene.cameras.len() {
        1 => Ok(None),
        _ => table.column("camera").map(Some),
    }
}

fn camera_number(row: &Row, column: Column, scene: &Scene) -> Result<usize> {
    let name = row.text(column)?;
    let found = scene.cameras.iter().position(|camera| camera.name == name);
    found.ok_or_else(|| {
        let names: Vec<&str> = scene.cameras.iter().map(|camera| &*camera.name).collect();
        user_error!(
            "{}, column camera: \"{name}\" is no camera of the scene; allowed: {}",
            row.place(),
            names.join(", ")
        )
    })
}
