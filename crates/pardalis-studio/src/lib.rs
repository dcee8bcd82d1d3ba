//! The local web server of `pardalis studio`, and its page.
//!
//! It knows nothing of tracking: a [`Program`] answers the requests of the page, and a [`Feed`] carries what the program shows, such as live
//! pictures, of which each page gets the latest. [`Lines`] are for other programs. What reaches the program has passed checks: it comes from the page itself, on this
//! computer, or from somebody who has the token.

mod assets;
mod feed;
mod guard;
mod lines;
mod live;
mod server;

pub use assets::Asset;
pub use feed::Feed;
pub use lines::Lines;
pub use server::{Extension, Program, Server};
