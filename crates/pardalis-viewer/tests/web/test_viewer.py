"""Reports and pages of finished tracks, as people see them."""

import csv
import io
import json
import math
import shutil

import pytest
from PIL import Image
from web_fixtures import REPOSITORY

HEADER = "frame,time_s,target,state,x_m,y_m,z_m,vx_mps,vy_mps,vz_mps,heading_rad,xx_m2,xy_m2,xz_m2,yy_m2,yz_m2,zz_m2,ess,confidence,vxx_m2ps2,vxy_m2ps2,vxz_m2ps2,vyy_m2ps2,vyz_m2ps2,vzz_m2ps2"
FRAMES = 24


@pytest.fixture(scope="session")
def report(pardalis, tmp_path_factory):
    """The report of a bundled sequence, with its rows."""
    folder = tmp_path_factory.mktemp("jump")
    pardalis("track", REPOSITORY / "data/dioptric-jump/scene.toml", "-o", folder, "--frames", FRAMES, "--no-plots", "--annotate", "--report")
    with open(folder / "tracks.csv") as file:
        return (folder / "report.html").as_uri(), list(csv.DictReader(file))


@pytest.fixture
def view(pardalis, tmp_path):
    """Returns the page of rows of text."""

    def make(rows, summary=None):
        (tmp_path / "tracks.csv").write_text("\n".join([HEADER, *rows]) + "\n")
        if summary is not None:
            (tmp_path / "summary.json").write_text(json.dumps(summary))
        pardalis("view", tmp_path, "--no-open")
        return (tmp_path / "view.html").as_uri()

    return make


def row(frame, target, position, state="tracking", variance=1e-4):
    """A row of tracks.csv; without a position, one of a target that is lost."""
    place = [f"{component}" for component in position] if position else [""] * 3
    velocity = ["0.5", "-0.25", "0"] if position else [""] * 3
    covariance = [f"{variance}", "0", "0", f"{variance}", "0", f"{variance}"] if position else [""] * 6
    of_velocity = ["0.04", "0", "0", "0.01", "0", "0.0025"] if position else [""] * 6
    return ",".join([f"{frame}", f"{frame / 25}", target, state if position else "lost", *place, *velocity, "", *covariance, "100", "0.9", *of_velocity])


def picture(locator):
    return Image.open(io.BytesIO(locator.screenshot())).convert("RGB")


def shown(page):
    """The positions that the page shows, in metres."""
    texts = [page.locator(f'tr[data-value="{axis}"] td').first.inner_text() for axis in "xyz"]
    return [text.replace("−", "-").removesuffix(" m") for text in texts]


def rounded(row):
    return [f"{float(row[f'{axis}_m']):.3f}" for axis in "xyz"]


def set_slider(page, index):
    page.locator(".pv-slider").evaluate("(slider, index) => { slider.value = index; slider.dispatchEvent(new Event('input')); }", index)


def settle(page):
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => requestAnimationFrame(done))))")


def test_velocities_have_two_standard_deviations(view, open_page):
    page = open_page(view([row(frame, "ball", [1, 2, 0.5]) for frame in range(3)]))
    # Of (0.5, -0.25, 0) m/s with the variances 0.04, 0.01 and 0.0025 m²/s².
    texts = [page.locator(f'tr[data-value="{axis}"] td').last.inner_text() for axis in "xyz"]
    assert texts == ["0.40", "0.20", "0.10"]
    along = math.sqrt(0.8 * 0.04 + 0.2 * 0.01)
    assert page.locator('[data-value="speed"] dd').all_inner_texts() == [f"± {2 * along:.2f}", "0.56 m/s"]


def test_a_report_shows_the_scene_and_loads_nothing(report, open_page):
    page = open_page(report[0])
    settle(page)
    # `open_page` fails at errors and requests. Background, floor, camera, trail, ball: many colours, of which the state's own.
    colors = picture(page.locator(".pv-canvas")).getcolors(1 << 20)
    assert len(colors) > 100
    blue = sum(count for count, (red, green, blue) in colors if blue > 120 and blue > 1.8 * red and green < blue)
    assert blue > 200
    assert page.locator(".pv-camera-name").inner_text() == "cam1"
    assert page.locator("h1").inner_text() == "dioptric-jump"
    assert "tracking" in page.locator('[data-value="state"]').inner_text()
    assert page.locator(".pv-image").evaluate("(image) => image.naturalWidth") == 480
    assert f"{FRAMES}" in page.locator("#summary").inner_text()
    assert page.locator(".pv-missed").count() == 0


def test_a_report_says_what_states_mean_and_why_a_target_was_missing(pardalis, tmp_path, open_page):
    scene = (REPOSITORY / "data/dioptric-jump/scene.toml").read_text()
    scene = scene.replace("../colors/orange-ball", f"{REPOSITORY}/data/colors/pink-ball").replace('"frames"', f'"{REPOSITORY}/data/dioptric-jump/frames"')
    (tmp_path / "pink.toml").write_text(scene)
    pardalis("track", tmp_path / "pink.toml", "-o", tmp_path / "out", "--frames", 6, "--no-plots", "--report")
    page = open_page((tmp_path / "out/report.html").as_uri())
    said = page.locator(".pv-missed")
    assert "ball was not found in frames 0 to 5" in said.inner_text()
    assert "in 6 of these 6 frames, nothing in the image has its colours" in said.locator("li").inner_text()
    # The floor below a camera alone is some metres wide.
    step = page.evaluate("""async () => {
        const { extentOf } = await import("pardalis/extent.js");
        return extentOf(JSON.parse(document.getElementById("data").textContent).scene, []).step;
    }""")
    assert 0.2 <= step <= 1
    page.get_by_text("What states mean").press("Enter")
    assert "searching\nnot found yet" in page.locator(".pv-meanings dl").inner_text()


def test_slider_and_keys_show_the_rows_of_their_time(report, open_page):
    address, rows = report
    page = open_page(address)
    assert shown(page) == rounded(rows[-1])
    set_slider(page, 7)
    assert shown(page) == rounded(rows[7])
    assert "frame 7" in page.locator(".pv-slider").get_attribute("aria-valuetext")
    assert page.locator('[data-value="confidence"] dd').last.inner_text() == f"{float(rows[7]['confidence']):.3f}"
    sigma_mm = 2000 * math.sqrt(float(rows[7]["xx_m2"]))
    assert page.locator('tr[data-value="x"] td').nth(1).inner_text() == f"{sigma_mm:.0f} mm"
    image = page.locator(".pv-image").get_attribute("alt")
    assert image == f"Image of cam1 at {float(rows[7]['time_s']):.3f} s"
    for key, expected in [("ArrowRight", 8), ("ArrowLeft", 7), ("Shift+ArrowRight", 17), ("Home", 0), ("ArrowLeft", 0), ("End", FRAMES - 1)]:
        page.keyboard.press(key)
        assert shown(page) == rounded(rows[expected]), key
    # The same with the slider in focus: no step is taken twice.
    page.locator(".pv-slider").focus()
    page.keyboard.press("ArrowLeft")
    assert shown(page) == rounded(rows[FRAMES - 2])


def test_keys_work_after_a_click_on_what_can_be_opened(report, open_page):
    page = open_page(report[0])
    for opened in (".pv-meanings summary", ".pv-settings summary"):
        page.locator(opened).click()
        page.keyboard.press("Home")
        assert page.locator('[data-value="time"] dd').nth(0).inner_text() == "frame 0"
        page.keyboard.press("ArrowRight")
        assert page.locator('[data-value="time"] dd').nth(0).inner_text() == "frame 1"


def test_it_plays_and_pauses(report, open_page):
    page = open_page(report[0])
    set_slider(page, 0)
    page.keyboard.press("Space")
    # Not `wait_for_function`, which the page's policy against scripts in strings forbids.
    while int(page.locator(".pv-slider").input_value()) <= 3:
        assert page.locator(".pv-play").get_attribute("aria-label") == "Pause"
        page.wait_for_timeout(50)
    page.keyboard.press("Space")
    stopped = page.locator(".pv-slider").input_value()
    page.wait_for_timeout(200)
    assert page.locator(".pv-slider").input_value() == stopped
    assert page.locator(".pv-play").get_attribute("aria-label") == "Play"


def test_keys_choose_views(report, open_page):
    page = open_page(report[0])
    settle(page)
    before = picture(page.locator(".pv-canvas")).tobytes()
    page.keyboard.press("2")
    settle(page)
    assert page.get_by_role("button", name="above").get_attribute("aria-pressed") == "true"
    assert picture(page.locator(".pv-canvas")).tobytes() != before
    page.keyboard.press("1")
    settle(page)
    assert picture(page.locator(".pv-canvas")).tobytes() == before


@pytest.mark.parametrize("width", [1000, 900, 400])
def test_narrow_windows_do_not_scroll_sideways(report, open_page, width):
    page = open_page(report[0], width=width)
    settle(page)
    # Nor do the values leave their panel.
    panel, values = (page.locator(part).first.bounding_box() for part in (".pv-panel", ".pv-vectors"))
    assert values["x"] + values["width"] <= panel["x"] + panel["width"]
    assert page.evaluate("document.documentElement.scrollWidth") == width
    canvas = page.locator(".pv-canvas").bounding_box()
    assert canvas["width"] > 0.5 * width and canvas["height"] > 300


def test_dark_mode_has_dark_paper_and_light_ink(report, open_page):
    light, dark = (open_page(report[0], dark=is_dark) for is_dark in (False, True))
    for page in (light, dark):
        settle(page)
    brightness = [sum(picture(page.locator(".pv-scene")).resize((1, 1)).getpixel((0, 0))) / 3 for page in (light, dark)]
    assert brightness[0] > 200 and brightness[1] < 60
    assert dark.evaluate("getComputedStyle(document.querySelector('.pv-facts dd:last-child')).color") == "rgb(230, 234, 240)"
    # A theme that changes while the page is open.
    light.emulate_media(color_scheme="dark")
    settle(light)
    assert sum(picture(light.locator(".pv-scene")).resize((1, 1)).getpixel((0, 0))) / 3 < 60
    dots = [page.locator('[data-value="state"] .pv-dot').evaluate("(dot) => dot.style.background") for page in (light, dark)]
    assert dots[0] == dots[1] != ""


def test_rows_without_estimates_leave_gaps(view, open_page):
    rows = [row(frame, "ball", None if 40 <= frame < 60 else (0.01 * frame, 1, 0.5)) for frame in range(100)]
    page = open_page(view(rows))
    set_slider(page, 50)
    assert shown(page) == ["–"] * 3
    assert page.locator('[data-value="state"] dd').last.inner_text() == "lost"
    # No segment of the trail, and in the plot no pixel of the line's colour.
    ends = page.evaluate(
        """async () => {
            const { Track } = await import("pardalis/tracks.js");
            const { segmentsOf } = await import("pardalis/trail.js");
            const track = new Track("ball");
            track.append(JSON.parse(document.getElementById("data").textContent).tracks.ball);
            return segmentsOf(track).rows;
        }"""
    )
    assert len(ends) == 2 * (39 + 39)
    assert not any(start < 40 <= end for start, end in zip(ends[::2], ends[1::2]))
    set_slider(page, 0)
    plot = picture(page.locator(".pv-plot .u-over").first)
    orange = [sum(1 for y in range(plot.height) if plot.getpixel((x, y))[0] - plot.getpixel((x, y))[2] > 60) for x in range(plot.width)]
    left, right = int(0.42 * plot.width), int(0.58 * plot.width)
    assert sum(orange[left:right]) == 0
    assert all(orange[x] > 0 for x in range(10, int(0.38 * plot.width)))


def test_a_page_opens_where_a_target_was_last_seen(view, open_page):
    states = {frame: "tracking" if frame < 60 else "occluded" for frame in range(10, 70)}
    rows = [row(frame, "ball", (0.01 * frame, 1, 0.5) if frame in states else None, states.get(frame, "lost")) for frame in range(100)]
    page = open_page(view(rows))
    assert shown(page) == ["0.590", "1.000", "0.500"]
    assert page.locator(".pv-slider").input_value() == "59"
    # If it was never seen, at the end.
    page = open_page(view([row(frame, "ball", None) for frame in range(10)]))
    assert page.locator(".pv-slider").input_value() == "9"


def test_a_crowd_of_fifty(view, open_page):
    rows = [row(frame, f"ball-{member}", (0.1 * member, 0.02 * frame, 0)) for frame in range(30) for member in range(1, 51) if frame < 20 or member <= 25]
    page = open_page(view(rows, {"scene": "nowhere.toml", "targets": {"ball": {"diameter_m": 0.1}}, "settings": {}}))
    assert page.locator(".pv-all tbody tr").count() == 50
    assert page.locator(".pv-strip-names button").count() == 50
    # Those that are gone have no values, and nothing is left in the view.
    assert page.locator(".pv-all tr.pv-absent").count() == 25
    settle(page)
    visible = "[...document.querySelectorAll('.pv-target-name')].filter((name) => name.style.visibility === 'visible').length"
    assert page.evaluate(visible) == 25
    page.locator(".pv-all button", has_text="ball-7").first.click()
    assert shown(page) == ["0.700", "0.580", "0.000"]
    set_slider(page, 19)
    settle(page)
    assert page.evaluate(visible) == 50


def test_a_hundred_thousand_rows(view, open_page):
    def position(frame):
        return (math.sin(frame / 1000), math.cos(frame / 1700), 0.5 + 0.4 * math.sin(frame / 300))

    # Hidden for a hundredth of the time: a few pixels of a plot, in which the line falls from top to bottom.
    rows = [row(frame, "ball", None if frame // 1000 == 80 else (math.copysign(1, 80_000 - frame) if frame > 70_000 else position(frame)[0], *position(frame)[1:])) for frame in range(100_000)]
    page = open_page(view(rows))
    plot = picture(page.locator(".pv-plot .u-over").first)
    orange = [sum(1 for y in range(plot.height) if plot.getpixel((x, y))[0] - plot.getpixel((x, y))[2] > 60) for x in range(plot.width)]
    hidden = int(0.80 * plot.width)
    assert min(orange[hidden : hidden + 6]) == 0 and max(orange[hidden - 10 : hidden + 16]) < 12
    assert page.locator(".pv-slider").get_attribute("max") == "99999"
    set_slider(page, 54_321)
    assert shown(page) == [f"{math.sin(54.321):.3f}", f"{math.cos(54321 / 1700):.3f}", f"{0.5 + 0.4 * math.sin(54321 / 300):.3f}"]
    # Each trail has a bounded number of points, with both ends of the track.
    ends = page.evaluate(
        """async () => {
            const { Track } = await import("pardalis/tracks.js");
            const { segmentsOf } = await import("pardalis/trail.js");
            const track = new Track("ball");
            track.append(JSON.parse(document.getElementById("data").textContent).tracks.ball);
            const { rows } = segmentsOf(track);
            return [rows.length, rows[0], rows.at(-1)];
        }"""
    )
    assert 10_000 < ends[0] <= 20_000 and ends[1:] == [0, 99_999]


def test_without_webgl_there_are_numbers_and_plots(report, open_page):
    address, rows = report
    without = "const get = HTMLCanvasElement.prototype.getContext; HTMLCanvasElement.prototype.getContext = function (kind, ...more) { return kind.startsWith('webgl') ? null : get.call(this, kind, ...more); };"
    page = open_page(address, before=without)
    assert "no WebGL" in page.locator(".pv-scene").inner_text()
    assert page.locator(".pv-canvas").count() == 0
    set_slider(page, 3)
    assert shown(page) == rounded(rows[3])
    assert page.locator(".pv-plot canvas").count() == 7


def test_hostile_names_stay_names(view, open_page):
    name = '<img src=x onerror=document.title="owned">'
    summary = {"scene": f"/tmp/</script><script>document.title='owned'</script>{name}.toml", "targets": {name: {"diameter_m": 0.1, "rows": {}}}, "error": name, "settings": {name: name}}
    page = open_page(view([row(frame, name, (0, frame, 0)) for frame in range(3)], summary))
    settle(page)
    assert page.locator(".pv-target-name").inner_text() == name
    assert name in page.locator("#summary").inner_text()
    assert page.locator("#viewer img[src=x], #summary img").count() == 0
    assert page.title() != "owned"


@pytest.fixture
def compare(pardalis, tmp_path):
    """Returns the page of two runs, each rows of text."""

    def make(first, second):
        for name, rows in (("first", first), ("second <b>", second)):
            (tmp_path / name).mkdir()
            (tmp_path / name / "tracks.csv").write_text("\n".join([HEADER, *rows]) + "\n")
        pardalis("view", tmp_path / "first", tmp_path / "second <b>", "--no-open")
        return (tmp_path / "first/comparison.html").as_uri()

    return make


def cells(page, row):
    return page.locator(".pv-comparison tbody tr").nth(row).locator("td").all_inner_texts()


def test_two_runs_lie_over_each_other(compare, open_page):
    # The second begins later, goes on for longer, and loses the ball for a while.
    first = [row(frame, "ball", (0.01 * frame, 1, 0.5)) for frame in range(100)]
    second = [row(frame, "ball", None if 40 <= frame < 60 else (0.01 * frame, 1 + 0.001 * frame, 0.5), variance=4e-4) for frame in range(10, 120)]
    page = open_page(compare(first, second), width=900)
    settle(page)
    assert page.evaluate("document.documentElement.scrollWidth") == 900
    assert page.locator("h1").inner_text() == "first and second <b>"
    assert cells(page, 0) == ["100", "0", "0", "0", "0.900", "17 mm"]
    assert cells(page, 1) == ["90", "0", "20", "0", "0.900", "35 mm"]
    assert cells(page, 2) == ["−10", "0", "+20", "0", "0.000", "+17 mm"]
    distance = page.locator(".pv-distance").inner_text()
    assert "largest 99 mm at 3.960 s" in distance and "of 70 times" in distance
    # Both are named where their lines are explained.
    assert [text.strip() for text in page.locator(".pv-legend span").all_inner_texts()[-2:]] == ["first", "second <b>"]
    # One slider for both: the times of the first, and those that it lacks.
    assert page.locator(".pv-slider").get_attribute("max") == "119"
    page.locator(".pv-distance button").click()
    assert page.locator(".pv-time").inner_text() == "3.960 s"
    apart = page.locator('[data-value="runs apart"] dd').last
    assert apart.inner_text() == "99 mm"
    y = page.locator(".pv-plot", has=page.get_by_text("y", exact=True)).locator(".pv-plot-value")
    assert y.inner_text() == "1.000 · 1.099"
    set_slider(page, 50)
    assert apart.inner_text() == "–"
    assert y.inner_text() == "1.000 · –"
    # Each run in its colour; the line of the second has gaps between its dashes, and none where it is lost.
    set_slider(page, 119)
    settle(page)
    plot = picture(page.locator(".pv-plot", has=page.get_by_text("y", exact=True)).locator(".u-over"))

    def columns(is_color):
        return [any(is_color(*plot.getpixel((x, y))) for y in range(plot.height)) for x in range(plot.width - 4)]

    blue = columns(lambda red, green, blue: blue > 120 and red < 90)
    orange = columns(lambda red, green, blue: red > 170 and blue < 90)
    left, right = int(0.36 * plot.width), int(0.48 * plot.width)
    assert all(blue[left:right]) and not any(orange[left:right])
    dashed = orange[int(0.6 * plot.width) : int(0.95 * plot.width)]
    assert 0.4 < sum(dashed) / len(dashed) < 0.9
    colors = picture(page.locator(".pv-canvas")).getcolors(1 << 20)
    for is_color in (lambda red, green, blue: blue > 120 and blue > 1.8 * red, lambda red, green, blue: red > 150 and red > 1.8 * blue):
        assert sum(count for count, color in colors if is_color(*color)) > 100
    # Both states, one below the other.
    assert page.locator(".pv-strip-names button").all_inner_texts() == ["ball", "ball"]


def test_times_of_another_clock_are_matched_to_the_nearest(compare, open_page):
    def shifted(frame):
        return row(frame, "ball", (0.01 * frame, 1, 0.5)).replace(f",{frame / 25},", f",{frame / 25 + 0.013},")

    page = open_page(compare([row(frame, "ball", (0.01 * frame, 1, 0.5)) for frame in range(50)], [shifted(frame) for frame in range(50)]))
    assert page.locator(".pv-slider").get_attribute("max") == "49"
    x = page.locator(".pv-plot", has=page.get_by_text("x", exact=True)).locator(".pv-plot-value")
    assert x.inner_text() == "0.490 · 0.490"
    # As far apart as it moves in 13 ms.
    assert "median 3.2 mm" in page.locator(".pv-distance").inner_text()


def test_a_comparison_can_be_taken_away(compare, open_page):
    page = open_page(compare([row(frame, "ball", (frame, 1, 0)) for frame in range(9)], [row(frame, "ball", (frame, 2, 0)) for frame in range(9)]))
    page.evaluate(
        """async () => {
            const { Viewer } = await import("pardalis/viewer.js");
            const { tracks, comparison } = JSON.parse(document.getElementById("data").textContent);
            document.body.innerHTML = "<div id=live></div>";
            window.live = new Viewer(document.getElementById("live"));
            live.setTracks(tracks);
            live.setComparison(comparison);
        }"""
    )
    settle(page)
    assert page.locator(".pv-comparison").is_visible()
    assert page.evaluate("live.stage.bodies[1].get('ball').trail.lines[0].geometry.attributes.instanceStart.count") == 8
    page.evaluate("live.setTime(0.1)")
    page.evaluate("live.setComparison(null)")
    settle(page)
    assert page.locator(".pv-comparison").is_hidden()
    assert page.locator(".pv-strip-names button").count() == 1
    assert page.locator(".pv-time").inner_text() == "0.080 s"
    assert page.evaluate("live.stage.bodies[1].size") == 0


LIVE = """async () => {
    const { Viewer } = await import("pardalis/viewer.js");
    document.body.innerHTML = "<div id=live></div>";
    window.live = new Viewer(document.getElementById("live"));
    window.rows = (from, count) => ({ ball: { time_s: Array.from({ length: count }, (_, i) => (from + i) / 10), frame: Array.from({ length: count }, (_, i) => from + i),
        state: Array(count).fill("tracking"), x_m: Array.from({ length: count }, (_, i) => from + i), y_m: Array(count).fill(0), z_m: Array(count).fill(null) } });
}"""


def test_cameras_that_move_are_where_they_were_also_live(pardalis, tmp_path, open_page):
    pardalis("track", REPOSITORY / "data/dioptric-moving-robot/scene.toml", "-o", tmp_path, "--frames", 40, "--no-plots")
    pardalis("view", tmp_path, "--no-open")
    page = open_page((tmp_path / "view.html").as_uri())
    page.evaluate(
        """async () => {
            const { Viewer } = await import("pardalis/viewer.js");
            window.data = JSON.parse(document.getElementById("data").textContent);
            document.body.innerHTML = "<div id=live></div>";
            window.live = new Viewer(document.getElementById("live"));
            window.camera = () => [live.stage.cameras[0].group.position.toArray(), live.stage.cameras[0].group.quaternion.toArray()].flat();
            live.setScene(data.scene);
            live.setTracks(data.tracks);
        }"""
    )
    settle(page)
    with open(tmp_path / "cameras.csv") as file:
        poses = [[float(row[name]) for name in ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")] for row in csv.DictReader(file)]
    assert math.dist(poses[39][:3], poses[0][:3]) > 0.1
    for index in (39, 0, 20):
        page.evaluate(f"live.setTime({index / 25})")
        assert page.evaluate("camera()") == pytest.approx(poses[index], abs=1e-9)
    label = page.locator(".pv-camera-name")
    settle(page)
    before = label.bounding_box()
    page.evaluate("live.setTime(1.56)")
    settle(page)
    assert abs(label.bounding_box()["x"] - before["x"]) > 3
    # Live: rows and poses come bit by bit, into a scene that knows no pose yet.
    page.evaluate(
        """() => {
            const cameras = data.scene.cameras.map(({ name, border_rays }) => ({ name, border_rays }));
            const { path } = data.scene.cameras[0];
            const part = (from, to) => Object.fromEntries(Object.entries(data.tracks.ball).map(([column, values]) => [column, values.slice(from, to)]));
            live.setTracks({});
            live.setScene({ ...data.scene, cameras });
            window.come = (from, to) => live.append({ ball: part(from, to) }, { cam1: path.slice(from, to) });
        }"""
    )
    settle(page)
    assert label.count() == 0
    for begin, end in ((0, 10), (10, 40)):
        page.evaluate(f"come({begin}, {end})")
        settle(page)
        assert label.is_visible()
        assert page.evaluate("camera()") == pytest.approx(poses[end - 1], abs=1e-9)
        assert page.evaluate("live.stage.cameras[0].line.geometry.attributes.position.count") == 2 * (end - 1)
    page.evaluate("live.setTime(0.2)")
    assert page.evaluate("camera()") == pytest.approx(poses[5], abs=1e-9)


def test_guesses_are_named_beside_what_follows_from_them(pardalis, tmp_path, open_page):
    pardalis("init", REPOSITORY / "data/dioptric-jump/frames", "--camera", "pinhole", "--fps", 25, "--colors", tmp_path / "ball.colors.toml", "-o", tmp_path / "scene.toml")
    shutil.copy(REPOSITORY / "data/colors/orange-ball.hsi.colors.toml", tmp_path / "ball.colors.toml")
    pardalis("track", tmp_path / "scene.toml", "-o", tmp_path / "out", "--frames", 5, "--no-plots", "--report")
    page = open_page((tmp_path / "out/report.html").as_uri())
    expected = "Positions are only as right as these guesses: the pose of camera, the lens of camera, the size of ball."
    assert page.locator(".pv-guesses").inner_text() == expected


def test_scenes_without_guesses_name_none(report, open_page):
    assert not open_page(report[0]).locator(".pv-guesses").is_visible()


def test_live_rows_are_followed_until_the_user_goes_back(report, open_page):
    page = open_page(report[0])
    page.evaluate(LIVE)
    time = page.locator("#live .pv-time")
    page.evaluate("live.append(rows(0, 5))")
    assert time.inner_text() == "0.400 s"
    page.evaluate("live.setScene({ title: 'live', cameras: [], targets: [{ name: 'ball', shape: { kind: 'box', size_m: [1, 2, 3] } }] })")
    page.evaluate("live.append(rows(5, 5))")
    assert time.inner_text() == "0.900 s"
    page.evaluate("live.setTime(0.25)")
    assert time.inner_text() == "0.200 s"
    page.evaluate("live.append(rows(10, 5))")
    assert time.inner_text() == "0.200 s"
    page.get_by_role("button", name="newest").click()
    page.evaluate("live.append(rows(15, 1))")
    assert time.inner_text() == "1.500 s"
    settle(page)
    page.evaluate("live.dispose()")
    assert page.locator("#live").inner_html() == ""
    page.keyboard.press("ArrowLeft")


def test_times_that_count_from_1970_are_shown_from_the_first_on(view, open_page):
    begun_s = 1_795_806_713
    rows = [row(frame, "ball", (0.01 * frame, 1, 0.5)).split(",") for frame in range(50)]
    for cells in rows:
        cells[1] = f"{begun_s + 0.25 + float(cells[1]):.6f}"
    page = open_page(view([",".join(cells) for cells in rows]))
    set_slider(page, 25)
    assert page.locator('[data-value="time"] dd').last.inner_text() == "1.250 s"
    assert page.locator(".pv-timeline").inner_text().endswith("1.250 s")
    assert page.locator(".pv-origin").inner_text() == "0 s is 2026-11-27 19:11:53 UTC"
    ticks = page.evaluate("""async () => {
        const { timeTick } = await import("pardalis/format.js");
        return [0.2, 0.4].map((offset) => timeTick(1795806713 + offset, 1795806713.4 - 1795806713.2));
    }""")
    assert ticks == ["0.2 s", "0.4 s"]
