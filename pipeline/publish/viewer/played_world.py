"""A scene that runs in real time behind a page: what happens in it, what is heard, seen and felt of it.

One thread owns the world, and the sound that it makes as it runs. Images are drawn in another process, from
the poses that were told last. None begins while the world is behind the clock: on one core it would delay the
sound further. While nobody asks, the world stands still.
"""

import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from contextlib import contextmanager
from functools import cached_property, partial
from typing import Any

import numpy as np

from objectfolder.errors import ObjectFolderError, QueryError
from objectfolder.live import Felt, Finger, LiveSight, LiveSound, LiveTouch
from objectfolder.live.contacts import Posed
from objectfolder.live.gripper import shown_finger
from objectfolder.live.sound import BLOCK_SAMPLES, SAMPLE_RATE_HZ
from pipeline.publish.scenes.handling import FELT_BY, FRICTION, GREATEST_FORCE_N, Found, Handling
from pipeline.publish.scenes.opened_scene import OpenedScene, camera_over, framed
from pipeline.publish.viewer.drawing_process import DrawingProcess, ThreadPoses
from pipeline.publish.viewer.live_queries import Answer, number_of, numbers_of

BLOCK_S = BLOCK_SAMPLES / SAMPLE_RATE_HZ
KEPT_BLOCKS, LEAST_BLOCKS = 86, 2  # a second of sound; that an answer has
FELT_EVERY = 2  # blocks
LATE_S = 0.5  # that the world may lag; more is given up: the page's player waits no longer
WAIT_S, ALONE_S = 0.25, 3.0  # that a question waits for news; without one the world stands still
# That poses may change while nothing is drawn again: some tenths of a pixel. Engines rock bodies at rest.
STILL = np.array(3 * [[2e-3, 2e-3, 2e-3, 2e-4]] + [[1.0] * 4])
FALLEN_M = -1.0  # below the table: it is put back
MOST_PIXELS = 1024
ACTS = ("strike", "throw", "grab", "pull", "drop", "lift", "squeeze", "grip", "open")


class Poses:
    """The poses of the bodies at the latest step of the world."""

    def __init__(self) -> None:
        self.stamp, self.by_body = 0, dict[str, np.ndarray]()

    def pose(self, body: str) -> np.ndarray:
        """Return the pose (4, 4) of a body."""
        return self.by_body[body]

    def tell(self, poses: dict[str, np.ndarray]) -> None:
        """Store new poses if any body has moved."""
        if any((np.abs(pose - self.by_body.get(name, 9.0)) > STILL).any() for name, pose in poses.items()):
            self.by_body = poses
            self.stamp += 1


class PlayedWorld:
    """A scene that is played; its methods answer the page.

    Lengths are in metres, impulses in N s, in the frame of the world. Every answer is a header and bytes; a
    question that has none raises `QueryError`.

    Raises
    ------
    QueryError
        A scene that cannot be heard, seen or felt.
    """

    def __init__(self, opened: OpenedScene) -> None:
        self._opened, self._files = opened, opened.files
        sensor = next(iter(self._files.values())).touch.sensor  # which files of a scene need not share
        self._world = Handling(opened.spec, self._files, sensor)
        self._points = opened.points(self._world)
        fingers = {name: Finger(sensor=sensor, friction=FRICTION) for name in FELT_BY}
        self._touch = LiveTouch(self._world, self._files, fingers, onto_surface=True)
        self._felt: dict[str, Felt] = {}
        self._poses, self._said = Poses(), ""
        self._grabbed: tuple[str, np.ndarray] | None = None
        self._blocks: deque[np.ndarray] = deque(maxlen=KEPT_BLOCKS)
        self._count, self._asked_s = 0, time.monotonic()
        self._acts: queue.SimpleQueue[tuple[Callable[[], Any], Future[Any]]] = queue.SimpleQueue()
        self._news, self._stopped = threading.Condition(), threading.Event()
        self._on_time = threading.Event()
        self._on_time.set()
        self._begin()

    @cached_property
    def _drawing(self) -> DrawingProcess:
        poses = ThreadPoses()
        poses.by_body = self._poses.by_body
        return DrawingProcess(self.sight(poses), poses)

    @contextmanager
    def running(self) -> Iterator[None]:
        """Run the world in a thread, and what draws it in a process, while the context lasts."""
        _ = self._drawing  # a fork, before there are threads
        thread = threading.Thread(target=self._run, daemon=True)
        thread.start()
        try:
            yield
        finally:
            self._stopped.set()
            thread.join()
            self.close()

    def close(self) -> None:
        """End the process that draws, if there is one."""
        if "_drawing" in vars(self):
            self._drawing.close()

    def sight(self, poses: Posed) -> LiveSight:
        """Return what is seen of its bodies and its hand where they are."""
        return self._opened.sight(poses, dict.fromkeys(FELT_BY, shown_finger(self._world.sensor)))

    def table(self, _: Mapping[str, Any]) -> Answer:
        """Return what the page needs before the first question."""
        middle, reach = framed(self._points)
        sensor = self._world.sensor
        descriptions = {name: file.description["object"] for name, file in self._files.items()}
        return {
            "bodies": [
                {"body": name, "name": description.get("name") or name, "licence": description.get("licence"),
                 "attribution": description.get("attribution")}
                for name, description in descriptions.items()
            ],
            "frame": {"centre": middle.tolist(), "scale": reach},
            "rate": SAMPLE_RATE_HZ,
            "gel": [sensor.image_height, sensor.image_width],
        }, b""  # fmt: skip

    def heard(self, query: Mapping[str, Any]) -> Answer:
        """Return the sound since block ``since``, float32 pascals; wait for some."""
        since = int(number_of(query, "since", 0, 2**53))
        self._wait(lambda: self._count >= since + LEAST_BLOCKS or since > self._count)
        with self._news:
            count, blocks = self._count, list(self._blocks)
        first = max(min(since, count), count - len(blocks))
        sound = np.concatenate([np.zeros(0), *blocks[len(blocks) - (count - first) :]])
        return {"first": first, "next": count, "said": self._said}, sound.astype("<f4").tobytes()

    def seen(self, query: Mapping[str, Any]) -> Answer:
        """Return an image of ``resolution`` from ``camera_to_world``, by ``sub_rays`` (null: the file's own).

        Or a ``draft`` of it. The header says how many milliseconds it took to draw.
        Where nothing has moved since ``stamp`` and ``wait`` is true, it waits for a while, and the header may
        say ``still``. The bytes are (resolution, resolution, 3) sRGB, then int8: which body, -1 for none.
        """
        resolution = int(number_of(query, "resolution", 1, MOST_PIXELS))
        rays = query.get("sub_rays")
        rays = None if rays is None else int(number_of(query, "sub_rays", 1, 1024))
        camera, stamp_before = numbers_of(query, "camera_to_world", (4, 4)), query.get("stamp")
        if query.get("wait") and stamp_before == self._poses.stamp:
            self._wait(lambda: stamp_before != self._poses.stamp)
            if stamp_before == self._poses.stamp:
                return {"still": True, "stamp": stamp_before}, b""
        self._on_time.wait(WAIT_S)
        stamp, draft = self._poses.stamp, bool(query.get("draft"))
        how = {"camera_to_world": camera, "resolution": resolution, "sub_rays": rays, "draft": draft}
        image, drawn_ms = self._drawing.image(self._poses.by_body, **how)
        header = {"stamp": stamp, "resolution": resolution, "fingers": self._apexes, "drawn_ms": drawn_ms}
        return header, image

    def felt(self, _: Mapping[str, Any]) -> Answer:
        """Return the images (height, width, 3) of both fingers, and the forces that they bear, newtons."""
        answers = self._felt
        forces = [[answers[name].normal_n, answers[name].tangential_n] for name in answers]
        contacts = [answers[name].touched for name in answers]
        images = b"".join(answers[name].image.rgb.tobytes() for name in answers)
        return {"forces": forces, "touched": contacts, "said": self._said}, images

    def act(self, query: Mapping[str, Any]) -> Answer:
        """Do what ``act`` names in the world; it is done when this answers."""
        name = query.get("act")
        if name not in ACTS:
            raise QueryError("act", "unknown", f"Ask for {', '.join(ACTS)}.")
        result: Future[dict[str, Any]] = Future()
        self._acts.put((partial(getattr(self, f"_{name}"), query), result))
        self._asked_s = time.monotonic()
        return result.result(timeout=10.0), b""

    def warm(self) -> None:
        """Prepare what drafts need, and set the exposure."""
        camera = camera_over(self._points)
        self._drawing.image(self._poses.by_body, camera_to_world=camera, resolution=64, draft=True)

    def _begin(self) -> None:
        """Start over, everything in its place."""
        self._world.reset()
        ears = tuple(camera_over(self._points)[:3, 3])
        self._sound = LiveSound(self._world, self._files, listener_m=ears)
        self._hand, self._grabbed = False, None
        self._tell()

    def _run(self) -> None:
        due_s = time.monotonic()
        while not self._stopped.is_set():
            self._do_acts()
            if time.monotonic() - self._asked_s > ALONE_S:
                time.sleep(BLOCK_S)
                due_s = time.monotonic()
                continue
            self._advance()
            due_s += BLOCK_S
            now_s = time.monotonic()
            if now_s > due_s + LATE_S:
                due_s = now_s
            if now_s > due_s:
                self._on_time.clear()
            else:
                self._on_time.set()
            time.sleep(max(0.0, due_s - now_s))

    def _do_acts(self) -> None:
        while True:
            try:
                act, result = self._acts.get_nowait()
            except queue.Empty:
                return
            try:
                result.set_result(act())
            except ObjectFolderError as error:
                result.set_exception(error)

    def _advance(self) -> None:
        """Run the world for a block of sound, and tell what became of it."""
        try:
            block = self._sound.block()
            if self._hand and self._count % FELT_EVERY == 0:
                self._felt, self._said = self._touch.feel(), ""
        except QueryError as error:
            self._said, block = str(error), np.zeros(BLOCK_SAMPLES)
            if error.where == "simulation":
                self._begin()
        for name in self._files:
            if self._world.pose(name)[2, 3] < FALLEN_M:
                self._world.lift(name, 0.05)
        with self._news:
            self._blocks.append(block)
            self._count += 1
            self._tell()
            self._news.notify_all()

    def _tell(self) -> None:
        self._poses.tell({name: self._world.pose(name) for name in (*self._files, *FELT_BY)})
        apex = np.array(self._world.sensor.gel_apex_m)
        self._apexes = [self._world.where(name, apex).tolist() for name in FELT_BY] if self._hand else []

    def _wait(self, until: Callable[[], bool]) -> None:
        self._asked_s = time.monotonic()
        with self._news:
            self._news.wait_for(until, WAIT_S)

    def _hit(self, query: Mapping[str, Any]) -> Found | None:
        """Return what a ray meets (``origin``, ``direction``); or a ``body``, from above its middle."""
        if query.get("body") is None:
            return self._world.under(numbers_of(query, "origin", (3,)), numbers_of(query, "direction", (3,)))
        body = self._body(query)
        above = self._world.pose(body)[:3, 3] + [0.0, 0.0, 1.0]
        return self._world.under(above, np.array([0.0, 0.0, -1.0]))

    def _body(self, query: Mapping[str, Any]) -> str:
        if query.get("body") not in self._files:
            raise QueryError("body", "none of the scene's", f"Name {', '.join(self._files)}.")
        return str(query["body"])

    def _strike(self, query: Mapping[str, Any]) -> dict[str, Any]:
        impulse, hit = number_of(query, "impulse", 0, 100), self._hit(query)
        if hit is None:
            return {"missed": True}
        point, force = self._world.where(hit.body, hit.local_m), -impulse * hit.normal
        self._world.strike(hit.body, point, force)
        self._sound.strike(hit.body, point, force)
        return {"body": hit.body, "point": point.tolist()}

    def _throw(self, query: Mapping[str, Any]) -> dict[str, Any]:
        body, speed = self._body(query), numbers_of(query, "velocity", (3,))
        at = self._world.pose(body)[:3, 3]
        self._world.strike(body, at, np.clip(speed, -5, 5) * self._world.mass_kg(body))
        return {}

    def _grab(self, query: Mapping[str, Any]) -> dict[str, Any]:
        hit = self._hit(query)
        if hit is None:
            return {"missed": True}
        point = self._world.where(hit.body, hit.local_m)
        self._grabbed = hit.body, hit.local_m
        self._world.carry(*self._grabbed, point)
        return {"body": hit.body, "point": point.tolist()}

    def _pull(self, query: Mapping[str, Any]) -> dict[str, Any]:
        target = numbers_of(query, "target", (3,))
        if self._grabbed:
            self._world.carry(*self._grabbed, target)
        return {}

    def _drop(self, _: Mapping[str, Any]) -> dict[str, Any]:
        self._grabbed = None
        self._world.let_go()
        return {}

    def _lift(self, query: Mapping[str, Any]) -> dict[str, Any]:
        self._world.lift(self._body(query), number_of(query, "height", 0, 1))
        return {}

    def _squeeze(self, query: Mapping[str, Any]) -> dict[str, Any]:
        self._world.reach_round(self._body(query), numbers_of(query, "across", (3,)))
        self._hand = True
        return self._grip(query)

    def _grip(self, query: Mapping[str, Any]) -> dict[str, Any]:
        force = number_of(query, "force", 0, GREATEST_FORCE_N)
        self._world.grip(force, number_of(query, "lifting", -0.1, 0.1))
        return {}

    def _open(self, _: Mapping[str, Any]) -> dict[str, Any]:
        self._world.park()
        self._hand, self._felt = False, {}
        return {}
