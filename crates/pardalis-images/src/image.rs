//! A grid of pixels.

/// An image of `CHANNELS` interleaved samples per pixel, row by row from the top left.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image<T, const CHANNELS: usize> {
    width: u32,
    height: u32,
    samples: Vec<T>,
}

/// An image with one byte per pixel.
pub type GrayImage = Image<u8, 1>;

/// An image with red, green and blue bytes.
pub type RgbImage = Image<u8, 3>;

impl RgbImage {
    /// Returns the image in grey. Colours are combined with the weights of BT.601.
    pub fn to_grey(&self) -> GrayImage {
        self.map(|[r, g, b]| {
            let sum = 299 * u32::from(r) + 587 * u32::from(g) + 114 * u32::from(b);
            [((sum + 500) / 1000) as u8]
        })
    }
}

impl<T: Copy + Default, const CHANNELS: usize> Image<T, CHANNELS> {
    /// Creates an image with all samples zero.
    pub fn new(width: u32, height: u32) -> Self {
        Self::from_pixel(width, height, [T::default(); CHANNELS])
    }
}

impl<T: Copy, const CHANNELS: usize> Image<T, CHANNELS> {
    /// Creates an image of one colour.
    pub fn from_pixel(width: u32, height: u32, pixel: [T; CHANNELS]) -> Self {
        Self::from_fn(width, height, |_, _| pixel)
    }

    /// Creates an image from a function of column and row.
    pub fn from_fn(
        width: u32,
        height: u32,
        mut pixel: impl FnMut(u32, u32) -> [T; CHANNELS],
    ) -> Self {
        let mut samples = Vec::with_capacity(sample_count::<CHANNELS>(width, height));
        for y in 0..height {
            for x in 0..width {
                samples.extend_from_slice(&pixel(x, y));
            }
        }
        Self {
            width,
            height,
            samples,
        }
    }

    /// Creates an image from interleaved samples; `None` if their number does not match the size.
    pub fn from_raw(width: u32, height: u32, samples: Vec<T>) -> Option<Self> {
        (samples.len() == sample_count::<CHANNELS>(width, height)).then_some(Self {
            width,
            height,
            samples,
        })
    }

    /// Returns the width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Returns the height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Returns the width and height in pixels.
    pub fn dimensions(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Returns the width and height in pixels, as indices.
    pub fn size_px(&self) -> (usize, usize) {
        (self.width as usize, self.height as usize)
    }

    /// Returns the interleaved samples, row by row.
    pub fn as_raw(&self) -> &[T] {
        &self.samples
    }

    /// Converts the image into its interleaved samples, row by row.
    pub fn into_raw(self) -> Vec<T> {
        self.samples
    }

    /// Returns the pixel in column `x` and row `y`.
    ///
    /// # Panics
    ///
    /// Panics if the pixel is outside the image.
    #[inline]
    pub fn get_pixel(&self, x: u32, y: u32) -> [T; CHANNELS] {
        self.samples.as_chunks().0[self.index(x, y)]
    }

    /// Sets the pixel in column `x` and row `y`.
    ///
    /// # Panics
    ///
    /// Panics if the pixel is outside the image.
    #[inline]
    pub fn put_pixel(&mut self, x: u32, y: u32, pixel: [T; CHANNELS]) {
        let index = self.index(x, y);
        self.samples.as_chunks_mut().0[index] = pixel;
    }

    /// Iterates over all pixels, row by row.
    pub fn pixels(&self) -> impl Iterator<Item = [T; CHANNELS]> {
        self.samples.as_chunks().0.iter().copied()
    }

    /// Iterates over mutable references to all pixels, row by row.
    pub fn pixels_mut(&mut self) -> impl Iterator<Item = &mut [T; CHANNELS]> {
        self.samples.as_chunks_mut().0.iter_mut()
    }

    /// Iterates over all pixels with their columns and rows, row by row.
    pub fn enumerate_pixels(&self) -> impl Iterator<Item = (u32, u32, [T; CHANNELS])> {
        let positions = (0..self.height).flat_map(|y| (0..self.width).map(move |x| (x, y)));
        positions.zip(self.pixels()).map(|((x, y), p)| (x, y, p))
    }

    /// Iterates over mutable references to all pixels with their columns and rows, row by row.
    pub fn enumerate_pixels_mut(&mut self) -> impl Iterator<Item = (u32, u32, &mut [T; CHANNELS])> {
        let (width, height) = self.dimensions();
        let positions = (0..height).flat_map(move |y| (0..width).map(move |x| (x, y)));
        positions
            .zip(self.pixels_mut())
            .map(|((x, y), p)| (x, y, p))
    }

    /// Applies a function to each pixel and returns the result as an image of the same size.
    pub fn map<U: Copy, const N: usize>(
        &self,
        mut pixel: impl FnMut([T; CHANNELS]) -> [U; N],
    ) -> Image<U, N> {
        let samples: Vec<[U; N]> = self.pixels().map(&mut pixel).collect();
        Image {
            width: self.width,
            height: self.height,
            samples: samples.into_flattened(),
        }
    }

    /// Copies the rectangle of this size whose top left pixel is in column `x` and row `y`. The part outside the image
    /// is omitted.
    pub fn crop(&self, x: u32, y: u32, width: u32, height: u32) -> Self {
        let (x, y) = (x.min(self.width), y.min(self.height));
        let width = width.min(self.width - x);
        let height = height.min(self.height - y);
        Self::from_fn(width, height, |column, row| {
            self.get_pixel(x + column, y + row)
        })
    }

    /// Repeats each pixel `factor` times to the right and downwards.
    pub fn repeat(&self, factor: u32) -> Self {
        Self::from_fn(self.width * factor, self.height * factor, |x, y| {
            self.get_pixel(x / factor, y / factor)
        })
    }

    #[inline]
    fn index(&self, x: u32, y: u32) -> usize {
        assert!(
            x < self.width,
            "column {x} is outside an image {} pixels wide",
            self.width
        );
        y as usize * self.width as usize + x as usize
    }
}

fn sample_count<const CHANNELS: usize>(width: u32, height: u32) -> usize {
    CHANNELS * width as usize * height as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbered(width: u32, height: u32) -> RgbImage {
        RgbImage::from_fn(width, height, |x, y| [x as u8, y as u8, (x * y) as u8])
    }

    #[test]
    fn pixels_are_stored_row_by_row() {
        let mut image = numbered(3, 2);
        assert_eq!(
            image.as_raw(),
            [0, 0, 0, 1, 0, 0, 2, 0, 0, 0, 1, 0, 1, 1, 1, 2, 1, 2]
        );
        assert_eq!(image.get_pixel(2, 1), [2, 1, 2]);
        image.put_pixel(0, 1, [7, 8, 9]);
        assert_eq!(image.enumerate_pixels().nth(3), Some((0, 1, [7, 8, 9])));
        assert_eq!(image.map(|[r, _, _]| [f32::from(r)]).as_raw()[3], 7.0);
    }

    #[test]
    #[should_panic(expected = "column 3")]
    fn columns_outside_the_image_panic() {
        numbered(3, 2).get_pixel(3, 0);
    }

    #[test]
    fn the_number_of_raw_samples_must_match_the_size() {
        assert_eq!(RgbImage::from_raw(3, 2, vec![0; 17]), None);
        assert_eq!(
            RgbImage::from_raw(3, 2, vec![0; 18]),
            Some(RgbImage::new(3, 2))
        );
    }

    #[test]
    fn crops_end_at_the_border_and_pixels_are_repeated_as_squares() {
        let image = numbered(5, 4);
        let part = image.crop(3, 1, 9, 2);
        assert_eq!(part.dimensions(), (2, 2));
        assert_eq!(part.get_pixel(1, 1), [4, 2, 8]);
        assert_eq!(image.crop(9, 9, 2, 2).dimensions(), (0, 0));
        let large = part.repeat(3);
        assert_eq!(large.dimensions(), (6, 6));
        assert_eq!(large.get_pixel(5, 2), [4, 1, 4]);
    }
}
