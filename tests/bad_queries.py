"""Queries that make no sense, more than sixty for each sense: a name, and what is called with an Object File."""

# Tables read better in long lines.
# ruff: noqa: E501

from collections.abc import Callable
from typing import Any

import numpy as np

from objectfolder.audio.synthesis.hertz import ContactBody
from objectfolder.audio.synthesis.support import Support
from objectfolder.object_file import ObjectFile
from objectfolder.vision.environment import Environment
from objectfolder.vision.lamps import Lamps

Query = Callable[[ObjectFile], Any]
NAN, INF = float("nan"), float("inf")
MANY = np.broadcast_to([0.0, 0.0, 0.004], (10**8, 3))  # 2.4 GB, had anybody written them
RAGGED = [[0.0, 0.0, 0.004], [0.0]]
COMPLEX = np.array([[0.0, 0.0, 0.004j]])
TOP = [0.0, 0.0, 0.004]
DOWN = [0.0, 0.0, -1.0]


def _each(method: str, argument: str, values: list[Any], **arguments: Any) -> dict[str, Query]:
    def query(value: Any) -> Query:
        return lambda file: getattr(file, method)(**{**arguments, argument: value})

    def label(value: Any) -> str:
        return f"{value.dtype}{value.shape}" if isinstance(value, np.ndarray) else repr(value)[:40]

    return {
        f"{method}({argument}={label(value)}) {index}": query(value) for index, value in enumerate(values)
    }


def _pose(**changed: Any) -> np.ndarray:
    pose = np.eye(4)[None]
    pose[0, 2, 3] = 0.3
    for name, value in changed.items():
        pose[0, int(name[1]), int(name[2])] = value
    return pose


POSE, LAMP = _pose(), [0.1, 0.1, 0.3]
MAP = np.ones((16, 32, 3))
VIEW = {"camera_to_object": POSE, "lights": LAMP, "resolution": 16}
SKY = {"camera_to_object": POSE, "resolution": 16}
RAYS = {"origins": [[0, 0, 0.1]], "directions": [[0, 0, -1.0]], "lights": LAMP}
WRONG_POINTS = ["points", None, [], 5, RAGGED, COMPLEX, MANY, {}, [[NAN, 0, 0]], [[INF, 0, 0]], [[1e300, 0, 0]],
                [0.0, 0.0], [[[0, 0, 0.004]]], [0.0, 0.0, 0.1]]  # fmt: skip
WRONG_COUNTS = [-1, 1.5, "ten", None, 10**12, NAN, True]
WRONG_SEEDS = [-1, 1.5, "seed", None, NAN]

SIGHT: dict[str, Query] = {
    **_each("render", "camera_to_object", [
        "camera", None, [], POSE * NAN, POSE * INF, POSE[:, :3], np.eye(3), POSE[None], _pose(a00=-1.0), _pose(a00=2.0),
        _pose(a30=1.0), _pose(a03=1e200), _pose(a03=1e8), POSE.astype(complex), RAGGED, np.zeros((1, 4, 4)), {},
        np.broadcast_to(POSE, (10**8, 4, 4)),
    ], lights=LAMP, resolution=16),
    **_each("render", "lights", [
        "lamp", 5, {}, [], [0.1, 0.1], [LAMP, LAMP], [NAN, 0, 0], [INF, 0, 0], [1e200, 0, 0], RAGGED,
        COMPLEX, np.ones((1, 1, 1, 3)), np.broadcast_to(LAMP, (1, 10**8, 3)),
    ], **SKY),
    **{f"Environment({index})": lambda file, light=light: file.render(**SKY, lights=Environment.of(light)) for index, light in enumerate((
        "sun", 5, {}, MAP[:, :16], MAP[..., 0], MAP * NAN, -MAP, MAP[:0], MAP.astype(complex)))},
    **{f"Lamps({colours!r})": lambda file, colours=colours: file.render(**SKY, lights=Lamps(LAMP, colours)) for colours in (
        "red", [1, 1], [-1, 1, 1], [INF, 1, 1], [1e300, 1, 1], np.ones((5, 3)), {})},
    **_each("render", "resolution", [
        0, -5, 1.5, NAN, None, "big", True, (64, 0), (3, 4, 5), (16.0, 16), 10**9, 2**70, (1, 10**12), 20_000,
    ], camera_to_object=POSE, lights=LAMP),
    **_each("render", "resolution", [1024], camera_to_object=np.repeat(POSE, 100, 0), lights=LAMP),
    **_each("render", "field_of_view_deg", [0, -39.6, 180, 200, NAN, INF, "wide", None, [1, 2]], **VIEW),
    **_each("render", "sub_rays", [0, -1, 1.5, "many", 10**6, 10**30, NAN, True], **VIEW),
    **_each("render", "sub_rays", [4096], **{**VIEW, "resolution": 4096}),
    **_each("render", "crop", [(60, 60, 10, 10), (-1, 0, 2, 2), (0, 0, 0, 1), (0, 0, 2), "all", 5, (0.5, 0, 2, 2), (NAN,) * 4], **VIEW),
    **_each("render_passes", "passes", [[], "depth", ["shadow"], [5], 5, {"image": 1}.values], **VIEW),
    **_each("radiance", "origins", ["o", None, [], [0, 0], [[NAN, 0, 0]], [[1e200, 0, 0]], np.zeros((3, 3)), MANY], **{**RAYS, "directions": [DOWN, DOWN]}),
    **_each("radiance", "directions", ["d", None, [], [[0, 0, 0]], [[NAN, 0, 1]], [[INF, 0, 1]], [1, 2], MANY], **RAYS),
    **_each("radiance", "lights", ["l", None, [], [NAN, 0, 0], [1e200, 0, 0]], **RAYS),
    **_each("radiance", "lights", [Lamps(LAMP, colours) for colours in ("red", [-1, 0, 0], [1, 1])], **RAYS),
    **_each("sample_views", "n", WRONG_COUNTS, seed=0),
    **_each("sample_views", "seed", WRONG_SEEDS, n=1),
    **_each("sample_views", "camera_radius", [0, -1, NAN, "far", 1e300], n=1, seed=0),
    **_each("pictures", "cameras", [0, *WRONG_COUNTS], resolution=16),
    **_each("pictures", "studio", ["garden", 5, []], cameras=1),
}  # fmt: skip

STRUCK = {"points": TOP, "impulses_n_s": DOWN, "duration_s": 0.05}
SOUND: dict[str, Query] = {
    **_each("strike", "points", WRONG_POINTS, impulses_n_s=DOWN, duration_s=0.05),
    **_each("strike", "impulses_n_s", [
        "hard", [], 5, [0.0, 1.0], [DOWN, DOWN], RAGGED, COMPLEX, MANY, [NAN, 0, 0], [INF, 0, 0], [1e300, 0, 0],
        np.zeros((1, 1, 1, 3)), {},
    ], points=TOP, duration_s=0.05),
    **_each("strike", "forces_n", [
        "hard", [], DOWN, np.zeros((2, 4, 3)), np.zeros((1, 4, 2)), np.zeros((1, 0, 3)), np.full((1, 4, 3), NAN), {},
    ], points=TOP, duration_s=0.05),
    **_each("strike", "forces_n", [np.zeros((1, 4, 3))], **STRUCK),
    **_each("strike", "duration_s", [0, -1, NAN, INF, "long", None, [1, 2], 1e9, 1e300, 1e-12], points=TOP),
    **_each("strike", "sample_rate_hz", [0, -1, NAN, INF, "high", None, [1, 2], 1e12, 1e-3], **STRUCK),
    **_each("strike", "modes", [-1, 1.5, "all", NAN, [1], True], **STRUCK),
    **_each("strike", "pulse", [0, -1, NAN, INF, "short", [0.001, 0.001], 1e-13, 1e9, {}], **STRUCK),
    **_each("strike", "pulse", [0.001], points=TOP, forces_n=np.zeros((1, 4, 3))),
    **_each("strike", "velocities_m_s", ["fast", [], [NAN, 0, 0], [DOWN, DOWN]], points=TOP, pulse="steel"),
    **_each("strike", "velocities_m_s", [DOWN], points=TOP),
    **_each("strike", "velocities_m_s", [DOWN], pulse="steel", **STRUCK),
    **_each("strike", "observed", ["ear", 5, None, [1, 2], [NAN, 0, 0], [1.0, 0, 0], MANY, []], **STRUCK),
    **_each("strike", "listener", ["ear", 5, [1, 2], [NAN, 0, 0], [INF, 0, 0], [1e200, 0, 0], [1e9, 0, 0], MANY, []], **STRUCK),
    **_each("strike", "support", ["hand", 5, [TOP]], **STRUCK),
    **_each("strike", "duration_s", [30.0], points=np.repeat([TOP], 1000, 0)),
    **_each("strikes", "duration_s", [0, NAN, "long", 1e9], points=TOP),
    **_each("rms_velocity", "times_s", [[-1], [NAN], [INF], "soon", None, RAGGED, MANY], points=TOP, impulses_n_s=DOWN),
    **_each("mode_velocities", "impulses_n_s", ["hard", [NAN, 0, 0], np.zeros((1, 2, 3)), [1, 2]], points=TOP),
    **_each("mode_velocities", "modes", [-1, 1.5, "all"], points=TOP, impulses_n_s=DOWN),
    **_each("stream", "sample_rate_hz", [0, -1, NAN, INF, "high", None]),
    **_each("stream", "observed", ["ear", 5, [1.0, 0, 0]]),
    **_each("stream", "listener", ["ear", [1, 2], [NAN, 0, 0]]),
    **{f"stream().block({n!r})": lambda file, n=n: file.stream().block(n) for n in WRONG_COUNTS},
    **{f"stream().strike(at={at!r})": lambda file, at=at: file.stream().strike(TOP, DOWN, at=at) for at in (-1, NAN, INF, "now", 1e300)},
    **{f"stream().strike({p!r})": lambda file, p=p: file.stream().strike(p, DOWN) for p in ("here", [0, 0], [TOP, TOP], [1.0, 0, 0])},
    **{f"stream().strike(pulse={p!r})": lambda file, p=p: file.stream().strike(TOP, DOWN, pulse=p) for p in ("short", -1, NAN, [1, 2], 1e9)},
    **{f"Support({k})": lambda file, k=k: file.strike(**STRUCK, support=Support(**{"points": TOP, **k})) for k in (
        {"points": "here"}, {"points": [1.0, 0, 0]}, {"points": []}, {"stiffness_n_m": -1}, {"stiffness_n_m": NAN},
        {"stiffness_n_m": "stiff"}, {"damping_n_s_m": [1, 2]}, {"damping_n_s_m": 1e300}, {"stiffness_n_m": 1e300})},
    **{f"ContactBody{c}": lambda file, c=c: file.strike(**STRUCK, pulse=ContactBody(*c)) for c in (
        (-1, 0.3, 0.01, 0.1), (NAN, 0.3, 0.01, 0.1), (1e9, 0.7, 0.01, 0.1), (1e9, 0.3, -1, 0.1), (1e9, 0.3, 0.01, 0), ("hard", 0.3, 0.01, 0.1), (1e9, 0.3, 0.01, 0.1, 0.0), (1e9, 0.3, 0.01, 0.1, 1.1))},
}  # fmt: skip

PRESSED = {"points": TOP}
SENSOR_IMAGE = np.zeros((160, 120, 3), np.uint8)
TOUCH: dict[str, Query] = {
    **_each("press", "points", WRONG_POINTS),
    **_each("press", "depth_m", [-1e-3, 0.1, NAN, INF, "deep", [1e-3, 1e-3], [[1e-3]], [], 1j, {}], **PRESSED),
    **_each("press", "tilt_deg", [-1, 90, NAN, INF, "leaning", [1, 2], []], **PRESSED),
    **_each("press", "azimuth_deg", [NAN, INF, 1e300, "left", [1, 2], []], **PRESSED),
    **_each("press", "roll_deg", [NAN, INF, 1e300, "left", [1, 2], []], **PRESSED),
    **_each("press", "force_n", [-1, NAN, INF, 1e300, "hard", [1, 2], []], **PRESSED),
    **_each("press", "force_n", [1.0], depth_m=0.001, **PRESSED),
    **_each("press", "force_n", [1.0], contact="rigid", **PRESSED),
    **_each("press", "contact", ["soft", 5, [], ""], **PRESSED),
    **_each("press", "resolution", [0, (0, 5), (1, 1), (-4, 4), (1.5, 8), (8.0, 8), (3,), (3, 4, 5), (NAN, 8), "big", {}, (10**6, 10**6), (10**30, 8), (True, 8)], **PRESSED),
    **_each("press", "resolution", [(4000, 3000)], points=np.repeat([TOP], 100, 0)),
    **_each("press", "background", ["photo", 5, SENSOR_IMAGE[:9], SENSOR_IMAGE[..., 0], SENSOR_IMAGE.astype(float), [], RAGGED], **PRESSED),
    **_each("press", "noise_seed", [-1, 1.5, NAN, "seed", [1, 2], [], 2**200], **PRESSED),
    **_each("project", "points", WRONG_POINTS),
    **_each("sample_contacts", "n", WRONG_COUNTS, seed=0, reachable=False),
    **_each("sample_contacts", "seed", WRONG_SEEDS, n=1),
    **_each("sample_contacts", "n", WRONG_COUNTS, seed=0),
}  # fmt: skip
