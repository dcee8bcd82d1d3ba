//! The error type of all library crates.

/// Largest accepted width or height of an image, in pixels. Byte offsets into an image then fit in
/// 31 bits.
pub const MAX_IMAGE_SIDE_PX: usize = 16_384;

/// An invalid argument, file or combination of inputs.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A number lies outside its allowed range.
    #[error("{name} is {value}; allowed: {allowed}")]
    OutOfRange {
        /// Name of the parameter, as in scene files.
        name: String,
        /// The rejected value.
        value: String,
        /// The allowed range.
        allowed: String,
    },
    /// An image is empty or too large.
    #[error(
        "the image is {width} x {height} pixels; allowed: 1 to {} a side",
        MAX_IMAGE_SIDE_PX
    )]
    ImageSize {
        /// Width in pixels.
        width: usize,
        /// Height in pixels.
        height: usize,
    },
    /// The length of an image buffer does not match the image's size and format.
    #[error("the image has {found} bytes, but its size and format require {expected}")]
    ImageBytes {
        /// Required number of bytes.
        expected: usize,
        /// Actual number of bytes.
        found: usize,
    },
    /// Two images that must have the same size differ.
    #[error("{what} is {} x {} pixels, but {} x {} are expected", found.0, found.1, expected.0, expected.1)]
    SizeMismatch {
        /// Description of the image.
        what: String,
        /// Expected width and height in pixels.
        expected: (usize, usize),
        /// Found width and height in pixels.
        found: (usize, usize),
    },
    /// A collection that must hold at least one element is empty.
    #[error("{what} is empty: {remedy}")]
    Empty {
        /// Description of the collection.
        what: String,
        /// How to fix it.
        remedy: String,
    },
    /// The input is well-formed but cannot be processed, for example because it is degenerate.
    #[error("{reason}; {remedy}")]
    Refused {
        /// The cause.
        reason: String,
        /// How to fix it.
        remedy: String,
    },
    /// A text file is malformed.
    #[error("line {line}: {message}")]
    Parse {
        /// Line number, counted from 1.
        line: usize,
        /// The problem and what is allowed instead.
        message: String,
    },
}

impl Error {
    /// Creates an [`Error::OutOfRange`].
    pub fn out_of_range(name: &str, value: impl ToString, allowed: &str) -> Self {
        Self::OutOfRange {
            name: name.to_owned(),
            value: value.to_string(),
            allowed: allowed.to_owned(),
        }
    }

    /// Creates an [`Error::Refused`] from the cause and its remedy.
    pub fn refused(reason: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Refused {
            reason: reason.into(),
            remedy: remedy.into(),
        }
    }
}
