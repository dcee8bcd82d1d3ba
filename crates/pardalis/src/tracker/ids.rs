//! Identifiers of cameras, targets and platforms, as separate types.

use pardalis_core::Error;

/// Identifies a camera of a tracker by its index among the tracker's views.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CameraId(usize);

/// Identifies a target of a tracker by its index among the tracker's targets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TargetId(usize);

/// Identifies a platform of a tracker by the order in which they were added.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PlatformId(usize);

macro_rules! id {
    ($id:ident, $what:literal) => {
        impl $id {
            #[doc = concat!("Returns the identifier of the ", $what, " with this index, from 0.")]
            pub const fn new(index: usize) -> Self {
                Self(index)
            }

            /// Returns the index, from 0.
            pub const fn index(self) -> usize {
                self.0
            }

            /// Returns an error unless the index is below this count.
            pub(super) fn check(self, count: usize) -> Result<(), Error> {
                if self.0 < count {
                    return Ok(());
                }
                let allowed = format!(concat!("the number of a ", $what, ", below {}"), count);
                Err(Error::out_of_range($what, self.0, &allowed))
            }
        }

        impl std::fmt::Display for $id {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                self.0.fmt(f)
            }
        }
    };
}

id!(CameraId, "camera");
id!(TargetId, "target");
id!(PlatformId, "platform");
