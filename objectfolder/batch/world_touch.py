"""Touch sensors of many simulated worlds: poses of bodies in, image tensors out, updated in place.

The fields are those of Isaac Lab's tactile sensors, where those of forces may be None, too. Poses are
positions and rotation matrices in world frames, as MuJoCo's ``xpos`` and ``xmat`` and their batches have
them. Positions are subtracted in double precision: an object far from its world's origin is felt as one at
it, as far as its pose is given. An array of Warp comes in by ``wp.to_torch``, without a copy.
"""

from objectfolder.batch.resident import numbers, object_indices
from objectfolder.batch.targets import Tensor, torch
from objectfolder.batch.touch import TouchBatch, TouchImages


class WorldTouch:
    """n sensors, each at one object.

    Parameters
    ----------
    touch
        Objects and sensor on a device.
    objects
        (n,) the object that each sensor may touch.

    Attributes
    ----------
    tactile_rgb_image : (n, height, width, 3) uint8
    tactile_depth_image : (n, height, width, 1) float32, metres in the gel
    penetration_depth : (n, 1) float64, metres, of one point: the deepest of the gel
    tactile_points_pos_w, tactile_points_quat_w, tactile_normal_force, tactile_shear_force : None

    Examples
    --------
    >>> import objectfolder, torch
    >>> from objectfolder.batch import Batch, WorldTouch
    >>> bar = objectfolder.load("bar.safetensors")
    >>> fingers = WorldTouch(Batch([bar], "cpu").touch, torch.zeros(2, dtype=torch.int64))
    >>> turn = torch.eye(3).repeat(2, 1, 1)
    >>> fingers.update(torch.tensor([[0.0, 0, 0], [1, 0, 0]]), turn, torch.zeros(2, 3), turn)
    >>> fingers.penetration_depth.gt(0).tolist()  # the second is a metre away
    [[True], [False]]
    """

    tactile_points_pos_w = tactile_points_quat_w = tactile_normal_force = tactile_shear_force = None

    def __init__(self, touch: TouchBatch, objects: object) -> None:
        self._touch = touch
        count = len(objects)  # type: ignore[arg-type]
        self._objects = object_indices(objects, count, touch.count, touch.device)
        self._images = TouchImages.empty(count, touch.sensor, touch.device)
        self.penetration_depth = torch.zeros((count, 1), dtype=torch.float64, device=touch.device)
        self.tactile_rgb_image = self._images.rgb
        self.tactile_depth_image = self._images.depth_m[..., None]

    def update(
        self,
        sensor_position: Tensor,
        sensor_rotation: Tensor,
        object_position: Tensor,
        object_rotation: Tensor,
    ) -> None:
        """Feel the objects at new poses.

        Parameters
        ----------
        sensor_position, object_position
            (n, 3) world frame, metres; or (worlds, bodies, 3), of n in all.
        sensor_rotation, object_rotation
            (n, 3, 3), or as many in worlds: columns the axes of the sensor (see `Sensor`) and of the object.
        """
        count, device = len(self._objects), self._touch.device

        def grouped(name: str, values: Tensor, *shape: int) -> Tensor:
            return numbers(name, values.reshape(-1, *shape), (count, *shape), device)

        turn = grouped("object_rotation", object_rotation, 3, 3).transpose(1, 2)
        sensor = grouped("sensor_rotation", sensor_rotation, 3, 3)
        place = grouped("sensor_position", sensor_position, 3)
        apart = place - grouped("object_position", object_position, 3)
        poses = torch.zeros((count, 4, 4), dtype=torch.float64, device=device)
        poses[:, :3, :3] = turn @ sensor
        poses[:, :3, 3] = (turn @ apart[:, :, None])[:, :, 0]
        poses[:, 3, 3] = 1.0
        self._touch.see(self._objects, poses, out=self._images)
        self.penetration_depth[:, 0] = self._touch.penetrations(self._objects, poses)
