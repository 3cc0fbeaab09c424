"""Commands around a published data set: cards, get, export, gallery, play."""

import json as json_text
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import CycloptsError, Parameter
from cyclopts.validators import Number

from objectfolder.errors import InputError
from pipeline.cli.options import (
    AtLeastOne,
    Fields,
    Json,
    Materials,
    ObjectFilePath,
    Output,
    Overwrite,
    Remote,
    Root,
)
from pipeline.cli.output_paths import check_new_file
from pipeline.cli.printing import (
    FAILED,
    FINE,
    RESUMED,
    end_at_once,
    on_interrupt,
    print_error,
    print_result,
    print_text,
    status_line,
)
from pipeline.cli.usage import UsageError
from pipeline.dataset.project_files import MATERIALS
from pipeline.publish.queries.requests import Exporting


def cards(root: Root = Path("."), *, output: Annotated[Path | None, Parameter(alias="-o")] = None) -> None:
    """Write the cards of a data set: croissant.json, data_card.md, CITATION.cff.

    Parameters
    ----------
    output
        folder of its reports, where earlier cards are replaced (default: reports in the root)
    """
    with status_line("writing cards"):
        from pipeline.publish.data_set import REPORTS, write_cards

        paths = write_cards(root, output or root / REPORTS)
    print_text("\n".join(map(str, paths)))


def release(
    name: str,
    /,
    *,
    since: str = "",
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    remote: Remote = "",
    json: Json = False,
    root: Root = Path("."),
) -> None:
    """Check the data set, write its cards and changelog, commit them and tag the commit; nothing is pushed.

    Parameters
    ----------
    name
        v and a number, as v2 or v2.1.0
    since
        the release before, a git revision (default: the last tag of this form)
    output
        a new folder for Hugging Face, whose README is the data card
    """
    with status_line(f"releasing {name}") as show:
        from pipeline.dataset.stages import STAGES
        from pipeline.publish.release.release import release as released

        day = datetime.now(UTC).date()
        stages = tuple(STAGES.values())
        summary = released(
            root.absolute(), name, stages, day=day, since=since, remote=remote, output=output, progress=show
        )
    print_result(summary, json=json)


def get(
    repository: str,
    /,
    *ids: str,
    output: Output = Path("."),
    stage: tuple[str, ...] = (),
    list_ids: Annotated[bool, Parameter(name="--list")] = False,
    remote: Remote = "",
    jobs: Annotated[int, AtLeastOne] = 4,
    json: Json = False,
) -> int:
    """Fetch single objects of a published data set: only what is missing, checked.

    Parameters
    ----------
    repository
        path or URL of a git repository under DVC, with @REV for a revision
    ids
        objects (default: all of them)
    output
        folder for them
    stage
        products in place of Object Files, to FOLDER/data/STAGE: object_files, objects, views, modes, touches
        or fidelity; may be given several times
    list_ids
        print the ids that can be fetched, and fetch nothing
    jobs
        files at a time
    """
    from pipeline.publish.cards import single_objects

    if list_ids:
        with single_objects.opened(repository, remote) as data_set:
            listing = sorted(data_set.products(single_objects.OBJECT_FILES))
        print_text(json_text.dumps(listing) if json else "\n".join(listing))
        return FINE
    figures: list[dict[str, str | int]] = []
    outcomes, bytes_read = [], [0]
    with on_interrupt(RESUMED), status_line(f"fetching from {repository}") as show:

        def progress(count: int) -> None:
            bytes_read.append(count)
            show(f"{sum(bytes_read) / 1e6:.1f} MB")

        for single in single_objects.get(
            repository, ids, output, stages=stage, remote=remote, jobs=jobs, progress=progress
        ):
            outcomes.append(single.outcome)
            if single.error:
                print_error(single.error)
                continue
            size = single.path.stat().st_size
            figures.append({"file": str(single.path), "bytes": size, "outcome": single.outcome})
            if not json:
                print_text(f"{single.path}  {size / 1e6:.2f} MB, {single.outcome}")
    if json:
        print(json_text.dumps(figures, indent=1))
    if failures := outcomes.count(single_objects.FAILED):
        print_error(
            f"{failures} of {len(outcomes)} failed. Run the same command again: it fetches what is missing."
        )
    return FAILED if failures else FINE


def export(
    *objects: Annotated[str, Parameter(name="OBJECT")],
    request: Annotated[Exporting, Fields],
    output: Output,
    root: Root = Path("."),
    json: Json = False,
) -> None:
    """Write views as NeRF or COLMAP data, a surface as textured glTF, or an object for simulators.

    Parameters
    ----------
    objects
        an id of the data set, a product of views or objects (.zarr.zip), an Object File (.safetensors), or,
        for glTF, a mesh in metres; for simulators also several (default there: all of the data set)
    output
        a folder that does not exist yet; several objects get a folder each in it
    """
    with status_line(f"exporting {', '.join(objects) or 'all objects'}"):
        from pipeline.publish.export.formats import OF_SIMULATORS, known_formats, write_exports

        if request.format not in (formats := known_formats()):
            choices = ", ".join(f'"{name}"' for name in formats)
            raise CycloptsError(msg=f'--format: "{request.format}" is unknown. Use one of {choices}.')
        if request.format not in OF_SIMULATORS and len(objects) != 1:
            finding = f"names {len(objects) or 'no'} objects, and --format {request.format} takes one"
            raise UsageError("export", finding, "Name one object.")
        figures = []
        for summary in write_exports(objects, root, request, output):
            figures.append(summary.as_json())
            if not json:
                print_text(summary)
    if json:
        print(json_text.dumps(figures, indent=1))


def scene(
    *objects: Annotated[str, Parameter(name="OBJECT")],
    output: Output,
    table_m: Annotated[float, Number(gt=0, lte=100)] | None = None,
    height_m: Annotated[float, Number(gte=0, lte=100)] = 0.0,
    seed: int = 0,
    most_parts: Annotated[int, AtLeastOne] | None = None,
    texture_side: Annotated[int, AtLeastOne] = 1024,
    poses: Literal["upright", "random"] = "upright",
    overwrite: Overwrite = False,
    root: Root = Path("."),
    json: Json = False,
) -> None:
    """Write a table with objects at rest on it: MJCF (.xml), SDF (.sdf) or USD (.usda).

    Parameters
    ----------
    objects
        ids of the data set or Object Files; one may come several times
    output
        the scene; assets of the objects are written to folders beside it
    table_m
        side of the square table, metres, all over which objects stand (default: they stand close together,
        and it is as large as they need)
    height_m
        height of its top, metres
    seed
        of stable poses, turns and places
    most_parts
        largest number of convex parts of an object (default: the parts of the data set or the Object File,
        else 16)
    texture_side
        texels a side, where colours are those of an Object File
    poses
        upright as their own z axis has it, where they can stand so; or drawn among all poses at rest
    """
    check_new_file(output, overwrite=overwrite)
    request = Exporting(
        format="all", seed=seed, most_parts=most_parts, texture_side=texture_side, overwrite=overwrite
    )
    with status_line(f"composing a scene: {', '.join(objects) or 'all objects'}"):
        from pipeline.publish.export.assets import all_objects, compose_scene

        names = objects or all_objects(root)
        summary = compose_scene(
            names, root, request, output, table_m=table_m, height_m=height_m, upright=poses == "upright"
        )
    print_result(summary, json=json)


def gallery(
    *files: ObjectFilePath,
    output: Output,
    title: str = "Objects to see, hear and feel",
    materials: Materials = MATERIALS,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Write a folder of pages that any web server hosts: Object Files to turn, strike and press.

    Parameters
    ----------
    files
        Object Files, or folders of them
    output
        a folder that does not exist yet
    title
        heading of the first page
    """
    with status_line("writing a gallery") as show:
        from objectfolder.making.materials import read_materials
        from pipeline.publish.gallery.site import write_gallery
        from pipeline.publish.viewer.static import object_files_of

        summary = write_gallery(
            object_files_of(files), output, read_materials(materials), title=title, overwrite=overwrite,
            progress=lambda object_id: show(f"writing a gallery: {object_id}"),
        )  # fmt: skip
    print_result(summary, json=json)


def demo(*, port: int = 0, no_browser: bool = False) -> None:
    """Strike, throw and squeeze the package's own objects on a table, in the browser.

    The page is served on 127.0.0.1 only.

    Parameters
    ----------
    port
        of 127.0.0.1; 0 for any free one
    no_browser
        print the page's address, open nothing
    """
    with status_line("setting the table"):
        from pipeline.publish.demo import play_demo
    play_demo(port, not no_browser)
    end_at_once()


def play(
    scene: Path,
    /,
    *,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    overwrite: Overwrite = False,
    seconds: Annotated[float, Number(gt=0, lte=60)] = 3.0,
    lift_m: Annotated[float, Number(gte=0, lte=2)] = 0.08,
    height: Annotated[int, Number(gte=16, lte=2160)] = 360,
    width: Annotated[int, Number(gte=16, lte=3840)] = 480,
    seed: int = 0,
    simulator: str = "mujoco",
    port: int = 0,
    no_browser: bool = False,
    json: Json = False,
) -> None:
    """Strike, carry, throw and squeeze the objects of a scene in the browser; or drop them in a video.

    The page is served on 127.0.0.1 only.

    Parameters
    ----------
    scene
        MJCF with its assets beside it, as `objectfolder scene` writes it
    output
        the video (.mp4) of what is seen and heard as the objects drop; none: the page
    seconds
        how long the video is
    lift_m
        metres by which objects are lifted at first, each a little more and turned; 0: they stand
    height
        of the video's image, pixels
    width
        of the video's image, pixels
    seed
        of heights, turns and rough surfaces
    simulator
        what moves the objects in the video: mujoco, or the simulator of a plugin
    port
        of 127.0.0.1 for the page; 0 for any free one
    no_browser
        print the page's address, open nothing
    """
    if output is None:
        if simulator != "mujoco":
            raise InputError("--simulator", f"{simulator!r} plays videos alone", "Give --output too.")
        from pipeline.publish.viewer.play import play_in_browser

        play_in_browser(scene, port, not no_browser)
        end_at_once()
    check_new_file(output, overwrite=overwrite)
    with status_line(f"playing {scene}"):
        from pipeline.publish.scenes.playing import play as played

        summary = played(scene, output, seconds, lift_m, (height, width), seed, simulator)
    print_result(summary, json=json)


def export_samples(
    *files: Path,
    root: Root = Path("."),
    output: Output,
    sense: Literal["vision", "audio", "touch"] = "vision",
    source: Literal["truth", "object_file"] = "truth",
    layout: Annotated[Literal["webdataset", "huggingface"], Parameter(name="--format")] = "webdataset",
    queries: Annotated[int, AtLeastOne] = 64,
    seed: int = 0,
    passes: bool = False,
    shard_samples: Annotated[int, AtLeastOne] = 1000,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Write samples for learning: shards of WebDataset, or a folder for Hugging Face datasets.

    Parameters
    ----------
    files
        Object Files, of which queries are drawn (default: the queries of the data set in --root)
    output
        a folder that does not exist yet
    source
        the ground truth, or what Object Files answer to the same queries
    queries
        a split and file, of files alone
    seed
        of their draw, and of the order of samples
    passes
        depth and mask with views
    shard_samples
        samples a shard of WebDataset
    """
    from objectfolder.dataset import export_samples as write_samples

    arguments: dict[str, Any] = {"source": "object_file", "queries": queries} if files else {"source": source}
    with status_line(f"writing samples of {sense}"):
        counts = write_samples(
            files or root,
            output,
            sense,
            layout=layout,
            seed=seed,
            passes=passes,
            shard_samples=shard_samples,
            overwrite=overwrite,
            **arguments,
        )
    if json:
        print(json_text.dumps({"folder": str(output), **counts}))
        return
    print_text(f"{output}: {counts['train']} samples to train and {counts['test']} to test")
