use super::*;
use crate::draw::test_folder;
use crate::source::decode::decode_image;

#[test]
fn labelled_images_are_drawn_with_outline_and_scores() {
    let folder = test_folder("mosaic");
    let is_ball = |x: u32, y: u32| x.abs_diff(120).pow(2) + y.abs_diff(90).pow(2) < 400;
    let image = RgbImage::from_fn(320, 240, |x, y| {
        if is_ball(x, y) {
            [230, 110, 20]
        } else {
            [90, (x / 2) as u8, y as u8]
        }
    });
    let tiles = (0..3).map(|i| {
        let log_odds = image
            .pixels()
            .map(|p| 0.05 * (f32::from(p[0]) - 1.5 * f32::from(p[2])));
        Ok(Tile {
            label: format!("00{i}.jpg"),
            found_px: Vec::new(),
            log_odds: log_odds.collect(),
            mask: image
                .enumerate_pixels()
                .map(|(x, y, _)| is_ball(x, y))
                .collect(),
            image: image.clone(),
        })
    });
    let path = folder.join("mosaic.png");
    write_mosaic(&path, tiles, 0.5).unwrap();
    let picture = decode_image(&path).unwrap();
    assert_eq!(picture.dimensions(), (2 * 452 + 10, 2 * 252 + 44));
    let first = picture.crop(10, 22, SIDE_PX, SIDE_PX);
    let count = |color: Rgb| first.pixels().filter(|p| *p == color).count();
    assert!(count([255; 3]) > 200 && count([0; 3]) > 200);
}

#[test]
fn found_outlines_are_drawn_where_they_are_seen() {
    let folder = test_folder("mosaic-found");
    let is_object = |x: u32, y: u32| (40..60).contains(&x) && (30..50).contains(&y);
    let image = RgbImage::from_pixel(100, 80, [90; 3]);
    let magenta_at = |left: f64| {
        let right = left + 20.0;
        let tile = Tile {
            label: String::new(),
            mask: image
                .enumerate_pixels()
                .map(|(x, y, _)| is_object(x, y))
                .collect(),
            log_odds: vec![0.0; 8000],
            // The corners are those of pixels, whose centres are at integers.
            found_px: [[left, 30.0], [right, 30.0], [right, 50.0], [left, 50.0]]
                .map(|corner| corner.map(|c: f64| c - 0.5))
                .to_vec(),
            image: image.clone(),
        };
        let path = folder.join("mosaic.png");
        write_mosaic(&path, [Ok(tile)], 0.0).unwrap();
        let drawn = decode_image(&path).unwrap();
        let found = drawn.enumerate_pixels().filter(|(_, _, p)| *p == FOUND);
        found.map(|(x, y, _)| [x, y]).collect::<Vec<_>>()
    };
    // 40 image pixels are 220 px: the outline lies around the middle half of the tile.
    let found = magenta_at(40.0);
    let middle = [GAP_PX + SIDE_PX / 2, LABEL_PX + SIDE_PX / 2];
    assert!(found.len() > 700, "{}", found.len());
    for [x, y] in found {
        let far = x.abs_diff(middle[0]).max(y.abs_diff(middle[1]));
        assert!((53..=56).contains(&far), "{x} {y}");
    }
    assert_eq!(magenta_at(70.0), [[0; 2]; 0], "outside of the tile");
}

#[test]
fn degenerate_tiles_are_drawn() {
    let folder = test_folder("mosaic-degenerate");
    let path = folder.join("mosaic.png");
    let tile = |width, height, mask, log_odds| Tile {
        label: String::new(),
        found_px: Vec::new(),
        image: RgbImage::new(width, height),
        mask,
        log_odds,
    };
    write_mosaic(&path, [], 0.0).unwrap();
    write_mosaic(&path, [Ok(tile(0, 0, vec![], vec![]))], 0.0).unwrap();
    let strange = vec![f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
    let tiles = [
        tile(3, 1, vec![false; 3], strange.clone()),
        tile(1, 3, vec![true; 3], strange),
        tile(5, 5, vec![true], vec![]),
    ];
    write_mosaic(&path, tiles.map(Ok), f32::NAN).unwrap();
    decode_image(&path).unwrap();
}

#[test]
fn colours_diverge_from_the_threshold() {
    assert_eq!(diverging_color(0.0), NEUTRAL);
    assert_eq!(diverging_color(f32::INFINITY), WARM);
    assert_eq!(diverging_color(-1.0), COLD);
}
