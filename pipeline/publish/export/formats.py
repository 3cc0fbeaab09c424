"""What writes a format of export: the project's own code, or a plugin's."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import objectfolder
from objectfolder.errors import InputError
from objectfolder.plugins import EXPORTS, Plugin, find_plugin, plugin_names
from objectfolder.vision.export.files import new_folder
from pipeline.publish.export.assets import ALL_FORMATS, all_objects, write_assets
from pipeline.publish.export.exports import write_export
from pipeline.publish.export.found_products import find_products
from pipeline.publish.export.summaries import ExportSummary
from pipeline.publish.queries.requests import Exporting

OF_SIMULATORS = (*ALL_FORMATS, "all")
OWN = ("nerf", "colmap", "gltf", *OF_SIMULATORS)


def known_formats() -> list[str]:
    """Return the names of all formats; no plugin is imported."""
    return [*OWN, *plugin_names(EXPORTS)]


def write_exports(
    names: Sequence[str], root: Path, wanted: Exporting, output: Path
) -> Iterator[ExportSummary]:
    """Write objects in a known format, into `output`, or of several into a folder each there.

    Formats that are not `OF_SIMULATORS` take one object.

    Yields
    ------
    ExportSummary
        One for each object, when it is written.

    Raises
    ------
    InputError
        No such object; a plugin that does not do its part.
    """
    plugin = find_plugin(EXPORTS, wanted.format, OWN)
    if wanted.format in OF_SIMULATORS:
        yield from write_assets(names or all_objects(root), root, wanted, output)
    elif plugin is None:
        yield write_export(find_products(names[0], root), wanted, output)
    else:
        yield _write_by(plugin, names[0], root, wanted, output)


def _write_by(plugin: Plugin, name: str, root: Path, wanted: Exporting, output: Path) -> ExportSummary:
    found = find_products(name, root)
    if found.object_file is None:
        raise InputError(found.object_id, "has no Object File, and a plugin writes one", "Make or name one.")
    with new_folder(output, overwrite=wanted.overwrite) as folder:
        described = plugin.part(folder, objectfolder.load(found.object_file))
        if not isinstance(described, Mapping):
            finding = f"returns a value of type {type(described).__name__}"
            raise plugin.error(finding, "It must return a dict, for export.json.")
        by = {"plugin": {"distribution": plugin.distribution, "version": plugin.version}}
        found.write_manifest(folder, wanted.format, {**described, **by})
    return ExportSummary(
        folder=str(output),
        licence=found.credit().licence,
        figures={**described, **by},
        words=f"by {plugin.distribution} {plugin.version}",
    )
