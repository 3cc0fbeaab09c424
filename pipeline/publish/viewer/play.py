"""The page of a scene that is played: a table with objects to drop, push, throw, strike and squeeze."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from pipeline.publish.scenes.opened_scene import OpenedScene
from pipeline.publish.viewer.live import Page, one_thread_each, serve_until_stopped
from pipeline.publish.viewer.live_queries import Answer
from pipeline.publish.viewer.played_world import PlayedWorld


def page_of_world(world: PlayedWorld) -> Page:
    """Return the page of a world, which something else runs."""
    sounds, images, acts = ThreadPoolExecutor(2), ThreadPoolExecutor(2), ThreadPoolExecutor(1)
    questions = {
        "table": (world.table, acts),
        "seen": (world.seen, images),
        "felt": (world.felt, acts),
        "act": (world.act, acts),
    }
    alone = {name: (partial(_of_one, answer), threads) for name, (answer, threads) in questions.items()}
    streams = {"heard": (partial(_of_one, world.heard), sounds)}
    return Page("play.js", alone, ((world.warm, images),), streams)


def _of_one(answer: Callable[[Any], Answer], _: int, query: Any) -> Answer:
    """Answer on a page that has one world, whatever its number."""
    return answer(query)


def play_in_browser(scene: Path, port: int, open_browser: bool) -> None:
    """Play a scene in the browser until Ctrl-C.

    Raises
    ------
    InputError
        A scene that cannot be opened, a port that cannot be had.
    QueryError
        A scene that cannot be heard, seen or felt.
    """
    one_thread_each()
    world = PlayedWorld(OpenedScene.of(scene))
    with world.running():
        serve_until_stopped(scene, page_of_world(world), port, open_browser)
