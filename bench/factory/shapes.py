"""Shapes from an image, a strike, or both, beside looking up the mesh of the object that was named.

    python -m bench.factory.shapes FOLDER

FOLDER has ``reconstruction.json`` of ``python -m learning reconstruction --results FOLDER``.
"""

from typing import Any

from bench.factory.learning import record
from bench.record import save, subplots
from learning.page import PUBLISHED_SHAPES

COMPARED = "Predicted shapes beside meshes of named objects, of the nearest known one, and published shapes"
WAYS = {"ours": "predicted", "look_up": "mesh of the named object", "nearest_known": "nearest known shape"}


def draw(figures: dict[str, Any]) -> None:
    found = figures["reconstruction"]
    unseen = {name: folds[0] for name, folds in found["unseen"].items()}
    picture, (left, right) = subplots(1, 2, figsize=(9, 4), sharey=True)
    _bars(left, found["seen"], ["ours", "look_up"])
    _bars(right, unseen, list(WAYS))
    places = [place + 0.13 for place in range(len(found["seen"]))]
    heights = [PUBLISHED_SHAPES[name][0] for name in found["seen"]]
    published = left.plot(places, heights, "k_", markersize=30, label="published")
    left.set(title="seen objects", ylabel="IoU", ylim=(0, 1))
    right.set(title="unseen objects")
    right.legend(handles=[*right.containers, *published], loc="upper left")
    save(picture, "shapes")


def _bars(axes: Any, row: dict[str, Any], ways: list[str]) -> None:
    for index, way in enumerate(ways):
        heights = [one[way]["iou"] for one in row.values()]
        axes.bar([place + 0.27 * index for place in range(len(row))], heights, 0.25, label=WAYS[way])
    axes.set_xticks([place + 0.13 * (len(ways) - 1) for place in range(len(row))], list(row))


if __name__ == "__main__":
    record("shapes", "reconstruction", COMPARED, draw)
