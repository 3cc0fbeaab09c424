"""Where a product comes from: fingerprints, code identity, seeds and environment.

A fingerprint is the SHA-256 of named parts (task, parameters, record, inputs, code, packages). The
parts travel inside the product, so two versions can be compared and the reason of a change named.
"""

import ast
import functools
import hashlib
import importlib.metadata
import importlib.util
import json
import platform
import re
from collections.abc import Iterable, Mapping, MutableMapping
from json.encoder import encode_basestring
from pathlib import Path
from typing import Any

from objectfolder.errors import InputError
from objectfolder.products.canonical import canonical_json as canonical_json
from objectfolder.products.regular_file import open_regular

PACKAGES = ("objectfolder", "pipeline")
_DOTTED = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)+")
# Wording of errors and bookkeeping of provenance decide no number of a product.
NEUTRAL_MODULES = frozenset(
    {"objectfolder.errors", "objectfolder.products.canonical", "objectfolder.products.provenance"}
)
_PLAIN = json.JSONEncoder(ensure_ascii=False, allow_nan=False)
_cache: dict[str, Any] = {}


class Constant(dict[str, Any]):
    """A mapping that nobody changes and many fingerprints have: its canonical JSON is made once.

    It is pickled as the dictionary that it is.
    """

    @functools.cached_property
    def text(self) -> str:
        """Canonical JSON."""
        return canonical_json(self)

    def __reduce__(self) -> tuple[type[dict[str, Any]], tuple[dict[str, Any]]]:
        """Leave the text out."""
        return dict, (dict(self),)


def json_lines(value: Any, levels: int, indent: str = "") -> str:
    """Return JSON with a line for each item down to `levels`, and all of an item below on its line.

    ``json.dumps`` takes several times as long where it indents. NaN is an error.
    """
    if levels == 0 or not value or not isinstance(value, Mapping | list | tuple):
        return _PLAIN.encode(value)
    deeper = f"{indent} "
    if isinstance(value, Mapping):
        ends = "{}"
        items = [(f"{encode_basestring(str(name))}: ", item) for name, item in value.items()]
    else:
        ends = "[]"
        items = [("", item) for item in value]
    lines = [f"{deeper}{name}{json_lines(item, levels - 1, deeper)}" for name, item in items]
    return "\n".join([ends[0], ",\n".join(lines), f"{indent}{ends[1]}"])


def fingerprint(parts: Mapping[str, Any]) -> str:
    """Return the SHA-256 (64 hex digits) of `parts` as canonical JSON."""
    texts = (
        f"{encode_basestring(name)}:{part.text if isinstance(part, Constant) else canonical_json(part)}"
        for name, part in sorted(parts.items())
    )
    return hashlib.sha256(f"{{{','.join(texts)}}}".encode()).hexdigest()


def file_digest(path: Path | str) -> str:
    """Return the SHA-256 (64 hex digits) of a file's bytes."""
    with open_regular(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def seed_from(base_seed: int, task: str, object_id: str) -> int:
    """Return a 31-bit seed (what every library takes) of all three arguments and nothing else."""
    digest = hashlib.sha256(canonical_json([base_seed, task, object_id]).encode()).digest()
    return int.from_bytes(digest[:4], "big") >> 1


def code_identity(module: str, cache: MutableMapping[str, Any] | None = None) -> dict[str, str]:
    """Return digests of the normalised source of `module` and of every package module it imports.

    Imports are followed through the source, function-level ones and modules named in a string (to be
    run as a process) included, inside `PACKAGES` and the package of `module`; nothing is imported.
    Comments, docstrings and layout do not count. The ``__init__`` of a package counts only where a name
    that is no submodule is imported from it.

    Parameters
    ----------
    module
        Dotted name of a module inside a package.
    cache
        What earlier calls found in sources, by their content, in values that JSON holds; what is new is
        added. None keeps it for this process.

    Returns
    -------
    dict
        Module name to 16 hex digits.

    Raises
    ------
    InputError
        `module` is not found.
    """
    roots = frozenset({*PACKAGES, module.split(".")[0]})
    source_path = functools.cache(_source_path)
    if source_path(module) is None:
        raise InputError(module, "no such module", "Name a module that Python finds.")
    cache = _cache if cache is None else cache
    digests: dict[str, str] = {}
    pending = [module]
    while pending:
        name = pending.pop()
        path = source_path(name)
        if name in digests or name in NEUTRAL_MODULES or path is None:
            continue
        digests[name], mentions = _normalised(name, path, cache)
        for origin, member in mentions:
            if origin.split(".")[0] in roots:
                submodule = f"{origin}.{member}"
                pending.append(submodule if member and source_path(submodule) else origin)
    return dict(sorted(digests.items()))


def package_versions(names: Iterable[str]) -> dict[str, str]:
    """Return the installed version of each distribution, ``"absent"`` where there is none."""
    return {name: _version(name) for name in sorted(names)}


def environment() -> dict[str, str]:
    """Return facts of the interpreter that a reader may want, none of which names the machine."""
    return {
        "python": platform.python_version(),
        "implementation": platform.python_implementation(),
        "system": platform.system(),
        "machine": platform.machine(),
    }


@functools.cache
def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "absent"


def _source_path(module: str) -> Path | None:
    package, *rest = module.split(".")
    specification = importlib.util.find_spec(package)
    if specification is None or not specification.submodule_search_locations:
        return None
    base = Path(next(iter(specification.submodule_search_locations))).joinpath(*rest)
    for path in (base / "__init__.py", base.with_name(base.name + ".py")):
        if path.is_file():
            return path
    return None


def _normalised(module: str, path: Path, cache: MutableMapping[str, Any]) -> tuple[str, list[list[str]]]:
    """Return the digest of the normalised source of `module`, and what it may import."""
    source = path.read_bytes()
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    # Versions of Python may write the same tree differently.
    about = f"{platform.python_version()} {package}\n".encode()
    key = hashlib.sha256(about + source).hexdigest()
    if key not in cache:
        tree = ast.parse(source, filename=str(path))
        mentions = sorted(_mentioned(tree, package))
        text = ast.unparse(_without_docstrings(tree))
        cache[key] = [hashlib.sha256(text.encode()).hexdigest()[:16], [list(mention) for mention in mentions]]
    digest, imports = cache[key]
    return digest, imports


def _mentioned(tree: ast.AST, package: str) -> set[tuple[str, str]]:
    """Return what `tree`, a module inside `package`, imports anywhere: modules, and names in them.

    The name is empty for a module that is imported itself, or named in a string.
    """
    mentions: set[tuple[str, str]] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            mentions.update((alias.name, "") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            origin = node.module or ""
            if node.level:
                parts = package.split(".")
                origin = ".".join(parts[: len(parts) - node.level + 1] + ([origin] if origin else []))
            mentions.update((origin, alias.name) for alias in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and _DOTTED.fullmatch(node.value):
            mentions.add((node.value, ""))
    return mentions


def _without_docstrings(tree: ast.Module) -> ast.Module:
    """Return `tree` with docstrings and other bare strings removed."""
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if not isinstance(body, list):
            continue
        statements = [
            statement
            for statement in body
            if not (
                isinstance(statement, ast.Expr)
                and isinstance(statement.value, ast.Constant)
                and isinstance(statement.value.value, str)
            )
        ]
        body[:] = statements or ([] if isinstance(node, ast.Module) else [ast.Pass()])
    return tree
