//! Integration tests of the camera models, in one executable.

mod cameras;
mod exact_mirror;
mod mirrors;
