"""Boxes of detectors of other kinds."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def boxes_of_masks(masks: ArrayLike) -> NDArray[np.float64]:
    """Return the boxes around masks, for `Tracker.observe`: left, top, right and bottom side (N x 4, pixels).

    `masks` are N x height x width booleans, true where a body is, such as those of a segmentation. Empty masks have no box. Sides lie half a pixel
    beyond the outermost pixels.

    >>> masks = np.zeros((2, 8, 10), bool)
    >>> masks[0, 2:5, 3:9] = True
    >>> boxes_of_masks(masks).tolist()
    [[2.5, 1.5, 8.5, 4.5]]
    """
    masks = np.asarray(masks)
    if masks.ndim != 3 or masks.dtype != np.bool_:
        raise ValueError(f"masks have the shape {masks.shape} and the type {masks.dtype}; needed: N x height x width booleans, such as scores > 0.5")
    boxes = []
    for mask in masks:
        rows, columns = (np.flatnonzero(mask.any(axis)) for axis in (1, 0))
        if len(rows):
            boxes.append([columns[0] - 0.5, rows[0] - 0.5, columns[-1] + 0.5, rows[-1] + 0.5])
    return np.array(boxes, np.float64).reshape(-1, 4)
