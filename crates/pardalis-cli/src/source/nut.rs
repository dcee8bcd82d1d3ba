//! Reads raw frames and their time stamps from a NUT stream with a single video stream, as ffmpeg writes it.
//!
//! NUT carries the stream's own time base, so that time stamps are exact. The format: <https://ffmpeg.org/~michael/nut.txt>

use std::io::{BufRead, Error, ErrorKind, Read, Result};

/// The file begins with this.
const FILE_ID: &[u8] = b"nut/multimedia container\0";

const MAIN: u64 = 0x4E4D_7A56_1F5F_04AD;
const STREAM: u64 = 0x4E53_1140_5BF2_F9DB;
const SYNCPOINT: u64 = 0x4E4B_E4AD_EECA_4569;

/// The first byte of every packet that is not a frame.
const START: u8 = b'N';

/// No header is longer, in bytes.
const MAX_HEADER: u64 = 1 << 20;

/// A header longer than this has a checksum of its length, in bytes; so has a frame no elided header.
const SHORT: u64 = 4096;

mod flag {
    pub(super) const CODED_PTS: u64 = 8;
    pub(super) const STREAM_ID: u64 = 16;
    pub(super) const SIZE_MSB: u64 = 32;
    pub(super) const CHECKSUM: u64 = 64;
    pub(super) const RESERVED: u64 = 128;
    pub(super) const HEADER_INDEX: u64 = 1024;
    pub(super) const MATCH_TIME: u64 = 2048;
    pub(super) const CODED: u64 = 4096;
    pub(super) const INVALID: u64 = 8192;
}

/// What the first byte of a frame stands for.
#[derive(Debug, Clone, Copy, Default)]
struct FrameCode {
    flags: u64,
    pts_delta: i64,
    size_factor: u64,
    size_rest: u64,
    reserved: u64,
    header: usize,
}

/// The video stream.
#[derive(Debug, Clone, Copy)]
struct Stream {
    size_px: (usize, usize),
    /// Number of low bits of a time stamp that a frame states.
    pts_bits: u32,
}

/// A reader of frames.
#[derive(Debug)]
pub(super) struct Nut<R> {
    input: R,
    has_begun: bool,
    /// Numerator and denominator of the time base in seconds.
    time_base: (u64, u64),
    codes: Vec<FrameCode>,
    /// First bytes of frames, which frames leave out.
    elided: Vec<Vec<u8>>,
    stream: Option<Stream>,
    last_pts: i64,
    /// The elided bytes of the frame that was announced.
    pending: Vec<u8>,
}

/// A frame that is about to be read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FrameHeader {
    /// Its time stamp in units of the time base.
    pub(super) ticks: i64,
    /// Its length in bytes.
    pub(super) byte_count: usize,
}

fn invalid(what: &str) -> Error {
    Error::new(ErrorKind::InvalidData, what.to_owned())
}

impl<R: BufRead> Nut<R> {
    pub(super) fn new(input: R) -> Self {
        Self {
            input,
            has_begun: false,
            time_base: (0, 1),
            codes: Vec::new(),
            elided: Vec::new(),
            stream: None,
            last_pts: 0,
            pending: Vec::new(),
        }
    }

    /// Returns the numerator and denominator of the time base in seconds, once a frame was announced.
    pub(super) fn time_base(&self) -> (u64, u64) {
        self.time_base
    }

    /// Waits for the header of the stream and returns width and height in pixels; `None` if the input ends before.
    pub(super) fn size_px(&mut self) -> Result<Option<(usize, usize)>> {
        while self.stream.is_none() {
            if self.at_end()? {
                return Ok(None);
            }
            self.packet()?;
        }
        Ok(self.stream.map(|stream| stream.size_px))
    }

    /// Waits for the next frame; `None` at the end. Read its bytes with [`Nut::read`] before the next call.
    pub(super) fn next_frame(&mut self) -> Result<Option<FrameHeader>> {
        loop {
            if self.at_end()? {
                return Ok(None);
            }
            if self.has_begun && self.input.fill_buf()?[0] != START {
                return self.frame().map(Some);
            }
            self.packet()?;
        }
    }

    /// Reads the bytes of the frame that was announced.
    pub(super) fn read(&mut self, bytes: &mut [u8]) -> Result<()> {
        let elided = std::mem::take(&mut self.pending);
        let (start, rest) = bytes
            .split_at_mut_checked(elided.len())
            .ok_or_else(|| invalid("a frame is shorter than its header"))?;
        start.copy_from_slice(&elided);
        self.input.read_exact(rest)
    }

    fn at_end(&mut self) -> Result<bool> {
        Ok(self.input.fill_buf()?.is_empty())
    }

    /// Reads a packet that is not a frame.
    fn packet(&mut self) -> Result<()> {
        if !self.has_begun {
            let mut id = [0; FILE_ID.len()];
            self.input.read_exact(&mut id)?;
            if id != FILE_ID {
                return Err(invalid("it is not a NUT stream"));
            }
            self.has_begun = true;
            return Ok(());
        }
        let code = u64::from_be_bytes(self.array()?);
        if code.to_be_bytes()[0] != START {
            return Err(invalid("a packet has no start code"));
        }
        let length = number(&mut self.input)?;
        if length > SHORT {
            self.array::<4>()?;
        }
        if length > MAX_HEADER {
            return Err(invalid("a header is too long"));
        }
        let mut bytes = vec![0; length as usize];
        self.input.read_exact(&mut bytes)?;
        let mut body = bytes.as_slice();
        match code {
            MAIN => self.main(&mut body),
            STREAM => self.stream(&mut body),
            SYNCPOINT => {
                // With one time base, the stamp in its units.
                self.last_pts = number(&mut body)? as i64;
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N]> {
        let mut bytes = [0; N];
        self.input.read_exact(&mut bytes)?;
        Ok(bytes)
    }

    fn main(&mut self, body: &mut &[u8]) -> Result<()> {
        if number(body)? > 3 {
            // The minor version.
            number(body)?;
        }
        let streams = number(body)?;
        let _max_distance = number(body)?;
        let time_bases = number(body)?;
        if (streams, time_bases) != (1, 1) {
            return Err(invalid("it has more than one stream"));
        }
        self.time_base = (number(body)?, number(body)?);
        if self.time_base.0 == 0 || self.time_base.1 == 0 {
            return Err(invalid("its time base is zero"));
        }
        self.codes = frame_codes(body)?;
        self.elided = vec![Vec::new()];
        for _ in 0..number(body)? {
            self.elided.push(text(body)?);
        }
        Ok(())
    }

    fn stream(&mut self, body: &mut &[u8]) -> Result<()> {
        let _id = number(body)?;
        let _class = number(body)?;
        let _code = text(body)?;
        let _time_base = number(body)?;
        let pts_bits = number(body)?;
        let _max_pts_distance = number(body)?;
        let _decode_delay = number(body)?;
        let _flags = number(body)?;
        let _extra = text(body)?;
        let size_px = (number(body)? as usize, number(body)? as usize);
        if pts_bits > 62 {
            return Err(invalid("its time stamps are too long"));
        }
        self.stream = Some(Stream {
            size_px,
            pts_bits: pts_bits as u32,
        });
        Ok(())
    }

    fn frame(&mut self) -> Result<FrameHeader> {
        let stream = self
            .stream
            .ok_or_else(|| invalid("a frame comes before its stream"))?;
        let [code] = self.array::<1>()?;
        let code = *self
            .codes
            .get(usize::from(code))
            .ok_or_else(|| invalid("a frame comes before the main header"))?;
        let input = &mut self.input;
        let mut flags = code.flags;
        if flags & flag::CODED != 0 {
            flags ^= number(input)?;
        }
        if flags & flag::INVALID != 0 {
            return Err(invalid("a frame has an invalid code"));
        }
        if flags & flag::STREAM_ID != 0 {
            number(input)?;
        }
        let pts = if flags & flag::CODED_PTS != 0 {
            let coded = number(input)? as i64;
            let span = 1 << stream.pts_bits;
            if coded >= span {
                coded - span
            } else {
                // The stamp with these low bits that is nearest to the last one.
                let least = self.last_pts.wrapping_sub((span - 1) / 2);
                (coded.wrapping_sub(least) & (span - 1)).wrapping_add(least)
            }
        } else {
            self.last_pts.wrapping_add(code.pts_delta)
        };
        let mut byte_count = code.size_rest;
        if flags & flag::SIZE_MSB != 0 {
            let high = number(input)?.checked_mul(code.size_factor);
            byte_count = high
                .and_then(|high| high.checked_add(byte_count))
                .ok_or_else(|| invalid("a frame is too long"))?;
        }
        if flags & flag::MATCH_TIME != 0 {
            number(input)?;
        }
        let mut header = code.header;
        if flags & flag::HEADER_INDEX != 0 {
            header = number(input)? as usize;
        }
        let mut reserved = code.reserved;
        if flags & flag::RESERVED != 0 {
            reserved = number(input)?;
        }
        for _ in 0..reserved {
            number(input)?;
        }
        if flags & flag::CHECKSUM != 0 {
            self.array::<4>()?;
        }
        if byte_count > SHORT {
            header = 0;
        }
        let elided = self.elided.get(header);
        self.pending
            .clone_from(elided.ok_or_else(|| invalid("a frame has an unknown header"))?);
        self.last_pts = pts;
        Ok(FrameHeader {
            ticks: pts,
            byte_count: byte_count as usize,
        })
    }
}

/// Reads the table of what the first byte of a frame stands for.
fn frame_codes(body: &mut &[u8]) -> Result<Vec<FrameCode>> {
    let mut codes = Vec::new();
    let mut code = FrameCode {
        size_factor: 1,
        ..FrameCode::default()
    };
    while codes.len() < 256 {
        code.flags = number(body)?;
        let fields = number(body)?;
        let mut count = None;
        code.size_rest = 0;
        code.reserved = 0;
        for field in 0..fields {
            match field {
                0 => code.pts_delta = signed(body)?,
                1 => code.size_factor = number(body)?,
                3 => code.size_rest = number(body)?,
                4 => code.reserved = number(body)?,
                5 => count = Some(number(body)?),
                7 => code.header = number(body)? as usize,
                _ => drop(number(body)?),
            }
        }
        let count = count.unwrap_or(code.size_factor.saturating_sub(code.size_rest));
        if count == 0 {
            return Err(invalid("its table of frames is damaged"));
        }
        for _ in 0..count {
            if codes.len() == usize::from(START) {
                codes.push(FrameCode {
                    flags: flag::INVALID,
                    ..FrameCode::default()
                });
            }
            if codes.len() >= 256 {
                return Err(invalid("its table of frames is too long"));
            }
            codes.push(code);
            code.size_rest += 1;
        }
    }
    Ok(codes)
}

/// Reads an unsigned number: seven bits a byte, highest first.
fn number(input: &mut impl Read) -> Result<u64> {
    let mut value = 0_u64;
    loop {
        let mut byte = [0];
        input.read_exact(&mut byte)?;
        if value >> 57 != 0 {
            return Err(invalid("a number is too large"));
        }
        value = value << 7 | u64::from(byte[0] & 0x7F);
        if byte[0] & 0x80 == 0 {
            return Ok(value);
        }
    }
}

fn signed(input: &mut impl Read) -> Result<i64> {
    let value = number(input)?;
    let half = value.div_ceil(2) as i64;
    Ok(if value & 1 == 1 { half } else { -half })
}

/// Reads bytes after their number.
fn text(body: &mut &[u8]) -> Result<Vec<u8>> {
    let length = number(body)? as usize;
    let (text, rest) = body
        .split_at_checked(length)
        .ok_or_else(|| Error::from(ErrorKind::UnexpectedEof))?;
    *body = rest;
    Ok(text.to_owned())
}

#[cfg(test)]
#[path = "nut_tests.rs"]
mod tests;
