"""The example in the docstring of a public function, class or method, run as it stands."""

import doctest
from collections.abc import Callable
from typing import Any


def run_example(name: str, documented: Callable[..., Any]) -> None:
    """Run it in the current folder, and fail with what it yields where that is not what it says."""
    own = {documented.__name__: documented}  # what else an example needs, it imports
    tests = doctest.DocTestFinder(recurse=False).find(documented, name, globs=own)
    assert sum(len(test.examples) for test in tests) > 0, f"{name} has no example"
    runner, output = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS), list[str]()
    for test in tests:
        runner.run(test, out=output.append)
    assert runner.failures == 0, "".join(output)
