"""Thousands of touches of several objects at once: what `press` answers, as tensors on a device."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np

from objectfolder.batch import contact_bodies, elastic, elastic_bodies
from objectfolder.batch.pixels import MOST_PIXEL_RAYS, Shadows, pixel_body
from objectfolder.batch.resident import closest, joined, numbers, object_indices, resident_trees, upload
from objectfolder.batch.shear import BatchShear, Compliance, GelShear, Push
from objectfolder.batch.targets import Tensor, checked_device, torch
from objectfolder.errors import QueryError
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.presses.elastic_press import greatest_depth_m
from objectfolder.touch.presses.touches import DEFAULT_DEPTH_M, TOLERANCE_M, Press, saturation_depth_m
from objectfolder.touch.rendering.surroundings import surroundings
from objectfolder.touch.sensor.camera import DEPTH_STEPS_PER_M, coverage_grid, no_contact_image
from objectfolder.touch.sensor.gel import gel_constants
from objectfolder.touch.sensor.point_lights import point_lights
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.sensor.table_lighting import table_lighting

# Cells of the gel, what is seen of them, and their compliances sideways by rows and columns.
_Gel = tuple[elastic.Layer, elastic.ElasticView, Callable[[tuple[int, int]], Compliance]]
PRECISIONS = {"single": np.float32, "double": np.float64}


@dataclass(frozen=True, eq=False)
class TouchImages:
    """Images of n touches, as of `Touches`: rgb uint8, depth_m float32 and mask bool."""

    rgb: Tensor
    depth_m: Tensor
    mask: Tensor

    @classmethod
    def empty(cls, count: int, sensor: Sensor, device: str | torch.device) -> "TouchImages":
        """Room for the images of `count` touches, to be filled again and again."""
        shape = (count, sensor.image_height, sensor.image_width)
        return cls(
            torch.empty((*shape, 3), dtype=torch.uint8, device=device),
            torch.empty(shape, dtype=torch.float32, device=device),
            torch.empty(shape, dtype=torch.bool, device=device),
        )


@dataclass(frozen=True, eq=False)
class BatchTouches:
    """n touches; the fields are those of `Touches`, as tensors on the device.

    ``relative_residual``, not among those, is that of `Contact`: which elastic contacts took too few steps.
    Under the rigid model it and the force are no numbers. ``shear`` is there where the gel was sheared.
    """

    rgb: Tensor
    depth_m: Tensor
    mask: Tensor
    sensor_to_object: Tensor
    points: Tensor
    normals: Tensor
    reachable: Tensor
    first_contact_offset_m: Tensor
    penetration_m: Tensor
    saturated: Tensor
    force_n: Tensor
    relative_residual: Tensor
    shear: BatchShear | None = None


class TouchBatch:
    """Surfaces and one sensor on a device.

    Parameters
    ----------
    patches
        The objects.
    sensor
        What is pressed.
    samples
        Samples along each side of a pixel, at most 4.
    device
        ``"cuda"``, or ``"cpu"`` for the same answers from loops.
    precision
        Of pixels, ``"single"`` or ``"double"``; contacts are found in double precision.

    Raises
    ------
    QueryError
        A device that is not there, or more samples than the kernels have room for.
    """

    def __init__(
        self,
        patches: Sequence[FacePatches],
        sensor: Sensor,
        samples: int = 2,
        device: str | torch.device = "cuda",
        precision: str = "single",
    ) -> None:
        if not 1 <= samples * samples <= MOST_PIXEL_RAYS:
            raise QueryError("samples", f"{samples}", f"Give 1 to {int(MOST_PIXEL_RAYS**0.5)}.")
        if precision not in PRECISIONS:
            raise QueryError("precision", f"{precision!r}", "Use 'single' or 'double'.")
        self.device, self.sensor = checked_device(device), sensor
        self.count, self._rays, kind = len(patches), samples * samples, PRECISIONS[precision]
        self._faces = resident_trees([patch.surface for patch in patches], self.device)
        self._surfaces = (
            *self._faces, joined([patch.face_normals for patch in patches], self.device),
            joined([patch.corner_normals for patch in patches], self.device),
        )  # fmt: skip
        self._diagonals = upload([patch.diagonal_m for patch in patches], self.device)
        grid, gel = coverage_grid(sensor, samples), gel_constants(sensor)
        shape = (sensor.image_height, sensor.image_width, 3)

        real, double = (partial(upload, device=self.device, kind=part) for part in (kind, np.float64))
        self._gel, self._camera = double(gel), double(sensor.camera_position_m)
        self._housing = double([sensor.housing_low_m, sensor.housing_high_m])
        around = surroundings(sensor)
        caster, self._response = (None, None) if around is None else (around.shadows, around.response)
        self._shadows = None if caster is None else Shadows(caster, self.device)
        self._near, self._u, self._v = grid.near, double(grid.u), double(grid.v)
        self._numbers = kind
        self._kind = torch.float32 if kind is np.float32 else torch.float64
        nearness = np.nextafter(1 / grid.gel_depth, np.inf).reshape(len(grid.v), len(grid.u))
        constants = [1 / grid.near, *gel[:3], *gel[5:7], DEPTH_STEPS_PER_M]
        table = sensor.photometric_table
        if table is None:
            lights = point_lights(sensor)
            material = np.append(lights.material, lights.exponent)
            look: tuple[np.ndarray, ...] = (lights.positions, lights.colours, material)
        else:
            lighting = table_lighting(sensor, table)
            look = lighting.nodes, lighting.place
        self._body = pixel_body(table is not None, kind)
        self._samples, self._layers = samples, lru_cache(maxsize=4)(self._layer)
        self._look = real(sensor.camera_position_m), *(real(part) for part in look)
        self._view = (
            self._rays, real(grid.u), real(grid.shift), real(grid.v), real(nearness),
            real(grid.gel_values.reshape(shape)), real(constants), *self._look,
            upload(no_contact_image(sensor, samples), self.device),
        )  # fmt: skip

    def press(
        self,
        objects: object,
        points: object,
        depth_m: object = None,
        tilt_deg: object = 0.0,
        azimuth_deg: object = 0.0,
        roll_deg: object = 0.0,
        *,
        force_n: object = None,
        contact: str | None = None,
        cell_m: float = Press.cell_m,
        steps: int = 32,
        across_n: object = None,
        torque_nm: object = None,
        friction: object = 1.0,
        marker_grid: tuple[int, int] | None = None,
        out: TouchImages | None = None,
    ) -> BatchTouches:
        """Press at points until the gel is indented by a depth, or bears a force.

        Parameters
        ----------
        objects
            (n,) which of the objects each touch is of, or one for all.
        points
            (n, 3) object frame, metres; the nearest points of the surfaces are touched.
        depth_m, force_n, tilt_deg, azimuth_deg, roll_deg
            As of `Press`: a number or (n,). Their ranges are not checked, which would wait for the device.
        contact, cell_m
            As of `Press`.
        steps
            Of the elastic contact, and of its shear, all taken. `BatchTouches.relative_residual` and
            `BatchShear.relative_residual` say how exact they are then.
        across_n, torque_nm, friction
            Shear an elastic gel, once it is pressed, by a load that grows in proportion: `force_n`,
            `torque_nm` and `friction` of `solve_shear`, (n, 2), (n,) and (n,) or what repeats to it. Images
            are those without shear.
        marker_grid
            Rows and columns of the sheared gel's markers, as `grid` of `moved_markers`.
        out
            Images to be filled; new ones if None.

        Raises
        ------
        QueryError
            As `Press`; arrays of other shapes, `out` of another size.
        """
        query = Press(force_n=force_n, contact=contact)  # type: ignore[arg-type]
        bends = query.contact_model == "elastic"
        if force_n is not None and depth_m is not None:
            raise QueryError("depth_m, force_n", "both given", "Ask for one of them.")
        shears = any(value is not None for value in (across_n, torque_nm, marker_grid))
        if shears and not (bends and steps > 0):
            raise QueryError("across_n", "no elastic gel is sheared", "Ask with contact='elastic' and steps.")
        count = len(points)  # type: ignore[arg-type]
        which = object_indices(objects, count, self.count, self.device)
        places = numbers("points", points, (count, 3), self.device)
        depths = numbers("depth_m", DEFAULT_DEPTH_M if depth_m is None else depth_m, (count,), self.device)
        degrees = ("tilt_deg", tilt_deg), ("azimuth_deg", azimuth_deg), ("roll_deg", roll_deg)
        turns = [numbers(name, value, (count,), self.device) for name, value in degrees]
        angles = torch.deg2rad(torch.stack(turns, dim=1))
        touched, shading, normals = (torch.empty_like(places) for _ in range(3))
        counts = torch.empty_like(which)
        radius = self.sensor.contact_radius_m
        face, barycentric = closest(self._faces, which, places)
        contact_bodies.find(
            count, which, face, barycentric, *self._surfaces, radius, touched, shading, counts
        )
        starts = _starts(counts)
        listed = torch.empty(max(1, int(starts[-1])), dtype=torch.int64, device=self.device)
        poses = torch.empty((count, 4, 4), dtype=torch.float64, device=self.device)
        contact_bodies.stand(
            count, which, touched, shading, angles, *self._surfaces, radius, self._gel, starts, listed,
            normals, poses,
        )  # fmt: skip
        offset = torch.empty_like(depths)
        reachable, blocked = (torch.empty(count, dtype=torch.bool, device=self.device) for _ in range(2))
        # The elastic gel is pressed from its first contact on.
        contact_bodies.advance(
            count, which, 0 * depths if bends else depths, *self._faces, self._gel, poses, offset, blocked
        )
        if bends:
            limit = greatest_depth_m(self.sensor)
            force = None if force_n is None else numbers("force_n", force_n, (count,), self.device)
            most = depths if force is None else torch.full_like(depths, limit)
            images = self._images(out, count)
            layer, push = self._layers(cell_m), None
            if shears:
                across = 0.0 if across_n is None else across_n
                torque = None if torque_nm is None else numbers("torque_nm", torque_nm, (count,), self.device)
                push = Push(
                    numbers("friction", friction, (count,), self.device),
                    numbers("across_n", across, (count, 2), self.device), torque, marker_grid, steps,
                )  # fmt: skip
            answers, shear = self._press_elastic(
                layer, (which, poses, blocked), (most, force, steps), images, push
            )
            self._change_surroundings(images, bends=True)
            penetration, bears, residual = (answer.to(torch.float64) for answer in answers)
            moved = penetration if force is not None else depths
            poses[:, :3, 3] += moved[:, None] * poses[:, :3, 0]
            saturated = penetration >= limit - TOLERANCE_M
        else:
            images = self._see(which, poses, blocked, out)
            saturated = ~blocked & (depths >= saturation_depth_m(self.sensor) - TOLERANCE_M)
            penetration = torch.where(blocked, 0.0, depths)
            bears, residual, shear = *[torch.full_like(depths, torch.nan)] * 2, None
        contact_bodies.fit(
            count, which, penetration, *self._faces, self._housing, self._diagonals, poses, offset, blocked,
            reachable,
        )  # fmt: skip
        return BatchTouches(
            images.rgb, images.depth_m, images.mask, poses, touched, normals, reachable, offset, penetration,
            saturated, bears, residual, shear,
        )  # fmt: skip

    def see(
        self, objects: object, sensor_to_object: object, *, out: TouchImages | None = None
    ) -> TouchImages:
        """Look through the gel at poses (n, 4, 4), wherever they are, as `render_poses` does."""
        which, poses = self._at(objects, sensor_to_object)
        return self._see(which, poses, torch.zeros(len(poses), dtype=torch.bool, device=self.device), out)

    def penetrations(self, objects: object, sensor_to_object: object) -> Tensor:
        """Return the deepest indentation (n,) of the gel at poses (n, 4, 4), metres, at least 0."""
        which, poses = self._at(objects, sensor_to_object)
        depths = torch.empty(len(poses), dtype=torch.float64, device=self.device)
        contact_bodies.penetrate(len(poses), which, poses, *self._faces, self._gel, depths)
        return depths

    def _at(self, objects: object, poses: object) -> tuple[Tensor, Tensor]:
        count = len(poses)  # type: ignore[arg-type]
        which = object_indices(objects, count, self.count, self.device)
        return which, numbers("sensor_to_object", poses, (count, 4, 4), self.device)

    def _see(self, which: Tensor, poses: Tensor, blocked: Tensor, out: TouchImages | None) -> TouchImages:
        count = len(which)
        images = self._images(out, count)
        starts, rows = self._faces_near(which, poses, blocked, torch.zeros_like(poses[:, 0, 0]))
        room = self._room
        planes = room(rows, contact_bodies.FACE_NUMBERS, kind=self._kind)
        maps, windows = room(rows, 9, kind=self._kind), room(rows, 4, kind=torch.int32)
        reach = room(max(1, count), 4, kind=torch.int32)
        contact_bodies.project(
            count, which, poses, blocked, starts, *self._surfaces, self._gel, self._camera, self._u, self._v,
            self._near, self._rays, room(rows), room(rows, kind=torch.int64), room(rows, 3, 3), planes, maps,
            windows, reach,
        )  # fmt: skip
        pixels = self.sensor.image_height * self.sensor.image_width
        self._body(
            (count, pixels), starts, windows, reach, planes, maps, *self._view, images.rgb, images.depth_m,
            images.mask,
        )  # fmt: skip
        self._change_surroundings(images, bends=False)
        return images

    def _change_surroundings(self, images: TouchImages, *, bends: bool) -> None:
        """Change what lies round the indented gel: its response on the host, by spreads of whole pictures."""
        if self._shadows is not None:
            self._shadows.cast(images.rgb, images.depth_m)
        if self._response is None:
            return
        pictures, depths = images.rgb.cpu().numpy(), images.depth_m.cpu().numpy()
        masks = images.mask.cpu().numpy() if bends else [None] * len(pictures)
        for picture, depth, mask in zip(pictures, depths, masks, strict=True):
            self._response.cast(picture, depth, mask)
        images.rgb.copy_(torch.from_numpy(pictures))

    def _images(self, out: TouchImages | None, count: int) -> TouchImages:
        images = TouchImages.empty(count, self.sensor, self.device) if out is None else out
        if images.mask.shape != (count, self.sensor.image_height, self.sensor.image_width):
            raise QueryError("out", f"shape {tuple(images.mask.shape)}", f"Give room for {count} touches.")
        return images

    def _room(self, *shape: int, kind: torch.dtype = torch.float64) -> Tensor:
        return torch.empty(shape, dtype=kind, device=self.device)

    def _faces_near(
        self, which: Tensor, poses: Tensor, blocked: Tensor, margins: Tensor
    ) -> tuple[Tensor, int]:
        """Return where the faces near each gel begin among those of all, (n + 1,), and how many there are."""
        counts = torch.empty_like(which)
        contact_bodies.count(len(which), which, poses, *self._faces, self._gel, blocked, margins, counts)
        starts = _starts(counts)
        return starts, max(1, int(starts[-1]))

    def _layer(self, cell_m: float) -> _Gel:
        layer = elastic.Layer(self.sensor, cell_m, self.device, self._numbers)
        view = elastic.ElasticView(self.sensor, self._samples, layer, self._look)
        return layer, view, lru_cache(maxsize=16)(partial(Compliance, layer))

    def _press_elastic(
        self, gel: _Gel, places: tuple[Tensor, Tensor, Tensor], load: tuple[Tensor, Tensor | None, int],
        images: TouchImages, push: Push | None,
    ) -> tuple[Tensor, BatchShear | None]:  # fmt: skip
        """Fill in images of gels pressed from poses on; return indentation, force, residual (3, n); shear."""
        (layer, view, compliance), (which, poses, blocked), (most, force, steps) = gel, places, load
        shear = None if push is None else GelShear(self.sensor, layer, push, compliance)
        parts = []
        most = torch.where(blocked, 0.0, most)
        answers = torch.empty((3, len(which)), dtype=self._kind, device=self.device)
        for first in range(0, len(which), elastic.TOUCHES_AT_ONCE):
            batch = slice(first, first + elastic.TOUCHES_AT_ONCE)
            margins = elastic.BULGE_MARGIN * most[batch]
            starts, rows = self._faces_near(which[batch], poses[batch], blocked[batch], margins)
            forms, windows = (
                self._room(rows, elastic_bodies.FORMS, kind=self._kind), self._room(rows, 4, kind=torch.int32)
            )  # fmt: skip
            elastic_bodies.lean(
                len(margins), which[batch], poses[batch], blocked[batch], starts, *self._surfaces, self._gel,
                margins, self._room(rows), self._room(rows, kind=torch.int64), self._room(rows, 3, 3),
                layer.grid, forms, windows,
            )  # fmt: skip
            gaps, slopes = layer.gaps_and_slopes(starts, windows, forms)
            pressed = layer.press(gaps, most[batch], None if force is None else force[batch], steps)
            shown = images.rgb[batch], images.depth_m[batch], images.mask[batch]
            view.see(pressed, slopes, shown)
            for answer, part in zip(
                answers, (pressed.indentation_m, pressed.force_n, pressed.relative_residual), strict=True
            ):
                answer[batch] = part[: len(margins)]
            if shear is not None:
                parts.append(shear.part(pressed, batch))
        return answers, shear.joined(parts) if shear is not None and parts else None


def _starts(counts: Tensor) -> Tensor:
    """Return where each of n lists begins in their concatenation, and where the last ends, (n + 1,)."""
    return torch.cat([torch.zeros_like(counts[:1]), torch.cumsum(counts, 0)])
