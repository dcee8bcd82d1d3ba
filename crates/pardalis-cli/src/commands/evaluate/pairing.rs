//! The pairing of targets with objects of the truth.

use std::path::Path;

use anyhow::Result;
use serde::Serialize;

use crate::output::Shown;
use crate::user_error::user_error;

/// Objects with this prefix occlude others; they are never paired by position.
pub(super) const OCCLUDER: &str = "occluder";

/// The reason for pairing a target with its object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum MatchedBy {
    /// The user requested it.
    Map,
    /// Both have the same name.
    Name,
    /// They were the only target and the only object left.
    Alone,
    /// The target follows this object best.
    Position,
    /// The target is a crowd: whichever member follows the object.
    Crowd,
}

/// A target and its object, as indices into the files.
#[derive(Debug, PartialEq)]
pub(super) struct Pair {
    pub(super) target: usize,
    pub(super) object: usize,
    pub(super) matched_by: MatchedBy,
}

/// A file, the names in it, and the positions by frame for each name.
type Side<'a> = (&'a Path, &'a [&'a str], &'a [Vec<Option<[f64; 3]>>]);

/// Pairs targets with objects: first as mapped, then by name, then by position. In the order of the targets.
pub(super) fn pair(
    (tracks_path, targets, target_paths): Side,
    (truth_path, objects, object_paths): Side,
    map: &[(String, String)],
    cap_m: f64,
) -> Result<Vec<Pair>> {
    let mut object_of: Vec<Option<(usize, MatchedBy)>> = vec![None; targets.len()];
    for (target, object) in mapped(map, (tracks_path, targets), (truth_path, objects))? {
        object_of[target] = Some((object, MatchedBy::Map));
    }
    for (t, name) in targets.iter().enumerate() {
        let same = objects.iter().position(|object| object == name);
        if let Some(o) = same.filter(|&o| object_of[t].is_none() && is_free(&object_of, o)) {
            object_of[t] = Some((o, MatchedBy::Name));
        }
    }

    let left: Vec<usize> = (0..targets.len())
        .filter(|&t| object_of[t].is_none())
        .collect();
    let free: Vec<usize> = (0..objects.len())
        .filter(|&o| is_free(&object_of, o) && !objects[o].starts_with(OCCLUDER))
        .collect();
    let left_paths: Vec<_> = left.iter().map(|&t| &target_paths[t]).collect();
    let free_paths: Vec<_> = free.iter().map(|&o| &object_paths[o]).collect();
    let matched_by = if left.len() == 1 && free.len() == 1 {
        MatchedBy::Alone
    } else {
        MatchedBy::Position
    };
    let assignment = pardalis_evaluate::assign(&left_paths, &free_paths, cap_m);
    for (&t, o) in left.iter().zip(assignment) {
        object_of[t] = o.map(|o| (free[o], matched_by));
    }
    let pairs: Vec<Pair> = object_of
        .into_iter()
        .enumerate()
        .filter_map(|(target, object)| {
            object.map(|(object, matched_by)| Pair {
                target,
                object,
                matched_by,
            })
        })
        .collect();
    if pairs.is_empty() {
        return Err(user_error!(
            "{}: no target ({}) has an object in {} ({}); pair them with --map TARGET=OBJECT",
            tracks_path.shown(),
            targets.join(", "),
            truth_path.shown(),
            objects.join(", ")
        ));
    }
    Ok(pairs)
}

/// Returns the indices of mapped targets and their objects.
///
/// Errors: a file does not have a name, or it is given twice.
pub(super) fn mapped(
    map: &[(String, String)],
    (tracks_path, targets): (&Path, &[&str]),
    (truth_path, objects): (&Path, &[&str]),
) -> Result<Vec<(usize, usize)>> {
    let mut pairs: Vec<(usize, usize)> = Vec::new();
    for (target, object) in map {
        let option = format!("--map {target}={object}");
        let t = place(&option, "target", target, targets, tracks_path)?;
        let o = place(&option, "object", object, objects, truth_path)?;
        if pairs.iter().any(|&(taken, _)| taken == t) {
            return Err(user_error!(
                "{option}: target \"{target}\" is mapped twice; allowed: one object per target"
            ));
        }
        if pairs.iter().any(|&(_, taken)| taken == o) {
            return Err(user_error!(
                "{option}: object \"{object}\" is mapped twice; allowed: one target per object"
            ));
        }
        pairs.push((t, o));
    }
    Ok(pairs)
}

/// Reports whether an object has no target yet.
fn is_free(object_of: &[Option<(usize, MatchedBy)>], object: usize) -> bool {
    object_of
        .iter()
        .flatten()
        .all(|&(taken, _)| taken != object)
}

/// Returns the index of a name given by the user.
fn place(option: &str, kind: &str, name: &str, names: &[&str], path: &Path) -> Result<usize> {
    names.iter().position(|n| *n == name).ok_or_else(|| {
        user_error!(
            "{option}: {} has no {kind} \"{name}\"; allowed: {}",
            path.shown(),
            names.join(", ")
        )
    })
}
