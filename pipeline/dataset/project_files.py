"""Files that a command takes where none is named; in a checkout they are links to those of the data set."""

from pathlib import Path

DEFAULTS = Path(__file__).parents[1] / "defaults"
MATERIALS = DEFAULTS / "materials.csv"
PARAMETERS = DEFAULTS / "params.yaml"
DASHBOARD = Path(".objectfolder/dashboard")  # where Dask's dashboard of the run is, while it runs
