//! The commands, one file or folder each.

pub(crate) mod evaluate;
pub(crate) mod learn;
