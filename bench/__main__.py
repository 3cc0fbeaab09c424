"""Run a bench by its name, or list them all: ``python -m bench [NAME [OPTION ...]]``."""

import ast
import sys
from importlib import import_module

from bench.record import benches


def main() -> None:
    """Run the bench that the first argument names; list all where it names none."""
    modules = benches()
    if len(sys.argv) > 1 and sys.argv[1] in modules:
        name = sys.argv.pop(1)
        sys.argv[0] = f"bench {name}"
        import_module(f"bench.{modules[name].parent.name}.{name}").main()
        return
    for name, path in modules.items():
        heading = (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").partition("\n")[0]
        print(f"{name:16} {heading}")
    if len(sys.argv) > 1 and sys.argv[1] not in ("-h", "--help"):
        sys.exit(f"no bench is named {sys.argv[1]}")


if __name__ == "__main__":
    main()
