"""Results of a comparison as a file: the figures, how they were taken, and by which code."""

import argparse
import json
import platform
import subprocess
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REPOSITORY = Path(__file__).parents[1]
RESULTS = REPOSITORY / "bench" / "results"
PACKAGES = ("numpy", "scipy", "torch")


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
        A figure that is not finite: say None where there is none.
    """
    content = {
        "name": name,
        "compared": compared,
        "figures": figures,
        "settings": settings,
        "versions": versions(),
    }
    text = json.dumps(content, indent=1, default=_plain, allow_nan=False, ensure_ascii=False)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.json"
    path.write_text(text + "\n", encoding="utf-8")
    return path


def arguments(description: str | None) -> argparse.ArgumentParser:
    """Return a parser whose help keeps the lines of `description`, the module's docstring or a phrase."""
    kept = argparse.RawDescriptionHelpFormatter
    return argparse.ArgumentParser(description=description, formatter_class=kept)


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


def versions() -> dict[str, Any]:
    """Return the versions of python, packages and project that decide the figures; None for one absent."""
    found: dict[str, Any] = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = None
    found["processor"] = _processor()
    found["commit"] = _git("rev-parse", "HEAD")
    status = _git(
        "status", "--porcelain", "--untracked-files=no", "--", "objectfolder", "pipeline", "bench/*.py"
    )
    found["uncommitted_changes"] = None if status is None else bool(status)
    return found


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
