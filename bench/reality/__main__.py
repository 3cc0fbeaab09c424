"""Compare the product with measurements of real things.

Prints the page and, where no measurement is absent, writes it to ``docs/reality.md`` with its pictures, and
its figures to ``bench/results/reality.json``. The bundle of measurements lies beside the checkout, or in the
folder that ``--bundle`` names.
"""

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

from bench.reality import sound
from bench.reality.fitted_sound import fitted_sound_rows
from bench.reality.gel import force_rows, marker_rows
from bench.reality.photographs import digit_rows, gelsight_rows
from bench.reality.plots import DECAYS, PHOTOGRAPHS, draw
from bench.reality.row import Row, page
from bench.record import REPOSITORY, arguments, write

BUNDLE = REPOSITORY.parent / "shared" / "reality"
# By the folder or file of the bundle that a comparison reads.
COMPARISONS: dict[str, Callable[[Path], list[Row]]] = {
    "sound": sound.compare,
    "sound/bowl": fitted_sound_rows,
    "touch/mini_force.csv": force_rows,
    "touch/markers": marker_rows,
    "touch/digit": digit_rows,
    "touch/gelsight": gelsight_rows,
}
# By sense.
PICTURES = {"sound": DECAYS, "touch": PHOTOGRAPHS}
COMPARED = "The product against measurements of real things, held out from what was fitted"


def main() -> None:
    """Run the comparisons whose measurements are there."""
    parser = arguments(__doc__)
    parser.add_argument("--bundle", type=Path, default=BUNDLE, help="folder of the measurements")
    bundle: Path = parser.parse_args().bundle
    rows: list[Row] = []
    absent = []
    for folder, compare in COMPARISONS.items():
        if (bundle / folder).exists():
            rows += compare(bundle / folder)
        else:
            absent.append(folder)
            print(f"{bundle / folder} is absent: its lines are left out, and nothing is written")
    if not rows:
        parser.error(f"{bundle} holds no measurements; name their folder with --bundle")
    rows.sort(key=lambda row: row.sense)
    print(page(rows))
    if not absent:
        settings = {"measurements": list(COMPARISONS)}
        print(write("reality", {"rows": [asdict(row) for row in rows]}, settings, COMPARED))
        draw(rows, REPOSITORY / "docs")
        (REPOSITORY / "docs" / "reality.md").write_text(page(rows, PICTURES), encoding="utf-8")


if __name__ == "__main__":
    main()
