"""Who does the units of a task: this process, or others (`dask_workers`).

Results do not depend on it, for every unit has its own seed.
"""

from collections.abc import Callable
from typing import Any, Protocol


class Workers(Protocol):
    """Those who do units of work."""

    def share(self, value: Any) -> Any:
        """Return what stands for a large value among the arguments of many units."""

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return what stands for a result, also among the arguments of units that are submitted later."""

    def gather(self, results: list[Any]) -> list[Any]:
        """Return results once all are there."""


class Here:
    """This process, which does each unit as it is submitted."""

    def share(self, value: Any) -> Any:
        """Return the value."""
        return value

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return the result."""
        return function(*arguments)

    def gather(self, results: list[Any]) -> list[Any]:
        """Return the results."""
        return results
