"""Any archive at all unpacks to what it holds, or is refused."""

import contextlib
import tempfile
import unicodedata
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from objectfolder.errors import FormatError, InputError
from pipeline.intake.sources.unpacking import unpack
from tests.sources.hostile_archives import KINDS, MAKERS, tree

SURROGATES_AND_CONTROLS = ("Cs", "Cc")
DEVICES = {
    "CON",
    "PRN",
    "AUX",
    "NUL",
    *(f"{port}{number}" for port in ("COM", "LPT") for number in range(1, 10)),
}
PART = st.text(
    st.characters(exclude_categories=SURROGATES_AND_CONTROLS, exclude_characters="/\\:"),
    min_size=1,
    max_size=12,
).filter(lambda part: part not in (".", "..") and part.split(".")[0].upper() not in DEVICES)
NAME = st.lists(PART, min_size=1, max_size=4).map("/".join)
PLAIN = st.dictionaries(NAME, st.binary(max_size=2000), min_size=1, max_size=8)
HOSTILE_PARTS = (
    "..", "/", "\\", ".", "C:", "c:\\", "a", "A", "b", "ä", "a\u0308", "ß", "SS", "\n", "\x7f", " ", "~",
    "%2e", "\u202e", "con", "x" * 200, "\uff0e\uff0e", "\u2215",  # the last look like dots and a slash
)  # fmt: skip
HOSTILE = st.lists(st.sampled_from(HOSTILE_PARTS), min_size=1, max_size=8).map("".join)


def seen_by_any_machine(name: str) -> str:
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


def clash(names: list[str]) -> bool:
    """Whether a machine that tells no case apart would take two of these files, or their folders, for one."""
    files = [seen_by_any_machine(name) for name in names]
    folders = {"/".join(name.split("/")[:depth]) for name in names for depth in range(1, name.count("/") + 1)}
    return (
        len(set(files)) < len(files)
        or len({seen_by_any_machine(folder) for folder in folders}) < len(folders)
        or bool({seen_by_any_machine(folder) for folder in folders} & set(files))
    )


@pytest.mark.parametrize("kind", KINDS)
@given(members=PLAIN)
def test_what_goes_in_comes_out(kind, members):
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        archive, target = folder / "archive", folder / "target"
        archive.write_bytes(MAKERS[kind](members.items()))
        if clash(list(members)):
            with pytest.raises(FormatError, match=r"where case|twice"):
                unpack(archive, target)
        else:
            assert unpack(archive, target) == list(members)
            assert tree(target) == members


@pytest.mark.parametrize("kind", KINDS)
@given(names=st.lists(HOSTILE, min_size=1, max_size=3))
def test_no_name_leads_out(kind, names):
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / "outer" / "inner"
        folder.mkdir(parents=True)
        archive, target = folder / "archive", folder / "target"
        archive.write_bytes(MAKERS[kind]([(name, b"" if name.endswith("/") else b"1") for name in names]))
        with contextlib.suppress(FormatError, InputError):  # the latter of names that no file may have
            assert set(unpack(archive, target)) == set(tree(target))
        outside = {path for path in Path(temporary).rglob("*") if not path.is_relative_to(target)}
        assert outside == {folder.parent, folder, archive}
        assert not any("\\" in name for name in tree(target))


@st.composite
def edits(draw: st.DrawFn) -> list[tuple[float, int, bytes]]:
    """Where, as a share of the length, how much is taken away, and what is put there."""
    return draw(
        st.lists(
            st.tuples(st.floats(0, 1), st.integers(0, 40), st.binary(max_size=20)), min_size=1, max_size=4
        )
    )


@pytest.mark.parametrize("kind", KINDS)
@given(members=PLAIN.filter(lambda members: not clash(list(members))), changes=edits())
def test_damage_is_seen_or_changes_nothing(kind, members, changes):
    content = bytearray(MAKERS[kind](members.items()))
    for share, length, new in changes:
        place = int(share * len(content))
        content[place : place + length] = new
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        archive, target = folder / "archive", folder / "target"
        archive.write_bytes(content)
        try:
            unpack(archive, target)
        except FormatError:
            return
        assert tree(target) == members
