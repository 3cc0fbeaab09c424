"""Touches as ObjectFolder 1.0 has them: at vertices of the surface, along their normals, all as deep."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from learning.runs import kept
from learning.samples import Floats, Samples, Source, pressed, reachable_vertices, regions_of
from learning.settings import Settings
from objectfolder.errors import InputError
from objectfolder.object_file import ObjectFile
from objectfolder.products.provenance import seed_from

AT_VERTICES = ("vertex", "vertex region")  # protocols
REMEDY = "Leave it out, or ask for fewer touches to test and to validate"
Mask = NDArray[np.bool_]


def touched_vertices(
    file: Source,
    name: str,
    file_digest: str,
    settings: Settings,
    protocol: str,
    seed: int,
    splits: Sequence[str],
) -> dict[str, Samples]:
    """Press at an object's vertices of several splits.

    Touches of meshes are kept, so that a run of a hundred that was stopped goes on with the next of them.

    Parameters
    ----------
    file_digest
        Of the object's file.
    protocol
        ``"vertex"``: test vertices are any; ``"vertex region"``: they lie in regions without another split.

    Raises
    ------
    InputError
        No vertices are left to train on, or none to test on.
    """
    depth_m, pixels = settings.touch_at_vertices.depth_m, settings.data.resolution.touch
    if isinstance(file, ObjectFile):
        places, held_out = _vertices(file, name, settings, seed)
        rows_by_split = _rows(held_out, name, settings, protocol)
        return {split: pressed(file, places[rows_by_split[split]], depth_m, pixels) for split in splits}
    key = {
        "unit": "touches", "object": name, "file": file_digest, "seed": seed,
        "count": _count(settings), "regions": settings.data.regions, "depth_m": depth_m, "pixels": pixels,
        "sensor": settings.touch_at_vertices.sensor,
    }  # fmt: skip
    stored = kept(__name__, key, lambda: _all_touches(file, name, settings, seed))
    rows_by_split = _rows(stored["held_out"], name, settings, protocol)
    return {
        split: Samples(
            torch.from_numpy(stored["inputs"][rows_by_split[split]]),
            stored["places"][rows_by_split[split]],
            stored["queries"][rows_by_split[split]],
            float(stored["extent"]),
        )
        for split in splits
    }


def _count(settings: Settings) -> int:
    return settings.data.test + settings.data.validation + settings.touch_at_vertices.training


def _vertices(file: Source, name: str, settings: Settings, seed: int) -> tuple[Floats, Mask]:
    """Return vertices (n, 3) that can be pressed, in random order, and which lie in held-out regions."""
    data = settings.data
    order_seed = seed_from(seed, "touch vertex", name)
    places = reachable_vertices(file, settings.touch_at_vertices.depth_m, order_seed, _count(settings))
    if len(places) <= data.test + data.validation:
        finding = f"{len(places)} vertices can be pressed, {data.test + data.validation + 1} are needed"
        raise InputError(name, finding, REMEDY)
    _, tested = regions_of(file, "touch", data.regions, seed_from(seed, "regions", name))
    return places, tested(places)


def _all_touches(file: Source, name: str, settings: Settings, seed: int) -> dict[str, NDArray[Any]]:
    places, held_out = _vertices(file, name, settings, seed)
    samples = pressed(file, places, settings.touch_at_vertices.depth_m, settings.data.resolution.touch)
    return {
        "inputs": samples.inputs.numpy(), "places": places, "queries": samples.queries,
        "extent": np.array(samples.extent), "held_out": held_out,
    }  # fmt: skip


def _rows(held_out: Mask, name: str, settings: Settings, protocol: str) -> dict[str, NDArray[np.int64]]:
    """Return the rows of each split: those of test come first, then those of validation, others train."""
    data, rows = settings.data, np.arange(len(held_out))
    tested = rows if protocol == "vertex" else rows[held_out]
    test = tested[: data.test]
    others = rows[data.test :] if protocol == "vertex" else rows[~held_out]
    training = others[data.validation :]
    if not len(training) or len(test) < data.test:
        finding = f"{len(tested)} of {len(rows)} vertices lie in held-out regions"
        needed = f"{data.test} there and {data.validation + 1} elsewhere are needed"
        raise InputError(name, f"{finding}: {needed}", REMEDY)
    return {"test": test, "validation": others[: data.validation], "training": training}
