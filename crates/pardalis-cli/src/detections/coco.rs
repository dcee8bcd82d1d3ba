//! Boxes in files as COCO has them: a data set with images and annotations, or the list of results that detectors write.

use std::collections::HashMap;
use std::fmt;
use std::path::Path;

use anyhow::Result;
use pardalis::tracker::ImageBox;
use serde::Deserialize;

use super::{Found, Place};
use crate::output::Shown;
use crate::source::images::trailing_number;
use crate::user_error::user_error;

/// Either kind of file.
#[derive(Deserialize)]
#[serde(untagged)]
enum File {
    Results(Vec<Annotation>),
    DataSet(DataSet),
}

#[derive(Deserialize)]
struct DataSet {
    images: Vec<Image>,
    annotations: Vec<Annotation>,
    #[serde(default)]
    categories: Vec<Category>,
}

#[derive(Deserialize)]
struct Image {
    id: Id,
    file_name: String,
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
#[serde(untagged)]
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

/// Returns the boxes in the text of a file. `images` are the names of the camera's images, from the first one on; a video has none.
pub(crate) fn boxes_in(path: &Path, text: &[u8], images: Option<&[String]>) -> Result<Vec<Found>> {
    let name = path.shown();
    let file = serde_json::from_slice(text);
    let file = file.map_err(|error| {
        if error.is_data() {
            user_error!(
                "{name}: is not in the format of COCO; needed: a list of results with image_id, category_id, bbox and score, or an object with images, annotations and categories"
            )
        } else {
            user_error!("{name}: is not JSON: {error}")
        }
    })?;
    let frames = Frames::of(images);
    let (annotations, names, categories) = match file {
        File::Results(results) => (results, None, HashMap::new()),
        File::DataSet(set) => {
            let names = set.images.into_iter().map(|one| (one.id, one.file_name));
            let categories = set.categories.into_iter().map(|one| (one.id, one.name));
            (
                set.annotations,
                Some(names.collect::<HashMap<Id, String>>()),
                categories.collect(),
            )
        }
    };
    let found = |(number, one): (usize, Annotation)| {
        let entry = number as u64 + 1;
        let failed = |problem: String| user_error!("{name}, entry {entry}: {problem}");
        let frame = match &names {
            None => frames.with_id(&one.image_id),
            Some(names) => match names.get(&one.image_id) {
                Some(image) => frames.with_name(image),
                None => Err(format!(
                    "there is no image with the id {}; add it to images",
                    one.image_id
                )),
            },
        };
        let [left, top, width, height] = one.bbox;
        let [left, top] = [left, top].map(|first| first - 0.5);
        let found = ImageBox::new([left, top, left + width, top + height]);
        let found = found.and_then(|found| match one.score {
            Some(score) => found.with_score(score),
            None => Ok(found),
        });
        let named = |id: i64| {
            categories
                .get(&id)
                .cloned()
                .unwrap_or_else(|| id.to_string())
        };
        Ok(Found {
            frame: frame.map_err(failed)?,
            class: one.category_name.or(one.category_id.map(named)),
            found: found.map_err(|error| failed(error.to_string()))?,
            place: Place::Entry(entry),
        })
    };
    let found: Result<Vec<Found>> = annotations.into_iter().enumerate().map(found).collect();
    let found = found?;
    if found.is_empty() {
        return Err(user_error!("{name}: has no boxes"));
    }
    Ok(found)
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
                "image_id is {id}, and no image of the camera has this name or ends in this number"
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
        frame.ok_or_else(|| format!("is of the image {name:?}, which the camera does not have"))
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
        let images: Option<Vec<String>> =
            images.map(|names| names.iter().map(|&name| name.to_owned()).collect());
        boxes_in(Path::new("boxes.json"), text.as_bytes(), images.as_deref())
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
            assert_eq!(found.found.sides_px(), [9.5, 19.5, 14.5, 25.5]);
            assert_eq!(found.found.score(), Some(0.5));
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
                r#"{{"images":[{{"id":9,"file_name":{name:?}}}],"categories":[{{"id":37,"name":"sports ball"}}],
                "annotations":[{{"image_id":9,"category_id":37,"bbox":[0,0,2,2],"segmentation":[[0,0,1,1]]}},{{"image_id":9,"category_id":1,"bbox":[0,0,2,2]}}]}}"#
            )
        };
        let found = boxes(&set("images/7.png"), Some(&IMAGES)).unwrap();
        let classes = [&found[0], &found[1]].map(|one| one.class.as_deref());
        assert_eq!(classes, [Some("sports ball"), Some("1")]);
        assert_eq!((found[0].frame, found[0].found.score()), (2, None));
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
                "boxes.json, entry 1: box",
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
