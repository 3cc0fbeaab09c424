"""Give the page of measurements its table: what is recorded, when, by which code, and what changed since."""

import ast
import json
import subprocess
from pathlib import Path
from typing import NamedTuple

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
MARK = "<!-- recorded results -->"
PACKAGES = ("objectfolder", "pipeline", "learning")
FOLLOWED = ("bench", "learning", "tests")
STALE = 100  # later commits to the code that was measured
PARTS = ("senses", "factory")
# Where rooms lay in earlier commits.
FORMER = {
    "objectfolder/export": ("objectfolder/vision/export/",),
    "objectfolder/making/air": ("objectfolder/audio/air/",),
    "objectfolder/making/audionet": ("objectfolder/audio/audionet/",),
    "objectfolder/making/elements": ("objectfolder/audio/elements/",),
    "objectfolder/making/mesh": ("objectfolder/mesh/",),
    "objectfolder/making/modes": ("objectfolder/audio/modes/",),
    "objectfolder/making/recordings": ("objectfolder/audio/recordings/",),
    "objectfolder/making/sensor": ("objectfolder/touch/sensor/",),
    "objectfolder/making/solid": ("objectfolder/solid/",),
    "objectfolder/making/touches": ("objectfolder/touch/truth/",),
    "objectfolder/making/views": ("objectfolder/vision/truth/",),
    "objectfolder/making/visionnet": ("objectfolder/vision/visionnet/",),
}
# Modules of results that have other names.
MODULES = {
    "gpu": "gpu/*",
    "gpu_elastic": "gpu/*",
    "gpu_shear": "gpu/*",
    "reality": "reality/*",
    "vision_known": "senses/vision",
    "hard_scans": "senses/vision_objects",
    "hard_scans_known": "senses/vision_objects",
    "all_scans_known": "senses/vision_objects",
}


class Commit(NamedTuple):
    """A commit of the history, with the files that it changed."""

    name: str
    date: str
    files: frozenset[str]


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Put the table where the page has its mark."""
    return markdown.replace(MARK, table()) if MARK in markdown else markdown


def table() -> str:
    """Return the recorded results as a table in Markdown."""
    history = commits()
    rows = [row(path, history) for path in sorted(ROOT.glob("bench/results/*.json"))]
    return "\n".join(
        ["| result | compared | recorded | processor | later changes |", "|---|---|---|---|---|", *rows]
    )


def row(path: Path, history: list[Commit]) -> str:
    """Return the row of one result."""
    content = json.loads(path.read_text(encoding="utf-8"))
    measured = content["versions"]
    source = path.relative_to(ROOT).as_posix()
    recorded = next((index for index, commit in enumerate(history) if source in commit.files), None)
    if recorded is None:
        when = later = "not known"
    else:
        when = f"{history[recorded].date}, `{history[recorded].name}`"
        rooms = tuple(imported_rooms(path.stem))
        count = sum(any(file.startswith(rooms) for file in commit.files) for commit in history[:recorded])
        later = f"**stale: {count}**" if count > STALE else str(count)
        later = later if rooms else "measured once"
    if measured.get("uncommitted_changes") is not False:
        when += ", code not committed" if measured.get("uncommitted_changes") else ", commit not stated"
    compared = content["compared"].replace("|", "\\|")
    processor = measured.get("processor") or "not stated"
    return f"| `{path.stem}` | {compared} | {when} | {processor} | {later} |"


def imported_rooms(name: str) -> list[str]:
    """Return the rooms of the product, as `objectfolder/vision/`, that the module of a result imports.

    Modules of `bench`, `learning` and `tests` are followed. What imports a whole package, or starts programs,
    may use all of it.
    """
    places = [MODULES[name]] if name in MODULES else [f"{part}/{name}" for part in PARTS]
    open_modules = [path for place in places for path in ROOT.glob(f"bench/{place}.py")]
    modules, rooms = set(), set()
    while open_modules:
        module = open_modules.pop()
        if module in modules:
            continue
        modules.add(module)
        for imported in imports(module):
            package, *rest = imported.split(".")
            if package in FOLLOWED:
                open_modules += [path for path in modules_of(imported) if path.name != "record.py"]
            if package == "subprocess":
                rooms |= {"objectfolder/", "pipeline/"}
            elif package in PACKAGES and rest:
                rooms |= set(room_of(package, rest))
            elif package in PACKAGES:
                rooms.add(f"{package}/")
    return sorted(rooms)


def room_of(package: str, names: list[str]) -> list[str]:
    """Return the room of a module, or of a file beside rooms, and where it lay before it was moved."""
    depth = 2 if names[0] == "making" and len(names) > 1 else 1
    room = "/".join((package, *names[:depth]))
    return [f"{room}/" if (ROOT / room).is_dir() else f"{room}.py", *FORMER.get(room, ())]


def imports(module: Path) -> set[str]:
    """Return the dotted names that a module imports, anywhere in it; of `from a import b` also `a.b`."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            if node.module in PACKAGES or node.module.startswith(FOLLOWED):
                names |= {f"{node.module}.{alias.name}" for alias in node.names}
            if node.module not in PACKAGES:
                names.add(node.module)
    return names


def modules_of(name: str) -> list[Path]:
    """Return the file of a dotted name of this repository; none where the name is within a module."""
    path = ROOT.joinpath(*name.split("."))
    return [file for file in (path.with_suffix(".py"), path / "__init__.py") if file.exists()]


def commits() -> list[Commit]:
    """Return the history, latest first, without merges; nothing where there is no git."""
    command = ["git", "log", "--format=%x01%h %cs", "--name-only", "--", "bench/results", *PACKAGES]
    try:
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return []
    history = []
    for part in done.stdout.split("\x01")[1:]:
        heading, *names = part.split("\n")
        name, _, date = heading.partition(" ")
        history.append(Commit(name, date, frozenset(filter(None, names))))
    return history
