//! Reading recordings from their beginning to their end.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read as _, Seek as _};
use std::path::Path;
use std::sync::Arc;

use mcap::io::MessageReader;
use mcap::sans_io::linear_reader::LinearReaderOptions;
use mcap::sans_io::summary_reader::{SummaryReadEvent, SummaryReader};
use mcap::{Channel, McapError, Message, Summary};

/// Maximum size of a record in bytes: more than the largest image takes.
const MAX_RECORD_BYTES: usize = 256 << 20;

/// The messages of a recording, in the order of the file. Nothing follows an error.
pub(super) struct Messages(MessageReader<File>);

impl Messages {
    pub(super) fn open(path: &Path) -> Result<Self, String> {
        let options = LinearReaderOptions::default()
            .with_validate_chunk_crcs(true)
            .with_record_length_limit(MAX_RECORD_BYTES);
        let mut file = File::open(path).map_err(|error| text_of(&error.into()))?;
        if path.is_dir() {
            return Err("is a folder; give the .mcap file in it".to_owned());
        }
        let mut begin = [0; mcap::MAGIC.len()];
        let is_recording = file.read_exact(&mut begin).is_ok() && begin == mcap::MAGIC;
        if !is_recording || file.rewind().is_err() {
            return Err("is not an MCAP recording; give an .mcap file".to_owned());
        }
        Ok(Self(MessageReader::new_with_options(file, options)))
    }
}

impl Iterator for Messages {
    type Item = Result<Message<'static>, String>;

    fn next(&mut self) -> Option<Self::Item> {
        let message = self.0.next()?;
        Some(message.map_err(|error| text_of(&error)))
    }
}

/// Reads the summary at the end of a recording; `None` without one, as of a recording that was cut off.
pub(super) fn summary(path: &Path) -> Option<Summary> {
    let mut file = File::open(path).ok()?;
    let mut reader = SummaryReader::new();
    while let Some(event) = reader.next_event() {
        match event.ok()? {
            SummaryReadEvent::ReadRequest(count) => {
                let read = file.read(reader.insert(count)).ok()?;
                reader.notify_read(read);
            }
            SummaryReadEvent::SeekRequest(to) => {
                reader.notify_seeked(file.seek(to).ok()?);
            }
        }
    }
    reader.finish()
}

/// Returns the channels of a recording, by its summary or else by its messages, in the order of topics.
pub(super) fn channels(
    path: &Path,
    summary: Option<&Summary>,
) -> Result<Vec<Arc<Channel<'static>>>, String> {
    let mut channels: BTreeMap<(String, u16), Arc<Channel>> = BTreeMap::new();
    let mut add = |channel: &Arc<Channel<'static>>| {
        channels.insert((channel.topic.clone(), channel.id), Arc::clone(channel));
    };
    if let Some(summary) = summary.filter(|summary| !summary.channels.is_empty()) {
        summary.channels.values().for_each(add);
    } else {
        // Damage is reported later, after the images before it have been read.
        let whole = Messages::open(path)?.map_while(Result::ok);
        whole.for_each(|message| add(&message.channel));
    }
    if channels.is_empty()
        && let Some(Err(error)) = Messages::open(path)?.next()
    {
        return Err(error);
    }
    Ok(channels.into_values().collect())
}

/// Says what is wrong with a recording, and what to do.
fn text_of(error: &McapError) -> String {
    match error {
        McapError::UnexpectedEof | McapError::UnexpectedEoc | McapError::BadMagic => {
            "the recording is cut off; what precedes was read (`mcap recover` repairs it)"
                .to_owned()
        }
        McapError::Io(error) if error.kind() == io::ErrorKind::NotFound => {
            "cannot be read: there is no such file; check the name".to_owned()
        }
        McapError::Io(error) => format!("cannot be read: {error}"),
        error => {
            format!(
                "the recording is damaged: {error}; what precedes was read (`mcap recover` repairs it)"
            )
        }
    }
}
