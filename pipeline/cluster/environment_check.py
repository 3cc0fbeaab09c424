"""Whether a worker would compute the numbers that the driver asks for: its Python, packages and code.

A product's fingerprint names the code and the package versions of the driver. A worker that has others
would store its numbers under a name that is not theirs, so it gets no work.
"""

import platform
import sys
from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import BaseModel

from objectfolder.errors import InputError
from objectfolder.products.provenance import code_identity, package_versions
from pipeline.dataset.differences import differences

NAMED = 3  # differing modules that a message names


class Environment(BaseModel):
    """The versions and code that decide numbers.

    Parameters
    ----------
    python
        Version of Python, ``major.minor``.
    packages
        Distribution to version.
    code
        Task module to the digests of its code, module by module; none where the module is missing.
    """

    python: str
    packages: Mapping[str, str] = {}
    code: Mapping[str, Mapping[str, str]] = {}


def environment_here(packages: Iterable[str], modules: Iterable[str]) -> Environment:
    """Return the environment of this process, of the named distributions and task modules."""
    python = ".".join(platform.python_version_tuple()[:2])
    code = {}
    for module in sorted(set(modules)):
        try:
            code[module] = code_identity(module)
        except InputError:
            code[module] = {}
    return Environment(python=python, packages=package_versions(set(packages)), code=code)


def environment_of(stages: Iterable[Any]) -> Environment:
    """Return the environment that the driver's fingerprints of `stages` name."""
    requirement = [(stage.packages, stage.task.partition(":")[0]) for stage in stages]
    return environment_here(
        {name for names, _ in requirement for name in names}, [task for _, task in requirement]
    )


def differences_of(requirement: Environment, environment: Environment) -> list[str]:
    """Return what differs, one sentence part each; empty where the worker may work."""
    before, now = (
        {
            "packages": {"Python": entry.python, **entry.packages},
            "code": {name: digest for digests in entry.code.values() for name, digest in digests.items()},
        }
        for entry in (requirement, environment)
    )
    changes = differences(before, now)
    parts = [
        f"{entry.name} {entry.new} instead of {entry.old}" for entry in changes if entry.kind == "package"
    ]
    if modules := [entry.name for entry in changes if entry.kind == "code"]:
        more = f" and {len(modules) - NAMED} more" if len(modules) > NAMED else ""
        parts.append(f"other code in {', '.join(modules[:NAMED])}{more}")
    return parts


def main() -> None:
    """Say on standard output what differs here from the environment on standard input, in one line."""
    requirement = Environment.model_validate_json(sys.stdin.read())
    print(", ".join(differences_of(requirement, environment_here(requirement.packages, requirement.code))))


if __name__ == "__main__":
    main()
