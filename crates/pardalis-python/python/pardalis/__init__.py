"""Tracks coloured objects in 3D with particle filters, through any camera.

From the images of one or more calibrated cameras a `Tracker` computes, image by image, where a ball,
a robot or a flat target is, how fast it moves, how certain that is, and whether it is occluded or lost.

Units end names: metres, seconds, radians, pixels. The world's z axis points up; the camera's x axis points
right, y down and z ahead. Pixel centres have integer coordinates. Images are arrays of height x width x 3
bytes, red, green and blue: OpenCV has them the other way round, so pass `image[..., ::-1]`.

`track`, `simulate`, `evaluate` and `run` are commands of the program, which scene files, videos, calibration and
plots belong to.

The same images, seed and version give the same numbers.
"""

from ._boxes import boxes_of_masks
from ._pardalis import Camera, ColorModel, Estimate, Shape, Target, Tracker, __version__, read_image
from ._program import Tracks, evaluate, read_tracks, run, simulate, track

__all__ = [
    "Camera",
    "ColorModel",
    "Estimate",
    "Shape",
    "Target",
    "Tracker",
    "Tracks",
    "__version__",
    "boxes_of_masks",
    "evaluate",
    "read_image",
    "read_tracks",
    "run",
    "simulate",
    "track",
]
