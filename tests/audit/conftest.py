"""Shared paths."""

import sys
from pathlib import Path

# The real stages over toy bodies, and the S3 server, are modules of the pipeline's tests.
sys.path.append(str(Path(__file__).parents[1] / "pipeline"))
