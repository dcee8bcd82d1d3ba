//! Boxes in files as COCO has them: a data set with images and annotations, or the list of results that detectors write.

use std::collections::HashMap;
use std::fmt;
use std::path::Path;

use anyhow::Result;
use pardalis::tracker::ImageBox;
use serde::Deserialize;
use serde_json::Value;

use super::{Found, Images, Place};
use crate::output::Shown;
use crate::source::images::trailing_number;
use crate::user_error::user_error;

/// Either kind of file.
#[derive(Deserialize)]
#[serde(untagged)]
enum File {
    Results(Vec<Value>),
    DataSet(DataSet),
}

#[derive(Deserialize)]
struct DataSet {
    images: Vec<Image>,
    annotations: Vec<Value>,
    #[serde(default)]
    categories: Vec<Category>,
}

#[derive(Deserialize)]
struct Image {
    id: Id,
    file_name: String,
    width: Option<f64>,
    height: Option<f64>,
}

#[derive(Deserialize)]
struct Category {
    id: i64,
    name: String,
}

#[derive(Deserialize)]
struct Annotation {
    image_id: Id,
    category_id: Option<i64>,
    /// Some programs write it in results.
    category_name: Option<String>,
    /// Left and top side, width and height, pixels, counted from 0 at the image's border.
    bbox: [f64; 4],
    score: Option<f64>,
}

/// A number, or the name of an image without its ending.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Deserialize)]
#[serde(untagged, expecting = "a number from 0 on, or a name")]
enum Id {
    Number(u64),
    Name(String),
}

impl fmt::Display for Id {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(number) => write!(f, "{number}"),
            Self::Name(name) => write!(f, "{name:?}"),
        }
    }
}

/// Returns the boxes in the text of a file that belongs to these images.
pub(crate) fn boxes_in(path: &Path, text: &[u8], images: &Images) -> Result<Vec<Found>> {
    let name = path.shown();
    let file = serde_json::from_slice(text);
    let file = file.map_err(|error| {
        if error.is_data() {
            user_error!(
                "{name}: is not in the format of COCO; needed: a list of results with image_id, category_id, bbox and score, or an object with images, annotations and categories"
            )
        } else {
            user_error!("{name}: is not JSON: {error}; write the file again, whole")
        }
    })?;
    let frames = Frames::of(images.names.as_deref());
    let (annotations, set) = match file {
        File::Results(results) => (results, None),
        File::DataSet(set) => {
            let images = set.images.into_iter().map(|one| (one.id.clone(), one));
            let categories = set.categories.into_iter().map(|one| (one.id, one.name));
            let named = (images.collect(), categories.collect());
            (set.annotations, Some(named))
        }
    };
    let found = annotations.into_iter().enumerate().map(|(number, value)| {
        let entry = number as u64 + 1;
        let list = if set.is_some() { " of annotations" } else { "" };
        found_in(value, &frames, images.size_px, set.as_ref())
            .map(|(frame, class, found)| Found {
                frame,
                class,
                found: Some(found),
                place: Place::Entry(entry),
            })
            .map_err(|problem| user_error!("{name}, entry {entry}{list}: {problem}"))
    });
    let found = found.collect::<Result<Vec<Found>>>()?;
    if found.is_empty() {
        return Err(user_error!(
            "{name}: has no boxes; run the detector again, or remove detections from the scene"
        ));
    }
    Ok(found)
}

/// The images and the categories of a data set.
type Named = (HashMap<Id, Image>, HashMap<i64, String>);

/// Returns frame, class and box of an entry, whose images have this size in pixels.
fn found_in(
    value: Value,
    frames: &Frames,
    size_px: (usize, usize),
    set: Option<&Named>,
) -> Result<(usize, Option<String>, ImageBox), String> {
    let one: Annotation = serde_json::from_value(value).map_err(|error| {
        format!("{error}; needed: image_id, bbox = [left, top, width, height] and perhaps category_id and score")
    })?;
    let frame = match set {
        None => frames.with_id(&one.image_id)?,
        Some((images, _)) => {
            let image = images.get(&one.image_id).ok_or_else(|| {
                format!(
                    "there is no image with the id {}; add it to images",
                    one.image_id
                )
            })?;
            image.check_size(size_px)?;
            frames.with_name(&image.file_name)?
        }
    };
    let class = match (one.category_name, one.category_id, set) {
        (Some(name), ..) => Some(name),
        (None, Some(id), Some((_, names))) if !names.is_empty() => {
            let name = names.get(&id).cloned();
            Some(name.ok_or_else(|| {
                format!("category_id is {id}, which is not in categories; add it there")
            })?)
        }
        (None, id, _) => id.map(|id| id.to_string()),
    };
    let [left, top, width, height] = one.bbox;
    for (side, what) in [(width, "width"), (height, "height")] {
        if side <= 0.0 {
            return Err(format!("bbox: its {what} is {side}; allowed: above 0"));
        }
    }
    let [left, top] = [left, top].map(|first| first - 0.5);
    let found = ImageBox::new([left, top, left + width, top + height]);
    let found = found.and_then(|found| match one.score {
        Some(score) => found.with_score(score),
        None => Ok(found),
    });
    Ok((frame, class, found.map_err(|error| error.to_string())?))
}

impl Image {
    /// Fails if it states another size in pixels than the camera's images have.
    fn check_size(&self, (width, height): (usize, usize)) -> Result<(), String> {
        let is_other = |stated: Option<f64>, side: usize| stated.is_some_and(|v| v != side as f64);
        if is_other(self.width, width) || is_other(self.height, height) {
            let shown =
                |stated: Option<f64>| stated.map_or_else(|| "?".to_owned(), |v| v.to_string());
            return Err(format!(
                "the image {:?} has {} x {} pixels there, and {width} x {height} in the scene; give boxes in pixels of the scene's images",
                self.file_name,
                shown(self.width),
                shown(self.height)
            ));
        }
        Ok(())
    }
}

/// The numbers of a camera's images.
struct Frames<'a> {
    /// By name; `None` of a video.
    names: Option<HashMap<&'a str, usize>>,
    /// By name without ending.
    stems: HashMap<&'a str, usize>,
    /// By the number at the end of that.
    numbers: HashMap<u64, usize>,
}

impl<'a> Frames<'a> {
    fn of(images: Option<&'a [String]>) -> Self {
        let all = || images.into_iter().flatten().map(String::as_str).enumerate();
        let numbered =
            all().filter_map(|(frame, name)| Some((trailing_number(Path::new(name))?, frame)));
        Self {
            names: images.map(|_| all().map(|(frame, name)| (name, frame)).collect()),
            stems: all().map(|(frame, name)| (stem(name), frame)).collect(),
            numbers: numbered.collect(),
        }
    }

    /// The image of a result, whose id is its name or the number in it. Images of a video count from 0.
    fn with_id(&self, id: &Id) -> Result<usize, String> {
        let frame = match (&self.names, id) {
            (None, Id::Number(number)) => usize::try_from(*number).ok(),
            (None, Id::Name(_)) => {
                return Err(format!(
                    "image_id is {id}; allowed for a video: the number of the image, from 0"
                ));
            }
            (Some(_), Id::Number(number)) => self.numbers.get(number).copied(),
            (Some(names), Id::Name(name)) => {
                let whole = names.get(name.as_str());
                whole.or_else(|| self.stems.get(name.as_str())).copied()
            }
        };
        frame.ok_or_else(|| {
            format!(
                "image_id is {id}, and no image of the camera has this name or ends in this number; are the boxes of other images, or do they count from another number?"
            )
        })
    }

    /// The image of a data set, which may name it with its folder.
    fn with_name(&self, name: &str) -> Result<usize, String> {
        let Some(names) = &self.names else {
            return Err(format!(
                "is of the image {name:?}, and the camera has a video; give its images as a folder, or results whose image_id is the number of the image, from 0"
            ));
        };
        let last = name.rsplit(['/', '\\']).next().unwrap_or(name);
        let frame = names.get(last).copied();
        frame.ok_or_else(|| {
            format!("is of the image {name:?}, which the camera does not have; keep the boxes of its own images only")
        })
    }
}

/// The name of a file without its ending.
fn stem(name: &str) -> &str {
    name.rsplit_once('.').map_or(name, |(stem, _)| stem)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn boxes(text: &str, images: Option<&[&str]>) -> Result<Vec<Found>> {
        let names = images.map(|names| names.iter().map(|&name| name.to_owned()).collect());
        let images = Images {
            size_px: (640, 480),
            count: None,
            names,
        };
        boxes_in(Path::new("boxes.json"), text.as_bytes(), &images)
    }

    const IMAGES: [&str; 3] = ["clip_000041.jpg", "clip_000042.jpg", "7.png"];

    #[test]
    fn results_are_of_the_images_that_they_name() {
        let one = |id: &str| {
            format!(r#"[{{"image_id":{id},"category_id":3,"bbox":[10,20,5,6],"score":0.5}}]"#)
        };
        for (id, frame) in [
            ("42", 1),
            ("\"clip_000041\"", 0),
            ("\"7.png\"", 2),
            ("7", 2),
        ] {
            let found = &boxes(&one(id), Some(&IMAGES)).unwrap()[0];
            assert_eq!((found.frame, found.class.as_deref()), (frame, Some("3")));
            // The pixels 10 to 14 and 20 to 25, counted from 0.
            assert_eq!(found.found.unwrap().sides_px(), [9.5, 19.5, 14.5, 25.5]);
            assert_eq!(found.found.unwrap().score(), Some(0.5));
        }
        assert_eq!(boxes(&one("12"), None).unwrap()[0].frame, 12);
        for (id, images, problem) in [
            (
                "43",
                Some(&IMAGES[..]),
                "boxes.json, entry 1: image_id is 43, and no image",
            ),
            (
                "\"clip\"",
                None,
                "image_id is \"clip\"; allowed for a video",
            ),
        ] {
            let error = boxes(&one(id), images).err().unwrap().to_string();
            assert!(error.contains(problem), "{error}");
        }
    }

    #[test]
    fn data_sets_have_names_of_images_and_categories() {
        let set = |name: &str| {
            format!(
                r#"{{"images":[{{"id":9,"file_name":{name:?},"width":640,"height":480}}],"categories":[{{"id":37,"name":"sports ball"}}],
                "annotations":[{{"image_id":9,"category_id":37,"bbox":[0,0,2,2],"segmentation":[[0,0,1,1]]}},{{"image_id":9,"bbox":[0,0,2,2]}}]}}"#
            )
        };
        let found = boxes(&set("images/7.png"), Some(&IMAGES)).unwrap();
        let classes = [&found[0], &found[1]].map(|one| one.class.as_deref());
        assert_eq!(classes, [Some("sports ball"), None]);
        assert_eq!((found[0].frame, found[0].found.unwrap().score()), (2, None));
        for (text, images, problem) in [
            (
                set("8.png"),
                Some(&IMAGES[..]),
                "which the camera does not have",
            ),
            (set("7.png"), None, "and the camera has a video"),
            (
                set("7.png").replace("\"id\":9", "\"id\":8"),
                Some(&IMAGES[..]),
                "no image with the id 9",
            ),
            (
                set("7.png").replace("[0,0,2,2]", "[0,0,-2,2]"),
                Some(&IMAGES[..]),
                "boxes.json, entry 1 of annotations: bbox: its width is -2; allowed: above 0",
            ),
            (
                set("7.png").replace("[0,0,2,2]", "[0,0,2]"),
                Some(&IMAGES[..]),
                "entry 1 of annotations: invalid length 3, expected an array of length 4; needed: image_id, bbox",
            ),
            (
                set("7.png").replace("\"category_id\":37", "\"category_id\":7"),
                Some(&IMAGES[..]),
                "category_id is 7, which is not in categories",
            ),
            (
                set("7.png").replace("640", "320"),
                Some(&IMAGES[..]),
                "has 320 x 480 pixels there, and 640 x 480 in the scene",
            ),
            ("[]".to_owned(), None, "boxes.json: has no boxes"),
            ("{}".to_owned(), None, "is not in the format of COCO"),
            ("[{".to_owned(), None, "is not JSON: EOF while parsing"),
        ] {
            let error = boxes(&text, images).err().unwrap().to_string();
            assert!(error.contains(problem), "{error}");
        }
    }
}
