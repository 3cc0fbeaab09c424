"""Commands for one object: build, info, sample, render, strike, press, modes, fit-sound, view."""

import json as json_text
from functools import partial
from pathlib import Path
from typing import Annotated

from cyclopts import Group, Parameter
from cyclopts.validators import MutuallyExclusive

from pipeline.cli.options import Fields, Json, MeshOrFile, ObjectFilePath, Output, Overwrite
from pipeline.cli.output_paths import answers_folder, check_new_file
from pipeline.cli.printing import (
    FAILED,
    FINE,
    REPEATED,
    RESUMED,
    end_at_once,
    on_interrupt,
    print_result,
    print_text,
    status_line,
)
from pipeline.publish.queries.requests import (
    Beater,
    FittingOfSound,
    ModesOfMesh,
    Pressing,
    Rendering,
    Striking,
)
from pipeline.run.single_build import Building

one_pulse = Group(show=False, validator=MutuallyExclusive())
one_goal = Group(show=False, validator=MutuallyExclusive())
ANY_MODES, ANY_VIEWS, ANY_STRIKES, ANY_PRESSES = ModesOfMesh(), Rendering(), Striking(), Pressing()
ANY_FIT = FittingOfSound()


def build(
    request: Annotated[Building, Fields],
    *,
    output: Output,
    overwrite: Overwrite = False,
    yes: bool = False,
    json: Json = False,
) -> None:
    """Make one verified Object File from a mesh, a material and a size.

    Parameters
    ----------
    output
        the Object File (.safetensors)
    yes
        build also an object of a doubtful size (1 m or more without --length, 100 kg)
    """
    import objectfolder
    from pipeline.run.doubtful_size import COMMAND, refuse_doubtful_size
    from pipeline.run.single_build import build_object_file

    check_new_file(output, overwrite=overwrite)
    with on_interrupt(RESUMED):
        confirm = None if yes else partial(refuse_doubtful_size, words=COMMAND)
        built = build_object_file(request, output, confirm)
    if json:
        figures = {
            "file": str(output),
            "bytes": output.stat().st_size,
            "looks": built.looks,
            "warnings": built.warnings,
            "fidelity": objectfolder.load(output).description.get("fidelity"),
            "cpu_s": built.cpu_s,
        }
        print(json_text.dumps(figures, indent=1))
        return
    print_text(f"{output}: {output.stat().st_size / 1e6:.2f} MB")
    print_text(f"looks        {built.looks}")
    for warning in built.warnings:
        print_text(f"warning      {warning}")
    from pipeline.publish.queries.description import fidelity_lines  # a refused mesh needs none of it

    print_text("\n".join(fidelity_lines(objectfolder.load(output))))
    steps = ", ".join(f"{name} {value:.1f}" for name, value in built.cpu_s.items())
    print_text(f"cost         {sum(built.cpu_s.values()):.1f} CPU-s ({steps})")


def info(file: ObjectFilePath, /, *, json: Json = False) -> None:
    """Print what an Object File holds and how faithful it is."""
    import objectfolder
    from pipeline.publish.queries.description import info_lines

    content = objectfolder.load(file)
    if json:
        description = {**content.description, "bytes": content.bytes_by_part()}
        print(json_text.dumps(description, indent=2, ensure_ascii=False))
    else:
        print_text("\n".join(info_lines(content, file)))


def sample(
    file: ObjectFilePath,
    /,
    *,
    views: int = 8,
    contacts: int = 8,
    seed: int = 0,
    anywhere: bool = False,
    output: Output,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Draw valid queries and write them as .npy files.

    Parameters
    ----------
    views
        number of views
    contacts
        number of contacts
    seed
        of the draw
    anywhere
        draw contacts anywhere on the surface, also where the sensor does not fit
    output
        folder for views.npy, points.npy and forces.npy
    """
    with answers_folder(output, overwrite=overwrite), status_line(f"drawing queries of {file}"):
        from pipeline.publish.queries.answers import sample_queries

        summary = sample_queries(file, views, contacts, seed, anywhere, output)
    print_result(summary, json=json)


def render(
    file: ObjectFilePath,
    /,
    *,
    request: Annotated[Rendering, Fields] = ANY_VIEWS,
    output: Output,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Render views to PNG.

    Parameters
    ----------
    output
        folder for 0000.png and so on
    """
    with answers_folder(output, overwrite=overwrite), status_line(f"rendering {file}"):
        from pipeline.publish.queries.answers import render_views

        summary = render_views(file, request, output)
    print_result(summary, json=json)


def strike(
    file: ObjectFilePath,
    /,
    *,
    request: Annotated[Striking, Fields] = ANY_STRIKES,
    pulse_s: Annotated[float | None, Parameter(group=one_pulse)] = None,
    beater: Annotated[Beater | None, Parameter(group=one_pulse)] = None,
    striker: Annotated[tuple[str, float, float] | None, Parameter(group=one_pulse)] = None,
    output: Output,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Strike points and write float WAV files.

    Parameters
    ----------
    pulse_s
        seconds: spend each impulse as half a sine of this length
    beater
        what strikes: a ball of wood, of steel, a fingertip, or an ideal impulse of 1 N s (default: wood, or
        the impulses of --forces)
    striker
        MATERIAL RADIUS MASS of a ball that strikes instead, metres and kilograms
    output
        folder for 0000.wav and so on
    """
    with answers_folder(output, overwrite=overwrite), status_line(f"striking {file}"):
        from pipeline.publish.queries.answers import strike_points

        summary = strike_points(file, request, output, pulse_s, striker or beater)
    print_result(summary, json=json)


def press(
    file: ObjectFilePath,
    /,
    *,
    request: Annotated[Pressing, Fields] = ANY_PRESSES,
    depth_m: Annotated[float | None, Parameter(group=one_goal)] = None,
    force_n: Annotated[float | None, Parameter(group=one_goal)] = None,
    output: Output,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Press the sensor and write PNG images and depth maps.

    Parameters
    ----------
    depth_m
        metres into the gel (default: 0.001)
    force_n
        newtons along the sensor's axis; the gel is elastic then
    output
        folder for 0000.png, depth.npy and labels.json
    """
    with answers_folder(output, overwrite=overwrite), status_line(f"pressing {file}"):
        from pipeline.publish.queries.answers import press_points

        summary = press_points(file, request, output, depth_m, force_n)
    print_result(summary, json=json)


def modes(
    mesh: MeshOrFile, /, *, request: Annotated[ModesOfMesh, Fields] = ANY_MODES, json: Json = False
) -> int:
    """Solve the modes of a mesh, or list those of an Object File: frequencies, dampings, error estimate.

    The exit status is 1 where the accuracy asked for was not reached.
    """
    with on_interrupt(REPEATED), status_line(f"solving the modes of {mesh}"):
        from pipeline.publish.queries.mesh_modes import modes_table, solve_modes

        result = solve_modes(mesh, request)
    print_text(json_text.dumps(result) if json else modes_table(result))
    return FAILED if result.get("accuracy_reached") is False else FINE


def fit_sound(
    *files: Annotated[Path, Parameter(help="recordings of strikes (WAV), then the mesh of the object")],
    request: Annotated[FittingOfSound, Fields] = ANY_FIT,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Fit a material to recordings of the real object: E / rho, Poisson's ratio, walls, loss factor.

    Parameters
    ----------
    output
        write the fitted material as a materials table (CSV)
    """
    if output is not None:
        check_new_file(output, overwrite=overwrite)
    with on_interrupt(REPEATED), status_line("reading recordings") as show:
        from pipeline.publish.queries.sound_fit import fit_lines, fit_sounds, write_row

        result = fit_sounds(files, request, show)
    if output is not None:
        write_row(output, result["material"])
    print_text(json_text.dumps(result) if json else fit_lines(result))


def view(*files: ObjectFilePath, port: int = 0, no_browser: bool = False) -> None:
    """Turn, strike and press an object in the browser; served on 127.0.0.1 only.

    Parameters
    ----------
    files
        one or more Object Files, or folders of them
    port
        of 127.0.0.1; 0 for any free one
    no_browser
        print the address, open nothing
    """
    from pipeline.publish.viewer.live import view as viewed

    viewed(files, port, not no_browser)
    end_at_once()
