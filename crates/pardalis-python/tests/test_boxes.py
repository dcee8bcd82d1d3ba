"""Targets that another program detects."""

import numpy as np
import pytest

from pardalis import Camera, ColorModel, Shape, Target, Tracker, boxes_of_masks

CAMERA = Camera.pinhole((640, 480), [500, 500], [319.5, 239.5])
SIDE = CAMERA.looking(from_m=[2.0, 0.0, 2.0], at_m=[0.0, 0.0, 2.0], roll_rad=0.0)
RADIUS_M = 0.1


def box(camera, place_m):
    """Return the box around a ball, by the directions to points on it."""
    angles = np.linspace(0, np.pi, 60)
    around, up = np.meshgrid(2 * angles, angles)
    sphere = np.stack([np.cos(around) * np.sin(up), np.sin(around) * np.sin(up), np.cos(up)], axis=-1)
    pixels = camera.project(np.asarray(place_m) + RADIUS_M * sphere.reshape(-1, 3))
    return np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])


def place(number):
    return [-0.3 + 0.02 * number, 0.1, 2.0]


def test_boxes_are_tracked_without_images():
    tracker = Tracker({"cam": CAMERA}, {"ball": Target.of_boxes(Shape.ball(RADIUS_M))})
    for number in range(20):
        clutter = [20, 30, 60, 60]
        boxes = np.array([[*clutter, 0.3], [*box(CAMERA, place(number)), 0.9]])
        tracker.observe({}, number / 25, boxes={"cam": {"ball": boxes}})
    estimate = tracker.estimate("ball")
    assert estimate.state == "tracking" and estimate.confidence > 0.9
    np.testing.assert_allclose(estimate.position_m, place(19), atol=0.1)
    np.testing.assert_allclose(estimate.position_m[:2], place(19)[:2], atol=0.02)
    np.testing.assert_allclose(estimate.velocity_mps[0], 0.5, atol=0.1)
    # Nothing found, for a while.
    for number in range(20, 30):
        tracker.observe({}, number / 25, boxes={"cam": {"ball": []}})
    assert tracker.estimate("ball").state != "tracking"


def test_two_cameras_know_the_distance():
    target = Target.of_boxes(Shape.ball(RADIUS_M), size_tolerance=0.0)
    tracker = Tracker({"cam": CAMERA, "side": SIDE}, {"ball": target})
    for number in range(10):
        boxes = {name: {"ball": [box(camera, place(number))]} for name, camera in (("cam", CAMERA), ("side", SIDE))}
        tracker.observe({}, number / 25, boxes)
    estimate = tracker.estimate("ball")
    np.testing.assert_allclose(estimate.position_m, place(9), atol=0.02)
    assert np.sqrt(np.diag(estimate.covariance_m2)).max() < 0.02


def test_a_crowd_of_boxes():
    tracker = Tracker({"cam": CAMERA}, {"ball": Target.of_boxes(Shape.ball(RADIUS_M), max_count=5)})
    for number in range(10):
        both = [box(CAMERA, place(number)), box(CAMERA, [0.5, -0.2, 3.0])]
        tracker.observe({}, number / 25, {"cam": {"ball": both}})
    xs = sorted(member.position_m[0] for member in tracker.members("ball"))
    np.testing.assert_allclose(xs, [place(9)[0], 0.5], atol=0.05)


def test_boxes_beside_a_target_in_the_images():
    image = np.full((480, 640, 3), 90, np.uint8)
    v, u = np.mgrid[:480, :640]
    mask = np.hypot(u - 400, v - 240) < 25
    image[mask] = [230, 110, 20]
    targets = {"seen": Target(Shape.ball(RADIUS_M), ColorModel.learn([image], [mask]))}
    targets["told"] = Target.of_boxes(Shape.ball(RADIUS_M))
    tracker = Tracker({"cam": CAMERA}, targets)
    for number in range(6):
        tracker.observe({"cam": image}, number / 25, {"cam": {"told": [[100, 100, 150, 150]]}})
    assert [tracker.estimate(name).state for name in ("seen", "told")] == ["tracking"] * 2
    np.testing.assert_allclose(CAMERA.project([tracker.estimate("told").position_m]), [[125, 125]], atol=3)
    with pytest.raises(ValueError, match='"seen" is found in the images; pass boxes of targets of Target.of_boxes or with_boxes'):
        tracker.observe({"cam": image}, 1.0, {"cam": {"seen": []}})


def test_boxes_tell_which_of_two_balls_is_meant():
    v, u = np.mgrid[:480, :640]

    def image(*middles):
        image = np.full((480, 640, 3), 90, np.uint8)
        mask = np.zeros(u.shape, bool)
        for middle in middles:
            mask |= np.hypot(u - middle[0], v - middle[1]) < 25
        image[mask] = [230, 110, 20]
        return image, mask

    first, mask = image((400, 240))
    colors = Target(Shape.ball(RADIUS_M), ColorModel.learn([first], [mask]))
    with pytest.raises(ValueError, match="side_sigma is 0; allowed"):
        colors.with_boxes(side_sigma=0)
    with pytest.raises(ValueError, match="for a single target with colours"):
        Target.of_boxes(Shape.ball(RADIUS_M)).with_boxes()
    both = image((400, 240), (150, 200))[0]
    for target, states in [(colors, {"searching"}), (colors.with_boxes(detection_probability=0.8), {"tracking"})]:
        tracker = Tracker({"cam": CAMERA}, {"ball": target})
        for number in range(6):
            # Off by three pixels to the right.
            boxes = {"cam": {"ball": [[128, 175, 178, 225]]}} if "tracking" in states else None
            tracker.observe({"cam": both}, number / 25, boxes)
        estimate = tracker.estimate("ball")
        assert {estimate.state} == states
    np.testing.assert_allclose(CAMERA.project([estimate.position_m]), [[150, 200]], atol=0.5)


def test_errors_say_which_box():
    tracker = Tracker({"cam": CAMERA}, {"ball": Target.of_boxes(Shape.ball(RADIUS_M))})
    for boxes, message in [
        ([[10, 10, 5, 20]], r'boxes\["cam"\]\["ball"\]\[0\]: box is \[10.0, 10.0, 5.0, 20.0\]'),
        ([[1, 2, 3, 4], [1, 2, float("nan"), 4]], r'\["ball"\]\[1\]: box is'),
        ([[1, 2, 3, 4, 1.5]], "score is 1.5; allowed: 0 to 1"),
        ([[1, 2, 3]], "has 3 columns; allowed: 4, or 5 with scores"),
        (["cup"], "is no array of N x 4 numbers"),
    ]:
        with pytest.raises(ValueError, match=message):
            tracker.observe({}, 0.0, {"cam": {"ball": boxes}})
    with pytest.raises(ValueError, match='there is no camera "left"; allowed: cam'):
        tracker.observe({}, 0.0, {"left": {"ball": []}})
    with pytest.raises(TypeError, match=r'boxes\["cam"\] is no dictionary of targets'):
        tracker.observe({}, 0.0, {"cam": [[1, 2, 3, 4]]})
    with pytest.raises(ValueError, match="side_sigma is 0; allowed"):
        Target.of_boxes(Shape.ball(RADIUS_M), side_sigma=0.0)
    assert tracker.time_s is None


def test_masks_have_boxes():
    masks = np.zeros((3, 48, 64), bool)
    rows, columns = np.mgrid[:48, :64]
    masks[0] = (rows - 20) ** 2 + (columns - 30) ** 2 <= 100
    masks[2, 47, 63] = True
    assert boxes_of_masks(masks).tolist() == [[19.5, 9.5, 40.5, 30.5], [62.5, 46.5, 63.5, 47.5]]
    assert boxes_of_masks(masks[1:2]).shape == (0, 4)
    for wrong in (masks[0], masks.astype(float)):
        with pytest.raises(ValueError, match="needed: N x height x width booleans"):
            boxes_of_masks(wrong)
