"""Shows cameras, images and tracks in Rerun (https://rerun.io), while they are computed or afterwards.

It needs the package rerun-sdk: `pip install rerun-sdk`.

    import rerun
    import pardalis.rerun

    rerun.init("pardalis", spawn=True)                     # or rerun.init("pardalis") and rerun.save("ball.rrd")
    rerun.send_blueprint(pardalis.rerun.blueprint({"cam1": camera}))
    pardalis.rerun.log_camera("cam1", camera)
    ...
    tracker.observe({"cam1": image}, time_s)               # for each image
    pardalis.rerun.log_images({"cam1": image}, time_s)
    pardalis.rerun.log_estimate("ball", tracker.estimate("ball"))

Everything is logged at its time on the timeline `time`, in seconds, into Rerun's current recording, or into `recording`. The world is
the entity `world`, in metres, with z up.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._pardalis import Camera, Estimate
from ._program import Tracks

try:
    import rerun as rr
    import rerun.blueprint as rrb
except ImportError as error:
    raise ImportError("pardalis.rerun needs the package rerun-sdk: pip install rerun-sdk") from error

__all__ = ["blueprint", "log_camera", "log_estimate", "log_images", "log_tracks"]

_TIMELINE = "time"
# How long the rays of cameras that are no pinholes are drawn.
_VIEW_M = 0.3
# Ellipsoids reach this many standard deviations.
_SIGMAS = 2.0
# Rerun takes negative radii for points on the screen.
_POINT = -3.0
_TRAIL_ROWS = 50
# Where the target is seen, and where its place is only predicted.
_SEEN, _PREDICTED = (255, 130, 0), (160, 160, 160)
# Pixels that are tried from the middle of an image to its border.
_STEPS = 100


class _Row(Protocol):
    """What is logged of a target at one time: an `Estimate`, or a row of tracks."""

    @property
    def time_s(self) -> float: ...
    @property
    def state(self) -> str: ...
    @property
    def confidence(self) -> float: ...
    @property
    def position_m(self) -> NDArray[np.float64] | None: ...
    @property
    def velocity_mps(self) -> NDArray[np.float64] | None: ...
    @property
    def covariance_m2(self) -> NDArray[np.float64] | None: ...
    @property
    def radius_m(self) -> float | None: ...


@dataclass(frozen=True)
class _TrackRow:
    time_s: float
    state: str
    confidence: float
    position_m: NDArray[np.float64] | None
    velocity_mps: NDArray[np.float64] | None
    covariance_m2: NDArray[np.float64] | None
    radius_m: float | None


def blueprint(cameras: Mapping[str, Camera]) -> rrb.Blueprint:
    """Return a layout for `rerun.send_blueprint`: space, the images of the cameras, confidences and states."""
    space, images = ["world/**"], []
    for name, camera in cameras.items():
        path = f"{_camera(name)}/image"
        is_pinhole = camera.model == "pinhole"
        images.append(rrb.Spatial2DView(origin=path, contents=["$origin/**"] + ["world/targets/**"] * is_pinhole, name=name))
        if not is_pinhole:
            # Rerun cannot place its image in space.
            space.append(f"- {path}")
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(
                rrb.Spatial3DView(origin="world", contents=space, name="space"),
                rrb.Vertical(contents=images),
                column_shares=[2, 1],
            ),
            rrb.Horizontal(
                rrb.TimeSeriesView(origin="targets", name="confidence", axis_y=rrb.ScalarAxis(range=(0, 1.05))),
                rrb.TextLogView(origin="targets", name="state"),
                column_shares=[2, 1],
            ),
            row_shares=[3, 1],
        ),
    )


def log_camera(name: str, camera: Camera, *, recording: rr.RecordingStream | None = None) -> None:
    """Log a camera that stands still: its pose, and what it sees.

    A pinhole camera has its image in space, and what lies in space is drawn over its image. Rerun knows no distortion: with a distorted
    lens, what is drawn is off by it. Of other lenses, the rays of the farthest pixels are drawn, 0.3 m long.
    """
    path = _camera(name)
    _log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, recording, static=True)
    pose = camera.world_from_camera
    _log(path, rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]), recording, static=True)
    if camera.model == "pinhole":
        of = camera.parameters
        # Rerun's pixels begin at their corner, ours at their middle.
        lens = rr.Pinhole(
            resolution=camera.size_px,
            focal_length=(of["fx_px"], of["fy_px"]),
            principal_point=(of["cx_px"] + 0.5, of["cy_px"] + 0.5),
        )
        _log(f"{path}/image", lens, recording, static=True)
    else:
        _log(f"{path}/view", rr.LineStrips3D(_view(camera)), recording, static=True)


def log_images(
    images: Mapping[str, NDArray[np.uint8]],
    time_s: float,
    *,
    jpeg_quality: int | None = 85,
    recording: rr.RecordingStream | None = None,
) -> None:
    """Log the images of cameras, by name: height x width x 3 bytes, red, green and blue, as in `Tracker.observe`.

    They are compressed as JPEG unless `jpeg_quality` is None.
    """
    _set_time(time_s, recording)
    for name, image in images.items():
        logged = rr.Image(image)
        path = f"{_camera(name)}/image"
        _log(path, logged if jpeg_quality is None else logged.compress(jpeg_quality), recording)


def log_estimate(
    name: str,
    estimate: Estimate,
    *,
    radius_m: float | None = None,
    trail_m: ArrayLike = (),
    recording: rr.RecordingStream | None = None,
) -> None:
    """Log where a target is: position, velocity (an arrow as long as its way in a second), two standard deviations of the position,
    state and confidence.

    The position is a point, with a ball around it if its radius is estimated or given by `radius_m`. `trail_m` is the way so far (N x 3,
    metres). Of a crowd, log each member under a name of its own: `f"ball-{member.number}"`.
    """
    _log_row(name, estimate, radius_m, np.asarray(trail_m, float).reshape(-1, 3), recording)
    _log_state(name, estimate, recording)


def log_tracks(
    tracks: Tracks,
    cameras: Mapping[str, Camera] | None = None,
    *,
    recording: rr.RecordingStream | None = None,
) -> None:
    """Log the tracks of a finished run, each with its way in the last 50 frames.

    Cameras are logged with their poses if they are given, otherwise as points where they stood according to the run.
    """
    if cameras is None:
        _log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, recording, static=True)
        for name, camera in tracks.summary["cameras"].items():
            # One on a platform moves.
            if "position_m" in camera:
                place = rr.Points3D([camera["position_m"]], radii=[_POINT], labels=[name])
                _log(_camera(name), place, recording, static=True)
    else:
        for name, camera in cameras.items():
            log_camera(name, camera, recording=recording)
    times_s = np.unique(tracks.columns["time_s"])
    for name in tracks.targets:
        positions_m = tracks.positions_m(name)
        radius_m = _radius_m(tracks, name)
        rows = _rows(tracks.of(name))
        for number, row in enumerate(rows):
            trail_m = positions_m[max(0, number + 1 - _TRAIL_ROWS) : number + 1]
            _log_row(name, row, radius_m, trail_m, recording)
            if number == 0 or row.state != rows[number - 1].state:
                _log_state(name, row, recording)
        later_s = times_s[times_s > rows[-1].time_s]
        if len(later_s) > 0:
            # A member of a crowd that is gone.
            _set_time(later_s[0], recording)
            _log(f"world/{_target(name)}", rr.Clear(recursive=True), recording)


def _rows(columns: Mapping[str, NDArray[Any]]) -> list[_TrackRow]:
    """Return the rows of a target; what has no value is None."""
    vectors = {
        name: np.stack([columns[column] for column in names.split()], axis=1)
        for name, names in (
            ("position_m", "x_m y_m z_m"),
            ("velocity_mps", "vx_mps vy_mps vz_mps"),
            ("covariance_m2", "xx_m2 xy_m2 xz_m2 xy_m2 yy_m2 yz_m2 xz_m2 yz_m2 zz_m2"),
            ("radius_m", "radius_m"),
        )
    }
    rows = []
    for number, time_s in enumerate(columns["time_s"]):
        known = {name: rows[number] if np.isfinite(rows[number]).all() else None for name, rows in vectors.items()}
        covariance_m2, radius_m = known["covariance_m2"], known["radius_m"]
        row = _TrackRow(
            time_s=float(time_s),
            state=str(columns["state"][number]),
            confidence=float(columns["confidence"][number]),
            position_m=known["position_m"],
            velocity_mps=known["velocity_mps"],
            covariance_m2=None if covariance_m2 is None else covariance_m2.reshape(3, 3),
            radius_m=None if radius_m is None else float(radius_m[0]),
        )
        rows.append(row)
    return rows


def _radius_m(tracks: Tracks, name: str) -> float | None:
    """Return the radius of a ball as the scene says it."""
    targets = tracks.summary["settings"]["targets"]
    # Members of a crowd have a number behind its name.
    target = targets.get(name) or targets[name.rpartition("-")[0]]
    radius_m = target.get("shape", {}).get("sphere", {}).get("radius_m")
    return radius_m if isinstance(radius_m, float) else None


def _log_row(
    name: str,
    row: _Row,
    radius_m: float | None,
    trail_m: NDArray[np.float64],
    recording: rr.RecordingStream | None,
) -> None:
    _set_time(row.time_s, recording)
    _log(f"{_target(name)}/confidence", rr.Scalars(row.confidence), recording)
    path = f"world/{_target(name)}"
    if row.position_m is None:
        _log(path, rr.Clear(recursive=True), recording)
        return
    colors = [_SEEN if row.state == "tracking" else _PREDICTED]
    point = rr.Points3D([row.position_m], radii=[_POINT], colors=colors, labels=[name])
    _log(f"{path}/position", point, recording)
    if radius_m := row.radius_m or radius_m:
        ball = rr.Ellipsoids3D(centers=[row.position_m], radii=[radius_m], colors=colors)
        _log(f"{path}/ball", ball, recording)
    if row.covariance_m2 is not None:
        variances_m2, axes = np.linalg.eigh(row.covariance_m2)
        ellipsoid = rr.Ellipsoids3D(
            centers=[row.position_m],
            half_sizes=[_SIGMAS * np.sqrt(np.maximum(variances_m2, 0))],
            quaternions=[rr.Quaternion(xyzw=_quaternion(axes))],
            colors=colors,
        )
        _log(f"{path}/uncertainty", ellipsoid, recording)
    if row.velocity_mps is not None:
        arrow = rr.Arrows3D(origins=[row.position_m], vectors=[row.velocity_mps], colors=colors)
        _log(f"{path}/velocity", arrow, recording)
    if len(trail_m) > 0:
        strips = np.split(trail_m, np.flatnonzero(~np.isfinite(trail_m).all(axis=1)))
        known = [strip[np.isfinite(strip).all(axis=1)] for strip in strips]
        _log(f"{path}/trail", rr.LineStrips3D(known, colors=[_SEEN] * len(known)), recording)


def _log_state(name: str, row: _Row, recording: rr.RecordingStream | None) -> None:
    level = "INFO" if row.state == "tracking" else "WARN"
    _log(f"{_target(name)}/state", rr.TextLog(row.state, level=level), recording)


def _quaternion(axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation (x, y, z, w) whose matrix has these orthogonal columns; one is reversed if they are left-handed."""
    rotation = axes * [1.0, 1.0, np.sign(np.linalg.det(axes))]
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation
    # The eigenvector of the largest eigenvalue, for any rotation (Bar-Itzhack 2000).
    matrix = [
        [xx - yy - zz, xy + yx, xz + zx, zy - yz],
        [xy + yx, yy - xx - zz, yz + zy, xz - zx],
        [xz + zx, yz + zy, zz - xx - yy, yx - xy],
        [zy - yz, xz - zx, yx - xy, xx + yy + zz],
    ]
    vectors: NDArray[np.float64] = np.linalg.eigh(matrix)[1]
    return vectors[:, -1]


def _view(camera: Camera) -> list[NDArray[np.float64]]:
    """Return lines in the camera's frame along the rays of its farthest pixels, and through their ends."""
    width, height = camera.size_px
    turn = np.linspace(0, 2 * np.pi, 32, endpoint=False)
    across = np.stack([width * np.cos(turn), height * np.sin(turn)], axis=1) / 2
    # From the middle of the image outwards: a fisheye may end before its border.
    pixels = np.array([width - 1, height - 1]) / 2 + np.linspace(0, 1, _STEPS)[:, None, None] * across
    origins_m, rays = (points.reshape(_STEPS, -1, 3) for points in camera.rays(pixels.reshape(-1, 2)))
    has_ray = np.isfinite(rays).all(axis=2)
    farthest = np.where(has_ray, np.arange(_STEPS)[:, None], 0).max(axis=0)
    sides = np.flatnonzero(has_ray.any(axis=0))
    starts_m = origins_m[farthest[sides], sides]
    ends_m = starts_m + _VIEW_M * rays[farthest[sides], sides]
    lines_m = [np.stack(line) for line in zip(starts_m[::4], ends_m[::4])] + [np.concatenate([ends_m, ends_m[:1]])]
    camera_from_world = np.linalg.inv(camera.world_from_camera)
    return [line_m @ camera_from_world[:3, :3].T + camera_from_world[:3, 3] for line_m in lines_m]


def _camera(name: str) -> str:
    return f"world/cameras/{rr.escape_entity_path_part(name)}"


def _target(name: str) -> str:
    return f"targets/{rr.escape_entity_path_part(name)}"


def _set_time(time_s: float, recording: rr.RecordingStream | None) -> None:
    rr.set_time(_TIMELINE, duration=time_s, recording=recording)


def _log(path: str, entity: Any, recording: rr.RecordingStream | None, *, static: bool = False) -> None:
    rr.log(path, entity, static=static, recording=recording)
