"""Whether a grasp will hold, told from images and gels, against how many grasps were trained on.

    python -m bench.factory.grasping FOLDER

FOLDER has ``grasping.json`` of ``python -m learning grasping --results FOLDER``.
"""

from typing import Any

from bench.factory.learning import record
from bench.record import save, subplots

COMPARED = "What networks tell from one image and both gels, beside the commoner outcome, and boosted trees"


def draw(figures: dict[str, Any]) -> None:
    curve, spread = figures["grasping"]["accuracy_percent"], figures["grasping"]["sd_percent"]
    sizes = sorted(curve, key=int)
    picture, axes = subplots(figsize=(9, 4))
    for who in curve[sizes[0]]:
        means, deviations = ([row[size][who] for size in sizes] for row in (curve, spread))
        axes.errorbar([int(size) for size in sizes], means, deviations, marker="o", capsize=3, label=who)
    axes.set(xscale="log", xlabel="grasps trained on", ylabel="told rightly, %", title="Will it be held?")
    axes.legend(loc="upper left", bbox_to_anchor=(1, 1))
    save(picture, "grasping")


if __name__ == "__main__":
    record("grasping", "grasping", COMPARED, draw)
