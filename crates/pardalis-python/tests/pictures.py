"""Pictures and data for the tests."""

from pathlib import Path

import numpy as np

DATA = Path(__file__).resolve().parents[3] / "data"

ORANGE, GREEN = np.array([230.0, 110, 20]), np.array([60.0, 110, 70])


def discs(size_px, places):
    """Draw orange discs with soft edges before a grainy green ground; return the image and where the discs are."""
    width, height = size_px
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    share = np.zeros((height, width))
    for center_px, radius_px in places:
        off_px = np.hypot(u - center_px[0], v - center_px[1]) - radius_px
        share = np.maximum(share, np.clip(0.5 - 0.5 * off_px, 0, 1))
    grain = np.random.default_rng(1).normal(0, 3, (height, width, 1))
    image = GREEN + share[..., None] * (ORANGE - GREEN) + grain
    return np.clip(image, 0, 255).astype(np.uint8), share > 0.5
