"""Images drawn in a process of their own.

A thread that draws would hold the interpreter's lock, for which sound then waits after each kernel that it
calls. The process is a fork, which has the scene without loading it again, and comes after sound on a busy
processor.
"""

import contextlib
import multiprocessing
import os
import queue
import signal
import threading
import time
import weakref
from collections.abc import Mapping
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from objectfolder.errors import QueryError
from objectfolder.live import LiveSight

Floats = np.ndarray
NICE = 19  # with 5 a minute of sound had two gaps on two idle cores, and fewer images
LANES = 2  # images at once: one that moves does not wait for a fine one


class ThreadPoses(threading.local):
    """The poses (4, 4) of bodies by name, as each thread knows them."""

    by_body: Mapping[str, Floats] = {}

    def pose(self, body: str) -> Floats:
        """Return the pose of a body."""
        return self.by_body[body]


class DrawingProcess:
    """A process that draws a scene, until `close` or this object is gone.

    Parameters
    ----------
    sight
        What it draws, of bodies whose poses are `poses`.
    poses
        It takes those that come with each question.
    """

    def __init__(self, sight: LiveSight, poses: ThreadPoses) -> None:
        pipes = [multiprocessing.Pipe() for _ in range(LANES)]
        self._lanes: queue.SimpleQueue[Connection] = queue.SimpleQueue()
        for near, _ in pipes:
            self._lanes.put(near)
        process = multiprocessing.get_context("fork").Process(
            target=_draw, args=(sight, poses, pipes), daemon=True
        )
        process.start()
        for _, far in pipes:
            far.close()
        # Later forks hold the near ends, too, so that it would not see that these are closed here.
        self.close = weakref.finalize(self, _end, process)

    def image(self, poses: Mapping[str, Floats], **how: Any) -> tuple[bytes, float]:
        """Return (height, width, 3) sRGB and int8 (height, width), which body; and milliseconds it took.

        Parameters
        ----------
        poses
            (4, 4) by the names of bodies.
        how
            As for `LiveSight.image`.

        Raises
        ------
        QueryError
            As `LiveSight.image`; or the process has ended.
        """
        lane = self._lanes.get()
        try:
            lane.send((poses, how))
            answer = lane.recv()
        except (EOFError, OSError) as error:
            raise QueryError(
                "images", "the process that draws has ended", "Start the program again."
            ) from error
        finally:
            self._lanes.put(lane)
        if isinstance(answer, Exception):
            raise answer
        return answer[0], answer[1]


def _end(process: Any) -> None:
    process.terminate()
    process.join()


def _draw(sight: LiveSight, poses: ThreadPoses, pipes: list[tuple[Connection, Connection]]) -> None:
    """Draw what is asked for through each pipe until the other side closes it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the program, whose end closes the pipes
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    os.nice(NICE)
    for near, _ in pipes:
        near.close()
    threads = [threading.Thread(target=_answer, args=(sight, poses, far), daemon=True) for _, far in pipes]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def _answer(sight: LiveSight, poses: ThreadPoses, lane: Connection) -> None:
    with contextlib.suppress(EOFError, OSError):  # nobody asks any more
        while True:
            poses.by_body, how = lane.recv()
            begun_s = time.monotonic()
            try:
                image = sight.image(**how)
            except Exception as error:  # raised where the image was asked for
                lane.send(error)
            else:
                drawn_ms = 1e3 * (time.monotonic() - begun_s)
                lane.send((image.rgb.tobytes() + image.body.astype(np.int8).tobytes(), drawn_ms))
