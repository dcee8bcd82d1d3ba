from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "Camera",
    "ColorModel",
    "Estimate",
    "Shape",
    "Target",
    "Tracker",
    "__version__",
    "read_image",
    "run_program",
    "toml_text",
]
__version__: str

@final
class Camera:
    @staticmethod
    def pinhole(
        size_px: Sequence[int],
        f_px: Sequence[float],
        center_px: Sequence[float],
        distortion: Sequence[float] = ...,
    ) -> Camera: ...
    @staticmethod
    def fisheye(
        size_px: Sequence[int],
        f_px: Sequence[float],
        center_px: Sequence[float],
        k: Sequence[float],
        max_angle_rad: float = ...,
    ) -> Camera: ...
    @staticmethod
    def equidistant(
        size_px: Sequence[int],
        f_px_per_rad: float,
        center_px: Sequence[float],
        max_angle_rad: float,
    ) -> Camera: ...
    @staticmethod
    def read(path: str | PathLike[str], size_px: Sequence[int] | None = None) -> Camera: ...
    @staticmethod
    def read_all(path: str | PathLike[str], size_px: Sequence[int] | None = None) -> dict[str, Camera]: ...
    def at(self, world_from_camera: ArrayLike) -> Camera: ...
    def looking(self, from_m: Sequence[float], at_m: Sequence[float], roll_rad: float = 0.0) -> Camera: ...
    def masked(self, open: NDArray[np.bool_]) -> Camera: ...
    def project(self, points_m: ArrayLike) -> NDArray[np.float64]: ...
    def rays(self, pixels: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
    @property
    def model(self) -> str: ...
    @property
    def parameters(self) -> dict[str, float]: ...
    @property
    def size_px(self) -> tuple[int, int]: ...
    @property
    def world_from_camera(self) -> NDArray[np.float64]: ...

@final
class ColorModel:
    @staticmethod
    def learn(images: Sequence[NDArray[np.uint8]], masks: Sequence[NDArray[np.bool_]]) -> ColorModel: ...
    @staticmethod
    def read(path: str | PathLike[str]) -> ColorModel: ...
    def write(self, path: str | PathLike[str]) -> None: ...
    @property
    def pixel_count(self) -> int: ...
    @property
    def image_count(self) -> int: ...
    def __eq__(self, other: object) -> bool: ...
    def __ne__(self, other: object) -> bool: ...

@final
class Shape:
    @staticmethod
    def ball(radius_m: float) -> Shape: ...
    @staticmethod
    def cylinder(radius_m: float, height_m: float) -> Shape: ...
    @staticmethod
    def box(size_m: Sequence[float]) -> Shape: ...
    @staticmethod
    def disc(radius_m: float, height_m: float = 0.0) -> Shape: ...
    @staticmethod
    def rectangle(size_m: Sequence[float], height_m: float = 0.0) -> Shape: ...
    @property
    def diameter_m(self) -> float: ...

@final
class Target:
    def __new__(
        cls,
        shape: Shape,
        colors: ColorModel,
        *,
        radius_tolerance: float | None = 0.02,
        turns: bool = True,
        ground_z_m: float = 0.0,
        particle_count: int = 500,
        min_particle_count: int | None = None,
        max_count: int | None = None,
    ) -> Target: ...
    @staticmethod
    def of_boxes(
        shape: Shape,
        *,
        detection_probability: float = 0.9,
        false_per_image: float = 0.5,
        side_sigma: float = 0.05,
        size_tolerance: float = 0.05,
        min_score: float = 0.0,
        acceleration_density_m2ps3: float | None = None,
        ground_z_m: float = 0.0,
        particle_count: int = 500,
        min_particle_count: int | None = None,
        max_count: int | None = None,
    ) -> Target: ...
    def with_boxes(
        self,
        *,
        detection_probability: float = 0.9,
        false_per_image: float = 0.5,
        side_sigma: float = 0.05,
        min_score: float = 0.0,
    ) -> Target: ...

@final
class Estimate:
    @property
    def time_s(self) -> float: ...
    @property
    def number(self) -> int | None: ...
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
    def velocity_covariance_m2ps2(self) -> NDArray[np.float64] | None: ...
    @property
    def heading_rad(self) -> float | None: ...
    @property
    def heading_sigma_rad(self) -> float | None: ...
    @property
    def radius_m(self) -> float | None: ...
    @property
    def radius_sigma_m(self) -> float | None: ...

@final
class Tracker:
    def __new__(
        cls,
        cameras: Mapping[str, Camera],
        targets: Mapping[str, Target],
        *,
        platforms: Mapping[str, str] | None = None,
        seed: int = 1,
    ) -> Tracker: ...
    @staticmethod
    def of_scene(
        scene: str | PathLike[str] | Mapping[str, Any],
        *,
        size_px: Mapping[str, tuple[int, int]] | None = None,
        seed: int | None = None,
    ) -> Tracker: ...
    def observe(
        self,
        images: Mapping[str, NDArray[np.uint8]],
        time_s: float,
        boxes: Mapping[str, Mapping[str, ArrayLike]] | None = None,
    ) -> None: ...
    def observe_pose(
        self,
        platform: str,
        world_from_platform: ArrayLike,
        time_s: float,
        covariance: ArrayLike | None = None,
    ) -> str: ...
    def observe_increment(
        self,
        platform: str,
        before_from_after: ArrayLike,
        from_s: float,
        to_s: float,
        covariance: ArrayLike | None = None,
    ) -> str: ...
    def observe_measurement(
        self,
        target: str,
        time_s: float,
        *,
        position_m: Sequence[float | None] | None = None,
        velocity_mps: Sequence[float | None] | None = None,
        range_m: float | None = None,
        direction: Sequence[float] | None = None,
        from_m: Sequence[float] | None = None,
        sigma: float | None = None,
        covariance: Sequence[Sequence[float]] | None = None,
    ) -> str: ...
    def measurement_counts(self, target: str) -> dict[str, int]: ...
    def estimate(self, target: str, time_s: float | None = None) -> Estimate: ...
    def members(self, target: str, time_s: float | None = None) -> list[Estimate]: ...
    @property
    def time_s(self) -> float | None: ...
    @property
    def cameras(self) -> list[str]: ...
    @property
    def targets(self) -> list[str]: ...
    @property
    def platforms(self) -> list[str]: ...

def read_image(path: str | PathLike[str]) -> NDArray[np.uint8]: ...
def run_program(arguments: Sequence[str], file: str | PathLike[str]) -> int: ...
def toml_text(table: Mapping[str, Any]) -> str: ...
