"""What writes a format of export: the project's own code, or a plugin's."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import objectfolder
from objectfolder.errors import InputError
from objectfolder.export.files import new_folder
from objectfolder.plugins import EXPORTS, Plugin, find_plugin, plugin_names
from pipeline.publish.export.assets import ALL_FORMATS, all_objects, write_assets
from pipeline.publish.export.exports import write_export
from pipeline.publish.export.object_products import find_products
from pipeline.publish.export.summaries import ExportSummary
from pipeline.publish.queries.requests import Exporting

OF_SIMULATORS = (*ALL_FORMATS, "all")
OWN = ("nerf", "colmap", "gltf", *OF_SIMULATORS)


def known_formats() -> list[str]:
    """Return the names of all formats; no plugin is imported."""
    return [*OWN, *plugin_names(EXPORTS)]


def write_exports(
    names: Sequence[str], root: Path, options: Exporting, output: Path
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
    plugin = find_plugin(EXPORTS, options.format, OWN)
    if options.format in OF_SIMULATORS:
        yield from write_assets(names or all_objects(root), root, options, output)
    elif plugin is None:
        yield write_export(find_products(names[0], root), options, output)
    else:
        yield _write_by(plugin, names[0], root, options, output)


def _write_by(plugin: Plugin, name: str, root: Path, options: Exporting, output: Path) -> ExportSummary:
    products = find_products(name, root)
    if products.object_file is None:
        raise InputError(
            products.object_id, "has no Object File, and a plugin writes one", "Make or name one."
        )
    with new_folder(output, overwrite=options.overwrite) as folder:
        description = plugin.part(folder, objectfolder.load(products.object_file))
        if not isinstance(description, Mapping):
            finding = f"returns a value of type {type(description).__name__}"
            raise plugin.error(finding, "It must return a dict, for export.json.")
        by = {"plugin": {"distribution": plugin.distribution, "version": plugin.version}}
        products.write_manifest(folder, options.format, {**description, **by})
    return ExportSummary(
        folder=str(output),
        licence=products.credit().licence,
        figures={**description, **by},
        words=f"by {plugin.distribution} {plugin.version}",
    )
