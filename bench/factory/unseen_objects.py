"""Retrieval of objects that no network was trained on, beside closed forms and chance.

    python -m bench.factory.unseen_objects FOLDER

FOLDER has ``retrieval.json`` of ``python -m learning retrieval --results FOLDER``.
"""

from typing import Any

from bench.factory.learning import record
from bench.record import save, subplots

COMPARED = "Objects that no network was trained on, beside closed forms on the same features, and chance"
METHODS = ("ours", "CCA", "PLS", "classify, then look up")


def draw(figures: dict[str, Any]) -> None:
    picture, axes = subplots(figsize=(9, 4))
    unseen = figures["retrieval"]["unseen"]
    directions = sorted(unseen)
    for index, method in enumerate(METHODS):
        scores = [unseen[direction][method]["map_one_positive"] for direction in directions]
        axes.bar([place + 0.2 * index for place in range(len(directions))], scores, 0.18, label=method)
    chance = [unseen[direction]["ours"]["chance_one_positive"] for direction in directions]
    axes.plot([place + 0.3 for place in range(len(directions))], chance, "k_", markersize=30, label="chance")
    axes.set_xticks([place + 0.3 for place in range(len(directions))], directions)
    axes.set(ylabel="mAP, one positive", title="Retrieval, unseen objects")
    axes.legend(loc="upper left", bbox_to_anchor=(1, 1))
    save(picture, "unseen_objects")


if __name__ == "__main__":
    record("unseen_objects", "retrieval", COMPARED, draw)
