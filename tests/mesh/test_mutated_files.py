"""Files that are damaged or made to harm: each ends as a mesh or is refused, soon, in bounded memory."""

import sys
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from hard_meshes import GltfWriter, box_primitive
from hostile_files import HOSTILE, png_of
from mutations import OBJECTS, write_mutated
from reading_process import read_in_processes

from objectfolder.errors import InputError
from objectfolder.making.mesh.readers import textures
from objectfolder.making.mesh.readers.load import load_mesh

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="bounds of memory are set as Linux has them")

QUICK, ALL = range(72), range(72, 500)


def held(objects: list[dict[str, str]]) -> list[dict[str, Any]]:
    """What became of objects, none of which did harm."""
    reports = read_in_processes(objects)
    assert len(reports) == len(objects)
    wrong = [
        report
        for report in reports
        if report["outcome"] not in ("mesh", "refused") or report["outside"] or report["memory"]
    ]
    assert not wrong, "\n\n".join(
        f"{report['name']}: {report['outcome']} {report['outside']} {report['said']}" for report in wrong[:5]
    )
    return reports


def mutated(folder: Path, seeds: range) -> list[dict[str, str]]:
    objects = []
    for seed in seeds:
        mutation = write_mutated(folder / str(seed), seed)
        name = f"seed {seed}, {mutation['kind']} ({mutation['done']})"
        objects.append(mutation | {"name": name, "folder": str(folder / str(seed) / "object")})
    return objects


def unharmed(folder: Path) -> list[dict[str, str]]:
    """The objects before they are mutated."""
    objects = []
    for number, (kind, build) in enumerate(OBJECTS.items()):
        mesh, targets = build(folder / f"whole {number}" / "object")
        archive = str(targets[0]) if kind == "zip" else ""
        name = {"name": f"{kind}, whole", "folder": str(folder / f"whole {number}" / "object")}
        objects.append(name | {"mesh": str(mesh), "archive": archive})
    return objects


@pytest.mark.slow
def test_some_mutated_files_of_every_kind(tmp_path):
    """What mutated files are refused for is what was done to them: whole, each is read."""
    originals = unharmed(tmp_path)
    outcomes_of_files = held(originals + mutated(tmp_path, QUICK))
    assert {result["outcome"] for result in outcomes_of_files[: len(originals)]} == {"mesh"}
    mutations = outcomes_of_files[len(originals) :]
    kinds = Counter(result["kind"] for result in mutations)
    assert kinds.keys() == OBJECTS.keys()
    assert min(kinds.values()) == 4
    # Some mutations do no harm, most do.
    outcomes = Counter(result["outcome"] for result in mutations)
    assert outcomes["mesh"] > 5
    assert outcomes["refused"] > 20


@pytest.mark.release("objectfolder.making.mesh")
def test_many_mutated_files(tmp_path):
    reports = held(mutated(tmp_path, ALL))
    assert len(reports) + len(QUICK) == 500


@pytest.mark.slow
def test_files_that_ask_for_too_much(tmp_path):
    objects = []
    for number, (name, build) in enumerate(HOSTILE.items()):
        folder = tmp_path / str(number) / "object"
        mesh = build(folder)
        objects.append({"name": name, "folder": str(folder), "mesh": str(mesh), "archive": ""})
    outcomes = {report["name"]: report["outcome"] for report in held(objects)}
    assert outcomes["deep nodes"] == "mesh"
    assert outcomes["nodes that double"] == "refused"
    assert outcomes["PNG of 8192 x 8192, black"] == "mesh"
    assert outcomes["PNG of 12000 x 11000, black"] == "refused"


def test_textures_that_are_too_large_together_are_refused(tmp_path, monkeypatch):
    writer = GltfWriter()
    for index in range(4):
        material = writer.material(png_of(100, 100) + bytes([index]))
        writer.node(mesh=writer.mesh(box_primitive(writer, material=material)))
    mesh = writer.write(tmp_path / "model.glb")
    monkeypatch.setattr(textures, "TEXTURE_BYTES", 4 * 100 * 100 * 4)
    load_mesh(mesh)
    monkeypatch.setattr(textures, "TEXTURE_BYTES", 4 * 100 * 100 * 4 - 1)
    with pytest.raises(InputError, match="its textures take more than 159999 bytes in all"):
        load_mesh(mesh)


@pytest.mark.slow
def test_the_process_tells_of_what_goes_wrong(tmp_path, monkeypatch):
    """A reader that opens what it may not, one that fails, and one that does not end, are all found."""
    objects = mutated(tmp_path, range(3))
    traps = tmp_path / "traps"
    traps.mkdir()
    (traps / "sitecustomize.py").write_text(
        "import objectfolder.making.mesh.ingest as ingest\n"
        "real, calls = ingest.ingest_object, []\n"
        "def trap(*arguments, **options):\n"
        "    calls.append(1)\n"
        "    if len(calls) == 2: open('/etc/passwd').close()\n"
        "    if len(calls) == 3: raise ValueError('trap')\n"
        "    while len(calls) == 4: pass\n"
        "    return real(*arguments, **options)\n"
        "ingest.ingest_object = trap\n"
    )
    monkeypatch.setenv("PYTHONPATH", f"{traps}:{Path(__file__).parents[2]}")
    monkeypatch.setattr("reading_process.CPU_S", 0.5)
    reports = read_in_processes(objects)
    assert reports[0]["outside"] == ["open '/etc/passwd'"]
    assert reports[1]["outcome"] == "failed"
    assert "ValueError: trap" in reports[1]["said"]
    assert reports[2]["outcome"] == "ended"
