//! Curves with labels drawn over a camera's image.

use pardalis_images::RgbImage;

use super::Rgb;
use super::overlay::{Mark, Overlay, annotated};
use super::picture::{canvas_of, picture_from};
use super::text::{Caption, write_caption};

/// Text beside a point of the image.
pub(crate) struct Label {
    pub(crate) text: String,
    /// The point, pixel centres at integers.
    pub(crate) at_px: [f64; 2],
    pub(crate) color: Rgb,
}

/// Images with a shorter side than this are drawn twice as large, so that thin lines and their labels stay apart.
const SMALL_SIDE_PX: u32 = 1000;

const TEXT_PX: f32 = 11.0;

/// Returns the pixels of the drawing per pixel of an image of this size.
fn zoom_of((width, height): (u32, u32)) -> u32 {
    if width.min(height) < SMALL_SIDE_PX {
        2
    } else {
        1
    }
}

/// Draws marks and labels over an image. A label stands to the right of its point, or to the left if there is no room
/// on the right; labels without room on either side are left out.
pub(crate) fn drawn_over(image: &RgbImage, marks: Vec<Mark>, labels: &[Label]) -> RgbImage {
    let zoom = zoom_of(image.dimensions());
    let (width, height) = (zoom * image.width(), zoom * image.height());
    let enlarged = image.resized(width, height);
    let scale = f64::from(zoom);
    let place = |pixel: [f64; 2]| pixel.map(|c| scale * (c + 0.5) - 0.5);
    let marks = marks.into_iter().map(|mark| Mark {
        points_px: mark.points_px.into_iter().map(|p| p.map(place)).collect(),
        ..mark
    });
    let overlay = Overlay {
        marks: marks.collect(),
        notes: Vec::new(),
        label: String::new(),
        zoom: None,
    };
    let drawn = annotated(&enlarged, &overlay);
    let Some(mut canvas) = canvas_of(&drawn) else {
        return drawn;
    };
    let mut boxes: Vec<[f32; 4]> = Vec::new();
    for label in labels {
        let [at_x, y] = place(label.at_px).map(|c| c as f32);
        let y = y + 3.0;
        let width_px = 0.65 * TEXT_PX * label.text.chars().count() as f32;
        let box_at = |x: f32| [x, y - TEXT_PX, x + width_px, y + 3.0];
        let free = |own: &[f32; 4]| {
            boxes
                .iter()
                .all(|b| own[0] > b[2] || b[0] > own[2] || own[1] > b[3] || b[1] > own[3])
        };
        let sides = [at_x + 3.0, at_x - 3.0 - width_px].map(box_at);
        let Some(own) = sides.into_iter().find(free) else {
            continue;
        };
        let x = own[0];
        boxes.push(own);
        // A shadow keeps text legible on any image.
        for (offset_px, color) in [(1.0, [0; 3]), (0.0, label.color)] {
            let caption = Caption {
                text: &label.text,
                at_px: [x + offset_px, y + offset_px],
                height_px: TEXT_PX,
                max_width_px: width as f32,
                color,
            };
            write_caption(&mut canvas, &caption);
        }
    }
    picture_from(&canvas)
}
