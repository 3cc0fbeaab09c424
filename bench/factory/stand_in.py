"""Networks trained on Object Files or on the simulated truth, and tested on either; and a detector of both.

    python -m bench.factory.stand_in FOLDER

FOLDER has ``stand_in.json`` of ``python -m learning stand_in --results FOLDER``.
"""

from typing import Any

from bench.factory.learning import record
from bench.record import save, subplots

COMPARED = "Recognition on one source with training on the other, beside training on the same"


def draw(figures: dict[str, Any]) -> None:
    found = figures["stand_in"]
    picture, (left, right) = subplots(1, 2, figsize=(10, 4))
    senses = list(found["recognition"])
    ways = list(found["recognition"][senses[0]])
    for index, way in enumerate(ways):
        heights = [found["recognition"][sense][way] for sense in senses]
        places = [place + 0.2 * index for place in range(len(senses))]
        left.bar(places, heights, 0.18, label=way.replace("object_file", "Object File"))
    left.set_xticks([place + 0.3 for place in range(len(senses))], senses)
    left.set(ylabel="named rightly, %", title="trained on, and tested on")
    left.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=2)
    for place, sense in enumerate(senses):
        told = found["detector"][sense]
        low, high = told["interval_percent"]
        right.plot([place, place], [low, high], "k-")
        right.plot(place, told["right_percent"], "ko")
    right.axhline(50, linestyle=":", color="grey")
    right.set_xticks(range(len(senses)), senses)
    right.set(ylabel="told apart, %, with 95 % confidence", title="a detector of both", ylim=(40, 75))
    save(picture, "stand_in")


if __name__ == "__main__":
    record("stand_in", "stand_in", COMPARED, draw)
