"""Gymnasium's environments of an object that is seen, heard and felt; importing this registers them.

Gymnasium 1.0 and later looks for none in installed packages, but imports the module that an id names::

    gymnasium.make("objectfolder.live.environments:objectfolder/Squeeze-v0")  # and Strike-v0
"""

from typing import Any

import numpy as np

from objectfolder import example
from objectfolder.extras import needs_extra
from objectfolder.live.contacts import finite_pose
from objectfolder.live.gripper import FINGERS, gripper, standing
from objectfolder.live.mujoco_simulation import MujocoSimulation
from objectfolder.live.sound import BLOCK_SAMPLES, LiveSound
from objectfolder.live.touch import Finger, LiveTouch
from objectfolder.object_file.object_file import ObjectFile
from objectfolder.query_values import whole
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.vision.cameras import look_at

with needs_extra("gymnasium"):
    import gymnasium
    from gymnasium.spaces import Box, Dict

BLOCKS, LONGEST_STEPS = 2, 200  # 23 ms a step
GREATEST_FORCE_N, LIFTING_M_S = 10.0, 0.1
LIFTED_M, LOUDEST_PA, FRICTION = 0.03, 200.0, 0.8
STRUCK_BLOCKS, MOST_STRIKES = 8, 20  # 93 ms a step
SOFTEST_N_S, REFERENCE_PA, WANTED_DB, NEAR_DB = 1e-3, 2e-5, (50.0, 75.0), 1.0
AWAY_M, CAMERA_POSITION = (
    0.002,
    np.array([1.6, -1.6, 1.2]),
)  # of where the object stands; of the camera, in its scale


class Standing(gymnasium.Env[dict[str, np.ndarray], np.ndarray]):
    """An object that stands in a world of MuJoCo, seen and heard; what is done to it is its subclasses'.

    Parameters
    ----------
    model
        `mujoco.MjModel` with a free body ``object``.
    file
        The object.
    pixels
        Of a side of the image.
    blocks
        Of sound that a step lasts.
    render_mode
        ``"rgb_array"``: `render` returns the image.

    Raises
    ------
    QueryError
        A number of pixels out of range.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 43}  # noqa: RUF012  (gymnasium declares it so)

    def __init__(
        self, model: Any, file: ObjectFile, pixels: int, blocks: int, render_mode: str | None
    ) -> None:
        with needs_extra("gymnasium"):
            import mujoco
        self._engine, self.render_mode = mujoco, render_mode
        self._file, self._model, self._data = file, model, mujoco.MjData(model)
        self._simulation = MujocoSimulation(model, self._data)
        low, high = file.surface.bounds
        centre = (low + high) / 2 - low * [0, 0, 1]
        self._camera = look_at(centre + CAMERA_POSITION * file.frame.scale, centre)[0]
        self._side, self._blocks = whole("pixels", pixels, 8, 2048), blocks
        self._spaces: dict[str, gymnasium.Space[Any]] = {
            "image": Box(0, 255, (self._side, self._side, 3), np.uint8),
            "audio": Box(-LOUDEST_PA, LOUDEST_PA, (blocks * BLOCK_SAMPLES,), np.float32),
        }

    def _stand(self, seed: int | None) -> np.ndarray:
        """Stand the object up to 2 mm from its place, silent, and return as much silence as a step lasts."""
        super().reset(seed=seed)
        self._engine.mj_resetData(self._model, self._data)
        body = self._data.body("object").id
        place = self._model.jnt_qposadr[self._model.body_jntadr[body]]
        self._data.qpos[place : place + 2] += self.np_random.uniform(-AWAY_M, AWAY_M, 2)
        self._engine.mj_forward(self._model, self._data)
        seed_of_sound = int(self.np_random.integers(2**31))
        self._sound = LiveSound(self._simulation, {"object": self._file}, seed=seed_of_sound)
        return np.zeros(self._blocks * BLOCK_SAMPLES)

    def _run(self) -> np.ndarray:
        """Run the world for a step, and return its sound in pascals."""
        return np.concatenate([self._sound.block() for _ in range(self._blocks)])

    def render(self) -> np.ndarray | None:
        """Return the image (pixels, pixels, 3) uint8, or None without a mode."""
        return self._image() if self.render_mode == "rgb_array" else None

    def _image(self) -> np.ndarray:
        """The object, seen by a camera that stands in the world and carries the lamp."""
        camera = np.linalg.inv(finite_pose(self._simulation, "object")) @ self._camera
        lamp = camera[:3, 3] / 2 + camera[:3, 1] * self._file.frame.scale / 2
        return np.asarray(self._file.render(camera, lamp, self._side, sub_rays=8)[0])

    def _seen_and_heard(self, sound: np.ndarray) -> dict[str, np.ndarray]:
        return {
            "image": self._image(),
            "audio": np.clip(sound, -LOUDEST_PA, LOUDEST_PA).astype(np.float32),
        }


class Squeeze(Standing):
    """Grip an object with two fingers and lift it by 3 cm.

    An action is how hard to squeeze, -1 to 1 for 0 to 10 N, and how fast to lift, -1 to 1 for -0.1 to
    0.1 m/s. The reward is how far the object rose meanwhile, over those 3 cm. An observation is a dictionary:
    ``image`` of the object alone, sRGB; ``audio``, pascals meanwhile at 44.1 kHz; ``touch`` of both fingers;
    ``proprioception``, of each finger how far it has closed and risen, metres, then the normal and the
    tangential force that it bears, newtons.

    Parameters
    ----------
    file
        The object; the mug of the package by default. Its hull is gripped, see `gripper`.
    pixels
        Of a side of the image.
    render_mode
        ``"rgb_array"``: `render` returns the image.
    sensor
        Of both fingers; the one that the file was made with if None.

    Raises
    ------
    QueryError
        A number of pixels out of range.

    Examples
    --------
    >>> import gymnasium
    >>> squeeze = gymnasium.make("objectfolder.live.environments:objectfolder/Squeeze-v0")
    >>> observation, _ = squeeze.reset(seed=0)
    >>> observation, reward, *_ = squeeze.step(squeeze.action_space.sample())
    >>> observation["touch"].shape, observation["audio"].shape
    ((2, 160, 120, 3), (1024,))
    """

    def __init__(
        self,
        file: ObjectFile | None = None,
        pixels: int = 64,
        render_mode: str | None = None,
        sensor: Sensor | None = None,
    ) -> None:
        file = example("mug") if file is None else file
        super().__init__(gripper(file, FRICTION, sensor=sensor), file, pixels, BLOCKS, render_mode)
        fingers = {name: Finger(friction=FRICTION, sensor=sensor) for name in FINGERS}
        self._touch = LiveTouch(self._simulation, {"object": file}, fingers, onto_surface=True)
        sensor = self._touch.sensors[FINGERS[0]]
        gels = (len(FINGERS), sensor.image_height, sensor.image_width, 3)
        self.action_space = Box(-1.0, 1.0, (2,), np.float32)
        self.observation_space: gymnasium.Space[Any] = Dict(
            self._spaces
            | {
                "touch": Box(0, 255, gels, np.uint8),
                "proprioception": Box(-1e3, 1e3, (4 * len(FINGERS),), np.float32),
            }
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Stand the object up to 2 mm from its place, the fingers open."""
        silence = self._stand(seed)
        self._start = self._risen()
        return self._observed(silence), {}

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Run the world for two blocks of sound."""
        squeeze, lift = np.clip(np.asarray(action, dtype=np.float64), -1.0, 1.0)
        force, speed = GREATEST_FORCE_N * (1 + squeeze) / 2, LIFTING_M_S * lift
        self._data.ctrl[:] = [force, force, speed, speed]
        before, sound = self._risen(), self._run()
        risen = self._risen()
        reward, done = (risen - before) / LIFTED_M, risen - self._start >= LIFTED_M
        return self._observed(sound), float(reward), bool(done), False, {}

    def _risen(self) -> float:
        return float(finite_pose(self._simulation, "object")[2, 3])

    def _observed(self, sound: np.ndarray) -> dict[str, np.ndarray]:
        felt = self._touch.feel()
        borne = [[felt[name].normal_n, felt[name].tangential_n] for name in FINGERS]
        moved = [[self._data.joint(f"{name}_{way}").qpos[0] for way in ("close", "lift")] for name in FINGERS]
        return self._seen_and_heard(sound) | {
            "touch": np.stack([felt[name].image.rgb for name in FINGERS]),
            "proprioception": np.hstack([moved, borne]).ravel().astype(np.float32),
        }


class Strike(Standing):
    """Strike an object so that it sounds as loud as is wanted.

    An action is where and how hard: the azimuth, -1 to 1 for half a turn to either side of x; the height, -1
    to 1 for level to straight down; and the impulse, -1 to 1 for 1 to 100 mN s, its logarithm even. A hammer
    comes along the ray through the middle of the object's box, and strikes the surface that this meets first
    along its normal. The reward is minus how far the level of the step's sound is from that wanted, decibels
    over 20; within 1 dB the episode ends. An observation is a dictionary: ``image`` of the object, sRGB;
    ``audio``, pascals meanwhile at 44.1 kHz; ``wanted``, dB; ``proprioception``, the pose of the object, the
    first three rows of (4, 4), metres.

    Parameters
    ----------
    file
        The object; the mug of the package by default. It collides by its hull, and is struck on its surface.
    pixels
        Of a side of the image.
    render_mode
        ``"rgb_array"``: `render` returns the image.

    Raises
    ------
    QueryError
        A number of pixels out of range.

    Examples
    --------
    >>> import gymnasium
    >>> strike = gymnasium.make("objectfolder.live.environments:objectfolder/Strike-v0")
    >>> observation, _ = strike.reset(seed=0)
    >>> observation, reward, *_ = strike.step(strike.action_space.sample())
    >>> observation["audio"].shape, bool(abs(observation["audio"]).max() > 0)
    ((4096,), True)
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 11}  # noqa: RUF012  (gymnasium declares it so)

    def __init__(
        self, file: ObjectFile | None = None, pixels: int = 64, render_mode: str | None = None
    ) -> None:
        file = example("mug") if file is None else file
        super().__init__(standing(file), file, pixels, STRUCK_BLOCKS, render_mode)
        self.action_space = Box(-1.0, 1.0, (3,), np.float32)
        self.observation_space: gymnasium.Space[Any] = Dict(
            self._spaces
            | {
                "wanted": Box(*WANTED_DB, (1,), np.float32),
                "proprioception": Box(-1e3, 1e3, (12,), np.float32),
            }
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Stand the object up to 2 mm from its place, and want another level."""
        silence = self._stand(seed)
        self._wanted_db = float(self.np_random.uniform(*WANTED_DB))
        return self._observed(silence), {}

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Strike, and run the world for eight blocks of sound."""
        around, down, hard = np.clip(np.asarray(action, dtype=np.float64), -1.0, 1.0)
        self._strike(np.pi * around, np.pi / 4 * (1 + down), SOFTEST_N_S * 10 ** (1 + hard))
        sound = self._run()
        level_db = 20 * np.log10(max(float(np.sqrt((sound**2).mean())), REFERENCE_PA) / REFERENCE_PA)
        away_db = abs(level_db - self._wanted_db)
        return self._observed(sound), -away_db / 20, bool(away_db <= NEAR_DB), False, {"level_db": level_db}

    def _strike(self, azimuth: float, elevation: float, impulse_n_s: float) -> None:
        pose, surface = finite_pose(self._simulation, "object"), self._file.surface
        away = np.array([np.cos(azimuth), np.sin(azimuth), np.tan(elevation)])
        away = pose[:3, :3].T @ (away / np.linalg.norm(away))
        origin = surface.bounds.mean(axis=0) + 2 * self._file.frame.scale * away
        hits = surface.ray_hits(origin[None], -away[None])
        if hits.face[0] < 0:
            return
        normal = surface.normals_at(hits.face, hits.barycentric)[0]
        normal *= np.sign(normal @ away) or 1.0
        point = pose[:3, :3] @ surface.points_at(hits.face, hits.barycentric)[0] + pose[:3, 3]
        for struck in (self._simulation, self._sound):
            struck.strike("object", point, -impulse_n_s * pose[:3, :3] @ normal)

    def _observed(self, sound: np.ndarray) -> dict[str, np.ndarray]:
        pose = finite_pose(self._simulation, "object")[:3]
        return self._seen_and_heard(sound) | {
            "wanted": np.array([self._wanted_db], np.float32),
            "proprioception": pose.ravel().astype(np.float32),
        }


gymnasium.register("objectfolder/Squeeze-v0", f"{__name__}:Squeeze", max_episode_steps=LONGEST_STEPS)
gymnasium.register("objectfolder/Strike-v0", f"{__name__}:Strike", max_episode_steps=MOST_STRIKES)
