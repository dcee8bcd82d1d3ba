"""The node and an independent implementation of DDS, in both directions."""

import csv
import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from cyclonedds.internal import InvalidSample
from PIL import Image
from ros import DATA, LATCHED, RELIABLE, SENSOR, Peer, header, message, nanoseconds

PROGRAM = Path(os.environ["PARDALIS_ROS2"])
RIG = DATA / "webcams-two"
NAMES = ["cam1", "cam2"]
START_NS = 1_700_000_000 * 10**9
STEP_NS = 40_000_000
# From here on the ball moves.
FIRST = 60

SCENE = """
[cameras.cam1]
calibration = "{rig}/cameras.json"
[cameras.cam2]
calibration = "{rig}/cameras.json"
[targets.ball]
shape.sphere.radius_m = 0.035
colors = "{data}/colors/pink-ball.hsi.colors.toml"
""".format(rig=RIG.as_posix(), data=DATA.as_posix())

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"


def file_of(camera, number):
    return RIG / "frames" / camera / f"{number:06}.jpg"


def raw(ns, pixels):
    height, width, _ = pixels.shape
    data = pixels[..., ::-1].tobytes()
    return message(IMAGE)(header(ns), height, width, "bgr8", 0, 3 * width, data)


def compressed(ns, camera, number):
    return message(COMPRESSED)(header(ns), "jpeg", file_of(camera, number).read_bytes())


def truth_m():
    with open(RIG / "truth.csv", newline="") as file:
        rows = {int(row["frame"]): row for row in csv.DictReader(file)}
    return np.array([[float(rows[n][key]) for key in ("x_m", "y_m", "z_m")] for n in sorted(rows)])


@pytest.fixture
def domain():
    return random.randrange(10, 200)


class Node:
    """The program, running."""

    def __init__(self, folder, domain, *arguments, scene=SCENE):
        (folder / "scene.toml").write_text(scene)
        command = [PROGRAM, folder / "scene.toml", "--domain", str(domain), *arguments]
        self.log = open(folder / "node.log", "w+")
        self.process = subprocess.Popen(command, stdout=self.log, stderr=self.log)

    def text(self):
        self.log.seek(0)
        return self.log.read()

    def stop(self):
        self.process.send_signal(signal.SIGINT)
        self.process.wait(10)
        return self.text()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()


def wait_for(condition, seconds=20):
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until, "nothing came"
        time.sleep(0.02)


def taken(reader):
    """The messages that have come; one that has stopped says so without one."""
    return [sample for sample in reader.take(100) if not isinstance(sample, InvalidSample)]


def matched(writers=(), readers=()):
    return all(writer.get_matched_subscriptions() for writer in writers) and all(reader.get_matched_publications() for reader in readers)


def results(peer, target="ball"):
    return {
        "pose": peer.subscription(f"/pardalis/{target}/pose", "geometry_msgs/msg/PoseWithCovarianceStamped"),
        "odometry": peer.subscription(f"/pardalis/{target}/odometry", "nav_msgs/msg/Odometry"),
        "state": peer.subscription(f"/pardalis/{target}/state", "std_msgs/msg/String"),
        "detections": peer.subscription("/pardalis/detections", "vision_msgs/msg/Detection3DArray"),
        "markers": peer.subscription("/pardalis/markers", "visualization_msgs/msg/MarkerArray"),
    }


def test_two_cameras_are_tracked_and_all_results_arrive(tmp_path, domain):
    peer = Peer(domain)
    writers = [peer.publisher("/cam1/image_raw", IMAGE), peer.publisher("/stereo/right/compressed", COMPRESSED)]
    diagnostics = peer.subscription("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
    readers = results(peer)
    found = {name: [] for name in readers}
    with Node(tmp_path, domain, "cam2=/stereo/right/compressed", "--frame", "map", "--reliable") as node:
        wait_for(lambda: matched(writers))
        # The first images only tell how large they are.
        until = time.monotonic() + 20
        ns = 0
        while not matched(readers=readers.values()):
            assert time.monotonic() < until, node.text()
            ns += 10**6
            writers[0].write(raw(ns, np.asarray(Image.open(file_of("cam1", 0)))))
            writers[1].write(compressed(ns, "cam2", 0))
            time.sleep(0.1)
        for number in range(60):
            ns = START_NS + number * STEP_NS
            writers[0].write(raw(ns, np.asarray(Image.open(file_of("cam1", FIRST + number)))))
            # Of the other camera half a microsecond later.
            writers[1].write(compressed(ns + 500, "cam2", FIRST + number))
            # However slow this computer is, nothing is dropped.
            wait_for(lambda: found["pose"].extend(taken(readers["pose"])) or ns in {nanoseconds(pose.header) for pose in found["pose"]})
            for name in ("odometry", "state", "detections", "markers"):
                found[name] += taken(readers[name])
        status = []
        wait_for(lambda: status.extend(taken(diagnostics)) or status)
        log = node.stop()
    for name, reader in readers.items():
        found[name] += taken(reader)
    at = {nanoseconds(pose.header): pose for pose in found["pose"] if pose.header.stamp.sec > 1}
    assert set(at) == {START_NS + number * STEP_NS for number in range(60)}
    assert {pose.header.frame_id for pose in found["pose"]} == {"map"}
    positions_m = np.array([[getattr(pose.pose.pose.position, axis) for axis in "xyz"] for _, pose in sorted(at.items())])
    truths_m = truth_m()[FIRST - 1 : FIRST + 60]
    errors_m = np.linalg.norm(positions_m - truths_m[1:], axis=1)
    assert np.sqrt(np.mean(errors_m**2)) < 0.002
    covariance = np.reshape(at[START_NS].pose.covariance, (6, 6))
    assert (np.linalg.eigvalsh(covariance[:3, :3]) > 0).all() and covariance[3, 3] == 1e6

    odometry = {nanoseconds(one.header): one for one in found["odometry"]}
    assert odometry[ns].child_frame_id == "ball" and odometry[ns].pose.pose == at[ns].pose.pose
    velocity_mps = [getattr(odometry[ns].twist.twist.linear, axis) for axis in "xyz"]
    np.testing.assert_allclose(velocity_mps, (truths_m[-1] - truths_m[-2]) / (1e-9 * STEP_NS), atol=0.06)
    assert np.linalg.norm(velocity_mps) > 0.1
    of_velocity = np.reshape(odometry[ns].twist.covariance, (6, 6))
    assert (np.linalg.eigvalsh(of_velocity[:3, :3]) > 0).all() and of_velocity[0, 0] < 1 and of_velocity[3, 3] == 1e6
    assert [state.data for state in found["state"]][-50:] == ["tracking"] * 50
    last = found["detections"][-1]
    assert [(one.id, one.results[0].hypothesis.class_id) for one in last.detections] == [("ball", "ball")]
    assert last.detections[0].results[0].hypothesis.score > 0.9
    assert last.detections[0].bbox.size.x == pytest.approx(0.07, rel=0.05)
    markers = found["markers"][-1].markers
    assert [marker.action for marker in markers] == [3, 0, 0, 0] and markers[-1].text.startswith("ball tracking ")
    assert markers[1].type == 2 and markers[1].scale.x == last.detections[0].bbox.size.x
    values = {pair.key: pair.value for pair in status[-1].status[0].values}
    assert status[-1].status[0].name == "pardalis: cam1" and int(values["received"]) > 0 and values["unusable"] == "0"
    assert "cam1: " in log and " 0 late, 0 dropped because tracking was too slow" in log


def test_cameras_keep_their_images_in_any_order_of_the_scene(tmp_path, domain):
    # That of their names is another.
    first, rest = SCENE.split("[cameras.cam2]")
    second, targets = rest.split("[targets.ball]")
    scene = f"[cameras.cam2]{second}{first}[targets.ball]{targets}"
    assert scene.index("cam2") < scene.index("cam1")
    peer = Peer(domain)
    writers = [peer.publisher(f"/{name}/image_raw/compressed", COMPRESSED) for name in NAMES]
    poses = peer.subscription("/pardalis/ball/pose", "geometry_msgs/msg/PoseWithCovarianceStamped")
    topics = [f"{name}=/{name}/image_raw/compressed" for name in NAMES]
    found = []
    with Node(tmp_path, domain, *topics, scene=scene) as node:
        until = time.monotonic() + 20
        number = 0
        while len(found) < 5 and time.monotonic() < until:
            for writer, name in zip(writers, NAMES):
                writer.write(compressed(START_NS + number * STEP_NS, name, 0))
            number += 1
            time.sleep(0.04)
            found += taken(poses)
        assert len(found) >= 5, node.text()
    position = found[-1].pose.pose.position
    np.testing.assert_allclose([position.x, position.y, position.z], truth_m()[0], atol=0.003)


@pytest.mark.parametrize("is_latched", [False, True])
def test_the_lens_may_come_from_camera_info(tmp_path, domain, is_latched):
    peer = Peer(domain)
    scene = SCENE.replace("[cameras.cam2]\ncalibration", "[cameras.cam2]\n# calibration").replace(
        f'[cameras.cam1]\ncalibration = "{RIG.as_posix()}/cameras.json"',
        "[cameras.cam1]\nworld_from_camera = [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 1], [0, 0, 0, 1]]",
    )
    scene = scene.split("[cameras.cam2]")[0] + "[targets.ball]" + scene.split("[targets.ball]")[1]
    writer = peer.publisher("/cam1/image_raw", IMAGE)
    infos = peer.publisher("/cam1/camera_info", "sensor_msgs/msg/CameraInfo", LATCHED if is_latched else RELIABLE)
    poses = peer.subscription("/pardalis/ball/pose", "geometry_msgs/msg/PoseWithCovarianceStamped")
    region = message("sensor_msgs/msg/RegionOfInterest")(0, 0, 0, 0, False)
    k = [330, 0, 159.5, 0, 330, 119.5, 0, 0, 1]
    info = message("sensor_msgs/msg/CameraInfo")(
        header(1), 240, 320, "plumb_bob", [0.0] * 5, [float(v) for v in k], np.eye(3).ravel().tolist(),
        [330.0, 0, 159.5, 0, 0, 330, 119.5, 0, 0, 0, 1, 0], 0, 0, region,
    )  # fmt: skip
    found = []
    if is_latched:
        infos.write(info)
    with Node(tmp_path, domain, "--camera-info", "cam1=/cam1/camera_info", scene=scene) as node:
        number = 0
        until = time.monotonic() + 20
        while len(found) < 5 and time.monotonic() < until:
            if not is_latched:
                infos.write(info)
            writer.write(raw(START_NS + number * STEP_NS, np.asarray(Image.open(file_of("cam1", number % 60)))))
            number += 1
            time.sleep(0.05)
            found += taken(poses)
        assert len(found) >= 5, node.text()
    # Ahead of the camera, at the distance of the ball: 0.46 m from the true camera.
    position = found[-1].pose.pose.position
    assert 0.3 < np.linalg.norm([position.x, position.y, position.z - 1]) < 0.7


def camera_info(k, d, p):
    region = message("sensor_msgs/msg/RegionOfInterest")(0, 0, 0, 0, False)
    matrix = lambda fx, fy, cx, cy: [float(v) for v in (fx, 0, cx, 0, fy, cy, 0, 0, 1)]
    p = np.column_stack([np.reshape(matrix(*p), (3, 3)), np.zeros(3)]).ravel().tolist()
    turn = np.eye(3).ravel().tolist()
    return message("sensor_msgs/msg/CameraInfo")(header(1), 240, 320, "plumb_bob", d, matrix(*k), turn, p, 0, 0, region)


def test_rectified_images_have_the_lens_of_the_projection_matrix(tmp_path, domain):
    peer = Peer(domain)
    known = json.loads((RIG / "cameras.json").read_text())["cameras"][0]
    pose = f"[cameras.cam1]\nworld_from_camera = {known['T_world_from_camera']}\n"
    scene = pose + "[targets.ball]" + SCENE.split("[targets.ball]")[1]
    writer = peer.publisher("/stereo/image_rect_color/compressed", COMPRESSED)
    infos = peer.publisher("/stereo/camera_info", "sensor_msgs/msg/CameraInfo", LATCHED)
    poses = peer.subscription("/pardalis/ball/pose", "geometry_msgs/msg/PoseWithCovarianceStamped")
    # With the raw lens, the ball would be at three quarters of its distance.
    infos.write(camera_info([250, 250, 150, 130], [-0.3, 0.1, 0.0, 0.0, 0.0], [known[key] for key in ("fx", "fy", "cx", "cy")]))
    found = []
    options = ["cam1=/stereo/image_rect_color/compressed", "--camera-info", "cam1=/stereo/camera_info"]
    with Node(tmp_path, domain, *options, scene=scene) as node:
        until = time.monotonic() + 20
        number = 0
        while len(found) < 5 and time.monotonic() < until:
            writer.write(compressed(START_NS + number * STEP_NS, "cam1", 0))
            number += 1
            time.sleep(0.05)
            found += taken(poses)
        assert len(found) >= 5, node.text()
    position = found[-1].pose.pose.position
    np.testing.assert_allclose([position.x, position.y, position.z], truth_m()[0], atol=0.03)


def test_what_does_not_come_is_explained(tmp_path, domain):
    peer = Peer(domain)
    scene = SCENE.replace("[targets.ball]", "[platforms.robot]\n[targets.ball]").replace("[cameras.cam1]", '[cameras.cam1]\nplatform = "robot"')
    others = [
        peer.publisher("/cam1/image_raw", COMPRESSED),
        peer.publisher("/stereo/image", IMAGE, SENSOR),
        peer.publisher("/odom", "geometry_msgs/msg/PoseStamped"),
    ]

    def said(words, *options, writer=None):
        with Node(tmp_path, domain, "--odometry", "robot=/odom", *options, scene=scene) as node:
            until = time.monotonic() + 30
            number = 0
            while words not in node.text():
                assert time.monotonic() < until and node.process.poll() is None, node.text()
                if writer:
                    number += 1
                    writer[0].write(raw(START_NS + number * STEP_NS, np.asarray(Image.open(file_of("cam1", 0)))))
                    writer[1].write(raw(START_NS + number * STEP_NS, np.asarray(Image.open(file_of("cam2", 0)))))
                time.sleep(0.05)

    said(
        "waiting for images on /cam1/image_raw: it has sensor_msgs/msg/CompressedImage, and sensor_msgs/msg/Image is needed; "
        "publish it on a topic that ends with /compressed"
    )
    said("waiting for images on /cam2/image_raw: nobody publishes there, but on /cam1/image_raw, /stereo/image\n")
    said("waiting for images on /stereo/image: its publisher is best effort (QoS); leave out --reliable", "cam1=/stereo/image", "--reliable")
    said("waiting for a calibration of cam1 on /info: nobody publishes there, nor sensor_msgs/msg/CameraInfo elsewhere", "--camera-info", "cam1=/info")
    words = "warning: nothing comes on /odom: it has geometry_msgs/msg/PoseStamped, and nav_msgs/msg/Odometry is needed"
    both = [others[1], peer.publisher("/other/image", IMAGE, SENSOR)]
    said(words, "cam1=/stereo/image", "cam2=/other/image", writer=both)


def test_a_simulated_clock_begins_at_zero(tmp_path, domain):
    # Of the detector, no message is taken before tracking begins.
    scene = SCENE.split("[cameras.cam2]")[0] + "[targets.ball]" + SCENE.split("[targets.ball]")[1].split("colors = ")[0] + "detector = {}\n[timing]\nmax_delay_s = 5\n"
    peer = Peer(domain)
    images = peer.publisher("/cam1/image_raw/compressed", COMPRESSED)
    boxes = peer.publisher("/boxes", "vision_msgs/msg/Detection2DArray")
    states = peer.subscription("/pardalis/ball/state", "std_msgs/msg/String")
    poses = peer.subscription("/pardalis/ball/pose", "geometry_msgs/msg/PoseWithCovarianceStamped")
    found = []
    options = ["cam1=/cam1/image_raw/compressed", "--detections", "cam1=/boxes", "--reliable"]
    with Node(tmp_path, domain, *options, scene=scene) as node:
        wait_for(lambda: matched([images, boxes]))
        # The node only looks at the size of this one.
        images.write(compressed(0, "cam1", 0))
        wait_for(lambda: matched(readers=[states, poses]))
        for number in range(20):
            ns = number * STEP_NS
            images.write(compressed(ns, "cam1", 0))
            boxes.write(detections(ns, [("ball", 0.9, [100, 100, 140, 140])]))
            time.sleep(0.05)
            found += taken(poses)
        wait_for(lambda: found.extend(taken(poses)) or 19 * STEP_NS in {nanoseconds(pose.header) for pose in found})
        log = node.stop()
    assert max(nanoseconds(pose.header) for pose in found) == 19 * STEP_NS and len(found) >= 15
    assert "cam1, detections: 20 images received, 20 used, 0 late, 0 dropped" in log


def test_odometry_moves_the_camera(tmp_path, domain):
    robot = DATA / "dioptric-moving-robot"
    scene = (robot / "scene.toml").read_text()
    scene = scene.replace('odometry = "odometry.csv"', "").replace('"camera.json"', f'"{robot.as_posix()}/camera.json"')
    scene = scene.replace('"../colors', f'"{DATA.as_posix()}/colors')
    peer = Peer(domain)
    writer = peer.publisher("/cam1/image_raw/compressed", COMPRESSED)
    odometry = peer.publisher("/odom", "nav_msgs/msg/Odometry")
    poses = peer.subscription("/pardalis/ball/pose", "geometry_msgs/msg/PoseWithCovarianceStamped")
    point, quaternion, pose = (message(f"geometry_msgs/msg/{name}") for name in ("Point", "Quaternion", "Pose"))
    vector, twist = (message(f"geometry_msgs/msg/{name}") for name in ("Vector3", "Twist"))
    there = pose(point(5.0, -3.0, 0.0), quaternion(0.0, 0.0, 0.0, 1.0))
    with_covariance = message("geometry_msgs/msg/PoseWithCovariance")(there, [0.0] * 36)
    still = twist(vector(0.0, 0.0, 0.0), vector(0.0, 0.0, 0.0))
    still = message("geometry_msgs/msg/TwistWithCovariance")(still, [0.0] * 36)
    image = (robot / "frames" / "000000.jpg").read_bytes()
    found = []
    with Node(tmp_path, domain, "cam1=/cam1/image_raw/compressed", "--odometry", "robot=/odom", scene=scene) as node:
        until = time.monotonic() + 20
        number = 0
        while len(found) < 5 and time.monotonic() < until:
            ns = START_NS + number * STEP_NS
            odometry.write(message("nav_msgs/msg/Odometry")(header(ns, "odom"), "base", with_covariance, still))
            time.sleep(0.02)
            writer.write(message(COMPRESSED)(header(ns), "jpeg", image))
            number += 1
            time.sleep(0.03)
            found += taken(poses)
        assert len(found) >= 5, node.text()
    # The truth is (2.62, -1.27) from the robot's origin.
    position = found[-1].pose.pose.position
    np.testing.assert_allclose([position.x, position.y], [5 + 2.62, -3 - 1.27], atol=0.1)


def detections(ns, boxes):
    """What a detector found: classes, scores and sides, which count from the corner of the image."""
    found = []
    for name, score, (left, top, right, bottom) in boxes:
        point, quaternion, pose = (message(f"geometry_msgs/msg/{kind}") for kind in ("Point", "Quaternion", "Pose"))
        nowhere = pose(point(0.0, 0.0, 0.0), quaternion(0.0, 0.0, 0.0, 1.0))
        nowhere = message("geometry_msgs/msg/PoseWithCovariance")(nowhere, [0.0] * 36)
        result = message("vision_msgs/msg/ObjectHypothesisWithPose")
        hypothesis = message("vision_msgs/msg/ObjectHypothesis")
        results = [result(hypothesis("kite", score / 2), nowhere), result(hypothesis(name, score), nowhere)]
        centre = message("vision_msgs/msg/Point2D")((left + right) / 2, (top + bottom) / 2)
        centre = message("vision_msgs/msg/Pose2D")(centre, 0.0)
        box = message("vision_msgs/msg/BoundingBox2D")(centre, float(right - left), float(bottom - top))
        found.append(message("vision_msgs/msg/Detection2D")(header(ns), results, box, ""))
    return message("vision_msgs/msg/Detection2DArray")(header(ns), found)


def test_boxes_of_detectors_are_tracked(tmp_path, domain):
    scene = SCENE.split("colors = ")[0] + 'detector.class = "sports ball"\n[timing]\nmax_delay_s = 60\n'
    peer = Peer(domain)
    images = [peer.publisher(f"/{name}/image_raw/compressed", COMPRESSED) for name in NAMES]
    boxes = [peer.publisher(f"/{name}/boxes", "vision_msgs/msg/Detection2DArray") for name in NAMES]
    poses = peer.subscription("/pardalis/ball/pose", "geometry_msgs/msg/PoseWithCovarianceStamped")
    states = peer.subscription("/pardalis/ball/state", "std_msgs/msg/String")
    cameras = json.loads((RIG / "cameras.json").read_text())["cameras"]
    topics = [f"{name}=/{name}/image_raw/compressed" for name in NAMES]
    options = [option for name in NAMES for option in ("--detections", f"{name}=/{name}/boxes")]
    found, seen = [], []
    with Node(tmp_path, domain, *topics, *options, "--reliable", scene=scene) as node:
        wait_for(lambda: matched(images + boxes))
        until = time.monotonic() + 20
        ns = 0
        while not matched(readers=[poses, states]):
            assert time.monotonic() < until, node.text()
            ns += 10**6
            for writer, name in zip(images, NAMES):
                writer.write(compressed(ns, name, 0))
            time.sleep(0.1)
        for number in range(40):
            ns = START_NS + number * STEP_NS
            for writer, name in zip(images, NAMES):
                writer.write(compressed(ns, name, FIRST + number))
            # Detectors take their time: these look at an image when the next has come.
            for writer, camera in zip(boxes, cameras):
                if number == 0:
                    continue
                at = np.linalg.inv(camera["T_world_from_camera"]) @ [*truth_m()[FIRST + number - 1], 1]
                radius = camera["fx"] * 0.035 / at[2]
                u, v = (camera[f"f{axis}"] * at[i] / at[2] + camera[f"c{axis}"] + 0.5 for i, axis in enumerate("xy"))
                ball = ("sports ball", 0.9, [u - radius, v - radius, u + radius, v + radius])
                # In two images they find nothing but others; later a box is none.
                other = ("person", 0.8, [10, 20, 60, 200])
                lists = {30: [other], 31: [other], 35: [ball, ("sports ball", 0.9, [5, 5, 5, 5])]}
                writer.write(detections(ns - STEP_NS, lists.get(number, [other, ball])))
            # However slow this computer is, nothing is dropped.
            wait_for(lambda: found.extend(taken(poses)) or number < 5 or ns - STEP_NS in {nanoseconds(pose.header) for pose in found})
            seen += taken(states)
        log = node.stop()
    seen += taken(states)
    at = {nanoseconds(pose.header): pose.pose.pose.position for pose in found}
    numbers = [number for number in range(5, 39) if START_NS + number * STEP_NS in at]
    assert len(numbers) == 34
    positions_m = np.array([[getattr(at[START_NS + number * STEP_NS], axis) for axis in "xyz"] for number in numbers])
    errors_m = np.linalg.norm(positions_m - truth_m()[[FIRST + number for number in numbers]], axis=1)
    assert np.median(errors_m) < 0.002
    assert [state.data for state in seen].count("occluded") == 1
    assert log.count("warning: images that are not used: ") == 1 and "/cam1/boxes: box is [" in log
    assert "cam1, detections: 39 images received, 39 used, 0 late, 0 dropped" in log


def test_detectors_need_topics_and_topics_detectors(tmp_path, domain):
    boxed = SCENE.split("colors = ")[0] + "detector = {}\n"
    for scene, options, expected in [
        (boxed, [], "targets.ball.detector: no topic has its boxes; give --detections cam1=/TOPIC"),
        (SCENE, ["--detections", "cam1=/boxes"], "no target of the scene has a detector"),
        (boxed, ["--detections", "cam3=/boxes"], "cam3: is no camera of the scene; allowed: cam1, cam2"),
        (boxed, ["--detections", "cam1=/a", "--detections", "cam1=/b"], "cam1 is given twice"),
    ]:
        with Node(tmp_path, domain, *options, scene=scene) as node:
            assert node.process.wait(20) == 2
            assert expected in node.text()


def test_images_that_cannot_be_used_are_counted_and_cost_no_others(tmp_path, domain):
    scene = SCENE.split("[cameras.cam2]")[0] + "[targets.ball]" + SCENE.split("[targets.ball]")[1]
    peer = Peer(domain)
    writer = peer.publisher("/cam1/image_raw", IMAGE)
    poses = peer.subscription("/pardalis/ball/pose", "geometry_msgs/msg/PoseWithCovarianceStamped")
    diagnostics = peer.subscription("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
    got, status = [], []
    with Node(tmp_path, domain, scene=scene) as node:
        until = time.monotonic() + 20
        number = 0
        while time.monotonic() < until and not (len(got) > 40 and status and status[-1].level == 1):
            pixels = np.asarray(Image.open(file_of("cam1", number % 60)))
            # After the first, which says how large all are.
            kind = number % 5 if got else 2
            image = raw(START_NS + number * STEP_NS, pixels if kind else pixels[:100])
            if kind == 1:
                image.encoding = "bayer_rggb8"
            if kind == 3:
                # A day in the future.
                image.header = header(time.time_ns() + 86_400 * 10**9)
            # In the end, the clock is set back.
            if len(got) > 40:
                image.header = header(START_NS)
            writer.write(image)
            number += 1
            time.sleep(0.02)
            got += taken(poses)
            status += [sample.status[0] for sample in taken(diagnostics)]
        log = node.stop()
    values = {pair.key: pair.value for pair in status[-1].values}
    assert int(values["unusable"]) > 10 and len(got) > 40, (values, log)
    assert "if a clock was set back, start the node again" in status[-1].message
    assert log.count("warning: images that are not used: ") == 1
    assert log.count("stamps are more than 10 s ahead of the clock of this computer") == 1


PUBLISH = """
import sys, time
sys.path.insert(0, {folder!r})
from test_node import *
peer = Peer({domain})
writer = peer.publisher("/cam1/image_raw/compressed", COMPRESSED)
for number in range(10**6):
    ns = time.time_ns()
    writer.write(message(COMPRESSED)(header(ns), "jpeg", file_of("cam1", number % 60).read_bytes()))
    time.sleep(0.033)
"""


def test_cameras_that_are_killed_and_restarted_are_tracked_again(tmp_path, domain):
    scene = SCENE.split("[cameras.cam2]")[0] + "[targets.ball]" + SCENE.split("[targets.ball]")[1]
    peer = Peer(domain)
    poses = peer.subscription("/pardalis/ball/pose", "geometry_msgs/msg/PoseWithCovarianceStamped")
    publish = PUBLISH.format(folder=str(Path(__file__).parent), domain=domain)
    with Node(tmp_path, domain, "cam1=/cam1/image_raw/compressed", scene=scene) as node:
        for _ in range(int(os.environ.get("RESTARTS", "2"))):
            publisher = subprocess.Popen([sys.executable, "-c", publish])
            try:
                taken(poses)
                got = []
                wait_for(lambda: got.extend(taken(poses)) or len(got) >= 10, 30)
            finally:
                publisher.kill()
                publisher.wait()
            assert node.process.poll() is None, node.text()
        assert " images received" in node.stop()


def test_mistakes_are_named(tmp_path, domain):
    def error(*arguments, scene=SCENE, domain=domain):
        (tmp_path / "scene.toml").write_text(scene)
        command = [PROGRAM, tmp_path / "scene.toml", "--domain", str(domain), *arguments]
        done = subprocess.run(command, capture_output=True, text=True, timeout=20)
        assert done.returncode == 2, done
        return done.stderr

    assert "cam3: is no camera of the scene; allowed: cam1, cam2" in error("cam3=/a")
    assert "allowed: a name of the scene and a topic" in error("cam1")
    assert "cameras: is missing" in error(scene="")
    assert "scene.toml: a problem in the scene:\n  line 1: " in error(scene="[cameras")
    # Before any image comes.
    wrong = error(scene=SCENE.replace("0.035", "-1"))
    assert "line 7: targets.ball.shape.sphere.radius_m: is -1" in wrong
    assert "no.toml: cannot be read: there is no such file" in error(scene=SCENE.replace("pink-ball.hsi.colors.toml", "no.toml"))
    # Names of topics have no hyphens.
    hyphens = SCENE + SCENE[SCENE.index("[targets.ball]") :].replace("targets.ball", "targets.a-b")
    hyphens += SCENE[SCENE.index("[targets.ball]") :].replace("targets.ball", "targets.a_b")
    assert "the targets a-b and a_b would have the same topic a_b; rename one of them" in error(scene=hyphens)
    assert "the cameras cam1 and cam2 have the same topic /cam1/image_raw; give each its own" in error("cam2=/cam1/image_raw")
    wrong = SCENE.replace("[cameras.cam1]\n", '[cameras.left-]\ncalibration_camera = "cam1"\n')
    assert "cameras.left-: no topic has this name; give left-=/TOPIC" in error(scene=wrong)
    platform = "[platforms.robot]\n" + SCENE.replace("[targets", 'platform = "robot"\n[targets')
    assert "platforms.robot: nothing says how it moves; give --odometry robot=/odom" in error(scene=platform)
    assert "--odometry: rover is no platform of the scene" in error("--odometry", "rover=/odom")
    assert "the domain is 300; allowed: 0 to 232" in error(domain=300)
