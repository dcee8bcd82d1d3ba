"""MCAP recordings as inputs and outputs, against the packages of MCAP's authors."""

import json
from pathlib import Path

import jsonschema
import numpy as np
import pandas
import pytest
import zstandard
from google.protobuf.json_format import MessageToDict
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer as PlainWriter
from mcap_protobuf.decoder import DecoderFactory
from mcap_ros2.writer import Writer
from pictures import DATA
from PIL import Image

import pardalis

HERE = Path(__file__).parent
RIG = DATA / "webcams-two"
NAMES = ["cam1", "cam2"]
FRAMES, FPS = 24, 25
START_S = 1_700_000_000

TIME = "int32 sec\nuint32 nanosec\n"
HEADER = "builtin_interfaces/Time stamp\nstring frame_id\n"
INCLUDED = f"{'=' * 80}\nMSG: std_msgs/Header\n{HEADER}{'=' * 80}\nMSG: builtin_interfaces/Time\n{TIME}"
# The definitions of sensor_msgs in ROS 2.
IMAGE = f"std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data\n{INCLUDED}"
COMPRESSED = f"std_msgs/Header header\nstring format\nuint8[] data\n{INCLUDED}"
REGION = "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n"
CAMERA_INFO = (
    "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\nfloat64[9] r\nfloat64[12] p\n"
    f"uint32 binning_x\nuint32 binning_y\nsensor_msgs/RegionOfInterest roi\n{INCLUDED}{'=' * 80}\nMSG: sensor_msgs/RegionOfInterest\n{REGION}"
)


def file_of(camera, number):
    return RIG / "frames" / camera / f"{number:06}.jpg"


def pixels_of(camera, number):
    return np.asarray(Image.open(file_of(camera, number)))


def raw(encoding, pixels):
    """An image without compression, with seven bytes behind each row."""
    if encoding == "bgr8":
        pixels = pixels[..., ::-1]
    elif encoding == "rgba8":
        pixels = np.dstack([pixels, np.full_like(pixels[..., 0], 7)])
    height, width, channels = pixels.shape
    rows = pixels.reshape(height, width * channels)
    rows = np.hstack([rows, np.full((height, 7), 99, np.uint8)])
    return {"height": height, "width": width, "encoding": encoding, "is_bigendian": 0, "step": rows.shape[1], "data": rows.tobytes()}


def header(number):
    return {"stamp": {"sec": START_S + number // FPS, "nanosec": number % FPS * (10**9 // FPS)}, "frame_id": "lens"}


def record(path, kinds, frames=FRAMES):
    """Record the webcams with the writer of MCAP's authors: of each camera, the messages of this kind."""
    calibrations = json.loads((RIG / "cameras.json").read_text())["cameras"]
    with open(path, "wb") as file:
        writer = Writer(file)
        image = writer.register_msgdef("sensor_msgs/msg/Image", IMAGE)
        compressed = writer.register_msgdef("sensor_msgs/msg/CompressedImage", COMPRESSED)
        info = writer.register_msgdef("sensor_msgs/msg/CameraInfo", CAMERA_INFO)
        for number in range(frames):
            for camera, kind, known in zip(NAMES, kinds, calibrations):
                # Messages are recorded a little later than they were taken.
                at = {"log_time": START_S * 10**9 + number * 10**9 // FPS + 10**7}
                stamped = {"header": header(number)}
                if kind == "jpeg":
                    message = {"format": "jpeg", "data": file_of(camera, number).read_bytes()}
                    writer.write_message(f"/{camera}/image", compressed, stamped | message, **at)
                else:
                    writer.write_message(f"/{camera}/image", image, stamped | raw(kind, pixels_of(camera, number)), **at)
                message = {
                    "height": known["height"],
                    "width": known["width"],
                    "distortion_model": "plumb_bob",
                    "d": known["distortion"],
                    "k": [known["fx"], 0, known["cx"], 0, known["fy"], known["cy"], 0, 0, 1],
                    "r": np.eye(3).ravel().tolist(),
                    "p": [known["fx"], 0, known["cx"], 0, 0, known["fy"], known["cy"], 0, 0, 0, 1, 0],
                    "binning_x": 0,
                    "binning_y": 0,
                    "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False},
                }
                writer.write_message(f"/{camera}/camera_info", info, stamped | message, **at)
        writer.finish()
    return path


def scene_of(path):
    calibrations = json.loads((RIG / "cameras.json").read_text())["cameras"]
    cameras = {
        camera: {
            "mcap": path,
            "topic": f"/{camera}/image",
            "calibration": path,
            "world_from_camera": known["T_world_from_camera"],
        }
        for camera, known in zip(NAMES, calibrations)
    }
    ball = {"shape": {"sphere": {"radius_m": 0.035}}, "colors": DATA / "colors" / COLORS}
    return {"cameras": cameras, "targets": {"ball": ball}}


COLORS = "pink-ball.hsi.colors.toml"


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return record(tmp_path_factory.mktemp("ros") / "rig.mcap", ["bgr8", "jpeg"])


@pytest.fixture(scope="module")
def tracked(recording):
    folder = recording.parent / "tracks"
    return pardalis.track(scene_of(recording), folder, plots=False, mcap=folder / "tracks.mcap")


def test_recordings_of_ros_give_the_tracks_of_their_images(recording, tracked, tmp_path):
    # The same pixels for one and the same decoder of the other.
    (tmp_path / "cam1").mkdir()
    for number in range(FRAMES):
        Image.fromarray(pixels_of("cam1", number)).save(tmp_path / "cam1" / f"{number:06}.png", compress_level=1)
    scene = scene_of(recording)
    for camera, folder in [("cam1", tmp_path / "cam1"), ("cam2", RIG / "frames" / "cam2")]:
        known = scene["cameras"][camera]
        del known["mcap"], known["topic"]
        known |= {"images": folder, "fps": FPS, "frame_limit": FRAMES, "calibration": RIG / "cameras.json"}
        del known["world_from_camera"]
    images = pardalis.track(scene, tmp_path / "tracks", plots=False)
    assert images.columns["state"].tolist() == tracked.columns["state"].tolist()
    # Times of 2023 have six digits behind the point, and velocities are made of their differences.
    np.testing.assert_allclose(tracked.columns["time_s"] - START_S, images.columns["time_s"], atol=1e-6)
    np.testing.assert_allclose(tracked.positions_m("ball"), images.positions_m("ball"), atol=1e-4)
    assert (tracked.columns["state"] == "tracking").sum() >= FRAMES - 2


@pytest.mark.parametrize("kinds", [("rgb8", "rgba8"), ("rgba8", "bgr8")])
def test_raw_images_of_all_orders_of_channels_are_alike(kinds, tmp_path):
    paths = [record(tmp_path / f"{number}.mcap", kind, frames=3) for number, kind in enumerate([kinds, ("bgr8", "rgb8")])]
    rows = [pardalis.track(scene_of(path), tmp_path / path.stem, plots=False).positions_m("ball") for path in paths]
    np.testing.assert_array_equal(*rows)
    assert np.isfinite(rows[0][-1]).all()


def test_recorded_tracks_pass_the_reader_of_others(tracked):
    counts, positions_m, covariances_m2, of_velocity_m2ps2, states, outlines = {}, [], [], [], [], []
    with open(tracked.folder / "tracks.mcap", "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        for _, channel, _, decoded in decoded_messages(reader):
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
            if channel.topic == "/ball/odometry":
                position = decoded.pose.position
                positions_m.append([position.x, position.y, position.z])
                covariances_m2.append(np.reshape(decoded.pose_covariance, (6, 6))[:3, :3])
                of_velocity_m2ps2.append(np.reshape(decoded.velocity_covariance, (6, 6)))
                assert decoded.frame_id == "world" and decoded.timestamp.seconds >= START_S
            elif channel.topic == "/ball/state":
                states.append(decoded)
            elif channel.topic == "/cam1/outlines" and decoded.points:
                outlines.append(np.array([[point.x, point.y] for point in decoded.points[0].points]))
            elif channel.topic == "/cam1/calibration":
                assert list(decoded.K) == [330, 0, 159.5, 0, 330, 119.5, 0, 0, 1] and decoded.distortion_model == "plumb_bob"
    found = tracked.columns["state"] == "tracking"
    assert counts["/cam1/image"] == counts["/cam2/image"] == counts["/ball/state"] == counts["/targets"] == FRAMES
    assert counts["/cam1/calibration"] == FRAMES and counts["/tf"] == 2 * FRAMES
    np.testing.assert_array_equal(positions_m, tracked.positions_m("ball")[found])
    np.testing.assert_array_equal([c[0, 1] for c in covariances_m2], tracked.columns["xy_m2"][found])
    np.testing.assert_allclose([c[1, 2] for c in of_velocity_m2ps2], tracked.columns["vyz_m2ps2"][found], rtol=1e-9)
    assert not np.any([c[3:] for c in of_velocity_m2ps2])
    assert [state["state"] for state in states] == tracked.columns["state"].tolist()
    np.testing.assert_array_equal([state["confidence"] for state in states], tracked.columns["confidence"])
    # Outlines are around the ball, in Foxglove's coordinates.
    camera = pardalis.Camera.read_all(RIG / "cameras.json")["cam1"]
    centers_px = camera.project(tracked.positions_m("ball")[found]) + 0.5
    np.testing.assert_allclose([outline.mean(axis=0) for outline in outlines], centers_px, atol=1.0)


def decoded_messages(reader):
    """The messages of a recording, those in JSON after a check by their schema."""
    protobuf = DecoderFactory()
    for schema, channel, message in reader.iter_messages():
        if channel.message_encoding == "json":
            decoded = json.loads(message.data)
            jsonschema.validate(decoded, json.loads(schema.data))
        else:
            decoded = protobuf.decoder_for("protobuf", schema)(message.data)
        yield schema, channel, message, decoded


def test_what_was_recorded_can_be_tracked_again(tracked, tmp_path):
    again = pardalis.track(scene_of(tracked.folder / "tracks.mcap"), tmp_path / "again", plots=False)
    assert again.columns["state"].tolist() == tracked.columns["state"].tolist()
    found = tracked.columns["state"] == "tracking"
    # The images were compressed a second time.
    np.testing.assert_allclose(again.positions_m("ball")[found], tracked.positions_m("ball")[found], atol=2e-3)


def test_foxglove_in_json_is_read_like_protobuf(tracked, tmp_path):
    with open(tracked.folder / "tracks.mcap", "rb") as source, open(tmp_path / "json.mcap", "wb") as target:
        writer = PlainWriter(target, compression=CompressionType.LZ4)
        writer.start()
        channels = {}
        for schema, channel, message, decoded in decoded_messages(make_reader(source)):
            if not channel.topic.endswith(("/image", "/calibration")):
                continue
            if channel.topic not in channels:
                schema_id = writer.register_schema(schema.name, "jsonschema", b"{}")
                channels[channel.topic] = writer.register_channel(channel.topic, "json", schema_id)
            fields = MessageToDict(decoded, preserving_proto_field_name=True, always_print_fields_with_no_presence=True)
            stamp = decoded.timestamp
            fields["timestamp"] = {"sec": stamp.seconds, "nsec": stamp.nanos}
            data = json.dumps(fields).encode()
            writer.add_message(channels[channel.topic], message.log_time, data, message.publish_time)
        writer.finish()
    names = ["tracks.mcap", "json.mcap"]
    rows = [
        pardalis.track(scene_of(folder / name), tmp_path / f"tracks-of-{name}", plots=False)
        for folder, name in zip([tracked.folder, tmp_path], names)
    ]
    np.testing.assert_array_equal(rows[0].positions_m("ball"), rows[1].positions_m("ball"))
    np.testing.assert_array_equal(rows[0].columns["time_s"], rows[1].columns["time_s"])


def test_a_recording_of_others_is_read(tmp_path):
    camera = {
        "mcap": HERE / "recordings" / "soccer_goal_12.mcap",
        "world_from_camera": np.eye(4),
        "model": {"pinhole": {"f_px": [600, 600], "center_px": [319.5, 239.5]}},
    }
    ball = {"shape": {"sphere": {"radius_m": 0.1}}, "colors": DATA / "colors" / COLORS}
    scene = {"cameras": {"cam": camera}, "targets": {"ball": ball}}
    with pytest.warns(UserWarning, match="ball: was not found in any of the 2 frames"):
        tracks = pardalis.track(scene, tmp_path, annotate=True, plots=False)
    assert tracks.columns["time_s"].tolist() == pytest.approx([8.297777777, 8.331088888], abs=1e-9)
    image = np.asarray(Image.open(tmp_path / "annotated" / "000000.jpg")).astype(int)
    assert image.shape == (480, 640, 3)
    with open(camera["mcap"], "rb") as file:
        [message, _] = [message for _, _, message in make_reader(file).iter_messages()]
    plain = zstandard.ZstdDecompressor().decompress(message.data, max_output_size=2_000_000)
    pixels = np.frombuffer(plain[-480 * 640 * 3 :], np.uint8).reshape(480, 640, 3).astype(int)
    # Below the label, and but for JPEG.
    assert np.abs(image[40:] - pixels[40:]).mean() < 3


def test_a_recording_that_is_cut_off_is_read_as_far_as_it_goes(tmp_path):
    # Small chunks, so that some of them are whole.
    with open(record(tmp_path / "whole.mcap", ["jpeg", "jpeg"]), "rb") as source, open(tmp_path / "small.mcap", "wb") as target:
        writer = PlainWriter(target, chunk_size=20_000)
        writer.start("ros2")
        schemas, channels = {}, {}
        for schema, channel, message in make_reader(source).iter_messages():
            if schema.name not in schemas:
                schemas[schema.name] = writer.register_schema(schema.name, schema.encoding, schema.data)
            if channel.topic not in channels:
                channels[channel.topic] = writer.register_channel(channel.topic, "cdr", schemas[schema.name])
            writer.add_message(channels[channel.topic], message.log_time, message.data, message.publish_time)
        writer.finish()
    whole = (tmp_path / "small.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: int(0.6 * len(whole))])
    with pytest.warns(UserWarning, match="cam.: stopped: .*cut.mcap: the recording is cut off; what precedes was read"):
        tracks = pardalis.track(scene_of(cut), tmp_path / "tracks", plots=False)
    rows = pardalis.track(scene_of(tmp_path / "small.mcap"), tmp_path / "all", plots=False).positions_m("ball")
    assert 10 <= len(tracks) <= 16
    np.testing.assert_array_equal(tracks.positions_m("ball")[:-1], rows[: len(tracks) - 1])
    # Nothing is left of the first image.
    cut.write_bytes(whole[:9000])
    with pytest.raises(ValueError, match="cut.mcap: .*cut off"):
        pardalis.track(scene_of(cut), tmp_path / "none", plots=False)


def test_damage_is_reported_and_costs_no_row(recording, tmp_path):
    whole = bytearray(recording.read_bytes())
    for place in range(len(whole) * 7 // 10, len(whole) * 7 // 10 + 60):
        whole[place] ^= 0x5A
    (tmp_path / "damaged.mcap").write_bytes(whole)
    with pytest.warns(UserWarning, match="damaged.mcap: the recording is damaged: .*; what precedes was read"):
        tracks = pardalis.track(scene_of(tmp_path / "damaged.mcap"), tmp_path / "tracks", plots=False)
    assert 2 < len(tracks) <= FRAMES


def test_topics_are_named_where_one_is_needed(recording, tmp_path):
    def error(**changes):
        scene = scene_of(recording)
        del scene["cameras"]["cam2"]
        scene["cameras"]["cam1"] |= changes
        with pytest.raises(ValueError) as caught:
            pardalis.track(scene, tmp_path / "tracks")
        return str(caught.value)

    assert "has several topics with images; give topic, one of /cam1/image, /cam2/image" in error(topic=None)
    assert "has no topic /cam3; topics with images: /cam1/image, /cam2/image" in error(topic="/cam3")
    assert "has no images in /cam1/camera_info: sensor_msgs/msg/CameraInfo (cdr)" in error(topic="/cam1/camera_info")
    assert 'calibration_camera: is the text "cam3"; allowed: cam1, cam2' in error(calibration_camera="cam3")
    assert "topic: applies to mcap only" in error(mcap=None, images=RIG / "frames" / "cam1", fps=25)
    assert "fps: applies to images and video only" in error(fps=25)
    assert "mcap: cannot be combined with images" in error(images="here")
    (tmp_path / "text.mcap").write_text("no recording")
    assert "text.mcap: is not an MCAP recording" in error(mcap=tmp_path / "text.mcap")
    assert f"is a folder; give a recording in it: {tmp_path / 'text.mcap'}" in error(mcap=tmp_path)
    assert "nowhere.mcap: cannot be read: there is no such file" in error(mcap=tmp_path / "nowhere.mcap")


def test_init_writes_a_scene_of_a_recording(recording, tracked, tmp_path):
    scene = tmp_path / "scene.toml"
    pardalis.run("init", recording, "--colors", DATA / "colors" / COLORS, "--radius-m", 0.035, "-o", scene)
    text = scene.read_text()
    assert text.count("# CHANGE: a guess") == 2 and text.count("\ncalibration = ") == 2
    poses = {camera["name"]: camera["T_world_from_camera"] for camera in json.loads((RIG / "cameras.json").read_text())["cameras"]}
    for name in NAMES:
        start = text.index("world_from_camera", text.index(f"[cameras.{name}]"))
        end = text.index("\n]\n", start) + 3
        text = text[:start] + f"world_from_camera = {poses[name]}\n" + text[end:]
    scene.write_text(text)
    tracks = pardalis.track(scene, tmp_path / "tracks", plots=False)
    np.testing.assert_array_equal(tracks.positions_m("ball"), tracked.positions_m("ball"))
    with pytest.raises(ValueError, match="--fps: a recording carries its own time stamps"):
        pardalis.run("init", recording, "--fps", 25, "-o", scene, "--force")
    with pytest.raises(ValueError, match="rig.mcap: is a recording, not a scene; `pardalis init .*rig.mcap` writes a scene of it"):
        pardalis.track(recording, tmp_path / "tracks")


def test_colours_are_learnt_and_lenses_shown_from_a_recording(recording, tmp_path):
    truth = pandas.read_csv(RIG / "truth.csv")
    seen = truth[(truth["camera"] == "cam2") & (truth["frame"].isin([3, 20]))]
    labels = {row.frame: f"{row.u_px:.1f},{row.v_px:.1f},20" for row in seen.itertuples()}
    of_recording, of_images = (["learn", "-o", tmp_path / f"{name}.toml", "--no-pictures"] for name in ("recording", "images"))
    of_recording += ["--image", recording, "--topic", "/cam2/image"]
    for number, label in labels.items():
        of_recording += ["--frame", number, "--circle", label]
        of_images += ["--image", file_of("cam2", number), "--circle", label]
    pardalis.run(*of_recording)
    pardalis.run(*of_images)

    def model(name):
        return [line for line in (tmp_path / f"{name}.toml").read_text().splitlines() if not line.startswith("#")]

    assert model("recording") == model("images")

    def error(*arguments):
        with pytest.raises(ValueError) as raised:
            pardalis.run("learn", "-o", tmp_path / "none.toml", *arguments)
        return str(raised.value)

    circle = ["--circle", labels[3]]
    assert "has several topics with images" in error("--image", recording, "--frame", 3, *circle)
    assert "which of its images is meant? Add --frame" in error("--image", recording, "--topic", "/cam2/image", *circle)
    assert "there is no such frame" in error("--image", recording, "--topic", "/cam2/image", "--frame", 999, *circle)
    assert "put it directly after the --image" in error("--topic", "/cam2/image", "--image", recording, *circle)
    assert "leave --topic out" in error("--image", file_of("cam2", 3).with_suffix(".mp4"), "--topic", "/a", "--frame", 3, *circle)
    shown = pardalis.run("camera", "show", recording, "--camera", "cam2")
    assert "cam2" in shown and "pinhole" in shown, shown


def test_init_leaves_out_what_it_cannot_read_and_keeps_lenses_with_topics(tmp_path):
    calibration = {
        "height": 240, "width": 320, "distortion_model": "plumb_bob", "d": [0.0] * 5, "k": [330.0, 0, 159.5, 0, 330, 119.5, 0, 0, 1],
        "r": np.eye(3).ravel().tolist(), "p": [330.0, 0, 159.5, 0, 0, 330, 119.5, 0, 0, 0, 1, 0], "binning_x": 0, "binning_y": 0,
        "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False},
    }  # fmt: skip
    with open(tmp_path / "depth.mcap", "wb") as file:
        writer = Writer(file)
        image = writer.register_msgdef("sensor_msgs/msg/Image", IMAGE)
        info = writer.register_msgdef("sensor_msgs/msg/CameraInfo", CAMERA_INFO)
        for number in range(2):
            stamped = {"header": header(number)}
            depth = {"height": 1, "width": 1, "encoding": "32FC1", "is_bigendian": 0, "step": 4, "data": b"\0" * 4}
            writer.write_message("/depth/image_raw", image, stamped | depth, log_time=number)
            unknown = calibration | {"height": 1, "width": 1, "k": [0.0] * 9}
            writer.write_message("/depth/camera_info", info, stamped | unknown, log_time=number)
            for name in ("left", "right"):
                pixels = raw("bgr8", pixels_of("cam1", number))
                writer.write_message(f"/{name}/image_rect_color", image, stamped | pixels, log_time=number)
                writer.write_message(f"/{name}/camera_info", info, stamped | calibration, log_time=number)
            writer.write_message("/rear/image_raw", image, stamped | raw("bgr8", pixels_of("cam1", number)), log_time=number)
        writer.finish()
    scene = tmp_path / "scene.toml"
    with pytest.warns(UserWarning) as warned:
        pardalis.run("init", tmp_path / "depth.mcap", "--colors", DATA / "colors" / COLORS, "-o", scene)
    words = [str(warning.message) for warning in warned]
    assert sum("left out: " in word and '"32FC1"' in word for word in words) == 1
    # One that nobody has calibrated costs the others nothing.
    assert sum("topic /depth/camera_info: " in word and "not calibrated" in word for word in words) == 1
    # Nor has it that of another.
    assert sum("/rear/image_raw: has no calibration; the scene has a guess" in word for word in words) == 1
    text = scene.read_text()
    assert text.count('calibration_lens = "rectified"') == 2
    assert "[cameras.depth]" not in text
    assert "calibration = " not in text.split("[cameras.rear]")[1].split("\n[")[0]
    # Another name keeps the lens.
    scene.write_text(text.replace("cameras.left", "cameras.port"))
    assert 'calibration_camera = "left"' in text
    with pytest.warns(UserWarning):
        assert "cameras.port" in pardalis.run("check", scene)


def test_rectified_images_have_the_lens_of_the_projection_matrix(tmp_path):
    # The webcams have no distortion: their images are those of a rectified camera, here with a calibration of raw images that would be quite another one.
    known = json.loads((RIG / "cameras.json").read_text())["cameras"][0]
    matrix = [known["fx"], 0, known["cx"], 0, 0, known["fy"], known["cy"], 0, 0, 0, 1, 0]
    calibration = {
        "height": 240, "width": 320, "distortion_model": "plumb_bob", "d": [-0.3, 0.1, 0.0, 0.0, 0.0],
        "k": [250.0, 0, 150, 0, 250, 130, 0, 0, 1], "r": np.eye(3).ravel().tolist(), "p": matrix, "binning_x": 0, "binning_y": 0,
        "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False},
    }  # fmt: skip
    # Names that differ only in a slash.
    topics = {"robot-left": "/robot/left", "robot_left": "/robot_left"}
    with open(tmp_path / "rect.mcap", "wb") as file:
        writer = Writer(file)
        image = writer.register_msgdef("sensor_msgs/msg/Image", IMAGE)
        info = writer.register_msgdef("sensor_msgs/msg/CameraInfo", CAMERA_INFO)
        for number in range(12):
            stamped = {"header": header(number)}
            pixels = raw("bgr8", pixels_of("cam1", number))
            at = {"log_time": START_S * 10**9 + number * 10**9 // FPS}
            writer.write_message("/robot/left/image_rect", image, stamped | pixels, **at)
            writer.write_message("/robot/left/camera_info", info, stamped | calibration, **at)
            writer.write_message("/robot_left/image_raw", image, stamped | pixels, **at)
            writer.write_message("/robot_left/camera_info", info, stamped | calibration, **at)
        writer.finish()
    path = tmp_path / "rect.mcap"
    colors = ["--colors", DATA / "colors" / COLORS, "--radius-m", 0.035]
    pardalis.run("init", path, *colors, "-o", tmp_path / "both.toml")
    text = (tmp_path / "both.toml").read_text()
    for name, topic in topics.items():
        part = text.split(f"[cameras.{name}]")[1].split("\n[")[0]
        assert f'topic = "{topic}/' in part and f'calibration_camera = "{name}"' in part
        assert ('calibration_lens = "rectified"' in part) == (name == "robot-left")
    camera = {"mcap": path, "topic": "/robot/left/image_rect", "calibration": path, "calibration_camera": "robot-left"}
    camera["world_from_camera"] = known["T_world_from_camera"]
    scene = {"cameras": {"cam": camera}, "targets": scene_of(path)["targets"]}
    rectified = pardalis.track(scene, tmp_path / "rectified", plots=False)
    model = {"pinhole": {"f_px": [known["fx"], known["fy"]], "center_px": [known["cx"], known["cy"]]}}
    for key in ("calibration", "calibration_camera"):
        del camera[key]
    stated = pardalis.track({**scene, "cameras": {"cam": {**camera, "model": model}}}, tmp_path / "stated", plots=False)
    assert (stated.columns["state"] == "tracking").sum() >= 10
    np.testing.assert_array_equal(rectified.positions_m("ball"), stated.positions_m("ball"))
    # Nothing is rectified where the topic does not say so.
    camera |= {"calibration": path, "calibration_camera": "robot-left"}
    raw_lens = pardalis.track({**scene, "cameras": {"cam": {**camera, "calibration_lens": "pinhole"}}}, tmp_path / "raw", plots=False)
    assert not np.array_equal(raw_lens.positions_m("ball"), stated.positions_m("ball"), equal_nan=True)


def test_bags_are_folders_with_recordings(recording, tmp_path):
    bag = tmp_path / "bag"
    bag.mkdir()
    (bag / "metadata.yaml").write_text("rosbag2_bagfile_information:\n  version: 5\n")
    scene = scene_of(recording)
    for camera in NAMES:
        scene["cameras"][camera]["mcap"] = bag

    def error(*arguments):
        with pytest.raises(ValueError) as caught:
            pardalis.run(*arguments)
        return str(caught.value)

    with pytest.raises(ValueError, match="bag: is a folder without recordings; give an .mcap file, or convert a bag"):
        pardalis.track(scene, tmp_path / "tracks")
    (bag / "bag_0.mcap").write_bytes(recording.read_bytes())
    with pytest.raises(ValueError, match="bag: is a folder; give a recording in it: .*bag_0.mcap"):
        pardalis.track(scene, tmp_path / "tracks")
    (bag / "bag_1.mcap").write_bytes(recording.read_bytes())
    assert error("init", bag, "-o", tmp_path / "scene.toml").endswith(f"give one of them: {bag / 'bag_0.mcap'}, {bag / 'bag_1.mcap'}")


def test_check_says_that_a_recording_is_cut_off_and_goes_on(recording, tmp_path):
    whole = recording.read_bytes()
    scene = tmp_path / "scene.toml"
    # Without its summary and its end, and with half of its chunks.
    for share in (0.97, 0.5):
        (tmp_path / "cut.mcap").write_bytes(whole[: int(share * len(whole))])
        pardalis.run("init", tmp_path / "cut.mcap", "--colors", DATA / "colors" / COLORS, "--radius-m", 0.035, "-o", scene, "--force")
        with pytest.warns(UserWarning) as warned:
            printed = pardalis.run("check", scene)
        words = [str(warning.message) for warning in warned]
        assert sum("cameras.cam1.mcap: the recording is cut off" in word and "images up to there are used" in word for word in words) == 1
        assert "cameras.cam1: " in printed and "320 x 240 pixels" in printed and "no errors" in printed
    (tmp_path / "cut.mcap").write_bytes(whole)
    with pytest.warns(UserWarning) as warned:
        pardalis.run("check", scene)
    assert not any("cut off" in str(warning.message) for warning in warned)


def test_batches_take_recordings(recording, tracked, tmp_path):
    import pardalis.batch

    # Another one; the topics of the scene's cameras stay.
    other = tmp_path / "other.mcap"
    other.write_bytes(recording.read_bytes())
    both = {camera: other for camera in NAMES}
    batch = pardalis.batch.run(scene_of(recording), tmp_path / "out", recordings={"other": both}, frames=3, progress=False)
    assert batch.failures == {} and batch.tracked == 1
    rows = pandas.read_parquet(tmp_path / "out" / "tracks")
    np.testing.assert_array_equal(rows[["x_m", "y_m", "z_m"]], tracked.positions_m("ball")[:3])
    # Where the scene has a folder of images, its keys go.
    scene = scene_of(recording)
    for camera in NAMES:
        del scene["cameras"][camera]["mcap"], scene["cameras"][camera]["topic"]
        scene["cameras"][camera] |= {"images": RIG / "frames" / camera, "fps": FPS}
    both = {camera: {"mcap": other, "topic": f"/{camera}/image"} for camera in NAMES}
    batch = pardalis.batch.run(scene, tmp_path / "images", recordings={"other": both}, frames=3, progress=False)
    assert batch.failures == {} and batch.tracked == 1


def test_only_recordings_are_replaced(recording, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(ValueError, match="--mcap .*notes.txt: exists and holds no recording of tracks"):
        pardalis.track(scene_of(recording), tmp_path / "tracks", plots=False, frames=2, mcap=tmp_path / "notes.txt")
    before = recording.read_bytes()
    with pytest.raises(ValueError, match="--mcap .*rig.mcap: exists and holds no recording of tracks"):
        pardalis.track(scene_of(recording), tmp_path / "tracks", plots=False, frames=2, mcap=recording)
    assert recording.read_bytes() == before
    assert (tmp_path / "notes.txt").read_text() == "mine"
    sizes = []
    for frames in (3, 2):
        pardalis.track(scene_of(recording), tmp_path / "tracks", plots=False, frames=frames, mcap=tmp_path / "tracks.mcap")
        sizes.append((tmp_path / "tracks.mcap").stat().st_size)
    assert sizes[1] < sizes[0]
    # Not even one of these, if the scene reads it.
    before = (tmp_path / "tracks.mcap").read_bytes()
    with pytest.raises(ValueError, match="--mcap .*tracks.mcap: is the input of cameras.cam1; choose another name"):
        pardalis.track(scene_of(tmp_path / "tracks.mcap"), tmp_path / "again", plots=False, mcap=tmp_path / "tracks.mcap")
    assert (tmp_path / "tracks.mcap").read_bytes() == before
