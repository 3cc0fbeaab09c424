"""YAML files as typed classes, and environment variables as numbers: mistakes come with their remedy."""

import contextlib
import difflib
import json
import os
import re
import types
import typing
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from objectfolder.errors import InputError
from objectfolder.products.regular_file import open_regular

Kind = TypeVar("Kind")

OWN = "input_error"
UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
MISSING = ("missing", "missing_argument")
SECTION = ("dataclass_type", "model_type", "dict_type", "model_attributes_type")


# Safe all the same, and ten times as fast where it is built.
SAFE_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
# As YAML 1.1 has them, which is read here; 1.2, which DVC reads, takes them for other numbers or for text.
AMBIGUOUS_NUMBER = re.compile(r"[-+]?0[0-9b]|.*[:_]", re.IGNORECASE)
MOST_BYTES, MOST_NODES, DEEPEST = 1 << 20, 100_000, 50
NUMBERS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
LONGEST_SHOWN = 60  # letters of a value in a message


def read_yaml(path: Path) -> Any:
    """Return what a YAML file holds.

    Raises
    ------
    InputError
        A file that cannot be read: absent, larger than `MOST_BYTES`, nested deeper than `DEEPEST`, of more
        than `MOST_NODES` values with repetitions, with a part inside itself, with a key twice, or with a
        number that versions of YAML read differently.
    """
    try:
        with open_regular(path) as file:
            content = file.read(MOST_BYTES + 1)
        if len(content) > MOST_BYTES:
            raise yaml.YAMLError(f"more than {MOST_BYTES} bytes")
        return _checked(content.decode())
    except FileNotFoundError as error:
        remedy = "Check the path, or go to the root of the data set."
        raise InputError(str(path), "no such file", remedy) from error
    except (OSError, ValueError, yaml.YAMLError) as error:
        finding = f"cannot be read ({' '.join(str(error).split())})"
        raise InputError(str(path), finding, "It must be a YAML file.") from error


def validated(where: str, kind: type[Kind], content: Any, context: Mapping[str, Any] | None = None) -> Kind:
    """Return `content` as `kind`, a dataclass or model of pydantic; no value is converted to another type.

    Parameters
    ----------
    where
        File name for messages.
    kind
        Its fields should forbid others (``extra="forbid"``).
    content
        As YAML has it. Lists become tuples and integers become floats where `kind` says so.
    context
        For validators of `kind`.

    Raises
    ------
    InputError
        The first mistake: field, value and remedy. Of an unknown field, the nearest known one is named.
    """
    try:
        text = json.dumps(content, default=str)
    except TypeError as error:
        raise InputError(where, "a key is neither a string nor a number", "Correct it.") from error
    try:
        return TypeAdapter(kind).validate_json(text, strict=True, context=dict(context or {}))
    except ValidationError as error:
        details = error.errors(include_url=False)
        # A misspelt key is also a missing one; its own name says more.
        first = next((detail for detail in details if detail["type"] in UNKNOWN), details[0])
        raise _input_error(where, kind, first) from None


def _checked(text: str) -> Any:
    """Return the content of a YAML text; raise YAMLError for one that is too deep or too large."""
    depth = 0
    for event in yaml.parse(text, SAFE_LOADER):  # before anything is built, which calls itself for each level
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST:
            raise yaml.YAMLError(f"nested more than {DEEPEST} deep")
    loader = SAFE_LOADER(text)
    node = loader.get_single_node()
    if node is None:
        return None
    _count_nodes(node, {})
    return loader.construct_document(node)


def _count_nodes(node: yaml.Node, counts: dict[int, int | None]) -> int:
    """Count the nodes of a part with repetitions; `counts` caches parts, None marks one still open."""
    if id(node) not in counts:
        counts[id(node)] = None
        parts = node.value if isinstance(node, yaml.CollectionNode) else []
        if node.tag in NUMBERS and AMBIGUOUS_NUMBER.match(node.value):
            start = node.value[:LONGEST_SHOWN]
            finding = f"{start} is another number in YAML 1.2: write decimals, or text in quotes"
            raise yaml.MarkedYAMLError(None, None, finding, node.start_mark)
        if isinstance(node, yaml.MappingNode):
            names = [(key.tag, key.value) for key, _ in parts if isinstance(key, yaml.ScalarNode)]
            if len(set(names)) < len(names):
                twice = next(name for name in names if names.count(name) > 1)
                raise yaml.MarkedYAMLError(None, None, f"the key {twice[1]!r} occurs twice", node.start_mark)
            parts = [part for pair in parts for part in pair]
        counts[id(node)] = 1 + sum(_count_nodes(part, counts) for part in parts)
    count = counts[id(node)]
    if count is None or count > MOST_NODES:
        finding = f"more than {MOST_NODES} values" if count else "a part contains itself"
        raise yaml.MarkedYAMLError(None, None, finding, node.start_mark)
    return count


def own_error(error: InputError) -> PydanticCustomError:
    """Return an `InputError` as an error of pydantic, which adds the name of the field."""
    context = {"finding": f"{error.where}: {error.finding}", "remedy": error.remedy}
    return PydanticCustomError(OWN, "{finding}", context)


def number_of(variable: str, default: float) -> float:
    """Return the number from 0 on that an environment variable gives.

    Raises
    ------
    InputError
        It is no such number.
    """
    text = os.environ.get(variable, str(default))
    with contextlib.suppress(ValueError):
        if (number := float(text)) >= 0:
            return number
    raise InputError(variable, f"{text!r} is not a number of at least 0", "Correct it, or leave it out.")


def did_you_mean(name: str, names: Iterable[str], otherwise: str) -> str:
    """Ask for the nearest of the known names; return `otherwise` where none is near."""
    near = difflib.get_close_matches(name, names, 1, 0.5)
    return f"Did you mean {near[0]}?" if near else otherwise


def _input_error(where: str, kind: Any, error: ErrorDetails) -> InputError:
    name, value = _dotted(error["loc"]), error["input"]
    if error["type"] == OWN:
        return InputError(where, f"{name}: {error['ctx']['finding']}", error["ctx"]["remedy"])
    if error["type"] in UNKNOWN:
        *section, key = error["loc"]
        fields = _fields(kind, section)
        paths = [_dotted([*section, field]) for field in fields]
        remedy = did_you_mean(_dotted([*section, str(key)]), paths, f"Known are {', '.join(fields)}.")
        return InputError(where, f"unknown key {name}", remedy)
    if error["type"] in MISSING:
        noun = "value" if isinstance(error["loc"][-1], int) else "key"
        return InputError(where, f"no {noun} {name}", "Add it; version control has the original.")
    if error["type"] in SECTION:
        finding = f"{name} is {value!r}" if name else "holds no keys"
        return InputError(where, finding, "It must be a section with keys.")
    rule = error["msg"].removeprefix("Value error, ").rstrip(".")
    excerpt = repr(value)
    excerpt = excerpt if len(excerpt) <= LONGEST_SHOWN else f"{excerpt[:LONGEST_SHOWN]}..."
    remedy = f"{rule.replace('Input should be', 'It must be')}."
    if error["type"] == "float_type" and isinstance(value, str):
        remedy += " YAML reads 1e-3 as text: write 1.0e-3, not 1e-3."
    return InputError(where, f"{name} is {excerpt}", remedy)


def _dotted(parts: Sequence[str | int]) -> str:
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts)
    return text.removeprefix(".")


def _fields(kind: Any, path: Sequence[str | int]) -> list[str]:
    """Return the names of the fields of the section at a path within `kind`."""
    fields = getattr(kind, "__pydantic_fields__", None)
    if fields is not None:
        if not path:
            return list(fields)
        return _fields(fields[path[0]].annotation, path[1:]) if path[0] in fields else []
    one_of = typing.get_origin(kind) in (typing.Union, types.UnionType)
    rest = path if one_of else path[1:]
    return [name for part in typing.get_args(kind) for name in _fields(part, rest)]
