"""A constant's name has one meaning in the whole library."""

import ast
from collections import defaultdict
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import objectfolder

LIBRARY = Path(objectfolder.__file__).parent


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


def test_no_name_of_a_constant_has_two_values() -> None:
    values: dict[str, dict[object, list[str]]] = defaultdict(lambda: defaultdict(list))
    for path in sorted(LIBRARY.rglob("*.py")):
        for name, value in constants(ast.parse(path.read_text())):
            if isinstance(value, ast.Attribute) and value.attr == name:  # another room's constant, handed on
                continue
            meaning: object = ast.unparse(value)
            with suppress(ValueError, TypeError):
                meaning = ast.literal_eval(value)
                hash(meaning)
            if isinstance(meaning, dict | list | set):
                meaning = repr(meaning)
            values[name][meaning].append(str(path.relative_to(LIBRARY)))
    assert len(values) > 500
    assert {name: dict(meanings) for name, meanings in values.items() if len(meanings) > 1} == {}
