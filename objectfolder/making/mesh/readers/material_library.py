"""Wavefront material libraries (.mtl): what each material looks like.

Read are `Kd`, `d`, `Pr`, `Pm` and their maps, and maps of normals: what `norm` or `map_Kn` names, and of
`bump` and `map_Bump` an image that is plainly no map of heights. Where `Kd` is black and has no picture, what
shows is the picture of `map_Ka` or `map_Ke`, or the reflection `Ks` of a metal, and a remark says so. Left
aside are heights; `Ns`, an exponent of another reflection model that exporters fill with defaults; and `Tr`,
which some write as transparency and others as opacity. The alpha channel of `map_Kd` means nothing by itself:
textures of scans carry one that says nothing of transparency.
"""

from dataclasses import dataclass, field
from pathlib import Path, PureWindowsPath

import numpy as np

from objectfolder.errors import InputError
from objectfolder.making.mesh.readers.files import (
    brief,
    find_file,
    joined_lines,
    lies_within,
    read_text,
    shortened,
    unquoted,
    usual_places,
    without_comment,
)

MOST_LIBRARIES = 100
"""Named by one mesh: real ones name a few."""

DEFAULT_COLOUR = np.array([0.8, 0.8, 0.8])
"""sRGB-encoded base colour of a mesh that names none."""

_OPTION_VALUES = {
    "-blendu": 1, "-blendv": 1, "-bm": 1, "-boost": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1, "-mm": 2,
    "-o": 3, "-s": 3, "-t": 3, "-texres": 1, "-type": 1,
}  # fmt: skip
_CHANNELS = {"r": 0, "g": 1, "b": 2, "m": 3}
_NORMALS = {"norm", "map_kn"}
_BUMPS = {"bump", "map_bump"}
_SCALARS = {"d": "opacity", "pr": "roughness", "pm": "metallic"}
_PICTURES = {"map_ka": "ambient", "map_ke": "emission", "map_ks": "reflection"}
"""Pictures that stand in for one of `map_Kd`, the first first, and what they are of."""
_GLASS = ("4", "6", "7", "9")
"""Values of `illum` that ask for glass or refraction."""
_BLACK = 0.02
"""A base colour that is nowhere brighter comes out black."""
_METAL = 0.2
"""A reflection that is nowhere brighter is that of a plastic."""
_BRIGHTEST = 2.0
"""Colours above it are not in 0..1: lights are brighter than 1, surfaces by rounding at most."""


@dataclass(frozen=True)
class ScalarMap:
    """An image of one quantity.

    Parameters
    ----------
    file
        The image.
    channel
        Of red, green, blue, alpha the one to take; None takes red (the value of a grey image), and for
        opacity alpha where it has one.
    """

    file: Path
    channel: int | None = None


@dataclass
class ObjMaterial:
    """A material as written.

    Parameters
    ----------
    colour
        Base colour (3,), sRGB-encoded 0..1.
    texture
        File of the base colour texture, which replaces `colour`.
    opacity, roughness, metallic
        Values in 0..1; None where not written.
    opacity_map, roughness_map, metallic_map
        Images. The opacity map is multiplied by the opacity, the others replace the value.
    normal_map, bump_map
        Images of normals, and of heights or normals.
    bump_scale
        Factor of what these add to the surface.
    pictures
        Images that are no base colour, by their keyword.
    other_colours
        `Ka`, `Ke` and `Ks` (3,), by their keyword.
    has_colour, half_transparent
        Whether `Kd`, and a `Tr` between 0 and 1, are written.
    left_out
        Options of pictures that are not followed.
    written
        Whether any of this was.
    remarks
        What was taken otherwise than written.
    """

    colour: np.ndarray = field(default_factory=DEFAULT_COLOUR.copy)
    texture: Path | None = None
    opacity: float | None = None
    roughness: float | None = None
    metallic: float | None = None
    opacity_map: ScalarMap | None = None
    roughness_map: ScalarMap | None = None
    metallic_map: ScalarMap | None = None
    normal_map: Path | None = None
    bump_map: Path | None = None
    bump_scale: float = 1.0
    pictures: dict[str, Path] = field(default_factory=dict)
    other_colours: dict[str, np.ndarray] = field(default_factory=dict)
    has_colour: bool = False
    half_transparent: bool = False
    left_out: set[str] = field(default_factory=set)
    glass: bool = False
    written: bool = False
    remarks: list[str] = field(default_factory=list)

    @property
    def files(self) -> list[Path]:
        """Every image the material names."""
        maps = (self.opacity_map, self.roughness_map, self.metallic_map)
        textures = [file for file in (self.texture, self.normal_map, self.bump_map) if file is not None]
        textures += self.pictures.values()
        return textures + [scalar.file for scalar in maps if scalar is not None]


def read_material_library(mesh: Path, library: str) -> dict[str, ObjMaterial]:
    """Read the materials of one `mtllib` statement of `mesh` (a file name, or several).

    Files are looked for in the folder of the mesh and the one around it, nowhere else. What stands before
    the first `newmtl` is the material of the empty name. Where a `Kd` is above 2, all of its file are in
    0..255.

    Raises
    ------
    InputError
        The library or a texture it names is not there, a texture is scaled or shifted, a value is no number
        in 0..1, or a material is wholly transparent.
    """
    materials: dict[str, ObjMaterial] = {}
    for path in library_files(mesh, library):
        current = ObjMaterial()
        of_file = [current]
        for number, line in enumerate(joined_lines(read_text(path)), start=1):
            keyword, *values = line.split("#", 1)[0].split() or [""]
            names_a_file = len(line.split()) > 1
            where = f"{path} line {number}"
            if keyword.lower() == "newmtl":
                current = materials.setdefault(unquoted(" ".join(line.split()[1:])), ObjMaterial())
                of_file.append(current)
                continue
            current.written |= bool(keyword)
            current.left_out |= _options_left_out(values)
            if keyword.lower() == "kd":
                current.colour, current.has_colour = _colour(values, where), True
            elif keyword.lower() in ("ka", "ke", "ks") and all(map(_is_number, values)):
                current.other_colours[keyword.lower()] = _colour(values, where)
            elif keyword.lower() == "tr" and all(map(_is_number, values)):
                current.half_transparent = any(0 < float(value) < 1 for value in values[:1])
            elif keyword.lower() == "illum":
                current.glass = values[:1] in [[value] for value in _GLASS]
            elif keyword.lower() in _PICTURES and names_a_file:
                # Others than base colours need not be there.
                if image := _nearest_texture(mesh, path, _file_name(line.strip(), where, moved=True)):
                    current.pictures[keyword.lower()] = image
            elif keyword.lower() == "map_kd" and names_a_file:
                current.texture = _texture_file(mesh, path, line, where)
            elif keyword.lower() in _NORMALS | _BUMPS and names_a_file:
                _read_normals(current, mesh, path, line, where)
            elif keyword.lower() in _SCALARS:
                setattr(current, _SCALARS[keyword.lower()], _fraction(keyword, values, where))
            elif keyword.lower().removeprefix("map_") in _SCALARS and names_a_file:
                name = _SCALARS[keyword.lower().removeprefix("map_")]
                setattr(
                    current,
                    f"{name}_map",
                    ScalarMap(_texture_file(mesh, path, line, where), _channel(values)),
                )
        _settle(path, of_file)
        if of_file[0].written:
            materials.setdefault("", of_file[0])
    for name, material in list(materials.items()):
        materials.setdefault(without_comment(name), material)
    return materials


def _settle(path: Path, materials: list[ObjMaterial]) -> None:
    """Bring the colours of a file to 0..1, and give materials that would come out black what shows of them.

    Raises
    ------
    InputError
        A colour above 255.
    """
    most = max(float(material.colour.max()) for material in materials)
    if most > 255:
        raise InputError(str(path), f"has a Kd of {most:g}", "Write colours in 0..1, or all in 0..255")
    for material in materials:
        if most > _BRIGHTEST:
            material.colour = material.colour / 255
            material.remarks.append(
                f"{path.name} has Kd up to {most:g}: its colours are taken to be in 0..255"
            )
        elif float(material.colour.max()) > 1:
            material.remarks.append(f"{path.name} has Kd up to {most:g}: what is above 1 is cut off")
        material.colour = np.clip(material.colour, 0, 1)
        if material.glass and material.opacity is None and material.opacity_map is None:
            material.remarks.append(
                f"illum of {path.name} asks for glass, without d: it is drawn opaque; write d 0.3, say"
            )
        elif material.half_transparent and material.opacity is None and material.opacity_map is None:
            material.remarks.append(
                f"Tr of {path.name} is not read, for some write it as opacity: it is drawn opaque; write d"
            )
        if material.left_out:
            options = ", ".join(sorted(material.left_out))
            material.remarks.append(f"{path.name} has options of pictures that are not followed: {options}")
        if material.texture is None:
            _show(path, material)


def _show(path: Path, material: ObjMaterial) -> None:
    """Take a picture, or the reflection of a metal, in place of a base colour that is absent or black."""
    black = bool((material.colour <= _BLACK).all())
    for keyword, kind in _PICTURES.items():
        if keyword in material.pictures and (black or keyword == "map_ka"):
            material.texture = material.pictures[keyword]
            material.remarks.append(
                f"{path.name} has a picture of {kind} (map_K{keyword[-1]}) and none of the colour (map_Kd): "
                "it is taken for the colour"
            )
            return
        if keyword == "map_ke" and keyword in material.pictures:
            material.remarks.append(
                f"{path.name} has a picture of emission (map_Ke), which is not used: bake it into that of "
                "the colour (map_Kd)"
            )
    shown = {keyword: np.clip(colour, 0, 1) for keyword, colour in material.other_colours.items()}
    if shown.get("ka", np.zeros(3)).min() == 1:
        del shown["ka"]  # Blender writes a white one whatever the colour is
    shown = {keyword: colour for keyword, colour in shown.items() if float(colour.max()) > _METAL}
    if black and "ks" in shown:
        material.colour = shown["ks"]
        material.metallic = 1.0 if material.metallic is None else material.metallic
        material.remarks.append(
            f"{path.name} has black Kd and bright Ks: a metal, whose reflection is its colour"
        )
    elif black or not material.has_colour:
        written = "black" if black else "no"
        for keyword in [keyword for keyword in ("ke", "ka") if keyword in shown][:1]:
            material.colour = shown[keyword]
            material.remarks.append(
                f"{path.name} has {written} Kd and bright {keyword.title()}, which is taken for it"
            )


def _read_normals(material: ObjMaterial, mesh: Path, library: Path, line: str, where: str) -> None:
    """Read a `norm` or `bump` line; a map of heights, which `bump` may name, need not be there."""
    keyword, *values = line.split()
    if keyword.lower() in _NORMALS:
        material.normal_map = _texture_file(mesh, library, line, where)
    else:
        material.bump_map = _nearest_texture(mesh, library, _file_name(line.strip(), where))
    if "-bm" in values[:-1] and _is_number(scale := values[values.index("-bm") + 1]):
        material.bump_scale = float(np.clip(np.nan_to_num(float(scale)), -1e3, 1e3))


def _fraction(keyword: str, values: list[str], where: str) -> float:
    """The number of a `d`, `Pr` or `Pm` line; `-halo` before it is passed over."""
    try:
        value = float(values[-1])
    except (ValueError, IndexError):
        value = -1.0
    if not 0.0 <= value <= 1.0:
        raise InputError(where, f"{keyword} {shortened(' '.join(values))} is no number in 0..1", "Write one")
    if keyword.lower() == "d" and value == 0.0:
        raise InputError(
            where, "d 0 makes the material wholly transparent", "Write d 1, or leave its faces out"
        )
    return value


def _channel(values: list[str]) -> int | None:
    """The channel that `-imfchan` names."""
    options = [option.lower() for option in values]
    if "-imfchan" not in options[:-1]:
        return None
    return _CHANNELS.get(options[options.index("-imfchan") + 1])


def library_files(mesh: Path, library: str) -> list[Path]:
    """Find the files of an `mtllib` statement, whose name may hold spaces or which may list several."""
    listed = list(dict.fromkeys(without_comment(library).split()))[:MOST_LIBRARIES]
    for names in ([library], [unquoted(without_comment(library))], listed):
        paths = [find_file(mesh.parent, _places(name), within=_outermost(mesh)) for name in names]
        files = [path for path in paths if path is not None]
        if files and len(files) == len(paths):
            return files
    raise InputError(
        str(mesh),
        f"names the material library {shortened(library)}, which is not there",
        "Add it beside the mesh, or name a texture for the object, or remove the mtllib line",
    )


def _places(name: str) -> list[str]:
    """Where a material library may be: as written, by its own name beside the mesh, or in usual folders."""
    base = PureWindowsPath(name).name
    return [name, base, *(f"{folder}/{base}" for folder in ("materials", "material", "mtl", "textures"))]


def _outermost(mesh: Path) -> Path:
    """Folder outside of which nothing that a mesh names is read: scans come with folders side by side."""
    return mesh.parent / ".."


def _colour(values: list[str], where: str) -> np.ndarray:
    try:
        numbers = np.array([float(value) for value in values[:3]])
    except ValueError:
        numbers = np.array([])
    if len(numbers) == 1:
        numbers = np.repeat(numbers, 3)
    if len(numbers) != 3 or not np.isfinite(numbers).all():
        raise InputError(
            where, f"Kd {shortened(' '.join(values))} is not a colour", "Write three numbers in 0..1"
        )
    return np.maximum(numbers, 0)


def _file_name(line: str, where: str, *, moved: bool = False) -> str:
    """The file name of a `map_Kd` line, which may hold spaces and follows the options; `moved` by these."""
    rest = line.split(maxsplit=1)[1].strip()
    while rest.startswith("-"):
        option, *values = rest.split()
        count = _OPTION_VALUES.get(option.lower())
        if count is None:
            break
        numbers = [
            value for value in values[:count] if option.lower() not in ("-o", "-s", "-t") or _is_number(value)
        ]
        unmoved = {"-o": 0.0, "-s": 1.0, "-t": 0.0}.get(option.lower())
        if not moved and unmoved is not None and any(float(value) != unmoved for value in numbers):
            raise InputError(
                where,
                f"the texture option {option} {brief(' '.join(numbers))} is not supported",
                "Apply the scale or offset to the texture coordinates",
            )
        after = rest.split(maxsplit=1 + len(numbers))[1 + len(numbers) :]
        if not after:
            raise InputError(where, "names no texture after its options", "Write the name of an image")
        rest = after[0].strip()
    return unquoted(rest)


def _options_left_out(values: list[str]) -> set[str]:
    """Return the options of a picture that show, which are not followed: no repetition, another contrast."""
    text = f" {' '.join(values).lower()} ".replace(" -mm 0 1 ", " ")
    return {option for option in ("-clamp on", "-mm") if f" {option} " in text}


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _texture_file(mesh: Path, library: Path, line: str, where: str) -> Path:
    """Where the texture is: as written, beside the library, or in the folders scans come with."""
    written = _file_name(line.strip(), where)
    file = _nearest_texture(mesh, library, written)
    if file is not None:
        return file
    outside = not lies_within(library.parent / PureWindowsPath(written).as_posix(), _outermost(mesh))
    raise InputError(
        where,
        f"names the texture {shortened(written)}, which "
        + ("lies outside of the folders of the object" if outside else "is not there"),
        "Bake its tiles into one picture within 0..1"
        if "<udim>" in written.lower()
        else "Add it beside the material library, or name a texture for the object",
    )


def _nearest_texture(mesh: Path, library: Path, written: str) -> Path | None:
    names: list[str] = []
    for name in dict.fromkeys([written, without_comment(written)]):
        base = PureWindowsPath(name).name
        # The last is where Google Scanned Objects have it as Fuel serves them.
        names += [*usual_places(name), f"../textures/{base}", f"../materials/textures/{base}"]
    return find_file(library.parent, names, within=_outermost(mesh))
