"""What is logged into a file of Rerun is read back with Rerun's reader."""

import importlib
import io
import sys
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from PIL import Image
from pictures import DATA, discs
from rerun.chunk import RrdReader

import pardalis
import pardalis.rerun
from pardalis import Camera, ColorModel, Shape, Target, Tracker, Tracks

SIZE_PX = (320, 240)
CAMERA = Camera.pinhole(SIZE_PX, [300, 310], [159.5, 119.5]).looking(from_m=[0, -2, 1], at_m=[0, 0, 0.5])
RADIUS_M = 0.1


@pytest.fixture
def log(tmp_path):
    """A recording, and a function that ends it and returns the rows of each entity: (time, values by component) in the order of time."""
    file = tmp_path / "log.rrd"
    recording = rr.RecordingStream("test")
    recording.save(file)

    def read():
        recording.flush()
        recording.disconnect()
        rows = {}
        for chunk in RrdReader(file).stream().to_chunks():
            table = chunk.to_record_batch().to_pydict()
            times_s = [time.total_seconds() for time in table["time"]] if "time" in table else [None]
            values = {name: column for name, column in table.items() if ":" in name}
            for number, time_s in enumerate(times_s):
                row = {name: column[number] for name, column in values.items() if column[number] is not None}
                rows.setdefault(chunk.entity_path, []).append((time_s, row))
        return {path: sorted(found, key=lambda row: -1 if row[0] is None else row[0]) for path, found in rows.items()}

    return recording, read


def column(rows, name):
    return np.array([row[name][0] for _, row in rows if name in row])


def test_a_pinhole_camera_has_its_pose_and_its_lens(log):
    recording, read = log
    pardalis.rerun.log_camera("cam1", CAMERA, recording=recording)
    rows = read()
    [(time_s, pose)] = rows["/world/cameras/cam1"]
    assert time_s is None
    np.testing.assert_allclose(pose["Transform3D:translation"][0], [0, -2, 1], atol=1e-6)
    # Rerun's matrices are stored column by column.
    rotation = np.reshape(pose["Transform3D:mat3x3"][0], (3, 3)).T
    np.testing.assert_allclose(rotation, CAMERA.world_from_camera[:3, :3], atol=1e-6)
    [(_, lens)] = rows["/world/cameras/cam1/image"]
    matrix = np.reshape(lens["Pinhole:image_from_camera"][0], (3, 3)).T
    # Rerun's pixels begin at their corner.
    np.testing.assert_allclose(matrix, [[300, 0, 160], [0, 310, 120], [0, 0, 1]])
    np.testing.assert_allclose(lens["Pinhole:resolution"][0], SIZE_PX)


def test_a_fisheye_shows_how_far_it_sees(log):
    recording, read = log
    camera = Camera.read(DATA / "dioptric-jump/camera.json")
    pardalis.rerun.log_camera("cam1", camera, recording=recording)
    rows = read()
    assert "/world/cameras/cam1/image" not in rows
    [(_, view)] = rows["/world/cameras/cam1/view"]
    *rays, ring = (np.array(line) for line in view["LineStrips3D:strips"])
    np.testing.assert_allclose([ray[0] for ray in rays], np.zeros((len(rays), 3)), atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(ring, axis=1), 0.3, atol=1e-6)
    # From the axis: 92.5 degrees, less the step in which the border is searched for.
    angles_deg = np.degrees(np.arccos(ring[:, 2] / 0.3))
    assert len(ring) == 33 and (angles_deg > 91).all() and (angles_deg <= 92.5).all()


def test_names_may_have_any_characters(log):
    recording, read = log
    pardalis.rerun.log_camera("left/upper cam", CAMERA, recording=recording)
    assert r"/world/cameras/left\/upper\ cam/image" in read()


def test_images_are_logged_at_their_times(log):
    recording, read = log
    image, _ = discs(SIZE_PX, [((100, 80), 30)])
    pardalis.rerun.log_images({"cam1": image}, 0.5, recording=recording)
    pardalis.rerun.log_images({"cam1": image}, 1.25, jpeg_quality=None, recording=recording)
    (first_s, first), (second_s, second) = read()["/world/cameras/cam1/image"]
    assert (first_s, second_s) == (0.5, 1.25)
    decoded = np.asarray(Image.open(io.BytesIO(bytes(first["EncodedImage:blob"][0]))), float)
    assert np.abs(decoded - image).mean() < 4
    np.testing.assert_array_equal(second["Image:buffer"][0], image.ravel())


def test_estimates_are_logged_as_they_are(log):
    recording, read = log
    image, mask = discs(SIZE_PX, [(CAMERA.project([[0, 0, 0.5]])[0], 14)])
    tracker = Tracker({"cam1": CAMERA}, {"ball": Target(Shape.ball(RADIUS_M), ColorModel.learn([image], [mask]))})
    estimates, way_m = [], []
    for number in range(60):
        seen, _ = discs(SIZE_PX, [(CAMERA.project([[0.02 * number - 0.1, 0, 0.5]])[0], 14)] * (number < 12))
        tracker.observe({"cam1": seen}, number / 25)
        estimates.append(tracker.estimate("ball"))
        if estimates[-1].position_m is not None:
            way_m.append(estimates[-1].position_m)
        pardalis.rerun.log_estimate("ball", estimates[-1], radius_m=RADIUS_M, trail_m=way_m, recording=recording)
    known = [estimate for estimate in estimates if estimate.position_m is not None]
    assert len(known) > 10 and estimates[-1].position_m is None
    rows = read()
    ball = "/world/targets/ball"

    def assert_is_logged(path, name, expected):
        np.testing.assert_allclose(column(rows[path], name), expected, rtol=1e-5, atol=1e-6)

    times_s = [time_s for time_s, row in rows[f"{ball}/position"] if "Points3D:positions" in row]
    np.testing.assert_allclose(times_s, [estimate.time_s for estimate in known], atol=1e-9)
    positions_m = [estimate.position_m for estimate in known]
    assert_is_logged(f"{ball}/position", "Points3D:positions", positions_m)
    assert_is_logged(f"{ball}/velocity", "Arrows3D:origins", positions_m)
    assert_is_logged(f"{ball}/velocity", "Arrows3D:vectors", [estimate.velocity_mps for estimate in known])
    assert_is_logged(f"{ball}/ball", "Ellipsoids3D:half_sizes", np.full((len(known), 3), RADIUS_M))
    assert_is_logged("/targets/ball/confidence", "Scalars:scalars", [estimate.confidence for estimate in estimates])
    states = [row["TextLog:text"][0] for _, row in rows["/targets/ball/state"]]
    assert states == [estimate.state for estimate in estimates]
    trail = [row["LineStrips3D:strips"][0] for _, row in rows[f"{ball}/trail"] if "LineStrips3D:strips" in row]
    np.testing.assert_allclose(trail[-1], way_m, rtol=1e-5, atol=1e-6)
    # Nothing is left where the ball is lost.
    cleared_s = [time_s for time_s, row in rows[ball] if row["Clear:is_recursive"] == [True]]
    assert cleared_s[-1] == pytest.approx(59 / 25) and len(cleared_s) == 60 - len(known)

    ellipsoids = [row for _, row in rows[f"{ball}/uncertainty"] if "Ellipsoids3D:half_sizes" in row]
    for row, estimate in zip(ellipsoids, known, strict=True):
        x, y, z, w = row["Ellipsoids3D:quaternions"][0]
        rotation = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
        # Half an axis is two standard deviations.
        root_m = np.array(rotation) * np.array(row["Ellipsoids3D:half_sizes"][0]) / 2
        scale_m2 = np.trace(estimate.covariance_m2)
        np.testing.assert_allclose(root_m @ root_m.T, estimate.covariance_m2, atol=1e-5 * scale_m2)


def test_a_finished_run_is_logged(log, tmp_path):
    recording, read = log
    tracks = pardalis.track(DATA / "dioptric-jump/scene.toml", tmp_path / "results", frames=12, plots=False)
    pardalis.rerun.log_tracks(tracks, recording=recording)
    rows = read()
    logged_m = column(rows["/world/targets/ball/position"], "Points3D:positions")
    np.testing.assert_allclose(logged_m, tracks.positions_m("ball"), rtol=1e-5)
    times_s = [time_s for time_s, _ in rows["/world/targets/ball/position"]]
    np.testing.assert_allclose(times_s, np.arange(12) / 25, atol=1e-9)
    assert set(column(rows["/world/targets/ball/ball"], "Ellipsoids3D:half_sizes").ravel()) == {np.float32(0.11)}
    # The state once, as it does not change.
    assert [row["TextLog:text"][0] for _, row in rows["/targets/ball/state"]] == ["tracking"]
    np.testing.assert_allclose(column(rows["/world/cameras/cam1"], "Points3D:positions"), [[0, 0, 0.9]], atol=1e-6)


def test_gaps_and_members_that_are_gone_are_not_drawn(log):
    recording, read = log
    numbers = {name: np.full(7, np.nan) for name in "radius_m xx_m2 xy_m2 xz_m2 yy_m2 yz_m2 zz_m2 vx_mps vy_mps vz_mps".split()}
    columns = {
        "time_s": np.array([0.0, 0.0, 0.1, 0.1, 0.2, 0.3, 0.4]),
        "target": np.array(["ball-1", "ball-2", "ball-1", "ball-2", "ball-1", "ball-1", "ball-1"]),
        "state": np.array(["tracking"] * 4 + ["lost"] + ["tracking"] * 2),
        "confidence": np.full(7, 0.5),
        **{axis: np.array([0, 1, 2, 3, np.nan, 4, 5]) for axis in ("x_m", "y_m", "z_m")},
        **numbers,
    }
    summary = {"cameras": {}, "settings": {"targets": {"ball": {"shape": {"sphere": {"radius_m": 0.02}}}}}}
    tracks = Tracks(Path("results"), columns, summary)
    pardalis.rerun.log_tracks(tracks, {"cam1": CAMERA}, recording=recording)
    rows = read()
    assert "Pinhole:resolution" in rows["/world/cameras/cam1/image"][0][1]
    assert [time_s for time_s, _ in rows["/world/targets/ball-2"]] == [pytest.approx(0.2)]
    assert [time_s for time_s, _ in rows["/world/targets/ball-1"]] == [pytest.approx(0.2)]
    *_, (_, last) = rows["/world/targets/ball-1/trail"]
    trail = [np.array(strip)[:, 0].tolist() for strip in last["LineStrips3D:strips"]]
    assert trail == [[0, 2], [4, 5]]
    assert [row["TextLog:text"][0] for _, row in rows["/targets/ball-1/state"]] == ["tracking", "lost", "tracking"]


def test_the_layout_shows_all_cameras(tmp_path):
    fisheye = Camera.equidistant(SIZE_PX, 90.0, [159.5, 119.5], 1.6)
    layout = pardalis.rerun.blueprint({"left": CAMERA, "right": fisheye})
    layout.save("test", tmp_path / "layout.rbl")
    queries, origins = set(), set()
    reader = RrdReader(tmp_path / "layout.rbl")
    for chunk in reader.stream(store=reader.blueprints()[0]).to_chunks():
        table = chunk.to_record_batch().to_pydict()
        origins |= {origin for rows in table.get("ViewBlueprint:space_origin", []) for origin in rows}
        queries |= {tuple(rows) for rows in table.get("ViewContents:query", [])}
    assert {"world/cameras/left/image", "world/cameras/right/image", "world", "targets"} <= {o.strip("/") for o in origins}
    # What lies in space is drawn over the image of the pinhole, and the image of the fisheye is not in space.
    assert {("$origin/**", "world/targets/**"), ("world/**", "- world/cameras/right/image")} <= queries


def test_without_rerun_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    monkeypatch.delitem(sys.modules, "pardalis.rerun")
    with pytest.raises(ImportError, match="pip install rerun-sdk"):
        importlib.import_module("pardalis.rerun")
