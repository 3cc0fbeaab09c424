"""What is counted in the library: meanings of a constant, parameters of a function, importers of a module."""

import ast
from collections import defaultdict
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

import objectfolder

LIBRARY = Path(objectfolder.__file__).parent
MOST_PARAMETERS = 8
# Functions with more of them; the number only falls.
SLOW_FIXTURES = ("modules",)
LONG_SIGNATURES = 20
# Modules that one other module imports, no package hands on, and no program beside the library imports.
ONE_IMPORTER = 38
PROGRAMS = ("pipeline", "bench", "learning", "tests/references")  # benches run the references


@pytest.fixture(scope="module")
def modules() -> dict[str, ast.Module]:
    """The modules of the library by their paths."""
    paths = sorted(LIBRARY.rglob("*.py"))
    return {str(path.relative_to(LIBRARY)): ast.parse(path.read_text(encoding="utf-8")) for path in paths}


def constants(module: ast.Module) -> Iterator[tuple[str, ast.expr]]:
    """Name and value of each public constant."""
    for statement in module.body:
        if isinstance(statement, ast.AnnAssign) and statement.value:
            pairs: list[tuple[ast.expr, ast.expr]] = [(statement.target, statement.value)]
        elif isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Name):
            pairs = [(statement.targets[0], statement.value)]
        elif isinstance(statement, ast.Assign) and isinstance(statement.value, ast.Tuple):
            targets = statement.targets[0]
            assert isinstance(targets, ast.Tuple)
            pairs = [*zip(targets.elts, statement.value.elts, strict=True)]
        else:
            continue
        for target, value in pairs:
            if isinstance(target, ast.Name) and target.id.isupper() and target.id[0] != "_":
                yield target.id, value


def test_no_name_of_a_constant_has_two_values(modules: dict[str, ast.Module]) -> None:
    values: dict[str, dict[object, list[str]]] = defaultdict(lambda: defaultdict(list))
    for path, module in modules.items():
        for name, value in constants(module):
            if isinstance(value, ast.Attribute) and value.attr == name:  # another room's constant, handed on
                continue
            meaning: object = ast.unparse(value)
            with suppress(ValueError, TypeError):
                meaning = ast.literal_eval(value)
                hash(meaning)
            if isinstance(meaning, dict | list | set):
                meaning = repr(meaning)
            values[name][meaning].append(path)
    assert len(values) > 500
    assert {name: dict(meanings) for name, meanings in values.items() if len(meanings) > 1} == {}


def parameters(function: ast.FunctionDef | ast.AsyncFunctionDef) -> list[str]:
    """Names of what a caller gives: all parameters but the instance or the class."""
    arguments = function.args
    names = [part.arg for part in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)]
    return names[1:] if names[:1] in (["self"], ["cls"]) else names


def test_few_functions_take_more_than_eight_parameters(modules: dict[str, ast.Module]) -> None:
    long, count = [], 0
    for path, module in modules.items():
        for node in ast.walk(module):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                count += 1
                if len(parameters(node)) > MOST_PARAMETERS:
                    long.append(f"{path}: {node.name}")
    assert count > 1500
    assert len(long) <= LONG_SIGNATURES, "\n".join(long)


def imported_modules(code: ast.Module) -> Iterator[str]:
    """Dotted names of what a module imports of the library, anywhere in it."""
    for node in ast.walk(code):
        if isinstance(node, ast.Import):
            yield from (part.name for part in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{part.name}" for part in node.names)


def test_few_modules_have_one_importer(modules: dict[str, ast.Module]) -> None:
    names = {path: f"objectfolder/{path}".removesuffix(".py").replace("/", ".") for path in modules}
    importers: dict[str, set[str]] = defaultdict(set)
    for path, module in modules.items():
        for name in imported_modules(module):
            importers[name].add(path)
    for program in PROGRAMS:
        for source in (LIBRARY.parent / program).rglob("*.py"):
            for name in imported_modules(ast.parse(source.read_text(encoding="utf-8"))):
                importers[name].add(str(source))
    single = [
        f"{name} by {path}"
        for name in names.values()
        if len(importers[name]) == 1 and not (path := min(importers[name])).endswith("__init__.py")
        if path in modules and path != name
    ]
    assert 0 < len(single) <= ONE_IMPORTER, "\n".join(single)
