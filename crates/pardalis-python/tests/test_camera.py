"""Cameras: points to pixels, pixels to rays, calibration files."""

import numpy as np
import pytest
from pictures import DATA

from pardalis import Camera

PINHOLE = Camera.pinhole((320, 240), [300, 310], [159.5, 119.5], [-0.1, 0.02, 0, 0])
FISHEYE = Camera.fisheye((640, 480), [200, 200], [319.5, 239.5], [0.01, -0.002, 0, 0], 1.6)
EQUIDISTANT = Camera.equidistant((640, 480), 145, [319.5, 239.5], np.radians(92.5))


def test_a_point_has_the_pixel_of_the_model():
    camera = Camera.pinhole((320, 240), [300, 310], [159.5, 119.5])
    pixels = camera.project([[0.0, 0.0, 1.0], [0.2, -0.1, 2.0], [0.1, 0.1, -1.0]])
    np.testing.assert_allclose(pixels[:2], [[159.5, 119.5], [159.5 + 30, 119.5 - 15.5]], atol=1e-9)
    assert np.isnan(pixels[2]).all()


@pytest.mark.parametrize("camera", [PINHOLE, FISHEYE, EQUIDISTANT], ids=lambda camera: camera.model)
def test_a_point_lies_on_the_ray_of_its_pixel(camera):
    camera = camera.looking([1, -2, 1.5], [0, 0, 0.2])
    random = np.random.default_rng(1)
    points = random.uniform(-0.5, 0.5, (50, 3))
    pixels = camera.project(points)
    assert np.isfinite(pixels).all()
    origins, directions = camera.rays(pixels)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-12)
    np.testing.assert_allclose(origins, np.tile([1, -2, 1.5], (50, 1)), atol=1e-12)
    off = np.cross(points - origins, directions)
    assert np.abs(off).max() < 1e-6


def test_points_may_be_in_any_array():
    camera = FISHEYE.looking([1, -2, 1.5], [0, 0, 0.2])
    points = np.random.default_rng(2).uniform(-0.5, 0.5, (40, 3))
    pixels = camera.project(points)
    assert pixels.flags.c_contiguous and pixels.flags.writeable and pixels.shape == (40, 2)
    # Views, other orders in memory, read-only arrays and lists.
    for same in [np.repeat(points, 2, axis=0)[::2], np.asfortranarray(points), points[:, ::-1].copy()[:, ::-1], points.tolist()]:
        np.testing.assert_array_equal(camera.project(same), pixels)
    points.flags.writeable = False
    np.testing.assert_array_equal(camera.project(points), pixels)
    single = points.astype(np.float32)
    np.testing.assert_array_equal(camera.project(single), camera.project(single.astype(float)))
    assert camera.project(np.empty((0, 3))).shape == (0, 2)
    assert [array.shape for array in camera.rays(np.empty((0, 2)))] == [(0, 3), (0, 3)]


def test_the_pose_maps_the_cameras_frame_to_the_world():
    camera = PINHOLE.looking([0, -2, 1], [0, 0, 1])
    pose = camera.world_from_camera
    np.testing.assert_allclose(pose @ [0, 0, 2, 1], [0, 0, 1, 1], atol=1e-12)
    np.testing.assert_allclose(PINHOLE.at(pose).world_from_camera, pose, atol=1e-12)
    np.testing.assert_allclose(camera.project([[0, 0, 1]]), [[159.5, 119.5]], atol=1e-9)


def test_calibration_files_are_read():
    cameras = Camera.read_all(DATA / "webcams-two/cameras.json")
    assert list(cameras) == ["cam1", "cam2"]
    assert [camera.size_px for camera in cameras.values()] == [(320, 240), (240, 320)]
    assert {camera.model for camera in cameras.values()} == {"pinhole"}
    assert cameras["cam1"].parameters["fx_px"] > 100
    with pytest.raises(ValueError, match=r"cameras.json: has 2 cameras \(cam1, cam2\); use read_all"):
        Camera.read(DATA / "webcams-two/cameras.json")
    with pytest.raises(ValueError, match=r"says that images are \(640, 480\), and size_px is \(320, 240\)"):
        Camera.read(DATA / "dioptric-jump/camera.json", [320, 240])
    with pytest.raises(FileNotFoundError, match="missing.yaml"):
        Camera.read("missing.yaml")


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: Camera.pinhole((320, 240), [0, 300], [160, 120]), "fx_px is 0; allowed: a positive number"),
        (lambda: Camera.pinhole((0, 240), [300, 300], [160, 120]), "the image is 0 x 240 pixels"),
        (lambda: Camera.pinhole((320, 240), [300, 300], [160, 120], [1, 2]), "distortion is 2 numbers"),
        (lambda: PINHOLE.project([[1, 2]]), "points_m has 2 columns; allowed: 3"),
        (lambda: PINHOLE.project([1, 2, 3]), "points_m is no array of N x 3 numbers"),
        (lambda: PINHOLE.at(np.eye(3)), "the pose matrix has 3 columns; allowed: 4"),
        (lambda: PINHOLE.at(2 * np.eye(4)), "allowed: 0, 0, 0, 1"),
        (lambda: PINHOLE.looking([0, 0, 0], [0, 0, 0]), "determine no direction"),
        (lambda: PINHOLE.looking([np.nan, 0, 0], [0, 0, 0]), "determine no direction"),
        (lambda: PINHOLE.masked(np.ones((320, 240), bool)), "the mask is 240 x 320 pixels, but 320 x 240"),
        (lambda: PINHOLE.masked(np.zeros((240, 320), bool)), "the mask is empty"),
    ],
)
def test_mistakes_are_explained(call, words):
    with pytest.raises(ValueError, match=words):
        call()
