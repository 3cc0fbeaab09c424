"""What no product knows of a data set: its title, where it is published, by whom and when.

Read from ``data/card.yaml``, which its publisher writes; every key may be left out. Nothing is invented
in place of what is not stated.
"""

import datetime
import re
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from objectfolder.errors import InputError

PUBLICATION = Path("data/card.yaml")
REMEDY = "Write it as docs/data-sets.md says."
VERSION = re.compile(r"\d+\.\d+\.\d+")


@dataclass(frozen=True)
class Publication:
    """The statements of the publisher; empty where there are none.

    Parameters
    ----------
    title
        Name of the data set.
    description
        A paragraph of it.
    version
        MAJOR.MINOR.PATCH; a digest of the Object Files is appended.
    date
        Day of publication, ISO 8601.
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
    version: str = "0.1.0"
    date: str = ""
    url: str = ""
    files_url: str = ""
    doi: str = ""
    creators: tuple[str, ...] = field(default=())


def read_publication(root: Path) -> Publication:
    """Read ``data/card.yaml`` of the data set at `root`.

    Raises
    ------
    InputError
        A file that is not YAML, an unknown key, or a value of a wrong kind.
    """
    import yaml

    path = root / PUBLICATION
    if not path.is_file():
        return Publication()
    try:
        stated = yaml.safe_load(path.read_text(encoding="utf-8")) or {}
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(str(PUBLICATION), f"not YAML ({error})", REMEDY) from error
    if not isinstance(stated, dict):
        raise InputError(str(PUBLICATION), "no keys and values", REMEDY)
    known = [entry.name for entry in fields(Publication)]
    for key in stated:
        if key not in known:
            raise InputError(str(PUBLICATION), f"unknown key {key!r}", f"Known are {', '.join(known)}.")
    return Publication(**{key: _checked(key, value) for key, value in stated.items()})


def _checked(key: str, value: Any) -> Any:
    if key == "creators":
        if not isinstance(value, list) or not all(isinstance(name, str) and name for name in value):
            raise InputError(str(PUBLICATION), f"creators is {value!r}", "Give a list of names.")
        return tuple(value)
    if key == "date":
        # YAML reads an unquoted day as a date.
        text = value.isoformat() if isinstance(value, datetime.date) else str(value)
        try:
            return datetime.date.fromisoformat(text).isoformat()
        except ValueError as error:
            raise InputError(str(PUBLICATION), f"date is {value!r}", "Give a day as 2026-11-21.") from error
    if not isinstance(value, str):
        raise InputError(str(PUBLICATION), f"{key} is {value!r}, no text", "Put it in quotes.")
    if key == "version" and not VERSION.fullmatch(value):
        raise InputError(str(PUBLICATION), f"version is {value!r}", "Give MAJOR.MINOR.PATCH.")
    if key in ("url", "files_url") and not re.match(r"https?://[^\s]+$", value):
        raise InputError(str(PUBLICATION), f"{key} is {value!r}", "Give an address with http or https.")
    return value
