"""What no product knows of a data set: its title, where it is published, by whom and when.

Read from ``data/card.yaml``, which its publisher writes; every key may be left out. Nothing is invented
in place of what is not stated.
"""

import datetime
from pathlib import Path
from typing import Annotated

from pydantic import ConfigDict, StringConstraints
from pydantic.dataclasses import dataclass

from pipeline.dataset.validation import read_yaml, validated

PUBLICATION = Path("data/card.yaml")
Address = Annotated[str, StringConstraints(pattern=r"^https?://\S+$")]


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Publication:
    """The statements of the publisher; empty where there are none.

    Parameters
    ----------
    version
        MAJOR.MINOR.PATCH; a digest of the Object Files is appended.
    url
        Page of the data set.
    files_url
        Address that paths such as ``data/object_files/mug.safetensors`` are relative to, if files are served.
    doi
        Without ``https://doi.org/``.
    creators
        Names of people or groups.
    """

    title: str = "ObjectFolder Factory data set"
    description: str = ""
    version: Annotated[str, StringConstraints(pattern=r"^\d+\.\d+\.\d+$")] = "0.1.0"
    date: datetime.date | None = None
    url: Address = ""
    files_url: Address = ""
    doi: str = ""
    creators: tuple[Annotated[str, StringConstraints(min_length=1)], ...] = ()


def read_publication(root: Path) -> Publication:
    """Read ``data/card.yaml`` of the data set at `root`.

    Raises
    ------
    InputError
        A file that is not YAML, an unknown key, or a value of a wrong kind.
    """
    path = root / PUBLICATION
    if not path.is_file():
        return Publication()
    return validated(str(PUBLICATION), Publication, read_yaml(path) or {})
