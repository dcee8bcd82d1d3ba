use super::*;
use crate::draw::test_folder;
use crate::source::decode::decode_image;

fn plot() -> ColorModelPlot {
    let bins = (0..40_u8).map(|i| ColorBin {
        color: [250 - 2 * i, 3 * i, 20],
        label: format!("U {} V {}", i, 31 - i / 2),
        share: 0.2 * (-0.2 * f64::from(i)).exp(),
    });
    let spread = |centre: f64, count: u32| {
        let score =
            move |i: u32| centre + 2.0 * (f64::from(i) * 0.7).sin() + (f64::from(i) * 1.3).cos();
        (0..count).map(|i| (score(i), 1)).collect::<Vec<_>>()
    };
    let mut background_log_odds = spread(-4.0, 5000);
    background_log_odds.push((f64::NEG_INFINITY, 1));
    ColorModelPlot {
        bins: bins.collect(),
        object_log_odds: spread(3.0, 900),
        background_log_odds,
        threshold: -0.25,
    }
}

#[test]
fn bars_have_the_colours_of_their_bins() {
    let folder = test_folder("histogram");
    let [svg, png] = write_color_model_plot(&folder, "colour", &plot()).unwrap();
    let picture = decode_image(&png).unwrap();
    let count = |color: Rgb| picture.pixels().filter(|p| *p == color).count();
    assert!(count([250, 0, 20]) > 2 * count([246, 6, 20]) / 2);
    assert!(count([246, 6, 20]) > 1000);
    assert_eq!(count([250 - 2 * 30, 90, 20]), 0, "only the most frequent");
    let svg = std::fs::read_to_string(svg).unwrap();
    assert!(svg.contains("threshold −0.25") && svg.contains("20.0 %"));
}

#[test]
fn degenerate_models_are_drawn() {
    let folder = test_folder("histogram-degenerate");
    let empty = ColorModelPlot {
        bins: vec![],
        object_log_odds: vec![],
        background_log_odds: vec![],
        threshold: 0.0,
    };
    let odd = ColorModelPlot {
        bins: [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-300]
            .map(|share| ColorBin {
                color: [0; 3],
                label: "\u{0}<".repeat(50),
                share,
            })
            .to_vec(),
        object_log_odds: vec![(f64::INFINITY, 1), (f64::NAN, 2), (1e300, 1)],
        background_log_odds: vec![(2.0, 10), (f64::MAX, 0)],
        threshold: f64::INFINITY,
    };
    for plot in [empty, odd] {
        let [svg, png] = write_color_model_plot(&folder, "colour", &plot).unwrap();
        assert!(!std::fs::read_to_string(svg).unwrap().contains("NaN"));
        decode_image(&png).unwrap();
    }
}

#[test]
fn the_outline_counts_every_score_once() {
    let scores = [
        (f64::NEG_INFINITY, 1),
        (-5.0, 1),
        (0.0, 1),
        (5.0, 1),
        (f64::INFINITY, 1),
        (f64::NAN, 7),
    ];
    let outline = outline(&scores, &(-5.0..5.0));
    let tops = outline[1..outline.len() - 1]
        .chunks(2)
        .map(|class| class[0].1);
    assert!((tops.sum::<f64>() - 100.0).abs() < 1e-9);
    assert_eq!(outline[1].1, 40.0);
}
