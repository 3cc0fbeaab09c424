"""Files of the project that a command takes where none is named."""

from pathlib import Path

REPOSITORY = Path(__file__).parents[2]
MATERIALS = REPOSITORY / "data" / "materials.csv"
PARAMETERS = REPOSITORY / "params.yaml"
