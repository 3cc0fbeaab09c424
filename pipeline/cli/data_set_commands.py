"""The commands `status`, `plan` and `clean`, for the data set in the current folder."""

import argparse
import importlib
from collections.abc import Sequence
from typing import Any

COMMANDS = {
    "status": ("pipeline.run.status", "say what is as the inputs ask for, what is not, and why"),
    "plan": ("pipeline.run.forecast.plan", "say what a run would do and take, or what the last one took"),
    "clean": ("pipeline.run.clean", "list what is safe to remove, and remove it with --yes"),
}


def add_commands(commands: Any, chosen: Sequence[str]) -> None:
    """Add the commands of this module; of modules that are slow to import, only the chosen one's is."""
    for name, (module, text) in COMMANDS.items():
        command = commands.add_parser(name, help=text, description=text)
        if [name] == list(chosen):
            importlib.import_module(module).add_arguments(command)
        command.set_defaults(run=run, module=module)


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit status."""
    return int(importlib.import_module(options.module).main(options))
