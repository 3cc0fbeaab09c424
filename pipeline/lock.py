"""``python -m pipeline.lock FILE``: pin what the extras of this project need, as installed here."""

import importlib.metadata
import re
import sys
from pathlib import Path

from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

PROJECT = "objectfolder-factory"
EXTRAS = ("factory", "s3", "ssh", "slurm", "kubernetes", "xarray", "dev")
HEADER = """\
# What the project with all its extras resolves to on Python 3.11; written by `make lock` from a working
# environment.
# torch has no build suffix, so that any build of the version serves: CPU or CUDA.
"""


def pinned(project: str, extras: tuple[str, ...]) -> dict[str, str]:
    """Return the versions installed of all that a project with these extras needs, itself left out.

    Raises
    ------
    importlib.metadata.PackageNotFoundError
        Something needed is not installed.
    """
    found: dict[str, str] = {}
    seen: set[tuple[str, str]] = set()
    pending = [(project, extra) for extra in ("", *extras)]
    while pending:
        name, extra = pending.pop()
        if (name, extra) in seen:
            continue
        seen.add((name, extra))
        distribution = importlib.metadata.distribution(name)
        if name != project:
            found[name] = distribution.version.partition("+")[0]
        environment = {**{key: str(value) for key, value in default_environment().items()}, "extra": extra}
        for text in distribution.requires or []:
            requirement = Requirement(text)
            if requirement.marker is None or requirement.marker.evaluate(environment):
                needed = canonicalize_name(requirement.name)
                pending.extend((needed, wanted) for wanted in ("", *requirement.extras))
    return dict(sorted(found.items()))


def main() -> None:
    """Write the lock file named on the command line."""
    lines = [f"{name}=={version}" for name, version in pinned(PROJECT, EXTRAS).items()]
    unknown = [line for line in lines if not re.fullmatch(r"[a-z0-9-]+==[A-Za-z0-9.!]+", line)]
    if unknown:
        sys.exit(f"cannot be pinned: {', '.join(unknown)}")
    Path(sys.argv[1]).write_text(HEADER + "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
