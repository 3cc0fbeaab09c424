"""Queries that make no sense end in one line that names the argument and the remedy, at once."""

import time
from collections.abc import Iterator

import numpy as np
import pytest
from bad_queries import SIGHT, SOUND, TOUCH, Query

import objectfolder
from objectfolder.errors import QueryError
from objectfolder.object_file import ObjectFile

SECONDS = 2.0


@pytest.fixture(scope="module")
def asked(small_file) -> ObjectFile:
    """The bar, asked once, so that its kernels are there."""
    file = objectfolder.load(small_file)
    points, normals = file.sample_contacts(1, seed=0, reachable=False)
    file.render(*file.sample_views(1, seed=0), 16)
    file.strike(points, -normals, 0.01)
    file.press(points)
    return file


ALL = SIGHT | SOUND | TOUCH


def answer(query: Query, file: ObjectFile) -> None:
    """Ask, and take the first part of what comes in parts."""
    answered = query(file)
    if isinstance(answered, Iterator):
        next(answered)


@pytest.mark.parametrize("query", ALL.values(), ids=ALL.keys())
def test_a_query_that_makes_no_sense_is_refused_at_once_and_by_name(query: Query, asked: ObjectFile) -> None:
    begin = time.process_time()
    with pytest.raises(QueryError) as refused:
        answer(query, asked)
    assert time.process_time() - begin < SECONDS
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 300
    assert refused.value.where
    assert refused.value.remedy


def test_there_are_sixty_of_each_sense() -> None:
    assert min(len(SIGHT), len(SOUND), len(TOUCH)) >= 60
    assert len(ALL) == len(SIGHT) + len(SOUND) + len(TOUCH)


def test_what_is_nearly_too_much_is_answered(asked: ObjectFile) -> None:
    cameras, lights = asked.sample_views(1, seed=0)
    assert asked.render(cameras, lights, (1, 1)).shape == (1, 1, 1, 3)
    assert asked.render(cameras, lights, 16, sub_rays=4096).shape == (1, 16, 16, 3)
    assert asked.render(cameras, lights, 1 << 20, crop=(1 << 19, 1 << 19, 2, 2)).shape == (1, 2, 2, 3)
    points, normals = asked.sample_contacts(1, seed=0, reachable=False)
    assert asked.strike(points, -normals, 1 / 44100).shape == (1, 1)
    assert asked.strike(points, -normals, 0.01, modes=0).shape == (1, 441)
    assert asked.press(points, 0.0, 45.0, -720.0, roll_deg=1e6).rgb.shape == (1, 160, 120, 3)
    assert asked.press(points, resolution=(8, 6)).rgb.shape == (1, 8, 6, 3)
    assert np.isfinite(asked.press(np.repeat(points, 2, 0), noise_seed=[1, 2]).rgb).all()
