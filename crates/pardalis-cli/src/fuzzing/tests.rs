use std::fs;
use std::path::PathBuf;

use rayon::prelude::*;

use super::mutation::{Random, Samples};
use super::{READERS, Reader};

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn samples_of(reader: &Reader) -> Samples {
    let list = fs::read_to_string(root().join("fuzz/samples.txt")).unwrap();
    let lines = list.lines().filter_map(|line| line.split_once(' '));
    let paths = lines.filter(|(name, _)| *name == reader.name);
    Samples::new(
        paths
            .map(|(_, path)| fs::read(root().join(path)).expect(path))
            .collect(),
    )
}

/// Reports whether a reader accepts a file. Fails with its name, `what` and the file if an invariant is violated.
fn check(reader: &Reader, what: &str, bytes: &[u8]) -> bool {
    let accepted = std::panic::catch_unwind(|| reader.check(bytes));
    accepted.unwrap_or_else(|_| panic!("{}, {what}: {}", reader.name, bytes.escape_ascii()))
}

/// Tries damaged samples of each reader, about this number of bytes; those with the same seed are the same.
fn try_damaged(bytes: usize) {
    let (mut tried, mut read) = (0, 0);
    for reader in READERS {
        let samples = samples_of(reader);
        let mean = samples.files.iter().map(Vec::len).sum::<usize>() / samples.files.len();
        let count = bytes / mean;
        let accepted = (0..count as u64).into_par_iter().filter(|&seed| {
            let bytes = samples.damaged(&mut Random::new(seed));
            check(reader, &format!("seed {seed}"), &bytes)
        });
        let accepted = accepted.count();
        println!(
            "{}: {count} damaged files, {accepted} of them read",
            reader.name
        );
        (tried, read) = (tried + count, read + accepted);
    }
    println!("in all: {tried} damaged files, {read} of them read");
    // Some damage changes only comments or digits, other damage does not.
    assert!(
        (tried / 100..tried / 2).contains(&read),
        "{read} of {tried}"
    );
}

#[test]
fn every_sample_is_accepted() {
    for reader in READERS {
        let samples = samples_of(reader);
        assert!(!samples.files.is_empty(), "{} has no samples", reader.name);
        for (index, file) in samples.files.iter().enumerate() {
            assert!(
                check(reader, &format!("sample {index}"), file),
                "{}: sample {index}",
                reader.name
            );
        }
    }
    let list = fs::read_to_string(root().join("fuzz/samples.txt")).unwrap();
    for (name, path) in list.lines().skip(1).filter_map(|line| line.split_once(' ')) {
        if name == "mcap" && !cfg!(feature = "mcap") {
            continue;
        }
        assert!(
            READERS.iter().any(|reader| reader.name == name),
            "{name} {path}"
        );
    }
}

/// Files that made some reader panic, accept nonsense or take too much memory.
#[test]
fn found_files_are_read_or_rejected() {
    let folder = root().join("fuzz/found");
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let bytes = fs::read(&path).unwrap();
        for reader in READERS {
            check(reader, &path.display().to_string(), &bytes);
        }
    }
}

/// Tries the beginnings of the samples of each reader, if there are at most `most` of them.
fn try_truncated(most: usize) {
    READERS.par_iter().for_each(|reader| {
        let samples = samples_of(reader);
        for (index, file) in samples
            .files
            .iter()
            .enumerate()
            .filter(|(_, file)| file.len() <= most)
        {
            (0..file.len()).into_par_iter().for_each(|end| {
                check(
                    reader,
                    &format!("{end} bytes of sample {index}"),
                    &file[..end],
                );
            });
        }
    });
}

#[test]
fn truncated_samples_are_read_or_rejected() {
    try_truncated(300);
}

#[test]
#[ignore = "exhaustive: the gate runs it with --ignored"]
fn all_truncated_samples_are_read_or_rejected() {
    try_truncated(6_000);
}

#[test]
fn damaged_samples_are_read_or_rejected() {
    try_damaged(50_000);
}

#[test]
#[ignore = "exhaustive: the gate runs it with --ignored"]
fn many_damaged_samples_are_read_or_rejected() {
    try_damaged(7_000_000);
}
