//! Any bytes as a file of the reader that the environment variable `READER` names.
#![no_main]

use std::sync::OnceLock;

use libfuzzer_sys::fuzz_target;
use pardalis_cli::fuzzing::{READERS, Reader};

static CHOSEN: OnceLock<&Reader> = OnceLock::new();

fuzz_target!(|bytes: &[u8]| {
    let reader = CHOSEN.get_or_init(|| {
        let name = std::env::var("READER").unwrap_or_default();
        let chosen = READERS.iter().find(|reader| reader.name == name);
        chosen.unwrap_or_else(|| panic!("READER is {name:?}, which no reader is called"))
    });
    reader.check(bytes);
});
