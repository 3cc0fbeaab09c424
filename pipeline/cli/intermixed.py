"""Commands whose ids may stand before, between and after their options."""

import argparse
from typing import Any


class IntermixedParser(argparse.ArgumentParser):
    """A parser that gives words after an option to the last positional argument, where that takes any number.

    `argparse` ends such an argument at the first option: of ``get REPO -o FOLDER mug`` it would refuse
    ``mug``. Its own remedy, `parse_intermixed_args`, does not go into sub-commands.
    """

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse; return the options and what nothing takes."""
        options, rest = super().parse_known_args(args, namespace)
        positionals = self._get_positional_actions()
        last = positionals[-1] if positionals else None
        words = [word for word in rest if not word.startswith("-")]
        if words and last is not None and last.nargs == "*" and last.choices is None and last.type is None:
            setattr(options, last.dest, [*(getattr(options, last.dest) or []), *words])
            rest = [word for word in rest if word.startswith("-")]
        return options, rest
