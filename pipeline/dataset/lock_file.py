"""The contents of a ``dvc.lock``: hashes of outputs and dependencies, and parameters.

Read as DVC documents the file (https://dvc.org/doc/user-guide/project-structure/dvcyaml-files); a folder
is a JSON list of files and their hashes, kept under its own hash with ``.dir`` behind it.
"""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import yaml

from objectfolder.errors import FormatError

LOCK = "dvc.lock"
DIRECTORY = ".dir"
RESTORE = "Restore it from git, or run `dvc repro`."
MD5 = re.compile(r"\b[0-9a-f]{32}\b(\.dir)?")


@dataclass(frozen=True)
class Lock:
    """What a ``dvc.lock`` says.

    Attributes
    ----------
    outs : MD5 of outputs by path
    parameters : by stage, without those from files that another stage makes
    paths : all that any stage reads or makes
    """

    outs: Mapping[str, str] = field(default_factory=dict)
    parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    paths: frozenset[str] = frozenset()

    @property
    def table(self) -> str:
        """Path of the table of objects; empty where no stage names it."""
        objects = self.parameter("objects")  # of versions before `inputs` was a stage
        return str(
            objects.get("table", "") if isinstance(objects, dict) else self.parameter("objects.table") or ""
        )

    def parameter(self, name: str) -> Any:
        """Return a parameter that any stage has, None where none has it."""
        return next((parameters[name] for parameters in self.parameters.values() if name in parameters), None)


def is_folder(md5: str) -> bool:
    """Whether an output is a folder, by its hash."""
    return md5.endswith(DIRECTORY)


def read_lock(where: str, text: bytes) -> Lock:
    """Read the text of a ``dvc.lock``, or of a file of ``dvc add``, whose paths are from its own folder.

    Raises
    ------
    FormatError
        Not such a file.
    """
    try:
        # Safe all the same, and ten times as fast where it is built.
        loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
        content = loader(text).get_single_data()
        stages = content.get("stages", {}) if "schema" in content else content
        if isinstance(content.get("outs"), list):
            stages = {"": content}
        outs: dict[str, str] = {}
        parameters: dict[str, dict[str, Any]] = {}
        paths: set[str] = set()
        outputs = {str(out["path"]) for entry in stages.values() for out in entry.get("outs", ())}
        for stage, entry in stages.items():
            for out in entry.get("outs", ()):
                md5 = out.get("md5")
                if not isinstance(md5, str) or not MD5.fullmatch(md5):
                    continue  # in no cache by MD5: a cloud's own version, or another file system's
                outs[str(out["path"])] = md5
            paths |= {str(file["path"]) for file in (*entry.get("outs", ()), *entry.get("deps", ()))}
            parameters[str(stage)] = {
                str(name): value
                for file, values in entry.get("params", {}).items()
                if file not in outputs
                for name, value in (values or {}).items()
            }
    except (yaml.YAMLError, AttributeError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise FormatError(where, f"not a lock file of DVC ({type(error).__name__})", RESTORE) from error
    return Lock(outs, parameters, frozenset(paths))


def read_folder(where: str, text: bytes) -> dict[str, str]:
    """Return the files of a folder, path inside it to MD5, from its ``.dir`` object.

    Raises
    ------
    FormatError
        Not such an object.
    """
    try:
        files = {str(entry["relpath"]): str(entry["md5"]) for entry in json.loads(text)}
        if not all(MD5.fullmatch(md5) for md5 in files.values()):
            raise ValueError("a hash that is not an MD5")
        if any(name.startswith("/") or ".." in name.split("/") for name in files):
            raise ValueError("a name that leads out of it")
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise FormatError(where, f"no list of a folder's files ({error})", "Run `dvc fetch`.") from error
    return files
