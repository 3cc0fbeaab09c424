"""Shared fixtures."""

import sys
from pathlib import Path

# The servers that tests of the pipeline stand up are modules of its folder.
sys.path.append(str(Path(__file__).parents[1] / "pipeline"))
