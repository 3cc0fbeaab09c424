"""Gymnasium's environments of an object that is seen, heard and felt; importing this registers them.

gymnasium.make("objectfolder/Squeeze-v0", file=objectfolder.load("mug.safetensors"))
"""

from typing import Any

import numpy as np

from objectfolder import example
from objectfolder.errors import QueryError
from objectfolder.live.contacts import finite_pose
from objectfolder.live.gripper import FINGERS, gripper
from objectfolder.live.mujoco_simulation import MujocoSimulation
from objectfolder.live.sound import BLOCK_SAMPLES, LiveSound
from objectfolder.live.touch import Finger, LiveTouch
from objectfolder.object_file import ObjectFile
from objectfolder.query_values import whole
from objectfolder.vision.cameras import look_at

try:
    import gymnasium
    from gymnasium.spaces import Box, Dict
except ImportError as error:
    raise QueryError("gymnasium", "is not installed", "pip install gymnasium") from error

BLOCKS, LONGEST_STEPS = 2, 200  # 23 ms a step
GREATEST_FORCE_N, LIFTING_M_S = 10.0, 0.1
LIFTED_M, LOUDEST_PA, FRICTION = 0.03, 200.0, 0.8
AWAY_M, VIEW = 0.002, np.array([1.6, -1.6, 1.2])  # of where the object stands; of the camera, in its scale


class Squeeze(gymnasium.Env[dict[str, np.ndarray], np.ndarray]):
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

    Raises
    ------
    QueryError
        A number of pixels out of range.

    Examples
    --------
    >>> import gymnasium
    >>> import objectfolder.live.environments
    >>> squeeze = gymnasium.make("objectfolder/Squeeze-v0")
    >>> observation, _ = squeeze.reset(seed=0)
    >>> observation, reward, *_ = squeeze.step(squeeze.action_space.sample())
    >>> observation["touch"].shape, observation["audio"].shape
    ((2, 160, 120, 3), (1024,))
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 43}  # noqa: RUF012  (gymnasium declares it so)

    def __init__(
        self, file: ObjectFile | None = None, pixels: int = 64, render_mode: str | None = None
    ) -> None:
        import mujoco

        self._engine, self.render_mode = mujoco, render_mode
        self._file = example("mug") if file is None else file
        self._model = gripper(self._file, FRICTION)
        self._data = mujoco.MjData(self._model)
        self._simulation = MujocoSimulation(self._model, self._data)
        fingers = {name: Finger(friction=FRICTION) for name in FINGERS}
        self._touch = LiveTouch(self._simulation, {"object": self._file}, fingers)
        low, high = self._file.surface.bounds
        centre = (low + high) / 2 - low * [0, 0, 1]
        self._camera = look_at(centre + VIEW * self._file.frame.scale, centre)[0]
        side, sensor = whole("pixels", pixels, 8, 2048), Finger().sensor
        gels = (len(FINGERS), sensor.image_height, sensor.image_width, 3)
        self.action_space = Box(-1.0, 1.0, (2,), np.float32)
        self.observation_space: gymnasium.Space[Any] = Dict(
            image=Box(0, 255, (side, side, 3), np.uint8),
            audio=Box(-LOUDEST_PA, LOUDEST_PA, (BLOCKS * BLOCK_SAMPLES,), np.float32),
            touch=Box(0, 255, gels, np.uint8),
            proprioception=Box(-1e3, 1e3, (4 * len(FINGERS),), np.float32),
        )
        self._side = side

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Stand the object up to 2 mm from its place, the fingers open."""
        super().reset(seed=seed)
        self._engine.mj_resetData(self._model, self._data)
        body = self._data.body("object").id
        place = self._model.jnt_qposadr[self._model.body_jntadr[body]]
        self._data.qpos[place : place + 2] += self.np_random.uniform(-AWAY_M, AWAY_M, 2)
        self._engine.mj_forward(self._model, self._data)
        seed_of_sound = int(self.np_random.integers(2**31))
        self._sound = LiveSound(self._simulation, {"object": self._file}, seed=seed_of_sound)
        self._start = self._risen()
        return self._observed(np.zeros(BLOCKS * BLOCK_SAMPLES)), {}

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Run the world for two blocks of sound."""
        squeeze, lift = np.clip(np.asarray(action, dtype=np.float64), -1.0, 1.0)
        force, speed = GREATEST_FORCE_N * (1 + squeeze) / 2, LIFTING_M_S * lift
        self._data.ctrl[:] = [force, force, speed, speed]
        before, sound = self._risen(), np.concatenate([self._sound.block() for _ in range(BLOCKS)])
        risen = self._risen()
        reward, done = (risen - before) / LIFTED_M, risen - self._start >= LIFTED_M
        return self._observed(sound), float(reward), bool(done), False, {}

    def render(self) -> np.ndarray | None:
        """Return the image (pixels, pixels, 3) uint8, or None without a mode."""
        return self._image() if self.render_mode == "rgb_array" else None

    def _risen(self) -> float:
        return float(finite_pose(self._simulation, "object")[2, 3])

    def _image(self) -> np.ndarray:
        """The object, seen by a camera that stands in the world and carries the lamp."""
        camera = np.linalg.inv(finite_pose(self._simulation, "object")) @ self._camera
        lamp = camera[:3, 3] / 2 + camera[:3, 1] * self._file.frame.scale / 2
        return np.asarray(self._file.render(camera, lamp, self._side, sub_rays=8)[0])

    def _observed(self, sound: np.ndarray) -> dict[str, np.ndarray]:
        felt = self._touch.feel()
        borne = [[felt[name].normal_n, felt[name].tangential_n] for name in FINGERS]
        moved = [[self._data.joint(f"{name}_{way}").qpos[0] for way in ("close", "lift")] for name in FINGERS]
        return {
            "image": self._image(),
            "audio": np.clip(sound, -LOUDEST_PA, LOUDEST_PA).astype(np.float32),
            "touch": np.stack([felt[name].image.rgb for name in FINGERS]),
            "proprioception": np.hstack([moved, borne]).ravel().astype(np.float32),
        }


gymnasium.register("objectfolder/Squeeze-v0", f"{__name__}:Squeeze", max_episode_steps=LONGEST_STEPS)
