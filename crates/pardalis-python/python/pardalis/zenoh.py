"""Takes images from cameras on several computers, over Zenoh (https://zenoh.io).

It needs the packages eclipse-zenoh and pillow: `pip install eclipse-zenoh pillow`.

Each computer with a camera stamps its images, compresses them and sends them:

    with pardalis.zenoh.Sender("left") as sender:
        while True:
            sender.send(image)                  # height x width x 3 bytes, red, green, blue

One computer tracks:

    tracker = pardalis.Tracker.of_scene("scene.toml")
    with pardalis.zenoh.Receiver(tracker.cameras) as receiver:
        for time_s, images in receiver:
            tracker.observe(images, time_s)
            print(tracker.estimate("ball"))

Times are seconds since 1970, on the clocks of the senders, which have to agree.
"""

from __future__ import annotations

import heapq
import io
import math
import secrets
import struct
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Collection, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

try:
    import zenoh
    from PIL import Image
except ImportError as error:
    raise ImportError("pardalis.zenoh needs the packages eclipse-zenoh and pillow: pip install eclipse-zenoh pillow") from error

__all__ = ["Clock", "Counts", "Receiver", "Sender"]

# Images closer in time than this belong together: triggered cameras whose stamps were rounded.
_SAME_INSTANT_NS = 1000
# Number of images of a camera that may wait for the consumer. Of more, the oldest is dropped.
_MAX_WAITING = 3
# Images stamped farther ahead than this are not used: once one of them is tracked, all others are late until that time.
_MAX_AHEAD_NS = 1_000_000_000
_CLOCK_PERIOD_S = 1.0
# Exchanges of times of which the quickest counts.
_EXCHANGES = 8
# A sender that restarts is not worth a warning.
_MAX_ABSENCE_S = 5.0
# How long a wait may last, so that Ctrl-C is noticed on all systems.
_WAKE_S = 0.5

# The number of the sender's start, that of the image since then, and its time in nanoseconds since 1970.
_HEADER = struct.Struct("<QQq")
_CLOCK = struct.Struct("<q")
_JPEG, _PNG = b"\xff\xd8\xff", b"\x89PNG"

_Item = TypeVar("_Item")


class Sender:
    """Sends the images of one camera.

    `camera` is its name in the scene. Receivers have the same `prefix`. Without a `session`, one with Zenoh's default configuration is opened,
    and closed with the sender. Use it from one thread, and in a `with` statement, or call `close`.
    """

    def __init__(
        self,
        camera: str,
        *,
        prefix: str = "pardalis",
        session: zenoh.Session | None = None,
        jpeg_quality: int = 90,
    ) -> None:
        if not 1 <= jpeg_quality <= 100:
            raise ValueError(f"jpeg_quality: is {jpeg_quality}; allowed: 1 to 100")
        key = _key(prefix, camera)
        self._jpeg_quality = jpeg_quality
        # A sender that was started again counts from zero. Receivers recognise it by this number.
        self._start = secrets.randbits(64)
        self._sent = 0
        self._clock_key = f"{key}/clock"
        with ExitStack() as stack:
            session = session or stack.enter_context(zenoh.open(zenoh.Config()))
            stack.enter_context(session.declare_queryable(self._clock_key, _direct(self._tell_time)))
            publisher = session.declare_publisher(
                f"{key}/image",
                # A slow network costs images, and does not stop the camera.
                congestion_control=zenoh.CongestionControl.DROP,
                express=True,
            )
            self._publisher = stack.enter_context(publisher)
            stack.enter_context(session.liveliness().declare_token(f"{key}/alive/{self._start:x}"))
            self._stack = stack.pop_all()

    def send(self, image: NDArray[np.uint8] | bytes, time_s: float | None = None) -> None:
        """Send an image: an array of height x width x 3 bytes (red, green, blue), or the bytes of a JPEG or PNG file as they are.

        `time_s` is the middle of its exposure, in seconds since 1970. Without it, the image has the time of this call.
        """
        stamp_ns = time.time_ns() if time_s is None else round(time_s * 1e9)
        payload = image if isinstance(image, bytes) else self._compressed(image)
        if not payload.startswith((_JPEG, _PNG)):
            raise ValueError("image: the bytes are neither JPEG nor PNG")
        attachment = _HEADER.pack(self._start, self._sent, stamp_ns)
        self._sent += 1
        self._publisher.put(payload, attachment=attachment)

    def close(self) -> None:
        """Tell the receivers that this sender ends."""
        self._stack.close()

    def __enter__(self) -> Sender:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _compressed(self, image: NDArray[np.uint8]) -> bytes:
        if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
            raise ValueError(f"image: has the shape {image.shape} and the type {image.dtype}; give height x width x 3 bytes")
        file = io.BytesIO()
        # Outlines are found by their colours, which keep all pixels.
        Image.fromarray(np.ascontiguousarray(image)).save(file, "JPEG", quality=self._jpeg_quality, subsampling=0)
        return file.getvalue()

    def _tell_time(self, query: zenoh.Query) -> None:
        with query:
            query.reply(self._clock_key, _CLOCK.pack(time.time_ns()))


@dataclass
class Counts:
    """How many images of a camera came, and what became of them. Those that still wait are among `received` only."""

    received: int = 0
    used: int = 0
    """Those that the receiver has returned."""
    late: int = 0
    """Those that came after later ones had been returned, or have the time of another one."""
    ahead: int = 0
    """Those with a time more than a second ahead of this computer's clock."""
    dropped: int = 0
    """Those for which the caller was too slow."""
    invalid: int = 0
    """Those that are no images of a `Sender`, or have another size than the first."""
    lost: int = 0
    """Those that were sent and did not come, as gaps in their numbers show. They are not among `received`."""


class Clock(NamedTuple):
    """The clock of a sender, compared with that of this computer."""

    offset_s: float
    """Seconds by which the sender's clock is ahead."""
    uncertainty_s: float
    """The largest possible error of `offset_s`: half the time that question and answer took."""


class _Sets:
    """Collects images in order of time into sets of one instant. Of images for which the consumer is too slow, the latest win."""

    def __init__(self, cameras: Iterable[str], max_delay_s: float) -> None:
        self.counts = {camera: Counts() for camera in cameras}
        self._max_delay_s = max_delay_s
        self._latest_ns = {camera: -math.inf for camera in self.counts}
        self._returned_ns = -math.inf
        # Of images that wait for others: time, a number that makes each one different, camera, when it came, image. The earliest is first.
        self._waiting: list[tuple[int, int, str, float, bytes]] = []
        self._number = 0
        self._complete: deque[tuple[int, dict[str, bytes]]] = deque()

    def take(self, camera: str, stamp_ns: int, image: bytes, now_s: float) -> None:
        """Take an image that arrived now."""
        if stamp_ns <= self._returned_ns:
            self.counts[camera].late += 1
            return
        self._latest_ns[camera] = max(self._latest_ns[camera], stamp_ns)
        self._number += 1
        heapq.heappush(self._waiting, (stamp_ns, self._number, camera, now_s, image))

    def complete(self, now_s: float, present: Collection[str]) -> None:
        """Complete the sets to which no camera that is present can add an image, and those that have waited long enough."""
        while self._waiting:
            stamp_ns, _, _, arrived_s, _ = self._waiting[0]
            if now_s < arrived_s + self._max_delay_s and any(self._latest_ns[camera] < stamp_ns for camera in present):
                break
            self._returned_ns = stamp_ns + _SAME_INSTANT_NS
            images: dict[str, bytes] = {}
            while self._waiting and self._waiting[0][0] <= self._returned_ns:
                _, _, camera, _, image = heapq.heappop(self._waiting)
                if camera in images:
                    self.counts[camera].late += 1
                else:
                    images[camera] = image
            self._complete.append((stamp_ns, images))
            for camera in images:
                holding = [held for _, held in self._complete if camera in held]
                if len(holding) > _MAX_WAITING:
                    del holding[0][camera]
                    self.counts[camera].dropped += 1
            while not self._complete[0][1]:
                self._complete.popleft()

    def next(self) -> tuple[int, dict[str, bytes]] | None:
        """Return the earliest complete set: its time in nanoseconds, and its images."""
        while self._complete:
            stamp_ns, images = self._complete.popleft()
            if images:
                return stamp_ns, images
        return None

    def due_s(self) -> float:
        """Return when the earliest image has waited long enough."""
        return self._waiting[0][3] + self._max_delay_s if self._waiting else math.inf


@dataclass
class _Link:
    """What a receiver knows of the sender of a camera."""

    absent_since_s: float
    # The starts of senders that are there. Of one that was killed and started again, the old may still be among them.
    alive: set[str] = field(default_factory=set)
    start: int | None = None
    # The start before that, to tell two senders of one name from one that was started again.
    start_before: int | None = None
    expected: int = 0
    size_px: tuple[int, int] | None = None
    exchanges: deque[Clock] = field(default_factory=lambda: deque(maxlen=_EXCHANGES))
    warned_offset_s: float = 0.0
    warned_of: set[str] = field(default_factory=set)

    def clock(self) -> Clock | None:
        return min(self.exchanges, key=lambda clock: clock.uncertainty_s, default=None)


class Receiver:
    """Receives the images of cameras that have a `Sender`, as sets of one instant in the order of time.

    Iterate over it: each item is the time in seconds since 1970 and a dictionary of images (height x width x 3 bytes; red, green, blue) for
    `Tracker.observe`. Images of the same time (within a microsecond) are one set. A set is returned as soon as all cameras that are present have sent
    an image of its time or a later one, at the latest `max_delay_s` seconds after its first image came. If the caller is too slow, the latest images win:
    at most three of a camera wait.

    `cameras` are the names of the senders. Without a `session`, one with Zenoh's default configuration is opened, and closed with the receiver.
    A clock that is wrong by more than `max_clock_error_s` seconds, a camera without a sender and two senders of one name are Python warnings,
    given by the iteration. Whatever comes from the network is counted, and raises nothing. Use the receiver in a `with` statement, or call `close`,
    which ends the iteration.
    """

    def __init__(
        self,
        cameras: Iterable[str],
        *,
        prefix: str = "pardalis",
        session: zenoh.Session | None = None,
        max_delay_s: float = 0.1,
        max_clock_error_s: float = 0.01,
    ) -> None:
        if isinstance(cameras, str):
            raise TypeError(f'cameras: is the text "{cameras}"; give a list of names')
        keys = {camera: _key(prefix, camera) for camera in cameras}
        if not keys:
            raise ValueError("cameras: there is none; give at least one name")
        for name, value_s in (("max_delay_s", max_delay_s), ("max_clock_error_s", max_clock_error_s)):
            if not 0 <= value_s < math.inf:
                raise ValueError(f"{name}: is {value_s}; allowed: 0 or more")
        self._max_clock_error_s = max_clock_error_s
        # For all that follows: Zenoh calls from threads of its own.
        self._changed = threading.Condition()
        self._sets = _Sets(keys, max_delay_s)
        now_s = time.monotonic()
        self._links = {camera: _Link(now_s) for camera in keys}
        # Names of senders that are there, wanted or not, for the warning of a camera that is not.
        self._senders: set[str] = set()
        self._notes: list[str] = []
        self._ask_at_s = now_s
        self._is_closed = False
        self._camera_of_clock = {f"{key}/clock": camera for camera, key in keys.items()}
        self._all_clocks = f"{prefix}/*/clock"
        with ExitStack() as stack:
            self._session = session or stack.enter_context(zenoh.open(zenoh.Config()))
            self._decoders = stack.enter_context(ThreadPoolExecutor(len(keys)))
            for camera, key in keys.items():
                stack.enter_context(self._session.declare_subscriber(f"{key}/image", _direct(partial(self._take, camera))))
            tokens = self._session.liveliness().declare_subscriber(f"{prefix}/*/alive/*", _direct(self._take_token), history=True)
            stack.enter_context(tokens)
            self._stack = stack.pop_all()

    @property
    def counts(self) -> dict[str, Counts]:
        """How many images of each camera came, and what became of them."""
        with self._changed:
            return {camera: replace(counts) for camera, counts in self._sets.counts.items()}

    @property
    def present(self) -> list[str]:
        """The cameras whose senders are there."""
        with self._changed:
            return self._present()

    @property
    def clocks(self) -> dict[str, Clock]:
        """The clocks of the senders that have told their time, once a second while the receiver is iterated."""
        with self._changed:
            clocks = {camera: link.clock() for camera, link in self._links.items()}
        return {camera: clock for camera, clock in clocks.items() if clock is not None}

    def __iter__(self) -> Receiver:
        return self

    def __next__(self) -> tuple[float, dict[str, NDArray[np.uint8]]]:
        while True:
            self._ask_for_times()
            for note in self._take_notes():
                warnings.warn(note, stacklevel=2)
            with self._changed:
                if self._is_closed:
                    raise StopIteration
                now_s = time.monotonic()
                self._sets.complete(now_s, self._present())
                found = self._sets.next()
                if found is None:
                    self._changed.wait(min(max(self._sets.due_s() - now_s, 0), _WAKE_S))
                    continue
            stamp_ns, payloads = found
            # Decoded only here: images that are dropped cost nothing.
            decoded = zip(payloads, self._decoders.map(self._decoded, payloads, payloads.values()))
            images = {camera: image for camera, image in decoded if image is not None}
            if images:
                return stamp_ns * 1e-9, images

    def close(self) -> None:
        """Receive no more, and end the iteration."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()
        self._stack.close()

    def __enter__(self) -> Receiver:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _present(self) -> list[str]:
        return [camera for camera, link in self._links.items() if link.alive]

    def _take(self, camera: str, sample: zenoh.Sample) -> None:
        header = b"" if sample.attachment is None else sample.attachment.to_bytes()
        payload = sample.payload.to_bytes()
        with self._changed:
            counts = self._sets.counts[camera]
            counts.received += 1
            if len(header) != _HEADER.size or not payload.startswith((_JPEG, _PNG)):
                counts.invalid += 1
                return
            start, number, stamp_ns = _HEADER.unpack(header)
            counts.lost += self._gap(camera, start, number)
            if stamp_ns > time.time_ns() + _MAX_AHEAD_NS:
                counts.ahead += 1
                return
            now_s = time.monotonic()
            self._sets.take(camera, stamp_ns, payload, now_s)
            # Here, too, so that not more images wait than may while the consumer is busy.
            self._sets.complete(now_s, self._present())
            self._changed.notify_all()

    def _gap(self, camera: str, start: int, number: int) -> int:
        """Return how many images were lost before this one, or -1 for one that had been taken for lost."""
        link = self._links[camera]
        if start != link.start:
            if start == link.start_before:
                self._warn_once(camera, f"{camera}: two senders have this name; give each camera a name of its own")
            link.start, link.start_before, link.expected = start, link.start, number
        gap = number - link.expected
        if gap < 0:
            return -1
        link.expected = number + 1
        return gap

    def _take_token(self, sample: zenoh.Sample) -> None:
        camera, _, start = str(sample.key_expr).split("/")[-3:]
        with self._changed:
            is_there = sample.kind == zenoh.SampleKind.PUT
            (self._senders.add if is_there else self._senders.discard)(camera)
            link = self._links.get(camera)
            if link is None:
                return
            if is_there:
                link.alive.add(start)
                # It may be on a computer with another clock.
                link.exchanges.clear()
                link.warned_of.clear()
            else:
                link.alive.discard(start)
                link.absent_since_s = time.monotonic()
            self._changed.notify_all()

    def _ask_for_times(self) -> None:
        now_s = time.monotonic()
        if now_s < self._ask_at_s:
            return
        self._ask_at_s = now_s + _CLOCK_PERIOD_S
        self._session.get(
            self._all_clocks,
            _direct(partial(self._take_time, time.time_ns())),
            target=zenoh.QueryTarget.ALL,
            # Each answer at once.
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=_CLOCK_PERIOD_S,
        )

    def _take_time(self, asked_ns: int, reply: zenoh.Reply) -> None:
        answered_ns = time.time_ns()
        if reply.ok is None:
            return
        camera = self._camera_of_clock.get(str(reply.ok.key_expr))
        told = reply.ok.payload.to_bytes()
        if camera is None or len(told) != _CLOCK.size:
            return
        (time_ns,) = _CLOCK.unpack(told)
        offset_s = 1e-9 * (time_ns - (asked_ns + answered_ns) // 2)
        with self._changed:
            self._links[camera].exchanges.append(Clock(offset_s, 0.5e-9 * (answered_ns - asked_ns)))

    def _take_notes(self) -> list[str]:
        """Return what there is to warn of, once."""
        now_s = time.monotonic()
        with self._changed:
            for camera, link in self._links.items():
                self._note_clock(camera, link)
                if not link.alive and now_s > link.absent_since_s + _MAX_ABSENCE_S:
                    there = ", ".join(sorted(self._senders)) or "none"
                    note = f"{camera}: has no sender; is it started, has it this name and prefix, and does it reach this computer? Senders that are there: {there}"
                    self._warn_once(camera, note)
            notes, self._notes = self._notes, []
        return notes

    def _note_clock(self, camera: str, link: _Link) -> None:
        clock = link.clock()
        if clock is None:
            return
        may_be_wrong_s = self._max_clock_error_s + clock.uncertainty_s
        if abs(clock.offset_s) <= may_be_wrong_s:
            link.warned_offset_s = 0.0
        elif abs(clock.offset_s - link.warned_offset_s) > may_be_wrong_s:
            link.warned_offset_s = clock.offset_s
            side = "ahead of" if clock.offset_s > 0 else "behind"
            self._notes.append(
                f"{camera}: its clock is {1e3 * abs(clock.offset_s):.1f} ± {1e3 * clock.uncertainty_s:.1f} ms {side} that of this computer; "
                "synchronise both (PTP or NTP)"
            )

    def _warn_once(self, camera: str, note: str) -> None:
        """Warn of something, once for each start of the camera's sender."""
        link = self._links[camera]
        # Names of senders in the text may change.
        what = note.split(";")[0]
        if what not in link.warned_of:
            link.warned_of.add(what)
            self._notes.append(note)

    def _decoded(self, camera: str, payload: bytes) -> NDArray[np.uint8] | None:
        """Decode an image, and count whether it is used."""
        link = self._links[camera]
        image = None
        try:
            opened = Image.open(io.BytesIO(payload), formats=["JPEG", "PNG"])
            if link.size_px in (None, opened.size):
                image = np.asarray(opened.convert("RGB"))
        # Pillow raises many kinds of errors for files that are damaged.
        except Exception:
            pass
        with self._changed:
            counts = self._sets.counts[camera]
            if image is None:
                counts.invalid += 1
            else:
                counts.used += 1
                link.size_px = opened.size
        return image


def _key(prefix: str, camera: str) -> str:
    """Return the beginning of a camera's keys."""
    for what, name, reserved in (("prefix", prefix, "*$?#"), ("camera", camera, "*$?#/")):
        if not name or any(sign in name for sign in reserved):
            raise ValueError(f'{what}: is "{name}"; give a name without {" ".join(reserved)}')
    return f"{prefix}/{camera}"


def _direct(callback: Callable[[_Item], Any]) -> zenoh.handlers.Callback[_Item]:
    """Have Zenoh's own threads call. Those that it makes for callbacks otherwise keep a program that closes nothing from ending."""
    return zenoh.handlers.Callback(callback, indirect=False)
