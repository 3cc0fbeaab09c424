"""``objectfolder view``: look at, strike and press one object in the browser."""

import argparse
import os
import sys
from typing import Any

TEXT = "turn, strike and press an object in the browser; served to this machine alone"


def add_commands(commands: Any) -> None:
    """Add the command to a parser's sub-commands."""
    command: argparse.ArgumentParser = commands.add_parser("view", help=TEXT, description=TEXT)
    command.add_argument("file", metavar="FILE.safetensors", help="an Object File")
    command.add_argument("--port", type=int, default=0, help="of 127.0.0.1 (default 0: any free one)")
    command.add_argument("--no-browser", action="store_true", help="print the address, open nothing")
    command.set_defaults(run=view)


def view(options: argparse.Namespace) -> None:
    """Serve the page until Ctrl-C, and end the process."""
    from pipeline.publish.viewer.live import serve_until_stopped

    serve_until_stopped(options.file, options.port, not options.no_browser)
    # Code may still be compiled, or an image computed, in a thread that nothing can stop and that Python
    # would wait for. Nobody wants what it makes any more, and nothing is left to be written.
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)
