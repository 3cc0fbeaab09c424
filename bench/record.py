"""Results of a comparison as files: the figures, how they were taken, by which code, and their picture.

``python -m bench.record [NAME ...]`` draws the pictures again from the stored figures. Without names it
draws all that there are.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REPOSITORY = Path(__file__).parents[1]
RESULTS = REPOSITORY / "bench" / "results"
PACKAGES = ("numpy", "scipy", "torch")
FOLDERS = ("factory", "senses")  # of benches


def conclude(
    name: str,
    figures: Mapping[str, Any],
    settings: Mapping[str, Any],
    compared: str,
    draw: Callable[[dict[str, Any]], None] | None = None,
) -> None:
    """Write ``NAME.json`` as `write` does; draw what a page shows from the figures that are stored there."""
    path = write(name, figures, settings, compared)
    if draw is not None:
        draw(stored(name)["figures"])
    print(path)


def stored(name: str) -> dict[str, Any]:
    """Return the content of ``NAME.json``."""
    content: dict[str, Any] = json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))
    return content


def benches() -> dict[str, Path]:
    """Return the modules that ``python -m bench`` runs, by name."""
    paths = (path for folder in FOLDERS for path in (REPOSITORY / "bench" / folder).glob("*.py"))
    texts = {path: path.read_text(encoding="utf-8") for path in sorted(paths)}
    return {
        path.stem: path for path, text in texts.items() if "\ndef main()" in text and "arguments(" in text
    }


def pictures() -> list[str]:
    """Return the comparisons that have a picture."""
    return sorted(path.stem for path in RESULTS.glob("*.png"))


def redraw(name: str) -> None:
    """Draw the stored figures of a comparison by the function `draw` of its module."""
    folder = benches()[name].parent.name
    import_module(f"bench.{folder}.{name}").draw(stored(name)["figures"])


def write(
    name: str,
    figures: Mapping[str, Any],
    settings: Mapping[str, Any],
    compared: str,
    *,
    folder: Path = RESULTS,
) -> Path:
    """Write ``NAME.json`` and return its path.

    Parameters
    ----------
    name
        Of the comparison: the name of its module.
    figures
        What was measured, units in the keys; numpy scalars and arrays may be among them.
    settings
        What it was measured on: cases, sizes, repetitions, threads.
    compared
        What against what and by which measure, in a sentence.
    folder
        Where results lie.

    Raises
    ------
    TypeError
        A value that JSON cannot hold.
    ValueError
        A figure that is not finite: say None where there is none. No figures, settings or sentence; a folder
        of this machine among the values.
    """
    for part, value in {"figures": figures, "settings": settings, "compared": compared}.items():
        if not value:
            raise ValueError(f"{name}: no {part}; a figure stands with what was compared and how")
    content = {
        "name": name,
        "compared": compared,
        "figures": figures,
        "settings": settings,
        "versions": versions(),
    }
    text = json.dumps(content, indent=1, default=_plain, allow_nan=False, ensure_ascii=False)
    for place in (REPOSITORY, Path.home(), Path(tempfile.gettempdir())):
        if f"{place}/" in text:
            raise ValueError(
                f"{name}: a value names {place}, a folder of this machine; give a name without it"
            )
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.json"
    path.write_text(text + "\n", encoding="utf-8")
    return path


def arguments(
    description: str | None, *, keeps: str | None = None, only: Sequence[str] | None = None
) -> argparse.ArgumentParser:
    """Return a parser whose help keeps the lines of `description`, the module's docstring or a phrase.

    With `keeps` it has the option ``--folder``, in which what `keeps` says lies. With `only` it has
    ``--only``, which chooses among these names; among all that there are where `only` is empty.
    """
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    if keeps is not None:
        parser.add_argument("--folder", type=Path, required=True, help=f"where {keeps} are kept")
    if only is not None:
        parser.add_argument(
            "--only", nargs="+", metavar="ID", default=only, choices=only or None, help="cases to measure"
        )
    return parser


def subplots(rows: int = 1, columns: int = 1, **settings: Any) -> tuple["Figure", Any]:
    """Return a figure that needs no screen, and its axes; `settings` are those of `pyplot.subplots`."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    return pyplot.subplots(rows, columns, **{"layout": "constrained", **settings})


def save(figure: "Figure", name: str) -> None:
    """Write ``NAME.png`` beside the figures and close it."""
    from matplotlib import pyplot

    figure.savefig(RESULTS / f"{name}.png", dpi=110)
    pyplot.close(figure)


def measure_once(path: Path, measure: Callable[[], Mapping[str, Any]]) -> dict[str, Any]:
    """Return what `measure` finds, or what it found before and is kept as JSON in a file; delete that to
    measure again."""
    if not path.exists():
        row = {**measure(), "commit": versions()["commit"]}
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(row, default=_plain), encoding="utf-8")
        print(path.stem, "measured", flush=True)
    measurement: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return measurement


def rows_of(
    names: Iterable[str], measure: Callable[[str], Mapping[str, Any]], folder: Path
) -> dict[str, dict[str, Any]]:
    """Return the row of each case by name, measured or kept in a folder, and print its numbers."""
    rows = {}
    for name in names:
        rows[name] = measure_once(folder / f"{name}.json", partial(measure, name))
        numbers = {key: value for key, value in rows[name].items() if isinstance(value, int | float)}
        print(name, " ".join(f"{key} {value:.4g}" for key, value in numbers.items()), flush=True)
    return rows


def spread(
    rows: Iterable[Mapping[str, Any]], key: str, worst: Callable[..., float] = min
) -> dict[str, float]:
    """Return mean, median and worst of a number over the rows that have it; nothing where none has."""
    values = [row[key] for row in rows if row.get(key) is not None]
    if not values:
        return {}
    return {"mean": float(np.mean(values)), "median": float(np.median(values)), "worst": float(worst(values))}


def cpu_seconds() -> float:
    """CPU seconds of this process and of the child processes that have ended."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


class Stopwatch:
    """CPU seconds by step, as `cpu_seconds` counts them."""

    def __init__(self) -> None:
        self.cpu_s: dict[str, float] = {}

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Add the seconds of what runs within to those of a step."""
        start = cpu_seconds()
        yield
        self.cpu_s[name] = self.cpu_s.get(name, 0.0) + cpu_seconds() - start


def versions() -> dict[str, Any]:
    """Return the versions of python, packages and project that decide the figures; None for one absent."""
    environment: dict[str, Any] = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            environment[package] = version(package)
        except PackageNotFoundError:
            environment[package] = None
    environment["processor"] = _processor()
    environment["threads"] = os.environ.get("OMP_NUM_THREADS", "all")
    environment["commit"] = _git("rev-parse", "HEAD")
    status = _git(
        "status", "--porcelain", "--untracked-files=no", "--", "objectfolder", "pipeline", "bench/*.py"
    )
    environment["uncommitted_changes"] = None if status is None else bool(status)
    return environment


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def _git(*arguments: str) -> str | None:
    """Answer of git in the project, None without git or a repository."""
    try:
        done = subprocess.run(["git", *arguments], cwd=REPOSITORY, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")


if __name__ == "__main__":
    for picture in sys.argv[1:] or pictures():
        redraw(picture)
