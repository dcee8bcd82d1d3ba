//! The one error type of the libraries.

/// The largest image width or height that is taken, in pixels: image offsets then fit in 31 bits.
pub const MAX_IMAGE_SIDE_PX: usize = 16_384;

/// What can be wrong with what the library is given.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A number lies outside what is allowed.
    #[error("{name} is {value}; allowed: {allowed}")]
    OutOfRange {
        /// The parameter, named as in scene files.
        name: String,
        /// Its value, as given.
        value: String,
        /// What is allowed.
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
    /// An image has another number of bytes than its size and format ask for.
    #[error("the image has {found} bytes where its size and format ask for {expected}")]
    ImageBytes {
        /// What size and format ask for.
        expected: usize,
        /// What was given.
        found: usize,
    },
    /// Two images that belong together differ in size.
    #[error("{what} is {} x {} pixels where {} x {} are expected", found.0, found.1, expected.0, expected.1)]
    SizeMismatch {
        /// Which image.
        what: String,
        /// Expected width and height in pixels.
        expected: (usize, usize),
        /// Found width and height in pixels.
        found: (usize, usize),
    },
    /// Something that must hold at least one element is empty.
    #[error("{what} is empty: {remedy}")]
    Empty {
        /// What is empty.
        what: String,
        /// What to do about it.
        remedy: String,
    },
    /// What was given has no answer.
    #[error("{reason}; {remedy}")]
    Refused {
        /// What is wrong with it.
        reason: String,
        /// What to do.
        remedy: String,
    },
    /// A text file could not be understood.
    #[error("line {line}: {message}")]
    Parse {
        /// The line, from 1.
        line: usize,
        /// What is wrong and what is allowed.
        message: String,
    },
}

impl Error {
    /// A number outside its allowed range.
    pub fn out_of_range(name: &str, value: impl ToString, allowed: &str) -> Self {
        Self::OutOfRange {
            name: name.to_owned(),
            value: value.to_string(),
            allowed: allowed.to_owned(),
        }
    }

    /// Something that has no answer.
    pub fn refused(reason: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Refused {
            reason: reason.into(),
            remedy: remedy.into(),
        }
    }
}
