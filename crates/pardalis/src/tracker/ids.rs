//! Numbers of cameras and of targets, which cannot be mistaken for one another.

use pardalis_core::Error;

/// A camera of a tracker: its place among the views that the tracker was made with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CameraId(usize);

/// A target of a tracker: its place among the targets that the tracker was made with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TargetId(usize);

macro_rules! id {
    ($id:ident, $what:literal) => {
        impl $id {
            #[doc = concat!("The ", $what, " of this number, from 0.")]
            pub const fn new(index: usize) -> Self {
                Self(index)
            }

            /// Its number, from 0.
            pub const fn index(self) -> usize {
                self.0
            }

            /// Returns an error unless the number is below this count.
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
