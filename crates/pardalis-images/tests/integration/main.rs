//! Integration tests of decoding, in one executable.

mod decode;
mod limits;
