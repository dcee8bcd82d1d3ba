//! Colour lookup tables against the reference, for every colour and any number of bins.

use pardalis::color::{Palette, PixelKind, PixelTable, YuvEncoding};
use proptest::prelude::*;

proptest! {
    #[test]
    fn tables_agree_with_the_reference_for_every_colour(bytes in any::<[u8; 3]>(), bins in prop::array::uniform3(1_u16..=40)) {
        let encoding = YuvEncoding::default();
        let palette = Palette::Yuv { y_bins: bins[0], u_bins: bins[1], v_bins: bins[2], encoding };
        for kind in [PixelKind::Rgb, PixelKind::Yuv(encoding)] {
            let bin = PixelTable::new(palette, kind).bin(bytes);
            prop_assert!(usize::from(bin) < palette.bin_count());
            prop_assert_eq!(bin, pardalis::reference::bin_of_bytes(palette, kind, bytes));
        }
    }
}
