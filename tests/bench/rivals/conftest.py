"""Rivals are tried on the shapes of the senses' tests."""

import sys
from pathlib import Path

sys.path.extend(str(Path(__file__).parents[2] / sense) for sense in ("audio", "vision", "touch"))
