use super::*;
use crate::draw::test_folder;
use crate::source::decode::{decode_image, decode_mask};

#[test]
fn labelled_images_are_drawn_with_outline_and_scores() {
    let folder = test_folder("mosaic");
    let training = concat!(env!("CARGO_MANIFEST_DIR"), "/../../data/training/dioptric");
    let tiles: Vec<Tile> = (0..3)
        .map(|i| {
            let image = decode_image(format!("{training}/00{i}.jpg").as_ref()).unwrap();
            let mask = decode_mask(format!("{training}/00{i}_ball_mask.png").as_ref()).unwrap();
            let log_odds = image
                .pixels()
                .map(|p| 0.05 * (f32::from(p[0]) - 1.5 * f32::from(p[2])));
            Tile {
                label: format!("00{i}.jpg"),
                log_odds: log_odds.collect(),
                mask: mask.pixels().map(|p| p[0] > 127).collect(),
                image,
            }
        })
        .collect();
    let path = folder.join("mosaic.png");
    write_mosaic(&path, &tiles, 0.5).unwrap();
    let picture = decode_image(&path).unwrap();
    assert_eq!(picture.dimensions(), (2 * 452 + 10, 2 * 252 + 44));
    let first = picture.crop(10, 22, SIDE_PX, SIDE_PX);
    let count = |color: Rgb| first.pixels().filter(|p| *p == color).count();
    assert!(count([255; 3]) > 200 && count([0; 3]) > 200);
}

#[test]
fn degenerate_tiles_are_drawn() {
    let folder = test_folder("mosaic-degenerate");
    let path = folder.join("mosaic.png");
    let tile = |width, height, mask, log_odds| Tile {
        label: String::new(),
        image: RgbImage::new(width, height),
        mask,
        log_odds,
    };
    write_mosaic(&path, &[], 0.0).unwrap();
    write_mosaic(&path, &[tile(0, 0, vec![], vec![])], 0.0).unwrap();
    let strange = vec![f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
    let tiles = [
        tile(3, 1, vec![false; 3], strange.clone()),
        tile(1, 3, vec![true; 3], strange),
        tile(5, 5, vec![true], vec![]),
    ];
    write_mosaic(&path, &tiles, f32::NAN).unwrap();
    decode_image(&path).unwrap();
}

#[test]
fn colours_diverge_from_the_threshold() {
    assert_eq!(diverging_color(0.0), NEUTRAL);
    assert_eq!(diverging_color(f32::INFINITY), WARM);
    assert_eq!(diverging_color(-1.0), COLD);
}
