"""The tracker, on drawn images and on bundled rendered ones."""

import csv

import numpy as np
import pytest
from pictures import DATA, discs
from PIL import Image

from pardalis import Camera, ColorModel, Shape, Target, Tracker

SIZE_PX = (320, 240)
CAMERA = Camera.pinhole(SIZE_PX, [300, 300], [159.5, 119.5])
RADIUS_M = 0.1


def picture(*places_m):
    """Draw balls at these places in the camera's frame."""
    pixels = CAMERA.project(places_m)
    # The outline of a small ball is a disc, nearly.
    radii_px = [300 * RADIUS_M / place_m[2] for place_m in places_m]
    return discs(SIZE_PX, list(zip(pixels, radii_px)))


COLORS = ColorModel.learn(*[[part] for part in picture([0, 0, 2])])


def tracker_of(**settings):
    return Tracker({"cam": CAMERA}, {"ball": Target(Shape.ball(RADIUS_M), COLORS, **settings)})


def track(seed=1):
    tracker = Tracker({"cam": CAMERA}, {"ball": Target(Shape.ball(RADIUS_M), COLORS)}, seed=seed)
    estimates = []
    for number in range(20):
        image, _ = picture([-0.3 + 0.02 * number, 0.1, 2])
        tracker.observe({"cam": image}, number / 25)
        estimates.append(tracker.estimate("ball"))
    return tracker, estimates


def test_a_ball_is_found_and_tracked():
    tracker, estimates = track()
    last = estimates[-1]
    assert [estimate.state for estimate in estimates[2:]] == ["tracking"] * 18
    np.testing.assert_allclose(last.position_m, [0.08, 0.1, 2], atol=0.05)
    np.testing.assert_allclose(last.position_m[:2], [0.08, 0.1], atol=0.005)
    np.testing.assert_allclose(last.velocity_mps[:2], [0.5, 0], atol=0.1)
    covariance = last.covariance_m2
    assert (covariance == covariance.T).all() and (np.linalg.eigvalsh(covariance) > 0).all()
    of_velocity = last.velocity_covariance_m2ps2
    assert (of_velocity == of_velocity.T).all() and (np.linalg.eigvalsh(of_velocity) > 0).all()
    # Along the line of sight of a single camera, distances and their changes are the least certain.
    assert of_velocity[2, 2] > of_velocity[0, 0]
    assert last.confidence > 0.9 and last.time_s == tracker.time_s == 19 / 25
    later = tracker.estimate("ball", 1.0)
    assert later.time_s == 1.0
    np.testing.assert_allclose(later.position_m[0], 0.08 + 0.24 * last.velocity_mps[0], atol=0.01)
    assert later.covariance_m2[0, 0] > covariance[0, 0]
    assert later.velocity_covariance_m2ps2[0, 0] > of_velocity[0, 0]


def test_the_same_seed_gives_the_same_numbers():
    positions = [[estimate.position_m for estimate in track(seed)[1][2:]] for seed in (1, 1, 2)]
    np.testing.assert_array_equal(positions[0], positions[1])
    assert (np.array(positions[0]) != np.array(positions[2])).any()


def test_images_may_be_views_of_other_arrays():
    image, _ = picture([0, 0, 2])
    wide = np.zeros((240, 640, 4), np.uint8)
    wide[:, ::2, 2::-1] = image
    bgr = image[..., ::-1].copy()
    positions = []
    for seen in [image, wide[:, ::2, 2::-1], bgr[..., ::-1], np.asfortranarray(image)]:
        tracker = tracker_of()
        tracker.observe({"cam": seen}, 0)
        positions.append(tracker.estimate("ball").position_m)
    assert np.linalg.norm(positions[0] - [0, 0, 2]) < 0.1
    for position in positions[1:]:
        np.testing.assert_array_equal(position, positions[0])


def test_an_array_may_be_written_once_it_is_observed():
    trackers = [tracker_of(), tracker_of()]
    shared = np.zeros((*SIZE_PX[::-1], 3), np.uint8)
    for number in range(20):
        image, _ = picture([0, 0, 2 - 0.01 * number])
        shared[:] = image
        trackers[0].observe({"cam": image}, number / 25)
        trackers[1].observe({"cam": shared}, number / 25)
        shared[:] = 255
    np.testing.assert_array_equal(*[tracker.estimate("ball").position_m for tracker in trackers])


def test_a_hidden_ball_has_no_position_after_a_while():
    tracker, _ = track()
    empty, _ = discs(SIZE_PX, [])
    for number in range(20, 120):
        tracker.observe({"cam": empty}, number / 25)
    estimate = tracker.estimate("ball")
    assert estimate.state == "lost"
    assert estimate.position_m is estimate.velocity_mps is estimate.covariance_m2 is estimate.velocity_covariance_m2ps2 is None


def test_a_crowd_has_members_with_numbers():
    tracker = tracker_of(max_count=5)
    for number in range(12):
        image, _ = picture([-0.4, 0, 2], [0.4, 0.1, 2.2])
        tracker.observe({"cam": image}, number / 25)
    members = tracker.members("ball")
    assert {member.number for member in members} == {1, 2}
    places_m = sorted(member.position_m.tolist() for member in members)
    np.testing.assert_allclose(np.array(places_m)[:, 0], [-0.4, 0.4], atol=0.02)


def test_two_rendered_webcams_agree_with_the_truth():
    cameras = Camera.read_all(DATA / "webcams-two/cameras.json")
    colors = ColorModel.read(DATA / "colors/pink-ball.hsi.colors.toml")
    tracker = Tracker(cameras, {"ball": Target(Shape.ball(0.035), colors)})
    with open(DATA / "webcams-two/truth.csv") as file:
        rows = [row for row in csv.DictReader(file) if row["object"] == "ball" and row["camera"] == "cam1"]
    errors_m = []
    for number, row in enumerate(rows[:60]):
        images = {
            name: np.asarray(Image.open(DATA / f"webcams-two/frames/{name}/{number:06}.jpg"))
            for name in cameras
        }
        tracker.observe(images, number / 25)
        estimate = tracker.estimate("ball")
        if number >= 5:
            assert estimate.state == "tracking"
            truth_m = [float(row[axis]) for axis in ("x_m", "y_m", "z_m")]
            errors_m.append(np.linalg.norm(estimate.position_m - truth_m))
    # As the program does (experiments/edge): 0.4 mm.
    assert np.sqrt(np.mean(np.square(errors_m))) < 0.001
    assert abs(estimate.radius_m - 0.035) < 3 * estimate.radius_sigma_m


def test_colours_are_written_and_read_again(tmp_path):
    file = tmp_path / "ball.colors.toml"
    COLORS.write(file)
    assert ColorModel.read(file) == COLORS
    assert COLORS.image_count == 1 and COLORS.pixel_count > 500
    file.write_text("format = 1")
    with pytest.raises(ValueError, match="ball.colors.toml: "):
        ColorModel.read(file)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda t: t.observe({"left": picture([0, 0, 2])[0]}, 0), 'there is no camera "left"; allowed: cam'),
        (lambda t: t.observe({"cam": np.zeros((240, 320))}, 0), 'image of "cam" is no array of height x width x 3'),
        (lambda t: t.observe({"cam": np.zeros((240, 320, 3))}, 0), "bytes"),
        (lambda t: t.observe({"cam": np.zeros((240, 320, 4), np.uint8)}, 0), "4 channels; allowed: 3"),
        (lambda t: t.observe({"cam": np.zeros((120, 160, 3), np.uint8)}, 0), "160 x 120 pixels, but 320 x 240"),
        (lambda t: t.observe({}, float("nan")), "time_s is NaN"),
        (lambda t: (t.observe({}, 2), t.observe({}, 1)), "time_s"),
        (lambda t: (t.observe({}, 2), t.observe({}, 2)), "images of 2 s were observed before"),
        (lambda t: (t.observe({}, 2), t.estimate("ball", 1.0)), "time_s is 1; allowed: 2, that of the latest images"),
        (lambda t: t.members("ball"), '"ball" is a single target; give it max_count'),
        (lambda t: t.estimate("cup"), 'there is no target "cup"; allowed: ball'),
        (lambda t: tracker_of(max_count=0), "max_count is out of range"),
        (lambda t: tracker_of(radius_tolerance=2), "radius_tolerance is out of range"),
        (lambda t: tracker_of(min_particle_count=501), "min_particles is 501; allowed: 1 to 500"),
        (lambda t: tracker_of(radius_tolerance=None), "one camera does not tell size from distance"),
        (lambda t: Tracker({}, {}), "the list of cameras is empty"),
        (lambda t: Shape.ball(-1), "radius_m is -1"),
        (lambda t: ColorModel.learn([], []), "label at least one pixel"),
        (lambda t: ColorModel.learn([picture([0, 0, 2])[0]], []), "1 images and 0 masks"),
        (
            lambda t: ColorModel.learn([picture([0, 0, 2])[0]], [np.zeros((240, 320), np.uint8)]),
            r"masks\[0\] is no array of height x width booleans; of other numbers: mask > 0",
        ),
        (
            lambda t: ColorModel.learn([picture([0, 0, 2])[0]], [np.ones((10, 10), bool)]),
            r"masks\[0\] has the shape \(10, 10\), and its image \(240, 320\)",
        ),
    ],
)
def test_mistakes_are_explained(call, words):
    with pytest.raises(ValueError, match=words):
        call(tracker_of())


def test_what_is_of_another_class_is_named():
    with pytest.raises(TypeError, match=r'targets\["ball"\] is no Target'):
        Tracker({"cam": CAMERA}, {"ball": Shape.ball(0.1)})
    with pytest.raises(TypeError, match=r'cameras\["cam"\] is no Camera'):
        Tracker({"cam": None}, {"ball": Target(Shape.ball(0.1), COLORS)})


def test_other_sensors_are_taken_into_account():
    from_m = [0.0, 0.0, 0.0]
    ranges = {}
    for sigma in (None, 0.002):
        tracker = tracker_of()
        for number in range(20):
            image, _ = picture([0, 0, 2])
            if sigma and number > 5:
                # It says that the ball is 2 cm farther away than the image does.
                observed = tracker.observe_measurement(
                    "ball", number / 25, range_m=2.02, from_m=from_m, sigma=sigma
                )
                assert observed == "waiting"
            tracker.observe({"cam": image}, number / 25)
        ranges[sigma] = np.linalg.norm(np.subtract(tracker.estimate("ball").position_m, from_m))
    assert ranges[None] < ranges[0.002] < 2.03
    counts = tracker.measurement_counts("ball")
    assert counts == {"used": 14, "rejected": 0, "without_target": 0, "late": 0}
    place = {"position_m": [5, None, 2], "covariance": [[0.01, np.nan, 0], [np.nan, np.nan, 0], [0, 0, 0.01]]}
    assert tracker.observe_measurement("ball", 0.5, **place) == "late"
    assert tracker.observe_measurement("ball", 0.8, **place) == "waiting"
    tracker.observe({}, 0.8)
    counts = tracker.measurement_counts("ball")
    assert (counts["rejected"], counts["late"]) == (1, 1)


@pytest.mark.parametrize(
    ("measured", "message"),
    [
        ({}, "give one of position_m, velocity_mps, range_m and direction"),
        ({"range_m": 1, "direction": [1, 0, 0]}, "give one of position_m"),
        ({"range_m": 1, "sigma": 0.1}, "give from_m and sigma"),
        ({"range_m": -1, "sigma": 0.1, "from_m": [0, 0, 0]}, "range_m is -1"),
        ({"direction": [0, 0, 0], "sigma": 0.1, "from_m": [0, 0, 0]}, "direction is"),
        ({"position_m": [1, 2, 3]}, "give sigma or covariance"),
        ({"position_m": [None, None, None], "sigma": 0.1}, "position_m is empty"),
        ({"velocity_mps": [1, 2, 3], "sigma": 0}, "the covariance is"),
        ({"position_m": [1, 2, 3], "covariance": [[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]}, "is not symmetric"),
    ],
)
def test_bad_measurements_are_refused(measured, message):
    with pytest.raises(ValueError, match=message):
        tracker_of().observe_measurement("ball", 0.0, **measured)
