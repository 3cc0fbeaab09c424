"""Folds of objects that are unseen together: near twins in one, and the data set's test objects first."""

from functools import lru_cache
from itertools import combinations

import numpy as np
from scipy.sparse.csgraph import connected_components

from learning.runs import Objects
from learning.settings import Settings
from learning.shapes import inside, overlap, unit_mesh, volume_points
from objectfolder.products import object_split

# Intersection over union of convex hulls in the unit frame. Among a hundred scans it joins ten nested cups,
# five bottles of tablets, three figures of one mould, two cans; .85 parts figures and cans.
TWIN_OVERLAP = 0.8
SMALLEST_FOLD = 2  # a gallery of one would be no choice
TESTED_FIRST = ("test", "validation", "train")


@lru_cache(maxsize=1)
def near_twins(objects: Objects) -> list[list[int]]:
    """Return groups of objects that are alike in shape, whatever their size; most objects are alone.

    Two objects whose convex hulls have an `overlap` of `TWIN_OVERLAP` in the unit frame are in one group, and
    so are those that a chain of such pairs joins. Hulls are closed where surfaces are not.

    Returns
    -------
    Positions in `Objects.ids`, in order, by group in the order of their first.
    """
    points = volume_points(seed=0)
    volumes = [inside(unit_mesh(file).convex_hull, points) for file in objects.files.values()]
    alike = np.eye(len(volumes), dtype=bool)
    for first, second in combinations(range(len(volumes)), 2):
        alike[first, second] = overlap(volumes[first], volumes[second]) >= TWIN_OVERLAP
    count, groups = connected_components(alike, directed=False)
    return [np.flatnonzero(groups == group).tolist() for group in range(count)]


def folds_of(objects: Objects, settings: Settings) -> list[list[int]]:
    """Return the objects that are unseen together, in folds of about equal size.

    Groups of `near_twins` stay together. They are dealt in an order that begins with those whose first object
    is of the data set's own test split (`object_split`), then of its validation split: what a network of the
    first fold was not trained on is, in a large data set, what other users of it hold out.

    Returns
    -------
    Positions in `Objects.ids`. None at all where every object has a near twin in what is left.
    """
    groups = near_twins(objects)
    order = np.random.default_rng(0).permutation(len(groups))
    ranks = [TESTED_FIRST.index(_split_of(objects, groups[group][0])) for group in order]
    count, left = min(settings.folds, len(objects) // SMALLEST_FOLD), len(objects)
    folds: list[list[int]] = []
    fold: list[int] = []
    for group in order[np.argsort(ranks, kind="stable")]:
        fold = fold + groups[group]
        if len(fold) >= max(SMALLEST_FOLD, left // max(1, count - len(folds))):
            folds.append(fold)
            left, fold = left - len(fold), []
    if fold and folds:
        folds[-1] = folds[-1] + fold
    return folds if len(folds) > 1 else []


def _split_of(objects: Objects, position: int) -> str:
    name = objects.ids[position]
    return object_split(name, objects.files[name].material or "")
