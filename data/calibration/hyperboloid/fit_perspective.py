#!/usr/bin/env python3
"""Writes perspective.toml: the perspective mirror model (thesis eq. 3.4) with the least squared pixel error over the noisy points of correspondences.csv.

`pardalis calibrate points` refuses this model here, because its best fit is tens of pixels off; this script gives that best fit all the same. Levenberg and
Marquardt's method with numeric derivatives over m, the principal point, and the pose.
"""

import csv
import math
import pathlib

FOLDER = pathlib.Path(__file__).parent
POINTS = [
    ([float(row[k]) for k in ("x_m", "y_m", "z_m")], [float(row[k]) for k in ("u_noisy_px", "v_noisy_px")])
    for row in csv.DictReader((FOLDER / "correspondences.csv").open())
]
# world_from_camera of an upright mirror camera, without its height.
UPRIGHT = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]


def product(a, b):
    return [[sum(a[i][k] * b[k][j] for k in range(3)) for j in range(3)] for i in range(3)]


def rotation(wx, wy, wz):
    angle = math.sqrt(wx * wx + wy * wy + wz * wz)
    s = math.sin(angle) / angle if angle > 1e-9 else 1.0
    c = (1.0 - math.cos(angle)) / angle**2 if angle > 1e-9 else 0.5
    cross = [[0.0, -wz, wy], [wz, 0.0, -wx], [-wy, wx, 0.0]]
    square = product(cross, cross)
    return [[(i == j) + s * cross[i][j] + c * square[i][j] for j in range(3)] for i in range(3)]


def residuals(p):
    m, cx, cy = p[:3]
    world_from_camera, place = product(UPRIGHT, rotation(*p[3:6])), p[6:9]
    errors = []
    for point, pixel in POINTS:
        offset = [a - b for a, b in zip(point, place)]
        x, y, z = (sum(world_from_camera[k][j] * offset[k] for k in range(3)) for j in range(3))
        z = min(z, -1e-3)
        errors += [cx - m * x / z - pixel[0], cy - m * y / z - pixel[1]]
    return errors


def solve(a, b):
    """Gauss's elimination with pivots."""
    n = len(b)
    rows = [row[:] + [value] for row, value in zip(a, b)]
    for i in range(n):
        pivot = max(range(i, n), key=lambda k: abs(rows[k][i]))
        rows[i], rows[pivot] = rows[pivot], rows[i]
        for k in range(i + 1, n):
            factor = rows[k][i] / rows[i][i]
            rows[k] = [x - factor * y for x, y in zip(rows[k], rows[i])]
    x = [0.0] * n
    for i in reversed(range(n)):
        x[i] = (rows[i][n] - sum(rows[i][k] * x[k] for k in range(i + 1, n))) / rows[i][i]
    return x


def fit(p):
    cost, damping = sum(e * e for e in residuals(p)), 1e-3
    for _ in range(2000):
        base = residuals(p)
        columns = []
        for i in range(9):
            step = 1e-6 * max(1.0, abs(p[i]))
            moved = p[:i] + [p[i] + step] + p[i + 1 :]
            columns.append([(a - b) / step for a, b in zip(residuals(moved), base)])
        normal = [[sum(a * b for a, b in zip(c, d)) for d in columns] for c in columns]
        for i in range(9):
            normal[i][i] *= 1.0 + damping
        change = solve(normal, [-sum(a * b for a, b in zip(c, base)) for c in columns])
        tried = [a + b for a, b in zip(p, change)]
        tried_cost = sum(e * e for e in residuals(tried))
        if tried_cost < cost:
            p, done = tried, cost - tried_cost < 1e-12 * cost
            cost, damping = tried_cost, damping * 0.3
            if done:
                break
        else:
            damping *= 5.0
            if damping > 1e12:
                break
    return cost, p


starts = [[m, 319.5, 239.5, 0.0, 0.0, 0.0, 0.0, 0.0, h] for m in (50.0, 100.0, 200.0) for h in (0.8, 1.2, 2.0)]
cost, p = min(fit(start) for start in starts)
rms_px = math.sqrt(cost / len(POINTS))
pose = product(UPRIGHT, rotation(*p[3:6]))
rows = "".join(f"    [{r[0]}, {r[1]}, {r[2]}, {t}],\n" for r, t in zip(pose, p[6:9]))
text = f"""# Best fit of the perspective mirror model to correspondences.csv, by fit_perspective.py: RMS {rms_px:.2f} px.

[cameras.camera]
size_px = [640, 480]
world_from_camera = [
{rows}    [0.0, 0.0, 0.0, 1.0],
]

[cameras.camera.model.perspective_mirror]
center_px = [{p[1]}, {p[2]}]
m_px = {p[0]}
"""
(FOLDER / "perspective.toml").write_text(text)
print(f"RMS {rms_px:.3f} px, m {p[0]:.2f} px, height {p[8]:.3f} m")
