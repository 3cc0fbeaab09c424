"""The command `cards`: what a data set is published with."""

import argparse
from pathlib import Path
from typing import Any


def add_commands(commands: Any) -> None:
    """Add the commands of this module to a parser's sub-commands."""
    text = "write the cards of a data set: croissant.json, data_card.md, CITATION.cff"
    command = commands.add_parser("cards", help=text, description=text)
    command.add_argument("root", nargs="?", default=".", help="root of the data set (default: here)")
    command.add_argument("-o", "--output", metavar="FOLDER", help="folder of its reports (default: reports)")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Write the cards; say where they are."""
    from pipeline.publish.cards.all_cards import CARDS, write_cards

    folder = Path(options.output) if options.output else Path(options.root) / "reports"
    write_cards(Path(options.root), folder)
    print("\n".join(str(folder / name) for name in CARDS))
