"""Data from elsewhere is data: it runs nothing, leaves its folder nowhere, takes no needless memory."""

import ast
import io
import json
import os
import pickle
import tracemalloc
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from objectfolder.errors import FormatError, InputError
from objectfolder.making.materials import read_materials
from objectfolder.making.mesh.readers.load import load_mesh, source_files
from objectfolder.object_file import ObjectFile
from objectfolder.products.store import Array, Product, read_product, write_product
from objectfolder.touch.sensor.photometric_table import PhotometricTable
from objectfolder.touch.sensor.sensor_file import read_sensor
from pipeline.dataset import archives, products
from pipeline.dataset.catalogue import read_catalogue
from pipeline.dataset.parameters import read_parameters
from pipeline.dataset.records import RECORDS, read_records
from pipeline.dataset.verified import Verified

REPOSITORY = Path(__file__).parents[1]
SOURCES = sorted(path for part in ("objectfolder", "pipeline") for path in (REPOSITORY / part).rglob("*.py"))
MEGABYTE = 1 << 20

# What may run code that data names, and where it is right all the same.
UNPICKLES = {
    "pipeline/cluster/dask_runner.py": "it sends code of its own to workers, and reads none",
    "pipeline/sandbox/child.py": "the pipe between a worker and the child process that it started itself",
}
IMPORTS_BY_NAME = {
    "objectfolder/lazy.py": "a module of the package that states the name in its own code",
    "pipeline/cluster/starting.py": "the class of a cluster, named by who starts the run in cluster/*.yaml",
    "pipeline/sandbox/child.py": "the module of a stage's task, named by code in pipeline/dataset/stages.py",
}
WRITES_CODE = {
    "objectfolder/batch/targets.py": "loops and kernels round a body, of its own texts and parameter names",
}
PICKLES = {"pickle", "_pickle", "cPickle", "dill", "cloudpickle", "joblib", "shelve", "marshal"}


def name_of(node: ast.expr) -> str:
    """Dotted name of what is called, as far as it has one."""
    if isinstance(node, ast.Attribute):
        return f"{name_of(node.value)}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else ""


def dangers(path: Path) -> Iterator[str]:
    """What in a module may run code that its data names, or unpack where its data says."""
    where = path.relative_to(REPOSITORY).as_posix()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import | ast.ImportFrom):
            module = getattr(node, "module", None)
            modules = {module or ""} | {alias.name for alias in node.names if module is None}
            if {name.split(".")[0] for name in modules} & PICKLES and where not in UNPICKLES:
                yield f"{where}:{node.lineno} imports {sorted(modules)}"
        elif isinstance(node, ast.Call):
            called, last = name_of(node.func), name_of(node.func).rpartition(".")[2]
            keywords = {keyword.arg: keyword.value for keyword in node.keywords}
            shell = keywords.get("shell")
            pickles = keywords.get("allow_pickle")
            if (
                called in ("eval", "compile", "__import__", "builtins.eval", "builtins.exec")
                or (called == "exec" and where not in WRITES_CODE)
                or called in ("torch.load", "os.system", "os.popen", "tempfile.mktemp", "pty.spawn")
                or called in ("yaml.unsafe_load", "yaml.full_load", "yaml.load_all", "yaml.unsafe_load_all")
                or last in ("extractall", "unpack_archive")
                or (last == "import_module" and where not in IMPORTS_BY_NAME)
                or (shell is not None and not (isinstance(shell, ast.Constant) and shell.value is False))
                or (
                    pickles is not None and not (isinstance(pickles, ast.Constant) and pickles.value is False)
                )
            ):
                yield f"{where}:{node.lineno} calls {called}"


@pytest.mark.slow
def test_no_code_here_runs_what_data_names():
    findings = [danger for path in SOURCES for danger in dangers(path)]
    # PyYAML's load takes any loader; the only other load of that name is ruamel's, whose default is safe.
    for path in SOURCES:
        text = path.read_text(encoding="utf-8")
        if "yaml.load(" in text:
            assert "yaml = YAML()" in text, path
    assert not findings


def test_the_walk_finds(subtests, tmp_path, monkeypatch):
    for code in [
        "import pickle",
        "from dill import loads",
        "eval('1')",
        "np.load('x', allow_pickle=True)",
        "np.load('x', allow_pickle=flag)",
        "subprocess.run('ls', shell=True)",
        "torch.load('x')",
        "archive.extractall('/')",
        "importlib.import_module(name)",
        "tempfile.mktemp()",
    ]:
        with subtests.test(code=code):
            monkeypatch.setitem(globals(), "REPOSITORY", tmp_path)
            (tmp_path / "module.py").write_text(code)
            assert list(dangers(tmp_path / "module.py"))


class Trap:
    """Leaves a file where it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (str(self.path),)


@pytest.fixture
def sprung(tmp_path: Path) -> Path:
    """Where the trap leaves its mark; the trap itself works."""
    mark = tmp_path / "sprung"
    pickle.loads(pickle.dumps(Trap(mark)))
    assert mark.exists()
    mark.rmdir()
    return mark


GROUP: dict[str, Any] = {"zarr_format": 3, "node_type": "group", "attributes": {"fingerprint": "f" * 64}}
BYTES = {"name": "bytes", "configuration": {"endian": "little"}}
BLOSC = {
    "name": "blosc",
    "configuration": {"typesize": 8, "cname": "zstd", "clevel": 5, "shuffle": "shuffle", "blocksize": 0},
}


def array(
    shape: Sequence[float], data_type: Any = "float64", codecs: Any = None, **more: Any
) -> dict[str, Any]:
    """``zarr.json`` of an array."""
    return {
        "zarr_format": 3,
        "node_type": "array",
        "shape": shape,
        "data_type": data_type,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": shape}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "fill_value": 0,
        "codecs": [BYTES, BLOSC] if codecs is None else codecs,
        "attributes": {"units": "1", "long_name": "x", "chunk_first": False},
        "dimension_names": ["a"] * len(shape),
        **more,
    }


def archive(path: Path, entries: dict[str, Any], compression: int = zipfile.ZIP_STORED) -> Path:
    """A zip with entries of bytes, or of JSON."""
    with zipfile.ZipFile(path, "w", compression) as file:
        for name, content in entries.items():
            file.writestr(name, content if isinstance(content, bytes) else json.dumps(content))
    return path


V2 = {
    "zarr_format": 2, "shape": [1], "chunks": [1], "dtype": "|O", "compressor": None, "fill_value": None,
    "order": "C", "filters": [{"id": "pickle", "protocol": 5}],
}  # fmt: skip
WITH_PICKLE: dict[str, dict[str, Any]] = {
    "codec of numcodecs": {
        "x/zarr.json": array([1], codecs=[{"name": "numcodecs.pickle", "configuration": {}}])
    },
    "codec": {"x/zarr.json": array([1], codecs=[BYTES, {"name": "pickle", "configuration": {}}])},
    "objects": {"x/zarr.json": array([1], "object", [{"name": "bytes"}], fill_value="")},
    "objects of NumPy": {"x/zarr.json": array([1], "|O", [{"name": "vlen-bytes"}], fill_value="")},
    "version 2 inside": {"x/.zarray": V2, "x/0": b""},
    "version 2 consolidated": {
        "zarr.json": {
            **GROUP,
            "consolidated_metadata": {
                "kind": "inline",
                "must_understand": False,
                "metadata": {"x": {**V2, "node_type": "array", "attributes": {}}},
            },
        },
    },
}


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_pickles_in_a_product_are_refused_and_not_run(subtests, tmp_path, sprung):
    for kind in WITH_PICKLE:
        with subtests.test(kind=kind):
            trap = pickle.dumps(Trap(sprung))
            entries = {"zarr.json": GROUP, "x/c/0": trap, **WITH_PICKLE[kind]}
            if "x/0" in entries:
                entries["x/0"] = trap
            path = archive(tmp_path / "x.zarr.zip", entries)
            with pytest.raises(FormatError):
                products.verify(path)
            try:
                read = read_product(path)
            except FormatError:
                pass
            else:
                assert "x" not in read  # an array of version 2 is none of this group's
            assert not sprung.exists()


def test_pickles_in_other_files_are_refused_and_not_run(tmp_path, sprung):
    objects = np.array([Trap(sprung)], dtype=object)
    np.save(tmp_path / "table.npy", objects)
    with pytest.raises(InputError, match="no photometric table"):
        PhotometricTable.read(tmp_path / "table.npy")
    (tmp_path / "mug.safetensors").write_bytes(pickle.dumps(Trap(sprung)))
    header = {"x": {"dtype": "O", "shape": [1], "data_offsets": [0, 8]}}
    text = json.dumps(header).encode()
    (tmp_path / "cup.safetensors").write_bytes(len(text).to_bytes(8, "little") + text + bytes(8))
    for name in ("mug", "cup"):
        with pytest.raises(FormatError):
            ObjectFile.load(tmp_path / f"{name}.safetensors")
    buffer = io.BytesIO()
    np.savez(buffer, x=objects)
    (tmp_path / "dish.zarr.zip").write_bytes(buffer.getvalue())
    with pytest.raises(FormatError):
        products.verify(tmp_path / "dish.zarr.zip")
    assert not sprung.exists()


HUGE = 10**11
GREEDY: dict[str, dict[str, Any]] = {
    "a shape without data": {"x/zarr.json": array([HUGE])},
    "many arrays": {f"x{index}/zarr.json": array([10**8]) for index in range(11)},
    "many chunks": {
        "x/zarr.json": array(
            [10**8], "uint8", chunk_grid={"name": "regular", "configuration": {"chunk_shape": [1]}}
        )
    },
    "a negative shape": {"x/zarr.json": array([-1])},
    "a shape of numbers with a point": {"x/zarr.json": array([1.5])},
    "a chunk that unpacks to more": {
        "x/zarr.json": array([1]),
        "x/c/0": bytes([2, 1, 0x91, 8]) + (0x7FFFFF00).to_bytes(4, "little") + bytes(8),
    },
    "lengths in the data": {
        "x/zarr.json": array([1], "variable_length_bytes", [{"name": "vlen-bytes"}], fill_value=""),
        "x/c/0": (10**9).to_bytes(4, "little"),
    },
    "lengths of texts in the data": {
        "x/zarr.json": array([1], "string", [{"name": "vlen-utf8"}], fill_value=""),
        "x/c/0": (10**9).to_bytes(4, "little"),
    },
    "another compression": {
        "x/zarr.json": array([1], codecs=[BYTES, {"name": "zstd", "configuration": {"level": 0}}])
    },
    "shards": {"x/zarr.json": array([4], codecs=[{"name": "sharding_indexed", "configuration": {}}])},
    "nesting": {"zarr.json": b"[" * 100_000},
    "attributes without names": {"zarr.json": {**GROUP, "attributes": [1]}},
    "no object": {"zarr.json": [1]},
    "a name that goes up": {"../evil/zarr.json": array([1])},
    "a name that goes up inside": {"x/zarr.json": array([1]), "x/../../evil": b"1"},
    "an absolute name": {"/evil/zarr.json": array([1])},
    "a name of Windows": {"x\\..\\evil/zarr.json": array([1])},
    "something else": {"x.py": b"print()"},
}


def test_archives_that_declare_what_no_product_has_are_refused_in_little_memory(subtests, tmp_path):
    for kind in GREEDY:
        with subtests.test(kind=kind):
            path = archive(tmp_path / "x.zarr.zip", {"zarr.json": GROUP, **GREEDY[kind]})
            before = set(tmp_path.parent.iterdir())
            tracemalloc.start()
            with pytest.raises(FormatError):
                products.verify(path)
            assert tracemalloc.get_traced_memory()[1] < 20 * MEGABYTE
            tracemalloc.stop()
            assert set(tmp_path.parent.iterdir()) == before


def test_a_header_that_unpacks_to_more_is_not_unpacked(tmp_path):
    content = json.dumps(GROUP).encode() + b" " * (64 * MEGABYTE)
    path = archive(tmp_path / "x.zarr.zip", {"zarr.json": content}, zipfile.ZIP_DEFLATED)
    del content
    for read in (products.read_fingerprint, archives.read_attributes, products.verify):
        tracemalloc.start()
        with pytest.raises(FormatError, match="compressed"):
            read(path)
        assert tracemalloc.get_traced_memory()[1] < 4 * MEGABYTE
        tracemalloc.stop()


def test_real_products_pass(tmp_path):
    arrays = {
        f"{kind}_{shape}".replace(" ", ""): Array(np.ones(shape, kind), ("a", "b")[: len(shape)], "1", "x")
        for kind in ("f2", "f4", "f8", "i4", "i8", "u1", "?", "c16")
        for shape in ((), (0,), (3,), (5, 3000), (0, 4))
    }
    path = tmp_path / "x.zarr.zip"
    named = {name.translate(str.maketrans("(),?", "____")): value for name, value in arrays.items()}
    write_product(path, Product(named, {"fingerprint": "f", "deep": {"er": [1, 2.5, None, "ü"]}}))
    products.verify(path)
    assert archives.read_attributes(path)["deep"] == {"er": [1, 2.5, None, "ü"]}
    path.write_bytes(path.read_bytes().replace(b"long_name", b"lang_nome", 1))
    with pytest.raises(FormatError, match=r"unreadable|damaged"):
        products.verify(path)


HOSTILE_IDS = (
    "../x", "/x", "..", ".", ".x", "a/b", "a\\b", "a\nb", "a\x00b", "x" * 101, "\uff41", "a\u202eb", "a b",
    "~", "$HOME", "a;b", "", "\u00fc", "tab\there",
)  # fmt: skip


def test_a_table_names_no_file_outside(tmp_path):
    (tmp_path / "x.obj").write_text("v 0 0 0\n")
    materials = read_materials(REPOSITORY / "data" / "materials.csv")
    for hostile in (*HOSTILE_IDS, "-rf", "CON", "nul.obj", "mug."):
        table = tmp_path / "objects.csv"
        table.write_bytes(b'id,mesh,material\n"' + hostile.encode() + b'",x.obj,steel\n')
        try:
            catalogue = read_catalogue(table, materials)
        except InputError:
            continue  # NUL: no table at all
        assert not catalogue.records, hostile
        (error,) = catalogue.errors.values()
        assert "field id: " in str(error), hostile
        assert "cannot be a file name" in str(error), hostile


def test_records_name_no_file_outside(subtests, tmp_path_factory):
    for object_id in [*HOSTILE_IDS, "../../x"]:
        with subtests.test(object_id=object_id):
            tmp_path = tmp_path_factory.mktemp("case")
            (tmp_path / "data").mkdir()
            said = {"objects": {"mug": {"name": "Mug"}}, "refused": []}
            (tmp_path / RECORDS).write_text(json.dumps(said))
            assert list(read_records(tmp_path).rows) == ["mug"]
            said["objects"][object_id] = {"name": "Mug"}
            (tmp_path / RECORDS).write_text(json.dumps(said))
            with pytest.raises(InputError):
                read_records(tmp_path)


def test_records_that_are_none_are_refused(subtests, tmp_path_factory):
    for content in ["[]", "5", "[" * 100_000, '{"objects": [1], "refused": []}', "\x00"]:
        with subtests.test(content=content):
            tmp_path = tmp_path_factory.mktemp("case")
            (tmp_path / "data").mkdir()
            (tmp_path / RECORDS).write_text(content)
            with pytest.raises(InputError):
                read_records(tmp_path)


@pytest.mark.parametrize("content", [b"[]", b'{"products": {"data/x": 5}}', b"\xff", b"\x00"])
def test_a_cache_of_what_was_checked_that_was_tampered_with_checks_again(content, tmp_path):
    path = tmp_path / "data" / "x.zarr.zip"
    write_product(path, Product({}, {"fingerprint": "f"}))
    cache = tmp_path / ".objectfolder" / "verified.json"
    cache.parent.mkdir()
    cache.write_bytes(content)
    assert Verified(tmp_path).holds(path, "f")
    assert not Verified(tmp_path).holds(path, "g")


YAML_BOMBS = (
    "!!python/object/apply:os.mkdir [{mark}]",
    "!!python/object/new:os.mkdir [{mark}]",
    "name: !!python/name:os.mkdir",
    "size: !!python/object/apply:os.mkdir [{mark}]",
)


@pytest.mark.parametrize("text", YAML_BOMBS)
@pytest.mark.parametrize("read", [read_parameters, read_sensor])
def test_tags_in_yaml_make_nothing(text, read, tmp_path, sprung):
    path = tmp_path / "x.yaml"
    path.write_text(text.format(mark=sprung))
    with pytest.raises(yaml.YAMLError):
        yaml.safe_load(path.read_text())
    with pytest.raises(InputError):
        read(path)
    assert not sprung.exists()


TRIANGLES = (
    "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nf 1/1 3/1 2/1\nf 1/1 2/1 4/1\nf 1/1 4/1 3/1\nf 2/1 3/1 4/1\n"
)


def test_an_obj_may_name_what_lies_in_the_folder_around_its_own_and_no_further(tmp_path):
    """Scans keep textures in a folder beside the mesh's; what they name counts as their source."""
    folder = tmp_path / "mesh"
    folder.mkdir()
    from PIL import Image

    Image.new("RGB", (2, 2), (200, 10, 10)).save(tmp_path / "outside.png")
    (folder / "m.obj").write_text("mtllib m.mtl\nusemtl a\n" + TRIANGLES)
    (folder / "m.mtl").write_text("newmtl a\nmap_Kd ../outside.png\n")
    assert tmp_path / "outside.png" in {path.resolve() for path in source_files(folder / "m.obj")}
    assert tuple(load_mesh(folder / "m.obj").textures[0][0, 0, :3]) == (200, 10, 10)
    deeper = folder / "deeper" / "still"
    deeper.mkdir(parents=True)
    for name in ("m.obj", "m.mtl"):
        (deeper / name).write_text((folder / name).read_text().replace("../outside", "../../../outside"))
    with pytest.raises(InputError):
        load_mesh(deeper / "m.obj")
    assert tmp_path / "outside.png" not in {path.resolve() for path in source_files(deeper / "m.obj")}
    (tmp_path / "outside.png").write_text("root:x:0:0: no image, and nothing of it is told\n")
    with pytest.raises(InputError) as refused:
        load_mesh(folder / "m.obj")
    assert "root:x" not in str(refused.value)


def test_a_gltf_reads_no_buffer_outside_its_folder(subtests, tmp_path_factory):
    for uri in ["../secret.bin", "%2e%2e/secret.bin", "{absolute}", "file://{absolute}"]:
        with subtests.test(uri=uri):
            tmp_path = tmp_path_factory.mktemp("case")
            folder = tmp_path / "mesh"
            folder.mkdir()
            points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()
            (tmp_path / "secret.bin").write_bytes(points)
            uri = uri.format(absolute=tmp_path / "secret.bin")
            described = {
                "asset": {"version": "2.0"},
                "buffers": [{"byteLength": 36, "uri": uri}],
                "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 36}],
                "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
                               "min": [0, 0, 0], "max": [1, 1, 0]}],
                "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
                "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}], "scene": 0,
            }  # fmt: skip
            (folder / "m.gltf").write_text(json.dumps(described))
            with pytest.raises(InputError):
                load_mesh(folder / "m.gltf")
            (folder / "inside.bin").write_bytes(points)
            described["buffers"] = [{"byteLength": 36, "uri": "inside.bin"}]
            (folder / "m.gltf").write_text(json.dumps(described))
            assert len(load_mesh(folder / "m.gltf").vertices) == 3
