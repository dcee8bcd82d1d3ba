//! The palette options of the command line.

use anyhow::Result;
use clap::ValueEnum;
use pardalis::color::{Palette, YuvEncoding, YuvMatrix, YuvRange};

use crate::user_error::user_error;

/// Other palettes that are tried, and their options.
pub(super) const PALETTES: [(&str, Palette); 3] = [
    (
        "--palette hsi --bins 24,16,6",
        Palette::Hsi {
            hue_bins: 24,
            saturation_bins: 16,
            intensity_bins: 6,
        },
    ),
    ("--palette yuv", Palette::YUV),
    ("--palette rgb", Palette::Rgb { channel_bins: 8 }),
];

/// How colours are divided into bins.
#[derive(Debug, clap::Args)]
pub(super) struct PaletteOptions {
    /// The colour space to divide [default: hsi; without --palette and --bins, finer bins and other colour spaces are
    /// tried if the detector misses a labelled ball]
    #[arg(long, value_enum)]
    palette: Option<Space>,
    /// Numbers of bins: of hue, saturation and intensity; of y, u and v; or, for rgb, one number for each
    /// channel [default: hsi 12,12,4; yuv 4,8,8; rgb 8]
    #[arg(long, value_name = "N,N,N|N", value_delimiter = ',')]
    bins: Vec<u16>,
    /// For yuv: the weights of red, green and blue in Y, as used by the camera [default: bt601]
    #[arg(long, value_enum)]
    yuv_matrix: Option<Matrix>,
    /// For yuv: the values of black and white, as used by the camera [default: full]
    #[arg(long, value_enum)]
    yuv_range: Option<Range>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Space {
    /// Hue, saturation and intensity: the most robust to illumination
    Hsi,
    /// Luma and chroma: the fastest with cameras and videos that deliver them
    Yuv,
    /// Red, green and blue
    Rgb,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Matrix {
    /// JPEG, webcams and standard-definition video
    Bt601,
    /// High-definition video
    Bt709,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Range {
    /// Y from 0 to 255, as in JPEG
    Full,
    /// Y from 16 to 235, as in most video
    Limited,
}

impl PaletteOptions {
    /// Returns the selected palette.
    ///
    /// Errors: the bins do not suit it, or options of another palette are given.
    pub(super) fn palette(&self) -> Result<Palette> {
        let yuv_only = [
            ("--yuv-matrix", self.yuv_matrix.is_some()),
            ("--yuv-range", self.yuv_range.is_some()),
        ];
        if let Some((option, _)) = yuv_only.iter().find(|(_, given)| *given)
            && self.space() != Space::Yuv
        {
            return Err(user_error!(
                "{option} requires --palette yuv; remove it, or give both"
            ));
        }
        let palette = match (self.space(), self.bins.as_slice()) {
            (Space::Hsi, []) => Palette::HSI,
            (Space::Hsi, &[hue_bins, saturation_bins, intensity_bins]) => Palette::Hsi {
                hue_bins,
                saturation_bins,
                intensity_bins,
            },
            (Space::Yuv, &[y_bins, u_bins, v_bins]) => self.yuv([y_bins, u_bins, v_bins]),
            (Space::Yuv, []) => self.yuv(Palette::YUV.channel_bins()),
            (Space::Rgb, []) => Palette::Rgb { channel_bins: 8 },
            (Space::Rgb, &[channel_bins]) => Palette::Rgb { channel_bins },
            (space, bins) => {
                let (name, allowed) = match space {
                    Space::Hsi => (
                        "hsi",
                        "three, of hue, saturation and intensity, as in 12,12,4",
                    ),
                    Space::Yuv => ("yuv", "three, of y, u and v, as in 4,8,8"),
                    Space::Rgb => ("rgb", "one, of each channel, as in 8"),
                };
                return Err(user_error!(
                    "--bins has {} numbers; allowed with --palette {name}: {allowed}",
                    bins.len()
                ));
            }
        };
        palette
            .check()
            .map_err(|error| user_error!("--bins: {error}"))?;
        Ok(palette)
    }

    /// Reports whether the palette is not for the program to choose.
    pub(super) fn is_given(&self) -> bool {
        self.palette.is_some() || !self.bins.is_empty()
    }

    fn space(&self) -> Space {
        self.palette.unwrap_or(Space::Hsi)
    }

    fn yuv(&self, [y_bins, u_bins, v_bins]: [u16; 3]) -> Palette {
        Palette::Yuv {
            y_bins,
            u_bins,
            v_bins,
            encoding: YuvEncoding {
                matrix: match self.yuv_matrix {
                    Some(Matrix::Bt709) => YuvMatrix::Bt709,
                    Some(Matrix::Bt601) | None => YuvMatrix::Bt601,
                },
                range: match self.yuv_range {
                    Some(Range::Limited) => YuvRange::Limited,
                    Some(Range::Full) | None => YuvRange::Full,
                },
            },
        }
    }
}

/// Formats the options that select a palette.
pub(super) fn words_of(palette: Palette) -> String {
    let [a, b, c] = palette.channel_bins();
    match palette {
        Palette::Hsi { .. } => format!("--palette hsi --bins {a},{b},{c}"),
        Palette::Rgb { channel_bins } => format!("--palette rgb --bins {channel_bins}"),
        Palette::Yuv { encoding, .. } => {
            let matrix = match encoding.matrix {
                YuvMatrix::Bt601 => "bt601",
                YuvMatrix::Bt709 => "bt709",
            };
            let range = match encoding.range {
                YuvRange::Full => "full",
                YuvRange::Limited => "limited",
            };
            format!("--palette yuv --bins {a},{b},{c} --yuv-matrix {matrix} --yuv-range {range}")
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::{Args, Command, FromArgMatches};

    use super::*;

    #[test]
    fn the_options_of_a_palette_select_it() {
        let mut yuv = Palette::YUV;
        if let Palette::Yuv { encoding, .. } = &mut yuv {
            encoding.matrix = YuvMatrix::Bt709;
            encoding.range = YuvRange::Limited;
        }
        let rgb = Palette::Rgb { channel_bins: 6 };
        for palette in [Palette::HSI, Palette::YUV, yuv, rgb] {
            let options = words_of(palette);
            let command = PaletteOptions::augment_args(Command::new("learn"));
            let words = format!("learn {options}");
            let matches = command.try_get_matches_from(words.split(' ')).unwrap();
            let parsed = PaletteOptions::from_arg_matches(&matches).unwrap();
            assert_eq!(parsed.palette().unwrap(), palette, "{options}");
        }
    }
}
