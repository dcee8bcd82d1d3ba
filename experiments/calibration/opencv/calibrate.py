"""Calibrates with OpenCV what Pardalis calibrates, and writes a row a result: calibrate.py DATA_FOLDER WORK_FOLDER RESULTS.csv

Every RMS is the root mean square of the distances of points, over all points that are not said to be left out. Two things are done for OpenCV that
its functions leave to the user, so that it is not handicapped: `fisheye.calibrate` starts poses from flat boards only, so each side of a cube is
given as a view of its own; and all poses of test views (and, under the name `refined`, all parameters) are minimised here by
Levenberg-Marquardt over `fisheye.projectPoints` and its derivatives.
"""

import csv
import glob
import re
import sys
import time
import xml.etree.ElementTree

import cv2
import numpy as np

EXACT = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 500, 1e-12)
MISSING_PX = 1e3
CUBE_M = 0.62
# OpenCV's fisheye model divides by z: it has no pixels for points at 90 degrees and beyond.
FISHEYE_LIMIT_DEG = 89.0


def rms(residuals):
    return float(np.sqrt(np.mean(np.sum(np.concatenate(residuals) ** 2, axis=1))))


def read_views(path):
    """name -> (points N x 3, pixels N x 2)"""
    views = {}
    with open(path, newline="") as file:
        for row in csv.DictReader(file):
            point = [float(row[name]) for name in ("x_m", "y_m", "z_m", "u_px", "v_px")]
            views.setdefault(row["view"], []).append(point)
    return {name: (np.array(rows)[:, :3], np.array(rows)[:, 3:]) for name, rows in views.items()}


def write_views(path, views):
    with open(path, "w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["view", "x_m", "y_m", "z_m", "u_px", "v_px"])
        for name, (points, pixels) in views.items():
            for point, pixel in zip(points, pixels):
                table.writerow([name, *map(repr, map(float, point)), *map(repr, map(float, pixel))])


def project(points, pose, intrinsics):
    """Pixels, and their derivatives by fx, fy, cx, cy, k1..k4, rotation vector, translation; points behind the camera are far off."""
    fx, fy, cx, cy = intrinsics[:4]
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    pixels, slopes = cv2.fisheye.projectPoints(
        points.reshape(-1, 1, 3), pose[:3].reshape(3, 1), pose[3:].reshape(3, 1), matrix, intrinsics[4:]
    )
    pixels = pixels.reshape(-1, 2)
    behind = points @ cv2.Rodrigues(pose[:3])[0][2] + pose[5] <= 0
    pixels[behind] += MISSING_PX
    return pixels, slopes[:, :14]


def minimise(views, intrinsics, poses, free_intrinsics, iterations=200):
    """Levenberg-Marquardt on the squared distances of all points; the intrinsics stay where they are not free."""
    held = 0 if free_intrinsics else 8
    unknowns = 8 - held + 6 * len(views)

    def cost(intrinsics, poses):
        return sum(np.sum((project(p, pose, intrinsics)[0] - q) ** 2) for (p, q), pose in zip(views, poses))

    damping, present = 1e-3, cost(intrinsics, poses)
    for _ in range(iterations):
        normal, gradient = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
        for i, ((points, pixels), pose) in enumerate(zip(views, poses)):
            projected, slopes = project(points, pose, intrinsics)
            residual = (projected - pixels).ravel()
            at = np.r_[0 : 8 - held, 8 - held + 6 * i : 14 - held + 6 * i]
            slopes = slopes[:, held:]
            normal[np.ix_(at, at)] += slopes.T @ slopes
            gradient[at] += slopes.T @ residual
        scale = 1 / np.sqrt(np.maximum(np.diag(normal), 1e-30))
        better = False
        while damping < 1e12:
            damped = normal * np.outer(scale, scale) + damping * np.eye(unknowns)
            step = -scale * np.linalg.solve(damped, scale * gradient)
            moved = intrinsics + step[:8] if free_intrinsics else intrinsics
            stepped = poses + step[8 - held :].reshape(-1, 6)
            after = cost(moved, stepped)
            if after < present:
                better = True
                break
            damping *= 8
        if not better:
            break
        gain, present = (present - after) / present, after
        intrinsics, poses, damping = moved, stepped, max(damping / 8, 1e-12)
        if gain < 1e-12:
            break
    residuals = [project(p, pose, intrinsics)[0] - q for (p, q), pose in zip(views, poses)]
    return intrinsics, poses, residuals


def fit_poses(views, intrinsics):
    """The best poses with the intrinsics held: a linear start from the pixels less than 75 degrees from the axis, then least squares."""
    fx, fy, cx, cy = intrinsics[:4]
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    fitted, residuals = [], []
    for points, pixels in views:
        normalised = cv2.fisheye.undistortPoints(pixels.reshape(-1, 1, 2), matrix, intrinsics[4:]).reshape(-1, 2)
        near = np.hypot(*normalised.T) < np.tan(np.radians(75))
        _, rotation, translation = cv2.solvePnP(
            points[near], normalised[near], np.eye(3), None, flags=cv2.SOLVEPNP_SQPNP
        )
        pose = np.concatenate([rotation.ravel(), translation.ravel()])[None]
        _, pose, residual = minimise([(points, pixels)], intrinsics, pose, False)
        fitted.append(pose[0])
        residuals += residual
    return np.array(fitted), residuals


def sides(views):
    """Each flat side of a target as a view of its own, in a frame whose z axis is normal to it."""
    boards = []
    for points, pixels in views:
        # Corners lie within 13 mm of their side of the cube, and 40 mm from the edges. A plane's z is 0.
        nearest = np.argmin(np.abs(np.hstack([points, points - CUBE_M])), axis=1)
        for face in np.unique(nearest):
            on_face = nearest == face
            centred = points[on_face] - points[on_face].mean(axis=0)
            _, widths, axes = np.linalg.svd(centred, full_matrices=False)
            assert widths[2] < 1e-3 * widths[0], "a side that is not flat"
            axes[2] *= np.linalg.det(axes)
            flat = centred @ axes.T
            flat[:, 2] = 0
            boards.append((flat, pixels[on_face]))
    return boards


def angles_rad(pixels, intrinsics):
    """How far from the axis pixels look: Newton's method on the polynomial."""
    fx, fy, cx, cy, *k = intrinsics
    bent = np.hypot((pixels[:, 0] - cx) / fx, (pixels[:, 1] - cy) / fy)
    angle = np.minimum(bent, 2.0)
    for _ in range(50):
        powers = [angle ** (2 * i) for i in range(5)]
        value = angle * (1 + sum(c * p for c, p in zip(k, powers[1:])))
        slope = 1 + sum((2 * i + 3) * c * p for i, (c, p) in enumerate(zip(k, powers[1:])))
        angle = angle - (value - bent) / slope
    return angle


def within(views, intrinsics, limit_deg):
    """The views without the points beyond this angle."""
    near = [angles_rad(pixels, intrinsics) < np.radians(limit_deg) for _, pixels in views]
    return [(points[keep], pixels[keep]) for (points, pixels), keep in zip(views, near)]


def fisheye_calibrate(boards, size, guess, flags):
    """OpenCV's fisheye calibration of flat boards; those that it says it cannot take are dropped. None where it still fails."""
    boards = [board for board in boards if len(board[0]) >= 10]
    while len(boards) >= 5:
        matrix = np.array([[guess[0], 0, guess[2]], [0, guess[1], guess[3]], [0, 0, 1.0]])
        try:
            error, matrix, distortion, *_ = cv2.fisheye.calibrate(
                [points.reshape(1, -1, 3) for points, _ in boards],
                [pixels.reshape(1, -1, 2) for _, pixels in boards],
                size,
                matrix,
                guess[4:].reshape(4, 1).copy(),
                flags=flags | cv2.CALIB_FIX_SKEW | cv2.CALIB_USE_INTRINSIC_GUESS,
                criteria=EXACT,
            )
        except cv2.error as fault:
            named = re.search(r"input array (\d+)", str(fault))
            if named is None:
                return None
            boards.pop(int(named[1]))
            continue
        fx, fy, cx, cy = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
        return np.array([fx, fy, cx, cy, *distortion.ravel()]) if np.isfinite(error) else None
    return None


def fisheye(train, size):
    """The best of OpenCV's fisheye calibration: its intrinsics, and a word on how they were reached."""
    focal = size[0] / np.pi
    guess = np.array([focal, focal, (size[0] - 1) / 2, (size[1] - 1) / 2, 0, 0, 0, 0])
    best = None
    for limit_deg in (70, 80, FISHEYE_LIMIT_DEG):
        boards = sides(within(train, guess, limit_deg))
        for name, flags in (
            ("CHECK_COND", cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_CHECK_COND),
            ("", cv2.CALIB_RECOMPUTE_EXTRINSIC),
        ):
            found = fisheye_calibrate(boards, size, guess, flags)
            if found is None:
                continue
            try:
                _, residuals = fit_poses(within(train, found, FISHEYE_LIMIT_DEG), found)
            except (cv2.error, np.linalg.LinAlgError):
                continue
            note = f"points within {limit_deg} degrees {name}".strip()
            if best is None or rms(residuals) < best[0]:
                best = rms(residuals), found, note
        if best is not None:
            guess = best[1]
    return best


def omnidir(path):
    """OpenCV's own example of a mirror camera; its views and what `omnidir.calibrate` makes of them: (views, row)."""
    root = xml.etree.ElementTree.parse(path).getroot()
    numbers = lambda name, width: [
        np.array(data.text.split(), float).reshape(1, -1, width) for data in root.find(name).iter("data")
    ]
    points, pixels = numbers("objectPoints", 3), numbers("imagePoints", 2)
    begin = time.perf_counter()
    _, matrix, xi, distortion, turns, shifts, used = cv2.omnidir.calibrate(
        points, pixels, (1280, 960), None, None, None, 0, EXACT
    )
    seconds = time.perf_counter() - begin
    used = used.ravel()
    residuals = [
        (cv2.omnidir.projectPoints(points[i], turn, shift, matrix, float(xi[0, 0]), distortion)[0] - pixels[i])[0]
        for i, turn, shift in zip(used, turns, shifts)
    ]
    views = {str(i): (p[0], q[0]) for i, (p, q) in enumerate(zip(points, pixels))}
    left_out = sum(q.shape[1] for i, q in enumerate(pixels) if i not in used)
    row = ["opencv-omnidir", "mei", "omnidir.calibrate", 10, rms(residuals), None, None, left_out, seconds, ""]
    return views, row


def stereo(folder, side):
    """Images of a checkerboard of unknown size, found and calibrated by OpenCV: (views, row)."""
    grid = np.zeros((54, 3), np.float32)
    grid[:, :2] = np.mgrid[0:9, 0:6].T.reshape(-1, 2) * 0.025
    begin, views = time.perf_counter(), {}
    for path in sorted(glob.glob(f"{folder}/{side}*.jpg")):
        image = cv2.imread(path, cv2.IMREAD_GRAYSCALE)
        found, corners = cv2.findChessboardCorners(image, (9, 6))
        if found:
            corners = cv2.cornerSubPix(image, corners, (5, 5), (-1, -1), EXACT)
            views[path.rsplit("/", 1)[1]] = (grid, corners.reshape(-1, 2))
    _, matrix, distortion, turns, shifts = cv2.calibrateCamera(
        [p for p, _ in views.values()], [q for _, q in views.values()], (640, 480), None, None, criteria=EXACT
    )
    seconds = time.perf_counter() - begin
    residuals = [
        cv2.projectPoints(p, turn, shift, matrix, distortion)[0].reshape(-1, 2) - q
        for (p, q), turn, shift in zip(views.values(), turns, shifts)
    ]
    note = f"fx {matrix[0, 0]:.2f}; fy {matrix[1, 1]:.2f}; {len(views)} images"
    row = [f"opencv-stereo {side}", "pinhole", "calibrateCamera", 9, rms(residuals), None, None, 0, seconds, note]
    return views, row


def babelcalib(folder, name):
    """Train and test views of a wide fisheye without what OpenCV's model cannot take, and the rows: (train, test, rows)."""
    train, test = (read_views(f"{folder}/{name}-{split}.csv") for split in ("train", "test"))
    size, data = (1280, 800), f"OV {name}"
    begin = time.perf_counter()
    _, intrinsics, note = fisheye(list(train.values()), size)
    seconds = time.perf_counter() - begin
    counts = [sum(len(p) for p, _ in views.values()) for views in (train, test)]
    train, test = (dict(zip(views, within(views.values(), intrinsics, FISHEYE_LIMIT_DEG))) for views in (train, test))
    left_out = sum(counts) - sum(len(p) for views in (train, test) for p, _ in views.values())
    poses, residuals = fit_poses(train.values(), intrinsics)
    tested = fit_poses(test.values(), intrinsics)[1]
    row = [data, "kannala_brandt", "fisheye.calibrate", 8, rms(residuals), None, rms(tested), left_out, seconds, note]
    refined, _, residuals = minimise(list(train.values()), intrinsics, poses, True)
    tested = fit_poses(test.values(), refined)[1]
    note = "the same refined with the cube as one rigid body" if name == "cube" else "the same refined"
    rows = [row, [data, "kannala_brandt", "fisheye refined", 8, rms(residuals), None, rms(tested), left_out, None, note]]
    return train, test, rows


def main(data, work, results):
    rows = []
    for name in ("plane", "cube"):
        train, test, found = babelcalib(f"{data}/babelcalib-ov", name)
        write_views(f"{work}/{name}-train.csv", dict(enumerate(sides(train.values()))))
        write_views(f"{work}/{name}-test.csv", test)
        rows += found
    views, row = omnidir(f"{data}/opencv-omnidir/omni_calib_data.xml")
    write_views(f"{work}/omnidir.csv", views)
    rows.append(row)
    for side in ("left", "right"):
        views, row = stereo(f"{data}/opencv-stereo", side)
        write_views(f"{work}/stereo-{side}.csv", views)
        rows.append(row)
    with open(results, "w", newline="") as file:
        shown = lambda value: "" if value is None else f"{value:.6g}" if isinstance(value, float) else value
        csv.writer(file, lineterminator="\n").writerows([[shown(value) for value in row] for row in rows])


if __name__ == "__main__":
    main(*sys.argv[1:])
