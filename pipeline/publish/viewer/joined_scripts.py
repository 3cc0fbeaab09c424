"""Scripts that import one another as one: browsers load no modules from disk."""

import re
from collections.abc import Callable, Iterator

# A script imports names in lines of their own, and exports what it declares where it declares it.
IMPORT = re.compile(r'^import (\{.+\}) from "\./(.+)";$', re.MULTILINE)
EXPORT = re.compile(r"^export (?=(?:async )?(?:const|class|function\*?) (\w+))", re.MULTILINE)


def joined_script(name: str, read: Callable[[str], str]) -> str:
    """Return a script after those that it imports, whose texts `read` returns by name."""
    text = read(name)
    if not IMPORT.search(text):
        return text
    modules = "".join(_modules(name, read, set()))
    return f'"use strict";\n(() => {{\nconst modules = {{}};\n{modules}}})();\n'


def _modules(name: str, read: Callable[[str], str], names: set[str]) -> Iterator[str]:
    """Yield scripts as functions that return their exports."""
    names.add(name)
    text = read(name)
    for _, other in IMPORT.findall(text):
        if other not in names:
            yield from _modules(other, read, names)
    body = EXPORT.sub("", IMPORT.sub(r'const \1 = modules["\2"];', text))
    exports = ", ".join(EXPORT.findall(text))
    yield f'modules["{name}"] = (() => {{\n{body}return {{ {exports} }};\n}})();\n'
