"""Sheared touches and their markers: against single queries, and how many a second."""

from functools import partial
from typing import Any

import numpy as np

from bench.gpu.run import Run, objects, touches
from bench.gpu.stages import stages

FRICTION = 0.8
# Of the force that friction bears; the radius of the contact is taken as a millimetre for torques.
SHARES, TORQUES_M = (0.0, 1.1), (-0.0003, 0.0003)


def loads(count: int, forces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Forces across (n, 2) and torques (n,), of which some are more than friction bears."""
    random = np.random.default_rng(5)
    angle, share = random.uniform(0, 2 * np.pi, count), random.uniform(*SHARES, count)
    across = (FRICTION * forces * share)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return across, forces * random.uniform(*TORQUES_M, count)


def shear_equality(run: Run) -> dict[str, Any]:
    """Markers against `solve_shear` and `moved_markers` of the same contacts, by steps."""
    from objectfolder.batch import Batch
    from objectfolder.touch import Elastomer, moved_markers, solve_contact, solve_shear
    from objectfolder.touch.contact.height_field import gap_field
    from objectfolder.touch.presses.elastic_press import _cells
    from objectfolder.touch.presses.touches import Press

    files, count = objects(), 8 if run.on_cpu else 24
    which, points, queries = touches(count, files)
    forces = 4000 * queries.pop("depth_m")
    across, torques = loads(count, forces)
    sensor = files[0].touch.sensor
    gel = Elastomer(sensor.gel_youngs_modulus_pa, sensor.gel_poisson_ratio, sensor.gel_thickness_m)
    cells = _cells(sensor, Press.cell_m)
    pitch = sensor.gel_height_m / cells[0], sensor.gel_width_m / cells[1]
    reached = Batch(files, run.device, precision="double").touch.press(
        which, points, force_n=forces, **queries, steps=40
    )
    pressed = {
        name: getattr(reached, name).cpu().numpy()
        for name in ("penetration_m", "sensor_to_object", "force_n")
    }
    contacts = []
    for row, index in enumerate(which):
        first = pressed["sensor_to_object"][row]
        first[:3, 3] -= pressed["penetration_m"][row] * first[:3, 0]
        gap = gap_field(files[index].touch.net._patches, sensor, first, cells)
        # Where the sensor cannot stand, or its gel is saturated, less is borne.
        contacts.append(solve_contact(gap, pitch, gel, force_n=float(pressed["force_n"][row])))
    figures: dict[str, Any] = {"touches": count}
    for name, twist in (("held", None), ("twisted", torques)):
        true = [
            solve_shear(
                contact, gel, FRICTION, across[row], tolerance=1e-6,
                torque_nm=None if twist is None else twist[row],
            )
            for row, contact in enumerate(contacts)
        ]  # fmt: skip
        markers = [moved_markers(sensor, *pair) for pair in zip(contacts, true, strict=True)]
        truth = {
            key: np.stack([getattr(part, key) for part in parts])
            for parts, keys in (
                (markers, ("displacement_m", "pixels")), (true, ("shift_m", "twist_rad", "sliding")),
            )
            for key in keys
        }  # fmt: skip
        for precision, steps in (("single", 16), ("single", 24), ("single", 32), ("double", 48)):
            batch = Batch(files, run.device, precision=precision).touch
            answer = batch.press(
                which, points, force_n=forces, **queries, steps=steps, across_n=across, torque_nm=twist,
                friction=FRICTION,
            ).shear  # fmt: skip
            moved = {key: getattr(answer.markers, key).cpu().numpy() for key in ("displacement_m", "pixels")}
            solved = {
                key: getattr(answer, key).cpu().numpy()
                for key in ("shift_m", "twist_rad", "sliding", "relative_residual")
            }
            apart = {key: float(np.abs(moved[key] - truth[key]).max()) for key in moved}
            sticks = ~truth["sliding"]
            figures[f"{name}_{precision}_{steps}"] = {
                "markers_um": 1e6 * apart["displacement_m"],
                "markers_px": apart["pixels"],
                "markers_um_median": 1e6
                * float(np.median(np.abs(moved["displacement_m"] - truth["displacement_m"]))),
                "markers_move_um": 1e6 * float(np.abs(truth["displacement_m"]).max()),
                "shift_um": 1e6 * float(np.abs(solved["shift_m"] - truth["shift_m"])[sticks].max()),
                "twist_rad": float(np.abs(solved["twist_rad"] - truth["twist_rad"])[sticks].max()),
                "sliding": int(truth["sliding"].sum()),
                "sliding_that_differ": int((solved["sliding"] != truth["sliding"]).sum()),
                "residual_largest": float(solved["relative_residual"].max()),
            }
    return figures


def shear_speed(run: Run) -> dict[str, Any]:
    """Sheared touches by force a second from points on, with markers, and where the time goes."""
    from objectfolder.batch import Batch, TouchImages

    files = objects()
    batch = Batch(files, run.device).touch
    figures: dict[str, Any] = {}
    for count in (2,) if run.on_cpu else (256, 4096):
        which, points, queries = touches(count, files)
        forces = 4000 * queries.pop("depth_m")
        across, torques = loads(count, forces)
        out = TouchImages.empty(count, batch.sensor, run.device)
        place = partial(run.torch.as_tensor, device=run.device)
        arguments = {name: place(value) for name, value in {**queries, "force_n": forces}.items()}
        for name, load in (
            ("pressed", {}),
            ("held", {"across_n": place(across)}),
            ("twisted", {"across_n": place(across), "torque_nm": place(torques)}),
        ):
            work = partial(
                batch.press,
                place(which),
                place(points),
                **arguments,
                **load,
                friction=FRICTION,
                steps=24,
                out=out,
            )
            figures[f"{name}_{count}_per_s"] = round(count / run.seconds(work, 3), 1)
        figures[f"milliseconds_{count}"] = stages(run, work)
    return {**figures, "peak_gib": run.peak_gib()}
