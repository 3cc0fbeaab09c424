"""Retrieval and reconstruction of objects that no network was trained on, beside those that were.

    python -m bench.factory.unseen_objects FOLDER

FOLDER has the results of ``python -m learning TASK --results FOLDER`` for retrieval and reconstruction.
"""

from typing import Any

from bench.factory.learning import record
from bench.record import save, subplots

COMPARED = "Objects that no network was trained on, beside closed forms, chance, and the nearest known shape"
METHODS = ("ours", "CCA", "PLS", "classify, then look up")


def draw(figures: dict[str, Any]) -> None:
    picture, (left, right) = subplots(1, 2, figsize=(13, 4))
    unseen = figures["retrieval"]["unseen"]
    directions = sorted(unseen)
    for index, method in enumerate(METHODS):
        scores = [unseen[direction][method]["map_one_positive"] for direction in directions]
        left.bar([place + 0.2 * index for place in range(len(directions))], scores, 0.18, label=method)
    chance = [unseen[direction]["ours"]["chance_one_positive"] for direction in directions]
    left.plot([place + 0.3 for place in range(len(directions))], chance, "k_", markersize=30, label="chance")
    left.set_xticks([place + 0.3 for place in range(len(directions))], directions)
    left.set(ylabel="mAP, one positive", title="Retrieval, unseen objects")
    left.legend()
    seen = figures["reconstruction"]["seen"]
    one_fold = {sense: folds[0] for sense, folds in figures["reconstruction"]["unseen"].items()}
    senses = list(seen)
    rows = {
        "seen": [seen[sense]["ours"]["iou"] for sense in senses],
        "seen, looked up": [seen[sense]["look_up"]["iou"] for sense in senses],
        "unseen": [one_fold[sense]["ours"]["iou"] for sense in senses],
        "unseen, nearest known shape": [one_fold[sense]["nearest_known"]["iou"] for sense in senses],
    }
    for index, (label, values) in enumerate(rows.items()):
        right.bar([place + 0.2 * index for place in range(len(senses))], values, 0.18, label=label)
    right.set_xticks([place + 0.3 for place in range(len(senses))], senses)
    right.set(ylabel="IoU", title="Reconstruction")
    right.legend()
    save(picture, "unseen_objects")


if __name__ == "__main__":
    record("unseen_objects", "retrieval", COMPARED, draw)
