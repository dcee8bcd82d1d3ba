//! The requests of the page, by their names.

use anyhow::Result;
use pardalis_studio::Program;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

use super::board::{BoardIn, BoardOf, ModelOf};
use super::pose::{KnownPoints, OfCamera, OnFloor};
use super::rig::{RigOf, RigStop};
use super::runs::{OtherRun, Tracked};
use super::session::Session;
use super::steps::{Calibrated, Guessed, Label, Renamed};
use super::targets::{NewTarget, OfTarget, SetNumber, Shaped};
use crate::commands::devices;
use crate::user_error::user_error;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Nothing {}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Folder {
    folder: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct NewSource {
    input: String,
    fps: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Shown {
    camera: String,
    is_playing: Option<bool>,
    frame: Option<usize>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Removed {
    kind: String,
    name: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Restored {
    text: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Rows {
    from: usize,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Marked {
    camera: String,
    target: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Unlabelled {
    target: String,
    number: usize,
}

impl Program for Session {
    fn answer(&self, request: &str, value: Value) -> Result<Value, String> {
        let answer = self.answered(request, value);
        answer.map_err(|error| format!("{error:#}"))
    }
}

/// Reads what comes with a request.
fn read<T: DeserializeOwned>(value: Value) -> Result<T> {
    serde_json::from_value(value).map_err(|error| user_error!("the request is malformed: {error}"))
}

impl Session {
    fn answered(&self, request: &str, value: Value) -> Result<Value> {
        match request {
            "state" => read::<Nothing>(value).map(|_| ())?,
            "files" => return self.places.listed(read::<Folder>(value)?.folder.as_deref()),
            "devices" => {
                read::<Nothing>(value)?;
                let found = devices::listed();
                let found = found
                    .iter()
                    .map(|(place, name)| json!({ "input": place, "name": name }));
                return Ok(found.collect());
            }
            "add_source" => {
                let source: NewSource = read(value)?;
                self.add_source(&source.input, source.fps)?;
            }
            "show" => {
                let shown: Shown = read(value)?;
                let inner = self.inner();
                let player = inner.player(&shown.camera)?;
                player.order(shown.is_playing, shown.frame);
                return Ok(json!({}));
            }
            "remove" => {
                let removed: Removed = read(value)?;
                self.remove(&removed.kind, &removed.name)?;
            }
            "rename_camera" => self.rename_camera(&read::<Renamed>(value)?)?,
            "set_fov" => self.set_fov(&read::<Guessed>(value)?)?,
            "set_calibration" => {
                if let Some(names) = self.set_calibration(&read::<Calibrated>(value)?)? {
                    return Ok(json!({ "choose": names }));
                }
            }
            "set_pose" => {
                let answer = self.set_pose(&read::<KnownPoints>(value)?)?;
                self.tell();
                return Ok(answer);
            }
            "set_pose_of_board" => {
                let answer = self.set_pose_of_board(&read::<OnFloor>(value)?)?;
                self.tell();
                return Ok(answer);
            }
            "find_rectangle" => return self.find_rectangle(&read::<OfCamera>(value)?),
            "grid" => return self.grid(&read::<OfCamera>(value)?),
            "add_target" => self.add_target(&read::<NewTarget>(value)?)?,
            "set_shape" => self.set_shape(&read::<Shaped>(value)?)?,
            "label" => self.label(&read::<Label>(value)?)?,
            "learn_anew" => self.learn_anew(&read::<OfTarget>(value)?)?,
            "unlabel" => {
                let label: Unlabelled = read(value)?;
                self.unlabel(&label.target, label.number)?;
            }
            "marked" => {
                let marked: Marked = read(value)?;
                return self.show_marked(&marked.target, &marked.camera);
            }
            "track" => self.track(&read::<Tracked>(value)?)?,
            "use_recording" => {
                read::<Nothing>(value)?;
                self.use_recording()?;
            }
            "stop" => {
                read::<Nothing>(value)?;
                self.stop();
            }
            "set_number" => self.set_number(&read::<SetNumber>(value)?)?,
            "compare" => return self.compare(&read::<OtherRun>(value)?),
            "write_comparison" => return self.write_comparison(&read::<OtherRun>(value)?),
            "rows" => return Ok(self.rows(read::<Rows>(value)?.from)),
            "undo" => {
                read::<Nothing>(value)?;
                self.inner().project.undo()?;
                self.changed();
            }
            "redo" => {
                read::<Nothing>(value)?;
                self.inner().project.redo()?;
                self.changed();
            }
            "restore" => self.restore(&read::<Restored>(value)?.text)?,
            "save" => {
                read::<Nothing>(value)?;
                self.inner().project.save()?;
            }
            _ => return self.answered_while_calibrating(request, value),
        }
        Ok(self.tell())
    }

    /// Answers the requests of calibrations that take a while.
    fn answered_while_calibrating(&self, request: &str, value: Value) -> Result<Value> {
        match request {
            "look_for_board" => {
                self.look_for_board(&read::<BoardOf>(value)?)?;
                return Ok(json!({}));
            }
            "look_for_board_in" => {
                self.look_in_folder(&read::<BoardIn>(value)?)?;
                return Ok(json!({}));
            }
            "leave_board" => {
                read::<Nothing>(value)?;
                self.leave_board();
                return Ok(json!({}));
            }
            "forget_board" => {
                read::<Nothing>(value)?;
                self.forget_board();
                return Ok(json!({}));
            }
            "fit_board" => {
                self.fit_board(&read::<ModelOf>(value)?)?;
                return Ok(json!({}));
            }
            "use_board" => {
                read::<Nothing>(value)?;
                self.use_board()?;
            }
            "wave" => self.wave(read::<RigOf>(value)?)?,
            "stop_waving" => {
                self.stop_waving(&read::<RigStop>(value)?);
                return Ok(json!({}));
            }
            "use_rig" => {
                read::<Nothing>(value)?;
                self.use_rig()?;
            }
            _ => return Err(user_error!("{request}: is no request of this page")),
        }
        Ok(self.tell())
    }
}
