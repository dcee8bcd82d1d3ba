//! Reading recordings from their beginning to their end.
//!
//! The library's readers are not used: some files make them panic, and they reserve what a length claims, up to 4 GiB, before they compare it with the file.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader, Cursor, Read, Seek as _, SeekFrom};
use std::path::Path;
use std::sync::Arc;

use crc32fast::Hasher;
use mcap::read::ChannelAccumulator;
use mcap::records::{Record, Statistics, op};
use mcap::{Channel, McapError, Message, parse_record};

use crate::recordings::recordings_in;

/// Maximum size of a record in bytes: more than the largest image takes.
const MAX_RECORD_BYTES: u64 = 256 << 20;

/// Size of the last record and of what follows it, in bytes: opcode, length, start of the summary, offsets and checksum; then the magic number.
const FOOTER_BYTES: usize = 1 + 8 + 8 + 8 + 4 + mcap::MAGIC.len();

/// The records that matter here, those in chunks among them. Nothing follows an error.
struct Records {
    file: BufReader<File>,
    chunk: Option<Chunk>,
    has_ended: bool,
}

/// The rest of a chunk.
struct Chunk {
    /// Its records, decompressed.
    records: Box<dyn Read + Send>,
    /// How many bytes are left by what it states.
    left: u64,
    /// The checksum that it states; 0 for none.
    checksum: u32,
    hasher: Hasher,
}

impl Records {
    /// Reads what follows the magic number at the beginning.
    fn new(file: File) -> Self {
        Self {
            file: BufReader::new(file),
            chunk: None,
            has_ended: false,
        }
    }

    fn next_record(&mut self) -> Result<Option<Record<'static>>, String> {
        loop {
            let (opcode, data) = if let Some(chunk) = &mut self.chunk {
                let Some(record) = chunk.next_record()? else {
                    self.chunk = None;
                    continue;
                };
                record
            } else {
                let (opcode, length) = record_head(&mut self.file)?;
                match opcode {
                    op::FOOTER => {
                        pass(&mut self.file, length)?;
                        let mut end = [0; mcap::MAGIC.len()];
                        self.file.read_exact(&mut end).map_err(io_text)?;
                        return if end == mcap::MAGIC {
                            Ok(None)
                        } else {
                            Err(cut_off())
                        };
                    }
                    op::CHUNK => {
                        let data = record_data(&mut self.file, opcode, length)?;
                        self.chunk = Some(Chunk::new(data)?);
                        continue;
                    }
                    _ if matters(opcode) => (opcode, record_data(&mut self.file, opcode, length)?),
                    _ => {
                        pass(&mut self.file, length)?;
                        continue;
                    }
                }
            };
            if !matters(opcode) {
                continue;
            }
            if has_names(opcode) && names_in(opcode, &data).is_none() {
                return Err(damaged("a name is longer than its record"));
            }
            let record = parse_record(opcode, &data).map_err(damaged)?;
            return Ok(Some(record.into_owned()));
        }
    }
}

impl Chunk {
    /// Opens the chunk in a record.
    fn new(data: Vec<u8>) -> Result<Self, String> {
        let head = || {
            // After the times of its first and last message.
            let (left, rest) = data.get(16..)?.split_first_chunk()?;
            let (checksum, rest) = rest.split_first_chunk()?;
            let (compression, rest) = text(rest)?;
            let (length, records) = rest.split_first_chunk()?;
            let at = data.len() - records.len();
            let end = at.checked_add(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
            (end <= data.len()).then_some(())?;
            let numbers = (u64::from_le_bytes(*left), u32::from_le_bytes(*checksum));
            Some((numbers, compression.to_owned(), at, end))
        };
        let Some(((left, checksum), compression, at, end)) = head() else {
            return Err(damaged("a chunk is longer than its record"));
        };
        let mut records = Cursor::new(data);
        records.set_position(at as u64);
        let records = records.take((end - at) as u64);
        let records: Box<dyn Read + Send> = match &*compression {
            b"" => Box::new(records),
            b"lz4" => Box::new(lz4::Decoder::new(records).map_err(damaged)?),
            b"zstd" => Box::new(zstd::Decoder::new(records).map_err(damaged)?),
            other => {
                let other = other.escape_ascii();
                return Err(damaged(format!(
                    "a chunk is compressed with \"{other}\"; allowed: lz4, zstd"
                )));
            }
        };
        Ok(Self {
            records,
            left,
            checksum,
            hasher: Hasher::new(),
        })
    }

    /// Returns opcode and data of the next record.
    fn next_record(&mut self) -> Result<Option<(u8, Vec<u8>)>, String> {
        if self.left == 0 {
            let is_right = self.checksum == 0 || self.hasher.clone().finalize() == self.checksum;
            return if is_right {
                Ok(None)
            } else {
                Err(damaged("the checksum of a chunk is wrong"))
            };
        }
        let (opcode, length) = record_head(&mut self.records)?;
        self.hasher.update(&[opcode]);
        self.hasher.update(&length.to_le_bytes());
        let Some(left) = self
            .left
            .checked_sub(RECORD_HEAD_BYTES)
            .and_then(|left| left.checked_sub(length))
        else {
            return Err(damaged("a record is longer than its chunk"));
        };
        self.left = left;
        let data = record_data(&mut self.records, opcode, length)?;
        self.hasher.update(&data);
        Ok(Some((opcode, data)))
    }
}

/// The opcode of a record and the length of its data.
const RECORD_HEAD_BYTES: u64 = 1 + 8;

fn record_head(source: &mut impl Read) -> Result<(u8, u64), String> {
    let mut head = [0; RECORD_HEAD_BYTES as usize];
    source.read_exact(&mut head).map_err(io_text)?;
    let [opcode, length @ ..] = head;
    Ok((opcode, u64::from_le_bytes(length)))
}

fn record_data(source: &mut impl Read, opcode: u8, length: u64) -> Result<Vec<u8>, String> {
    if length > MAX_RECORD_BYTES {
        return Err(damaged(McapError::RecordTooLarge {
            opcode,
            len: length,
        }));
    }
    let mut data = Vec::new();
    // Grows with what is there.
    let read = source
        .take(length)
        .read_to_end(&mut data)
        .map_err(io_text)?;
    if read as u64 == length {
        Ok(data)
    } else {
        Err(cut_off())
    }
}

/// Passes over data of the file.
fn pass(file: &mut BufReader<File>, length: u64) -> Result<(), String> {
    let length = i64::try_from(length).map_err(|_| cut_off())?;
    file.seek_relative(length).map_err(io_text)
}

fn matters(opcode: u8) -> bool {
    has_names(opcode) || matches!(opcode, op::MESSAGE | op::DATA_END | op::STATISTICS)
}

fn has_names(opcode: u8) -> bool {
    matches!(opcode, op::SCHEMA | op::CHANNEL)
}

/// Splits off a text, whose length precedes it.
fn text(data: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = data.split_first_chunk()?;
    rest.split_at_checked(u32::from_le_bytes(*length) as usize)
}

/// Passes over the names and texts in a schema or channel, and returns what follows; `None` if one of them is longer than its record.
fn names_in(opcode: u8, data: &[u8]) -> Option<&[u8]> {
    // After the numbers of the schema, and of the channel.
    let numbers = if opcode == op::SCHEMA { 2 } else { 4 };
    let rest = text(text(data.get(numbers..)?)?.1)?.1;
    if opcode == op::SCHEMA {
        return Some(rest);
    }
    let (length, mut rest) = rest.split_first_chunk()?;
    let end = rest
        .len()
        .checked_sub(u32::from_le_bytes(*length) as usize)?;
    while rest.len() > end {
        rest = text(text(rest)?.1)?.1;
    }
    Some(rest)
}

impl Iterator for Records {
    type Item = Result<Record<'static>, String>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.has_ended {
            return None;
        }
        let record = self.next_record().transpose();
        self.has_ended = !matches!(record, Some(Ok(_)));
        record
    }
}

/// The messages of a recording, in the order of the file. Nothing follows an error.
pub(super) struct Messages {
    records: Records,
    channels: ChannelAccumulator<'static>,
    /// Whether the summary has begun, which repeats the channels.
    is_summary: bool,
}

impl Messages {
    pub(super) fn open(path: &Path) -> Result<Self, String> {
        let mut file = File::open(path).map_err(io_text)?;
        if path.is_dir() {
            return Err(match recordings_in(path) {
                Some(files) => format!("is a folder; give a recording in it: {files}"),
                None => "is a folder without recordings; give an .mcap file, or convert a bag of ROS 2 with `ros2 bag convert`".to_owned(),
            });
        }
        let mut begin = [0; mcap::MAGIC.len()];
        let is_recording = file.read_exact(&mut begin).is_ok() && begin == mcap::MAGIC;
        if !is_recording {
            return Err("is not an MCAP recording; give an .mcap file".to_owned());
        }
        Ok(Self {
            records: Records::new(file),
            channels: ChannelAccumulator::default(),
            is_summary: false,
        })
    }

    /// Returns the message in a record; `None` of other records.
    fn message_in(
        &mut self,
        record: Record<'static>,
    ) -> Result<Option<Message<'static>>, McapError> {
        match record {
            Record::DataEnd(_) => self.is_summary = true,
            _ if self.is_summary => {}
            Record::Schema { header, data } => self.channels.add_schema(header, data)?,
            Record::Channel(channel) => self.channels.add_channel(channel)?,
            Record::Message { header, data } => {
                let unknown = McapError::UnknownChannel(header.sequence, header.channel_id);
                return Ok(Some(Message {
                    channel: self.channels.get(header.channel_id).ok_or(unknown)?,
                    sequence: header.sequence,
                    log_time: header.log_time,
                    publish_time: header.publish_time,
                    data,
                }));
            }
            _ => {}
        }
        Ok(None)
    }
}

impl Iterator for Messages {
    type Item = Result<Message<'static>, String>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let message = match self.records.next()? {
                Ok(record) => self.message_in(record).map_err(damaged),
                Err(error) => Err(error),
            };
            self.records.has_ended |= message.is_err();
            if let Some(message) = message.transpose() {
                return Some(message);
            }
        }
    }
}

/// What stands at the end of a recording.
pub(super) struct Summary {
    /// In the order of their topics.
    pub(super) channels: Vec<Arc<Channel<'static>>>,
    pub(super) statistics: Option<Statistics>,
}

/// Reads the summary at the end of a recording; `None` without one, as of a recording that was cut off.
pub(super) fn summary(path: &Path) -> Option<Summary> {
    let mut file = File::open(path).ok()?;
    file.seek(SeekFrom::End(-(FOOTER_BYTES as i64))).ok()?;
    let mut footer = [0; FOOTER_BYTES];
    file.read_exact(&mut footer).ok()?;
    let is_footer = footer[0] == op::FOOTER && footer.ends_with(mcap::MAGIC);
    let start = u64::from_le_bytes(*footer[9..].first_chunk()?);
    if !is_footer || start == 0 {
        return None;
    }
    file.seek(SeekFrom::Start(start)).ok()?;
    let (mut channels, mut statistics) = (ChannelAccumulator::default(), None);
    let mut ids = Vec::new();
    for record in Records::new(file) {
        match record.ok()? {
            Record::Schema { header, data } => channels.add_schema(header, data).ok()?,
            Record::Channel(channel) => {
                ids.push(channel.id);
                channels.add_channel(channel).ok()?;
            }
            Record::Statistics(read) => statistics = Some(read),
            _ => {}
        }
    }
    let channels = ids.into_iter().filter_map(|id| channels.get(id));
    Some(Summary {
        channels: by_topic(channels),
        statistics,
    })
}

/// Reports whether a recording lacks its end, because it was cut off or is still being written.
pub(crate) fn is_cut_off(path: &Path) -> bool {
    let mut end = [0; mcap::MAGIC.len()];
    let read = File::open(path).and_then(|mut file| {
        file.seek(SeekFrom::End(-(mcap::MAGIC.len() as i64)))?;
        file.read_exact(&mut end)
    });
    read.is_err() || end != mcap::MAGIC
}

/// Returns the channels of a recording, by its summary or else by its messages, in the order of topics.
pub(super) fn channels(
    path: &Path,
    summary: Option<&Summary>,
) -> Result<Vec<Arc<Channel<'static>>>, String> {
    if let Some(summary) = summary.filter(|summary| !summary.channels.is_empty()) {
        return Ok(summary.channels.clone());
    }
    // Damage is reported later, after the images before it have been read.
    let whole = Messages::open(path)?.map_while(Result::ok);
    let channels = by_topic(whole.map(|message| message.channel));
    match Messages::open(path)?.next() {
        Some(Err(error)) if channels.is_empty() => Err(error),
        _ => Ok(channels),
    }
}

/// Returns each channel once, in the order of topics.
fn by_topic(channels: impl Iterator<Item = Arc<Channel<'static>>>) -> Vec<Arc<Channel<'static>>> {
    let by_topic = channels.map(|channel| ((channel.topic.clone(), channel.id), channel));
    by_topic.collect::<BTreeMap<_, _>>().into_values().collect()
}

/// Says what is wrong with the file.
fn io_text(error: io::Error) -> String {
    match error.kind() {
        io::ErrorKind::UnexpectedEof => cut_off(),
        io::ErrorKind::NotFound => {
            "cannot be read: there is no such file; check the name".to_owned()
        }
        // Of a decoder.
        io::ErrorKind::Other | io::ErrorKind::InvalidData => damaged(error),
        _ => format!("cannot be read: {error}"),
    }
}

fn cut_off() -> String {
    "the recording is cut off; what precedes was read (`mcap recover` repairs it)".to_owned()
}

fn damaged(how: impl std::fmt::Display) -> String {
    format!("the recording is damaged: {how}; what precedes was read (`mcap recover` repairs it)")
}
