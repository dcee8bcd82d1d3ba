//! What the EXIF data of a JPEG file say about the camera: how it was held, and its focal length.

use super::Image;

/// How the stored pixels are turned upright.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Orientation {
    /// Rows of the upright image are stored as columns.
    is_transposed: bool,
    /// Stored columns run from right to left of what is then the image.
    reverses_columns: bool,
    /// Stored rows run from bottom to top of what is then the image.
    reverses_rows: bool,
}

/// The EXIF data that are used; missing and invalid ones have their default.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Exif {
    pub(super) orientation: Orientation,
    /// The focal length of a lens with the same diagonal angle of view on film of 36 x 24 mm, in mm.
    film_focal_length_mm: Option<f64>,
    focal_length_mm: Option<f64>,
    /// Pixels of the recorded image per mm on the sensor.
    pixels_per_mm: Option<f64>,
    /// Width of the recorded image in pixels, before it was scaled.
    recorded_width_px: Option<f64>,
}

/// The diagonal of 36 x 24 mm, in mm.
const FILM_DIAGONAL_MM: f64 = 43.266_615_305_567_87;

impl Orientation {
    /// Returns the orientation with the given EXIF number; the usual one unless it is 2 to 8.
    fn of_number(number: f64) -> Self {
        let (is_transposed, reverses_columns, reverses_rows) = match number as u8 {
            2 => (false, true, false),
            3 => (false, true, true),
            4 => (false, false, true),
            5 => (true, false, false),
            6 => (true, false, true),
            7 => (true, true, true),
            8 => (true, true, false),
            _ => (false, false, false),
        };
        Self {
            is_transposed,
            reverses_columns,
            reverses_rows,
        }
    }

    /// Returns the width and height of the upright image.
    pub(super) fn size<T>(self, (width, height): (T, T)) -> (T, T) {
        if self.is_transposed {
            (height, width)
        } else {
            (width, height)
        }
    }

    /// Turns an image upright.
    pub(super) fn upright<const CHANNELS: usize>(
        self,
        stored: Image<u8, CHANNELS>,
    ) -> Image<u8, CHANNELS> {
        if self == Self::default() {
            return stored;
        }
        let (width, height) = self.size(stored.dimensions());
        let (last_column, last_row) = (stored.width() - 1, stored.height() - 1);
        Image::from_fn(width, height, |x, y| {
            let (column, row) = self.size((x, y));
            let column = if self.reverses_columns {
                last_column - column
            } else {
                column
            };
            let row = if self.reverses_rows {
                last_row - row
            } else {
                row
            };
            stored.get_pixel(column, row)
        })
    }
}

impl Exif {
    /// Reads the TIFF structure of EXIF data. Whatever cannot be read is left out.
    pub(super) fn read(tiff: &[u8]) -> Self {
        let mut exif = Self::default();
        let Some(tiff) = Tiff::open(tiff) else {
            return exif;
        };
        let mut details = None;
        // Units: none, inch, cm, mm and µm. Inches are the default.
        let (mut resolution, mut unit_mm) = (None, 25.4);
        for (tag, value) in tiff.directory(tiff.first_directory()) {
            match tag {
                0x0112 => exif.orientation = Orientation::of_number(value),
                0x8769 => details = Some(value as usize),
                _ => {}
            }
        }
        for (tag, value) in details.into_iter().flat_map(|at| tiff.directory(Some(at))) {
            let value = Some(value).filter(|value| *value > 0.0);
            match tag {
                0x920A => exif.focal_length_mm = value,
                0xA405 => exif.film_focal_length_mm = value,
                0xA002 => exif.recorded_width_px = value,
                0xA20E => resolution = value,
                0xA210 => match value {
                    Some(3.0) => unit_mm = 10.0,
                    Some(4.0) => unit_mm = 1.0,
                    Some(5.0) => unit_mm = 1e-3,
                    _ => {}
                },
                _ => {}
            }
        }
        exif.pixels_per_mm = resolution.map(|pixels| pixels / unit_mm);
        exif
    }

    /// Returns the focal length in pixels of an image stored with this width and height, if the data state it.
    pub(super) fn focal_length_px(&self, (width, height): (usize, usize)) -> Option<f64> {
        let (width, height) = (width as f64, height as f64);
        let by_film = |mm: f64| mm / FILM_DIAGONAL_MM * (width * width + height * height).sqrt();
        let by_sensor = |mm: f64| {
            let scale = width / self.recorded_width_px.unwrap_or(width);
            Some(mm * self.pixels_per_mm? * scale)
        };
        let film = self.film_focal_length_mm.map(by_film);
        film.or_else(|| self.focal_length_mm.and_then(by_sensor))
    }
}

/// A TIFF structure: directories of tagged values.
struct Tiff<'b> {
    bytes: &'b [u8],
    is_big_endian: bool,
}

impl<'b> Tiff<'b> {
    fn open(bytes: &'b [u8]) -> Option<Self> {
        let is_big_endian = match bytes {
            [b'I', b'I', 42, 0, ..] => false,
            [b'M', b'M', 0, 42, ..] => true,
            _ => return None,
        };
        Some(Self {
            bytes,
            is_big_endian,
        })
    }

    fn first_directory(&self) -> Option<usize> {
        Some(self.u32(4)? as usize)
    }

    /// Returns the tags of a directory with their first values, as far as these are numbers.
    fn directory(&self, at: Option<usize>) -> impl Iterator<Item = (u16, f64)> {
        let start = at.and_then(|at| Some((at.checked_add(2)?, self.u16(at)?)));
        let (first, count) = start.unwrap_or_default();
        // The directory may claim more entries than there are bytes.
        let entries = (0..usize::from(count)).map_while(move |number| {
            let entry = first.checked_add(12 * number)?;
            Some((entry, self.u16(entry)?))
        });
        entries.filter_map(|(entry, tag)| Some((tag, self.value(entry)?)))
    }

    /// Returns the first number of an entry.
    fn value(&self, entry: usize) -> Option<f64> {
        match self.u16(entry.checked_add(2)?)? {
            3 => Some(f64::from(self.u16(entry + 8)?)),
            4 => Some(f64::from(self.u32(entry + 8)?)),
            // A fraction of two numbers elsewhere.
            5 => {
                let at = self.u32(entry + 8)? as usize;
                let [numerator, denominator] = [self.u32(at)?, self.u32(at.checked_add(4)?)?];
                (denominator > 0).then(|| f64::from(numerator) / f64::from(denominator))
            }
            _ => None,
        }
    }

    fn u16(&self, at: usize) -> Option<u16> {
        let bytes = *self.bytes.get(at..)?.first_chunk()?;
        Some(if self.is_big_endian {
            u16::from_be_bytes(bytes)
        } else {
            u16::from_le_bytes(bytes)
        })
    }

    fn u32(&self, at: usize) -> Option<u32> {
        let bytes = *self.bytes.get(at..)?.first_chunk()?;
        Some(if self.is_big_endian {
            u32::from_be_bytes(bytes)
        } else {
            u32::from_le_bytes(bytes)
        })
    }
}
