"""Options that commands share, each declared once."""

import re
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

PLACE, STORE = "OBJECTFOLDER_CLUSTER", "OBJECTFOLDER_REMOTE"
UNIT = re.compile(r"_(m_s|m|s|hz|kg|deg|n)$")


def option_name(name: str) -> str:
    """Return the option of a parameter; units are in the help, not in the option."""
    return {"object_id": "id"}.get(name, UNIT.sub("", name)).replace("_", "-")


# The fields of a request of a room below, each an option.
Fields = Parameter(name="*")
AtLeastOne = Parameter(validator=Number(gte=1))

Root = Annotated[Path, Parameter(help="folder of the data set")]
Output = Annotated[Path, Parameter(alias="-o")]
Overwrite = Annotated[bool, Parameter(help="replace what an earlier run wrote there")]
ObjectFilePath = Annotated[Path, Parameter(help="an Object File (.safetensors)")]
MeshOrFile = Annotated[
    Path,
    Parameter(help="a mesh that `build` takes (OBJ, glTF, PLY, STL, FBX, USD and others), or an Object File"),
]
Materials = Annotated[Path, Parameter(help="materials table (CSV)")]
Json = Annotated[bool, Parameter(help="print JSON")]
Remote = Annotated[str, Parameter(env_var=STORE, help="DVC remote to read from (default: the repository's)")]
Cluster = Annotated[
    str | None,
    Parameter(env_var=PLACE, help="where to run: a name in cluster/, a YAML file or a scheduler's address"),
]
