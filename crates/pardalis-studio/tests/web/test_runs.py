"""Runs of the studio, one after another: replay, another setting, and the comparison of both.

`scripts/web-test` runs it, with the fixtures of `web_fixtures.py` and `studio_fixtures.py`.
"""

import csv
import json
import math
import re

import pytest
from playwright.sync_api import expect
from studio_fixtures import DATA, frames_of, run, truth_of, until


@pytest.fixture
def jump(tmp_path):
    """A folder with a scene of a thrown ball, whose images are elsewhere."""
    scene = (DATA / "dioptric-jump/scene.toml").read_text()
    scene = scene.replace('"frames"', f'"{DATA / "dioptric-jump/frames"}"').replace("../colors", str(DATA / "colors"))
    (tmp_path / "scene.toml").write_text(scene)
    return tmp_path


def listen(page):
    """Keeps the messages that the page gets, as it gets them."""
    page.evaluate(
        """async () => {
            const { Live } = await import("/connection.js");
            window.seen = new Map();
            new Live((topic, value, image) => { window.seen.set(topic, value); image?.close(); }, () => {});
        }"""
    )


def track(page):
    page.click("#start")
    expect(page.locator("#start")).to_be_hidden()
    expect(page.locator("#report")).to_contain_text("processed 110 frames")


def replay_at(page, frame, count=110):
    page.locator("#replay-frame").evaluate("(slider, frame) => { slider.value = frame; slider.dispatchEvent(new Event('input')); }", frame)
    expect(page.locator("#replay .number-of-frame")).to_have_text(f"{frame} / {count - 1}")


def outlines(page, frame, count=110):
    """The outlines over a frame of the replay, by their colours: the middle and the radius in pixels."""
    replay_at(page, frame, count)
    until(lambda: page.evaluate("window.seen.get('image/cam1').index") == frame)
    found = {}
    for mark in page.evaluate("window.seen.get('image/cam1').marks"):
        points = mark["points_px"]
        middle = [sum(point[axis] for point in points) / len(points) for axis in range(2)]
        found[tuple(mark["color"])] = (middle, sum(math.dist(point, middle) for point in points) / len(points))
    return found


def rows_of(folder):
    with open(folder / "tracks.csv") as file:
        return list(csv.DictReader(file))


def test_a_setting_is_changed_and_both_runs_are_compared(studio, jump):
    one = studio("scene.toml", folder=jump)
    page = one.page
    listen(page)
    one.step("track")
    track(page)
    # Replay: every frame with the outline where the ball is.
    truth = truth_of("dioptric-jump")
    for frame in (100, 40, 0):
        ((middle, _),) = outlines(page, frame).values()
        assert math.dist(middle, [float(truth[frame]["u_px"]), float(truth[frame]["v_px"])]) < 2
        # And its values beside it.
        row = rows_of(jump / "scene-tracks")[frame]
        expect(page.locator("#now")).to_contain_text(f"Frame {frame}, ")
        cells = page.locator("[data-target=ball] td")
        expect(cells.nth(0)).to_have_text(f"{float(row['x_m']):.3f}")
        expect(cells.nth(1)).to_have_text(f"± {2000 * math.sqrt(float(row['xx_m2'])):.0f} mm")
    # It plays by itself, from the beginning once it has come to the end.
    replay_at(page, 109)
    page.click("#replay-play")
    expect(page.locator("#replay-play")).to_contain_text("Pause")
    expect(page.locator("#replay .number-of-frame")).to_have_text(re.compile(r"^[1-9]\d? / 109"))
    page.click("#replay-play")
    expect(page.locator("#replay-play")).to_contain_text("Replay")
    # From where the bar stands, whatever frame another step has shown.
    replay_at(page, 100)
    one.step("targets")
    one.step("track")
    expect(page.locator("#replay .number-of-frame")).to_have_text("109 / 109")
    page.click("#replay-play")
    expect(page.locator("#replay .number-of-frame")).to_have_text(re.compile(r"^[1-9]\d? / 109"))
    page.click("#replay-play")
    expect(page.locator("#replay-play")).to_contain_text("Replay")
    # The other view does not disturb it.
    replay_at(page, 30)
    page.click("#show-viewer")
    expect(page.locator("#viewer canvas").first).to_be_visible()
    page.click("#show-pictures")
    replay_at(page, 31)
    expect(page.locator("#now")).to_contain_text("Frame 31, ")
    # And by keys.
    page.locator("#replay-frame").focus()
    page.keyboard.press("Home")
    page.keyboard.press("ArrowRight")
    expect(page.locator("#replay .number-of-frame")).to_have_text("1 / 109")
    # Nothing to compare with yet. Another seed, another size: edits of the scene, which can be undone.
    expect(page.locator("#compare-with")).to_be_hidden()
    page.click("#settings summary")
    page.fill("#seed", "7")
    page.keyboard.press("Tab")
    expect(page.locator("#undo")).to_have_attribute("title", re.compile("seed 7"))
    page.fill("#run-diameter-ball", "20")
    page.keyboard.press("Tab")
    until(lambda: "radius_m = 0.1\n" in one.ask("state")["text"])
    first = rows_of(jump / "scene-tracks")
    track(page)
    # The earlier run is kept, and both lie over each other.
    assert rows_of(jump / "scene-tracks/earlier/1") == first
    expect(page.locator("#compare-with option:checked")).to_have_text("run 1: seed 1, radius_m 0.11")
    comparison = page.locator("#viewer .pv-comparison")
    # From the earlier to the last.
    expect(comparison.locator("tbody th").nth(0)).to_have_text("run 1")
    expect(comparison.locator("tbody th").nth(1)).to_have_text("run 2")
    expect(comparison).to_contain_text("targets.ball.shape.sphere.radius_m 0.11 → 0.1")
    confidences = [float(row["confidence"]) for row in rows_of(jump / "scene-tracks")], [float(row["confidence"]) for row in first]
    means = [sum(values) / len(values) for values in confidences]
    expect(comparison.locator("tbody tr").nth(2).locator("td").nth(4)).to_have_text(re.compile(rf"^.?{abs(means[0] - means[1]):.3f}$"))
    second = rows_of(jump / "scene-tracks")
    apart = sorted(math.dist([float(a[f"{axis}_m"]) for axis in "xyz"], [float(b[f"{axis}_m"]) for axis in "xyz"]) for a, b in zip(first, second))
    expect(comparison.locator(".pv-distance")).to_contain_text(f"median {1000 * (apart[54] + apart[55]) / 2:.0f} mm, largest {1000 * apart[-1]:.0f} mm")
    # A smaller ball that looks as large is nearer to the camera.
    assert apart[0] > 0.1
    # Both are in the plots, although the rows of the last run came after the comparison.
    for value in page.locator("#viewer .pv-plot").filter(has_text="m)").all():
        expect(value).to_contain_text(re.compile(r"\d\.\d+ · .?\d\.\d+"))
    # The same figures as `pardalis view` of the two folders.
    page.click("#write-comparison")
    expect(page.locator("#messages")).to_contain_text("Written to scene-tracks/comparison.html")
    written = jump / "scene-tracks/comparison.html"
    by_studio = written.read_bytes()
    written.unlink()
    # It is that of the command line.
    run("view", "scene-tracks", "scene-tracks/earlier/1", "--no-open", folder=jump)
    assert written.read_bytes() == by_studio
    data = (jump / "scene-tracks/comparison.html").read_text().split('id="data">')[1].split("</script>")[0]
    shown = one.ask("compare", {"run": 1})
    written_comparison = json.loads(data)["comparison"]
    assert shown["targets"] == written_comparison["targets"]
    # Changes are from the earlier run to the last, as in the studio.
    assert written_comparison["other_is_earlier"] and shown["other_is_earlier"]
    assert written_comparison["names"] == ["scene-tracks", "scene-tracks/earlier/1"]
    page.set_viewport_size({"width": 900, "height": 700})
    assert page.evaluate("document.documentElement.scrollWidth") == 900
    page.set_viewport_size({"width": 1280, "height": 800})
    # In the replay both outlines lie on the ball, each in its size.
    page.click("#show-pictures")
    both = outlines(page, 60)
    assert set(both) == {(255, 255, 255), (255, 138, 76)}
    for middle, radius in both.values():
        assert math.dist(middle, [float(truth[60]["u_px"]), float(truth[60]["v_px"])]) < 2
        assert 4 < radius < 12
    radii = [radius for _, radius in both.values()]
    assert abs(radii[0] - radii[1]) < 0.3
    # And it can be taken away.
    page.select_option("#compare-with", "")
    until(lambda: len(outlines(page, 61)) == 1)
    page.click("#show-viewer")
    expect(page.locator("#viewer")).to_contain_text("tracking")
    expect(page.locator("#viewer .pv-comparison")).to_be_hidden()
    # The settings of the first run again give its rows, byte for byte.
    page.click("#undo")
    page.click("#undo")
    expect(page.locator("#undo")).to_be_disabled()
    kept = written.read_bytes()
    track(page)
    assert rows_of(jump / "scene-tracks") == first
    # The page of the comparison may have been sent to somebody: it goes with its run.
    assert (jump / "scene-tracks/earlier/2/comparison.html").read_bytes() == kept
    expect(page.locator("#compare-with option")).to_have_count(3)



def test_the_track_of_a_recording_is_smoothed(studio, jump):
    one = studio("scene.toml", folder=jump)
    page = one.page
    one.step("track")
    track(page)
    filtered = rows_of(jump / "scene-tracks")
    expect(page.locator("#smoothed")).to_be_hidden()
    page.check("#smooth")
    page.check("#page")
    track(page)
    expect(page.locator("#report")).to_contain_text("scene-tracks/report.html")
    report = (jump / "scene-tracks/report.html").read_text()
    assert report.count("data:image/jpeg") > 50
    expect(page.locator("#smoothed")).to_be_visible()
    smoothed = rows_of(jump / "scene-tracks")
    # As with `track --smooth`.
    run("track", "scene.toml", "--smooth", "-o", "out", "--no-plots", folder=jump)
    assert smoothed == rows_of(jump / "out")
    assert smoothed != filtered
    with open(jump / "scene-tracks/filtered.csv") as file:
        assert list(csv.DictReader(file)) == filtered
    # The comparison with the run before says so, and all that is shown is smoothed.
    expect(page.locator("#compare-with option:checked")).to_have_text("run 1: smoothed not set")
    def furthest(row):
        return math.dist([float(smoothed[row][f"{axis}_m"]) for axis in "xyz"], [float(filtered[row][f"{axis}_m"]) for axis in "xyz"])
    frame = max(range(110), key=furthest)
    assert furthest(frame) > 0.002
    page.locator("#viewer .pv-slider").evaluate("(slider, index) => { slider.value = index; slider.dispatchEvent(new Event('input')); }", frame)
    for axis in "xyz":
        shown = page.locator(f'#viewer tr[data-value="{axis}"] td').first
        expect(shown).to_contain_text(f"{float(smoothed[frame][f'{axis}_m']):.3f}".replace("-", "−"))
    last = page.locator("[data-target=ball] td").nth(1)
    expect(last).to_have_text(f"± {2000 * math.sqrt(float(smoothed[-1]['xx_m2'])):.0f} mm")
    page.click("#show-pictures")
    replay_at(page, frame)
    expect(page.locator("#now")).to_contain_text(f"Frame {frame}, ")
    expect(page.locator("[data-target=ball] td").nth(0)).to_have_text(f"{float(smoothed[frame]['x_m']):.3f}")
    # The page of an earlier run is kept with it.
    page.uncheck("#smooth")
    page.uncheck("#page")
    track(page)
    assert (jump / "scene-tracks/earlier/2/report.html").read_text() == report
    assert not (jump / "scene-tracks/report.html").exists()


def test_the_replay_shows_what_was_examined_and_why_it_was_ruled_out(studio, jump):
    # A pole is looked for, and there is a ball.
    scene = (jump / "scene.toml").read_text().replace("shape.sphere.radius_m = 0.11", "shape.cylinder = { radius_m = 0.02, height_m = 2.0 }")
    (jump / "scene.toml").write_text(scene)
    one = studio("scene.toml", folder=jump)
    page = one.page
    listen(page)
    one.step("track")
    page.click("#start")
    expect(page.locator("#report")).to_contain_text("was not found in any of the 110 frames")
    # The last frame, as the run left it.
    expect(page.locator("#reasons li")).not_to_have_count(0)
    with open(jump / "scene-tracks/candidates.csv") as file:
        candidates = [row for row in csv.DictReader(file) if row["verdict"] != "same-place" and row["origin"] == "blob"]
    for frame in (10, 60):
        replay_at(page, frame)
        until(lambda: page.evaluate("window.seen.get('image/cam1').index") == frame)
        notes = page.evaluate("window.seen.get('image/cam1').notes")
        examined = [row for row in candidates if int(row["frame"]) == frame]
        assert len(examined) > 0
        for row in examined:
            at = [float(row["u_px"]), float(row["v_px"])]
            assert any(note["text"] == row["verdict"] and math.dist(note["at_px"], at) < 0.1 for note in notes), (row, notes)
            expect(page.locator("#reasons")).to_contain_text(row["verdict"])
        expect(page.locator("#now")).to_contain_text("in its colours")


def test_a_run_right_after_a_change_is_compared_with_the_one_before(studio, jump):
    one = studio("scene.toml", folder=jump)
    page = one.page
    one.step("track")
    track(page)
    page.click("#settings summary")
    for seed in (7, 8):
        # The edit is on its way when the button is pressed.
        page.fill("#seed", str(seed))
        track(page)
        expect(page.locator("#compare-with option:checked")).to_contain_text(f"seed {1 if seed == 7 else 7}")
        expect(page.locator("#viewer .pv-comparison")).to_contain_text("change")
    expect(page.locator(".message.error")).to_have_count(0)


def test_wrong_settings_and_runs_are_refused_with_their_remedy(studio, jump):
    one = studio("scene.toml", folder=jump)
    page = one.page
    before = one.ask("state")["text"]
    one.step("track")
    track(page)
    # What was opened stays open, even if the page changes at once.
    page.locator("#settings").evaluate(
        """(settings) => {
            settings.querySelector("summary").click();
            const seed = settings.querySelector("#seed");
            seed.value = "1.5";
            seed.dispatchEvent(new Event("change"));
        }"""
    )
    expect(page.locator("#messages")).to_contain_text("Type a whole number.")
    expect(page.locator("#particles-ball")).to_be_visible()
    page.fill("#particles-ball", "0")
    page.keyboard.press("Tab")
    expect(page.locator("#messages")).to_contain_text("targets.ball.filter.particles: ")
    # Fields show again what holds.
    expect(page.locator("#seed")).to_have_value("1")
    expect(page.locator("#particles-ball")).not_to_have_value("0")
    errors = {
        "set_number": ({"key": "cameras.cam1.size_px", "value": 3}, "allowed: seed, targets.NAME.filter.particles, cameras.NAME.fps"),
        "set_number  ": ({"key": "cameras.other.fps", "value": 3}, "cameras.other: is not in the scene"),
        "set_number   ": ({"key": "seed", "value": 1.5}, "seed: 1.5 is no whole number"),
        "set_number ": ({"key": "targets.cube.filter.particles", "value": 3}, "targets.cube: is not in the scene"),
        "compare": ({"run": 8}, "run 8: is not kept any more"),
        "track": ({"record": True}, "no camera is live: what there is to be tracked is recorded already"),
        "use_recording": ({}, "there is no recording yet"),
    }
    for request, (value, remedy) in errors.items():
        assert remedy in one.ask(request.strip(), value)["error"], request
    assert one.ask("state")["text"] == before
    # Requests that are refused are errors on the console of the browser.
    one.errors.clear()


def test_a_camera_on_a_robot_moves_in_the_view_and_under_its_outlines(studio, tmp_path):
    sequence = DATA / "dioptric-moving-robot"
    scene = (sequence / "scene.toml").read_text().replace("../colors", str(DATA / "colors"))
    for name in ("frames", "camera.json", "odometry.csv"):
        scene = scene.replace(f'"{name}"', f'"{sequence / name}"')
    (tmp_path / "scene.toml").write_text(scene)
    one = studio("scene.toml")
    page = one.page
    listen(page)
    one.step("track")
    page.click("#start")
    expect(page.locator("#report")).to_contain_text("processed 100 frames")
    assert len(one.ask("rows", {"from": 0})["cameras"]["cam1"]) == 100
    assert len(one.ask("rows", {"from": 60})["cameras"]["cam1"]) == 40
    truth = truth_of("dioptric-moving-robot")
    for frame in (90, 10):
        ((middle, _),) = outlines(page, frame, 100).values()
        assert math.dist(middle, [float(truth[frame]["u_px"]), float(truth[frame]["v_px"])]) < 3
    page.click("#show-viewer")
    label = page.locator("#viewer .pv-camera-name")
    expect(label).to_be_visible()
    end = label.bounding_box()
    page.keyboard.press("Home")
    expect(page.locator("#viewer .pv-time")).to_have_text("0.000 s")
    until(lambda: abs(label.bounding_box()["x"] - end["x"]) > 20)


def test_a_live_camera_is_recorded_and_tracked_again(studio, jump, streams):
    address = streams(*frames_of("dioptric-jump/frames")).address
    scene = (jump / "scene.toml").read_text()
    scene = re.sub('images = .*\\nfps = 25', f'video = "{address}"\ntime_offset_s = 0.5', scene)
    (jump / "scene.toml").write_text(scene)
    one = studio("scene.toml", folder=jump)
    page = one.page
    listen(page)
    one.step("track")
    page.check("#record")
    page.click("#start")
    # How much there is shows while it grows.
    expect(page.locator("#recorded")).to_have_text(re.compile(r"Recorded (4\d|[5-9]\d|\d{3}) images, \d+\.\d MB"))
    assert "null" not in page.locator("#now").inner_text()
    page.click("#stop")
    expect(page.locator("#report")).to_contain_text("ball:")
    folder = jump / "scene-recording/1/cam1"
    images = sorted(path.name for path in folder.glob("*.jpg"))
    live = rows_of(jump / "scene-tracks")
    # On a machine with other work, some images may come too fast.
    recording = one.ask("state")["run"]["recording"]
    assert recording["images"] == len(images) > 40
    assert recording["images"] + recording["dropped"] == len(live)
    assert recording["bytes"] == sum(path.stat().st_size for path in folder.glob("*.jpg"))
    # The times are those of the camera, without what the scene adds.
    with open(folder / "times.csv") as file:
        times = [float(row["time_s"]) + 0.5 for row in csv.DictReader(file)]
    at = [round(float(row["time_s"]), 6) for row in live]
    assert len(times) == len(images) and all(round(time_s, 6) in at for time_s in times)
    # The recording takes the place of the camera, and is tracked with nearly the same rows.
    page.click("#use-recording")
    expect(page.locator("#record")).to_be_hidden()
    assert 'images = "scene-recording/1/cam1"' in one.ask("state")["text"]
    page.click("#start")
    expect(page.locator("#compare-with option:checked")).to_contain_text("run 1")
    again = rows_of(jump / "scene-tracks")
    assert len(again) == len(images)
    distance = page.locator("#viewer .pv-distance")
    expect(distance).to_contain_text("times")
    shown = one.ask("compare", {"run": 1})["targets"]["ball"]
    # Not where one of both has not found it yet.
    assert 0.5 * len(images) < shown["distance"]["times"] <= len(images)
    assert shown["distance"]["median_m"] < 0.05
    # And replayed.
    page.click("#show-pictures")
    assert len(outlines(page, 5, len(images))) == 2
    # Undo goes back to the camera.
    page.click("#undo")
    expect(page.locator("#record")).to_be_visible()
    assert (jump / "scene.toml").read_text() == one.ask("state")["text"]
    page.click("#start")
    expect(page.locator("#recorded")).to_have_text(re.compile(r"Recorded [1-9]\d* images"))
    page.click("#stop")
    expect(page.locator("#report")).to_contain_text("ball:")
    assert (jump / "scene-recording/2/cam1/000000.jpg").exists()
    # A live run has no times in common with those before.
    assert one.ask("state")["run"]["earlier"] == []
    expect(page.locator("#compare-with")).to_be_hidden()
