#!/usr/bin/env python3
"""Writes correspondences.csv: 40 points in the world and their pixels in the mirror camera of data/worlds/hyperboloid-ball.toml.

The pixels come from the law of reflection at the mirror (thesis eq. 3.2), solved by bisection, and share no code with the program.
"""

import math
import pathlib
import random

A, B, VERTEX, RIM = 0.064, 0.07155417527999328, 0.16, 0.07  # metres
F_PX, CENTER_PX, HEIGHT_M, NOISE_PX = 620.0, (319.5, 239.5), 0.82, 0.3


def mirror(t):
    """Height of the mirror over the pinhole, and its slope."""
    root = math.sqrt(1.0 + (t / B) ** 2)
    return VERTEX + A * (root - 1.0), A * t / (B * B * root)


def image_radius(r, z):
    """Image radius over focal length of the scene point (r, z) in the camera's frame."""

    def excess(t):
        height, slope = mirror(t)
        return math.atan(t / height) + 2.0 * math.atan(slope) - math.atan2(r - t, height - z)

    low, high = 0.0, RIM
    assert excess(low) < 0.0 < excess(high)
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) < 0.0 else (low, middle)
    return low / mirror(low)[0]


rng = random.Random(1)
rows = ["id,x_m,y_m,z_m,u_true_px,v_true_px,u_noisy_px,v_noisy_px"]
for number in range(40):
    distance_m, angle = rng.uniform(0.5, 3.0), rng.uniform(-math.pi, math.pi)
    x, y = distance_m * math.cos(angle), distance_m * math.sin(angle)
    z = (0.0, 0.0, rng.uniform(0.05, 0.5))[number % 3]
    in_camera = (y, -x, z - HEIGHT_M)
    radius = F_PX * image_radius(distance_m, in_camera[2]) / distance_m
    pixel = [center + radius * side for center, side in zip(CENTER_PX, in_camera)]
    noisy = [side + rng.gauss(0.0, NOISE_PX) for side in pixel]
    numbers = [f"{v:.6f}" for v in (x, y, z)] + [f"{v:.4f}" for v in pixel + noisy]
    rows.append(",".join([str(number), *numbers]))
pathlib.Path(__file__).with_name("correspondences.csv").write_text("\n".join(rows) + "\n")
