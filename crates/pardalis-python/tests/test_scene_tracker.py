"""Trackers of scenes for images from elsewhere, and of cameras on platforms."""

import csv

import numpy as np
import pytest
from pictures import DATA
from PIL import Image

import pardalis
from pardalis import Tracker

ROBOT = DATA / "dioptric-moving-robot"


def image_of(folder, number):
    return pardalis.read_image(folder / "frames" / f"{number:06}.jpg")


def odometry(count):
    """The increments of the robot's odometry: 4 x 4 matrices with their times."""
    with open(ROBOT / "odometry.csv", newline="") as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    before_s = 0.0
    for row in rows[:count]:
        turn = row["dtheta_rad"]
        matrix = np.eye(4)
        matrix[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
        matrix[:2, 3] = row["dx_m"], row["dy_m"]
        yield matrix, before_s, row["time_s"]
        before_s = row["time_s"]


def test_a_scene_on_a_robot_gives_the_tracks_of_the_program(tmp_path):
    tracks = pardalis.track(ROBOT / "scene.toml", tmp_path, frames=30, plots=False)
    tracker = Tracker.of_scene(ROBOT / "scene.toml")
    assert tracker.cameras == ["cam1"] and tracker.targets == ["ball"] and tracker.platforms == ["robot"]
    for increment in odometry(40):
        assert tracker.observe_increment("robot", *increment) == "used"
    estimates = []
    for number in range(30):
        tracker.observe({"cam1": image_of(ROBOT, number)}, number / 25)
        estimates.append(tracker.estimate("ball"))
    assert [estimate.state for estimate in estimates] == tracks.columns["state"].tolist()
    positions_m = np.array([estimate.position_m for estimate in estimates])
    # tracks.csv has six digits.
    np.testing.assert_allclose(positions_m, tracks.positions_m("ball"), atol=6e-7)


def test_images_are_read_as_by_the_program(tmp_path):
    file = ROBOT / "frames" / "000000.jpg"
    image = pardalis.read_image(file)
    assert image.shape == (480, 640, 3) and image.dtype == np.uint8
    # Another decoder of JPEG differs a little.
    other = np.asarray(Image.open(file)).astype(int)
    assert 0 < np.abs(image - other).mean() < 1
    Image.fromarray(image).save(tmp_path / "image.png")
    np.testing.assert_array_equal(pardalis.read_image(tmp_path / "image.png"), image)
    with pytest.raises(FileNotFoundError, match="nowhere.png"):
        pardalis.read_image(tmp_path / "nowhere.png")
    (tmp_path / "cut.jpg").write_bytes(file.read_bytes()[:3000])
    with pytest.raises(ValueError, match="cut.jpg: the file ends before"):
        pardalis.read_image(tmp_path / "cut.jpg")


def test_a_dictionary_needs_no_inputs(tmp_path):
    scene = {
        "platforms": {"robot": {}},
        "cameras": {"cam1": {"platform": "robot", "calibration": ROBOT / "camera.json"}},
        "targets": {
            "ball": {
                "shape": {"sphere": {"radius_m": 0.11}},
                "colors": DATA / "colors" / "orange-ball.hsi.colors.toml",
            }
        },
    }
    image = image_of(ROBOT, 0)
    positions_m = []
    for described, seed in [(scene, None), (scene, 1), (ROBOT / "scene.toml", None), (scene, 2)]:
        tracker = Tracker.of_scene(described, seed=seed)
        assert tracker.observe_pose("robot", np.eye(4), 0.0) == "used"
        tracker.observe({"cam1": image}, 0.0)
        positions_m.append(tracker.estimate("ball").position_m)
    np.testing.assert_array_equal(positions_m[0], positions_m[1])
    np.testing.assert_array_equal(positions_m[0], positions_m[2])
    assert (positions_m[0] != positions_m[3]).any()


def test_poses_move_what_a_camera_sees():
    rig = {"cam1": pardalis.Camera.read(ROBOT / "camera.json")}
    colors = pardalis.ColorModel.read(DATA / "colors" / "orange-ball.hsi.colors.toml")
    targets = {"ball": pardalis.Target(pardalis.Shape.ball(0.11), colors)}
    there = np.eye(4)
    there[:3, 3] = 1, -2, 0.5
    positions_m = []
    for world_from_robot in [np.eye(4), there]:
        tracker = Tracker(rig, targets, platforms={"cam1": "robot"})
        # That of this image; a later pose would say how the robot moves meanwhile.
        tracker.observe_pose("robot", world_from_robot, 0.0, np.diag([1e-4] * 3 + [1e-6] * 3))
        assert tracker.observe_pose("robot", world_from_robot, 0.0) == "late"
        tracker.observe({"cam1": image_of(ROBOT, 0)}, 0.0)
        estimate = tracker.estimate("ball")
        positions_m.append(estimate.position_m)
        # The error of the pose is part of that of the ball.
        assert estimate.covariance_m2[2, 2] > 1e-4
    np.testing.assert_allclose(positions_m[1] - positions_m[0], [1, -2, 0.5], atol=1e-6)
    assert tracker.observe_pose("robot", there, 0.04) == "used"
    with pytest.warns(UserWarning, match='images of 1 s were not used: the pose of the platform "robot" is unknown'):
        tracker.observe({"cam1": image_of(ROBOT, 1)}, 1.0)
    far = there + np.array([[0, 0, 0, 100.0]] + [[0] * 4] * 3)
    assert tracker.observe_pose("robot", far, 0.08) == "jump"


def test_sizes_are_asked_for_only_where_nothing_states_them():
    camera = {
        "world_from_camera": np.eye(4),
        "model": {"pinhole": {"f_px": [160, 160], "center_px": [79.5, 59.5]}},
    }
    scene = {
        "cameras": {"cam1": camera},
        "targets": {"ball": {"shape": {"sphere": {"radius_m": 0.1}}, "detector": {}}},
    }
    with pytest.raises(ValueError, match=r"cameras\.cam1\.size_px: is missing; give the width and height"):
        Tracker.of_scene(scene)
    with pytest.raises(ValueError, match='size_px: there is no camera "cam2"; allowed: cam1'):
        Tracker.of_scene(scene, size_px={"cam2": (160, 120)})
    tracker = Tracker.of_scene(scene, size_px={"cam1": (160, 120)})
    for number in range(3):
        tracker.observe({}, number / 25, boxes={"cam1": {"ball": [[70, 50, 90, 70, 0.9]]}})
    assert tracker.estimate("ball").state == "tracking"
    camera["size_px"] = [160, 120]
    assert Tracker.of_scene(scene).cameras == ["cam1"]


def test_problems_of_scenes_are_named_all_at_once(tmp_path):
    scene = {
        "cameras": {"cam1": {"world_from_camera": np.eye(4), "model": {"pinhole": {"f_px": [160, 160], "center_px": [80, 60]}}}},
        "targets": {"ball": {"shape": {"sphere": {"radius_m": -1}}, "colors": "missing.toml"}},
        "sed": 1,
    }
    with pytest.raises(ValueError) as caught:
        Tracker.of_scene(scene)
    for part in ["targets.ball.shape.sphere.radius_m: is -1", "sed: is not a key"]:
        assert part in str(caught.value), caught.value
    del scene["sed"]
    scene["targets"]["ball"]["shape"]["sphere"]["radius_m"] = 0.1
    with pytest.raises(ValueError, match="missing.toml: cannot be read: there is no such file; `pardalis learn` writes such files"):
        Tracker.of_scene(scene, size_px={"cam1": (160, 120)})
    # As of any missing file, and with the words of the program.
    with pytest.raises(FileNotFoundError, match="nowhere.toml: cannot be read: there is no such file"):
        Tracker.of_scene(tmp_path / "nowhere.toml")
    text = (ROBOT / "scene.toml").read_text().replace("radius_m = 0.11", "radius_m = 0")
    (tmp_path / "scene.toml").write_text(text)
    with pytest.raises(ValueError, match=r"scene.toml: \d problems in the scene:(\n|.)*line 16: targets.ball"):
        Tracker.of_scene(tmp_path / "scene.toml")


def test_warnings_of_scenes_are_those_of_python():
    camera = {
        "world_from_camera": np.eye(4),
        "size_px": [160, 120],
        "model": {"pinhole": {"f_px": [160, 160], "center_px": [79.5, 59.5]}},
    }
    scene = {
        "cameras": {"cam1": camera, "cam2": camera},
        "targets": {"ball": {"shape": {"sphere": {"radius_m": 0.1}}, "detector": {}}},
    }
    with pytest.warns(UserWarning, match=r"cameras\.cam2: has the same pose as cam1"):
        Tracker.of_scene(scene)


def test_platforms_are_named_in_errors():
    rig = {"cam1": pardalis.Camera.read(ROBOT / "camera.json")}
    targets = {"ball": pardalis.Target.of_boxes(pardalis.Shape.ball(0.11))}
    with pytest.raises(ValueError, match='there is no camera "cam2"; allowed: cam1'):
        Tracker(rig, targets, platforms={"cam2": "robot"})
    with pytest.raises(ValueError, match="the tracker has no platforms; give platforms="):
        Tracker(rig, targets).observe_pose("robot", np.eye(4), 0)
    tracker = Tracker(rig, targets, platforms={"cam1": "robot"})
    with pytest.raises(ValueError, match='there is no platform "rover"; allowed: robot'):
        tracker.observe_pose("rover", np.eye(4), 0)
    with pytest.raises(ValueError, match="the covariance"):
        tracker.observe_pose("robot", np.eye(4), 0, -np.eye(6))
    with pytest.raises(ValueError, match="time"):
        tracker.observe_pose("robot", np.eye(4), float("nan"))
