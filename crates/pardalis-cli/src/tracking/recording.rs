//! The images of live cameras, kept as folders of JPEG images with their times, so that they can be tracked again.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

use anyhow::{Context as _, Result};
use pardalis::Frame;
use pardalis_images::{JpegSampling, encode_jpeg};
use serde_json::{Value, json};

use super::Instant;
use crate::draw::picture::picture_of;
use crate::files::{RowFile, unwritable};
use crate::output::Shown as _;

/// The most bytes of a recording. Hand-set: a quarter of an hour of four cameras of 640 x 480 pixels at 25 frames per second, roughly.
const MAX_BYTES: usize = 2 << 30;

/// The most images that wait to be written.
const MAX_WAITING: usize = 64;

/// Hardly any loss: what is tracked again should see the same edges.
const JPEG_QUALITY: u8 = 95;

/// A live camera that is recorded.
#[derive(Debug, Clone)]
pub(crate) struct RecordedCamera {
    /// Its index in the scene.
    pub(crate) index: usize,
    pub(crate) name: String,
    /// What the scene adds to its time stamps, in seconds.
    pub(crate) time_offset_s: f64,
}

/// A recording of the images of a run. Cloning shares it. Tracking does not wait for it: images that come too fast are dropped, and counted.
#[derive(Debug, Clone)]
pub(crate) struct Recording {
    folder: PathBuf,
    cameras: Vec<RecordedCamera>,
    shared: Arc<Mutex<Shared>>,
}

#[derive(Debug)]
struct Shared {
    /// `None` once it has ended.
    sender: Option<SyncSender<(usize, Frame)>>,
    thread: Option<JoinHandle<()>>,
    written: Written,
}

/// What has become of the images.
#[derive(Debug, Default)]
struct Written {
    images: usize,
    bytes: usize,
    dropped: usize,
    is_full: bool,
    error: Option<String>,
}

fn locked(shared: &Mutex<Shared>) -> MutexGuard<'_, Shared> {
    // Counts are changed one at a time.
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Recording {
    /// Begins a recording in the first numbered folder in `place` that does not exist yet.
    ///
    /// Errors: the folder cannot be made.
    pub(crate) fn start(place: &Path, cameras: Vec<RecordedCamera>) -> Result<Self> {
        let mut numbered = (1_usize..).map(|number| place.join(number.to_string()));
        let folder = numbered.find(|folder| !folder.exists());
        let folder = folder.context("all numbers are taken")?;
        let mut files = Vec::new();
        for camera in &cameras {
            let folder = folder.join(&camera.name);
            fs::create_dir_all(&folder).map_err(|error| unwritable(&folder, error))?;
            let mut times = RowFile::create(&folder.join("times.csv"))?;
            times.write("frame,time_s\n")?;
            files.push(CameraFiles {
                folder,
                times,
                time_offset_s: camera.time_offset_s,
                count: 0,
            });
        }
        let (sender, receiver) = sync_channel(MAX_WAITING);
        let shared = Arc::new(Mutex::new(Shared {
            sender: Some(sender),
            thread: None,
            written: Written::default(),
        }));
        let thread = std::thread::Builder::new()
            .name("recording".to_owned())
            .spawn({
                let shared = Arc::clone(&shared);
                move || write_all(&receiver, files, &shared)
            })
            .context("no further thread can be started")?;
        locked(&shared).thread = Some(thread);
        Ok(Self {
            folder,
            cameras,
            shared,
        })
    }

    /// Keeps the images of one time.
    pub(super) fn take(&self, instant: &Instant) {
        let mut shared = locked(&self.shared);
        if shared.written.is_full || shared.written.error.is_some() {
            return;
        }
        for (index, frame) in instant.frames {
            let place = self.cameras.iter().position(|one| one.index == *index);
            let (Some(place), Some(sender)) = (place, &shared.sender) else {
                continue;
            };
            if let Err(TrySendError::Full(_)) = sender.try_send((place, frame.clone())) {
                shared.written.dropped += 1;
            }
        }
    }

    /// Waits until all images are written that were taken.
    pub(crate) fn finish(&self) {
        let mut shared = locked(&self.shared);
        shared.sender = None;
        let thread = shared.thread.take();
        drop(shared);
        if let Some(thread) = thread {
            // A panic has been reported.
            let _ = thread.join();
        }
        if locked(&self.shared).written.images == 0 {
            self.remove();
        }
    }

    /// Removes a recording without images.
    fn remove(&self) {
        for camera in &self.cameras {
            let folder = self.folder.join(&camera.name);
            let _ = fs::remove_file(folder.join("times.csv"));
            let _ = fs::remove_dir(folder);
        }
        let _ = fs::remove_dir(&self.folder);
    }

    /// Returns the folder of each camera that has images, with its name.
    pub(crate) fn folders(&self) -> Vec<(String, PathBuf)> {
        let folders = self.cameras.iter().map(|camera| {
            let folder = self.folder.join(&camera.name);
            (camera.name.clone(), folder)
        });
        let has_images = |(_, folder): &(String, PathBuf)| folder.join(image_name(0)).exists();
        folders.filter(has_images).collect()
    }

    /// Describes it for a page.
    pub(crate) fn about(&self) -> Value {
        let shared = locked(&self.shared);
        let written = &shared.written;
        json!({
            "folder": self.folder.shown(),
            "images": written.images,
            "bytes": written.bytes,
            "dropped": written.dropped,
            "is_full": written.is_full,
            "error": written.error,
        })
    }
}

/// Where the images of a camera go.
struct CameraFiles {
    folder: PathBuf,
    times: RowFile,
    time_offset_s: f64,
    count: usize,
}

fn image_name(number: usize) -> String {
    format!("{number:06}.jpg")
}

impl CameraFiles {
    /// Writes an image and its time. Returns its size in bytes.
    fn write(&mut self, frame: &Frame) -> Result<usize> {
        let jpeg = encode_jpeg(&picture_of(frame), JPEG_QUALITY, JpegSampling::Automatic)?;
        let path = self.folder.join(image_name(self.count));
        // Waiting until each is on the disk would be too slow.
        fs::write(&path, &jpeg).map_err(|error| unwritable(&path, error))?;
        let time_s = frame.time_s() - self.time_offset_s;
        self.times.write(&format!("{},{time_s}\n", self.count))?;
        self.count += 1;
        Ok(jpeg.len())
    }
}

/// Writes the images that come, until there are too many or one cannot be written.
fn write_all(
    images: &Receiver<(usize, Frame)>,
    mut cameras: Vec<CameraFiles>,
    shared: &Mutex<Shared>,
) {
    for (place, frame) in images {
        let written = cameras[place].write(&frame);
        let mut shared = locked(shared);
        match written {
            Ok(bytes) => {
                shared.written.images += 1;
                shared.written.bytes += bytes;
                shared.written.is_full = shared.written.bytes >= MAX_BYTES;
            }
            Err(error) => shared.written.error = Some(format!("{error:#}")),
        }
        if shared.written.is_full || shared.written.error.is_some() {
            break;
        }
    }
}
