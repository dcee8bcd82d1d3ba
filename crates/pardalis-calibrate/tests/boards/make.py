#!/usr/bin/env python3
"""Renders the ChArUco and AprilGrid images of this folder with OpenCV's own boards and tags, and writes the true corners to tables
(id, position in the board frame, pixel; only those at least 12 px inside the image).

The images are those of an equidistant fisheye or a pinhole camera, blurred by sigma 0.7 px, with noise of 3 grey levels, as JPEG.
Requires numpy and opencv-python (5.0 was used). Also writes src/board/dictionaries.txt.
"""

import csv
import pathlib

import cv2
import numpy as np

HERE = pathlib.Path(__file__).parent
SIZE = (640, 480)  # width, height
SAMPLES = 4  # along each side of a pixel
TEXTURE_PER_M = 4000


def charuco(columns, rows, square_m, marker_m, name, old):
    """Texture with the board's bottom left at its own, margin in metres, and corners by id in a frame with y up."""
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
    board = cv2.aruco.CharucoBoard((columns, rows), square_m, marker_m, dictionary)
    board.setLegacyPattern(old)
    margin = int(0.02 * TEXTURE_PER_M)
    size = (int(columns * square_m * TEXTURE_PER_M) + 2 * margin, int(rows * square_m * TEXTURE_PER_M) + 2 * margin)
    image = board.generateImage(size, marginSize=margin, borderBits=1)
    corners = board.getChessboardCorners()
    return image, 0.02, [(i, x, rows * square_m - y) for i, (x, y, _) in enumerate(corners)]


def aprilgrid(columns, rows, tag_m, spacing):
    """As `kalibr_create_target_pdf` draws it: tags upside down by OpenCV's notion, borders of 2 modules, squares between corners."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    tag, gap = int(round(tag_m * TEXTURE_PER_M)), int(round(tag_m * spacing * TEXTURE_PER_M))
    margin = 2 * gap
    pitch = tag + gap
    width, height = columns * pitch - gap + 2 * margin, rows * pitch - gap + 2 * margin
    image = np.full((height, width), 255, np.uint8)
    corners = []
    for row in range(rows):
        for column in range(columns):
            left, bottom = margin + column * pitch, height - margin - row * pitch
            top = bottom - tag
            drawn = np.rot90(dictionary.generateImageMarker(row * columns + column, 8, borderBits=1), 2)
            drawn = np.pad(drawn, 1)
            image[top:bottom, left : left + tag] = cv2.resize(drawn, (tag, tag), interpolation=cv2.INTER_NEAREST)
            for y in (top - gap, bottom):
                for x in (left - gap, left + tag):
                    image[y : y + gap, x : x + gap] = 0
            for up in (0, 1):
                for right in (0, 1):
                    number = (2 * row + up) * 2 * columns + 2 * column + right
                    corners.append(
                        (number, (column * (1 + spacing) + right) * tag_m, (row * (1 + spacing) + up) * tag_m)
                    )
    return image, margin / TEXTURE_PER_M, sorted(corners)


def rotation(degrees):
    """About x, then y, then z, of a board that faces the camera."""
    facing = np.diag([1.0, -1.0, -1.0])
    turn = np.eye(3)
    for axis, angle in enumerate(np.radians(degrees)):
        vector = np.zeros(3)
        vector[axis] = angle
        turn = cv2.Rodrigues(vector)[0] @ turn
    return turn @ facing


def project(points, f, fisheye):
    middle = np.array([(SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2])
    across = np.hypot(points[..., 0], points[..., 1])
    theta = np.arctan2(across, points[..., 2])
    rho = f * (theta if fisheye else np.tan(theta))
    return middle + points[..., :2] * (rho / np.maximum(across, 1e-12))[..., None]


def rays(pixels, f, fisheye):
    middle = np.array([(SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2])
    offset = pixels - middle
    rho = np.linalg.norm(offset, axis=-1)
    theta = rho / f if fisheye else np.arctan(rho / f)
    across = offset * (np.sin(theta) / np.maximum(rho, 1e-12))[..., None]
    return np.concatenate([across, np.cos(theta)[..., None]], axis=-1)


def picture(name, board, degrees, middle_m, f, fisheye, seed):
    texture, margin_m, corners = board
    height_m = texture.shape[0] / TEXTURE_PER_M - 2 * margin_m
    width_m = texture.shape[1] / TEXTURE_PER_M - 2 * margin_m
    turn = rotation(degrees)
    origin = np.array(middle_m) - turn @ np.array([width_m / 2, height_m / 2, 0])
    steps = (np.arange(SIZE[0] * SAMPLES) + 0.5) / SAMPLES - 0.5, (np.arange(SIZE[1] * SAMPLES) + 0.5) / SAMPLES - 0.5
    ray = rays(np.stack(np.meshgrid(*steps), axis=-1), f, fisheye)
    normal = turn[:, 2]
    along = ray @ normal
    reach = np.where(np.abs(along) > 1e-9, (origin @ normal) / along, -1)
    place = (ray * reach[..., None] - origin) @ turn
    u = (place[..., 0] + margin_m) * TEXTURE_PER_M - 0.5
    v = (height_m + margin_m - place[..., 1]) * TEXTURE_PER_M - 0.5
    u[reach <= 0] = -1e6
    seen = cv2.remap(
        texture, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=110
    )
    seen = seen.reshape(SIZE[1], SAMPLES, SIZE[0], SAMPLES).mean(axis=(1, 3)) * 0.7 + 35
    seen = cv2.GaussianBlur(seen, (0, 0), 0.7) + np.random.default_rng(seed).normal(0, 3, seen.shape)
    cv2.imwrite(str(HERE / f"{name}.jpg"), np.clip(np.round(seen), 0, 255).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 90])
    with open(HERE / f"{name}.csv", "w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["id", "x_m", "y_m", "z_m", "u_px", "v_px"])
        for number, x, y in corners:
            point = origin + turn @ np.array([x, y, 0])
            pixel = project(point[None], f, fisheye)[0]
            inside = all(12 <= pixel[n] <= SIZE[n] - 13 for n in (0, 1)) and (fisheye or point[2] > 0)
            if inside:
                rows.writerow([number, f"{x:.6f}", f"{y:.6f}", "0", f"{pixel[0]:.4f}", f"{pixel[1]:.4f}"])


def dictionaries():
    names = [f"DICT_{n}X{n}_{count}" for n in (4, 5, 6, 7) for count in (50, 100, 250, 1000)]
    names += ["DICT_ARUCO_ORIGINAL", "DICT_ARUCO_MIP_36h12"]
    names += [f"DICT_APRILTAG_{family}" for family in ("16h5", "25h9", "36h10", "36h11")]
    with open(HERE / "../../src/board/dictionaries.txt", "w") as file:
        file.write(
            "# Marker dictionaries of OpenCV (Apache-2.0), written by tests/boards/make.py. One line each: name, number of modules along a\n"
            "# side without the border, number of wrong modules that are corrected (OpenCV's error correction rate of 0.6), and for each id\n"
            "# from 0 the modules as a hexadecimal number, row by row from the top left, highest bit first, 1 for white.\n"
        )
        for name in names:
            dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
            codes = []
            for entry in range(dictionary.bytesList.shape[0]):
                bits = cv2.aruco.Dictionary.getBitsFromByteList(
                    dictionary.bytesList[entry : entry + 1], dictionary.markerSize
                )
                codes.append(f"{int(''.join(str(int(bit)) for bit in bits.flatten()), 2):x}")
            corrected = int(dictionary.maxCorrectionBits * 0.6)
            file.write(" ".join([name, str(dictionary.markerSize), str(corrected), *codes]) + "\n")


if __name__ == "__main__":
    dictionaries()
    small = charuco(5, 7, 0.04, 0.03, "DICT_4X4_50", False)
    picture("charuco_whole", small, (25, -20, 15), (0.0, 0.0, 0.42), 600, False, 1)
    picture("charuco_turned", small, (-30, 25, 200), (0.03, -0.01, 0.16), 230, True, 2)
    picture("charuco_cut", small, (20, 30, 95), (0.15, 0.1, 0.09), 230, True, 3)
    even = charuco(8, 6, 0.03, 0.022, "DICT_5X5_100", True)
    picture("charuco_old_pattern", even, (15, 30, -40), (0.0, 0.01, 0.28), 500, False, 4)
    grid = aprilgrid(6, 6, 0.04, 0.3)
    picture("aprilgrid_whole", grid, (25, 20, 10), (0.0, 0.0, 0.42), 500, False, 5)
    picture("aprilgrid_turned", grid, (-30, 15, 160), (0.02, 0.02, 0.16), 230, True, 6)
    large = aprilgrid(4, 3, 0.06, 0.25)
    picture("aprilgrid_cut", large, (15, 20, -80), (0.08, 0.06, 0.3), 500, False, 7)
