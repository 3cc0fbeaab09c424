"""Functions of the library take few parameters: what belongs together is a record."""

import ast
from pathlib import Path

import objectfolder

LIBRARY = Path(objectfolder.__file__).parent
MOST_PARAMETERS = 8
# Functions with more of them; the number only falls.
LONG_SIGNATURES = 20


def parameters(function: ast.FunctionDef | ast.AsyncFunctionDef) -> list[str]:
    """Names of what a caller gives: all parameters but the instance or the class."""
    arguments = function.args
    names = [part.arg for part in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)]
    return names[1:] if names[:1] in (["self"], ["cls"]) else names


def test_few_functions_take_more_than_eight_parameters() -> None:
    long, count = [], 0
    for path in sorted(LIBRARY.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                count += 1
                if len(parameters(node)) > MOST_PARAMETERS:
                    long.append(f"{path.relative_to(LIBRARY)}: {node.name}")
    assert count > 1500
    assert len(long) <= LONG_SIGNATURES, "\n".join(long)
