"""ObjectFolder 1.0's VisionNet: two scattering networks, and rendering by marching along rays.

Published (papers, and the authors' public inference code): the networks (`scattering_network`); one ray
through the middle of a pixel, from 0.01 to 4 for cameras at 2.5; 64 even samples for the coarse network; 128
more by inverting the cumulative distribution of their weights, and all 192 for the fine one; the last
interval is endless; the background is white. The light that enters a point is (1, 1, 1): what is lost on the
way to it, through shadow or distance, is in the scattering function, and light is marched through *other*
objects only, of which there are none here. The light's input is its position, one for the whole ray, not its
direction from each sample. (The code's rays pass through a pixel's corner, the paper's through its middle.)

Left open and decided here: colours are those of an 8-bit image, sRGB on white; transmittance is the stable
form of `ray_marching`, which differs from the published one by rounding; cameras elsewhere keep the far end
1.5 behind the centre.
"""

import numpy as np
import torch
from torch import Tensor

from bench.rivals.published import Training
from bench.rivals.vision.ray_marching import evenly_spaced, refined, weights
from bench.rivals.vision.scattering_network import ScatteringNetwork
from objectfolder.vision.cameras import pixel_rays
from objectfolder.vision.compositing import srgb_decode

COARSE_SAMPLES, FINE_SAMPLES = 64, 128
NEAR, BEHIND_CENTRE = 0.01, 1.5
ENDLESS = 1e10
# Rays marched at once; 192 samples of 256 numbers each make 50 MB a layer.
CHUNK = 256


def march(
    network: ScatteringNetwork,
    origins: Tensor,
    directions: Tensor,
    lights: Tensor,
    distances: Tensor,
    density_noise: Tensor | None = None,
) -> tuple[Tensor, Tensor]:
    """Return the colour (n, 3) of rays on black, and the share (n, samples) of each sample in it.

    Parameters
    ----------
    network
        Coarse or fine.
    origins, directions, lights
        (n, 3) unit frame.
    distances
        (n, samples) ascending.
    density_noise
        (n, samples) added to densities before their ReLU.
    """
    points = origins[:, None] + directions[:, None] * distances[..., None]
    density, colour = network(points, directions, lights)
    if density_noise is not None:
        density = density + density_noise
    lengths = torch.cat(
        [distances[:, 1:] - distances[:, :-1], torch.full_like(distances[:, :1], ENDLESS)], dim=-1
    )
    shares = weights(torch.relu(density) * lengths)
    return (shares[..., None] * colour).sum(dim=1), shares


class ScatteringFunction:
    """A fitted pair of networks.

    Parameters
    ----------
    coarse, fine
        Networks, on one device.
    camera_radius
        Of the views fitted to, unit frame.
    training
        What the fit did; None where it is not known.
    """

    def __init__(
        self,
        coarse: ScatteringNetwork,
        fine: ScatteringNetwork,
        camera_radius: float,
        training: Training | None = None,
    ) -> None:
        self.coarse, self.fine = coarse, fine
        self.camera_radius = camera_radius
        self.training = training

    @property
    def parameters(self) -> int:
        """Weights and biases of both networks."""
        return sum(value.numel() for net in (self.coarse, self.fine) for value in net.parameters())

    @property
    def bytes(self) -> int:
        """Stored in single precision, as released."""
        return 4 * self.parameters

    def pixels(
        self,
        camera_to_world: np.ndarray,
        light_position: np.ndarray,
        pixels: np.ndarray,
        resolution: int | tuple[int, int],
        field_of_view_deg: float,
    ) -> np.ndarray:
        """Return pixels (n, 4) of a view by 192 samples along one ray each.

        Parameters
        ----------
        camera_to_world, light_position
            (4, 4) pose, and (3,) position of the point light, unit frame.
        pixels
            (n,) flat indices.
        resolution, field_of_view_deg
            Pixels a side or (height, width), and the angle over the longer side.

        Returns
        -------
        np.ndarray
            (n, 4) float32 scene-linear premultiplied RGBA, whose composite on white is the networks' colour.
        """
        origins, directions = pixel_rays(
            camera_to_world, pixels, np.array([[0.5, 0.5]]), resolution, field_of_view_deg
        )
        lights = np.broadcast_to(np.asarray(light_position, dtype=np.float64), directions.shape)
        return self.radiance(origins, directions, lights)

    def radiance(self, origins: np.ndarray, directions: np.ndarray, lights: np.ndarray) -> np.ndarray:
        """Return (n, 4) float32 scene-linear premultiplied RGBA along rays with their lights, (n, 3) each."""
        device = next(self.fine.parameters()).device
        far = self.camera_radius + BEHIND_CENTRE
        rgba = np.zeros((len(directions), 4), dtype=np.float32)
        for start in range(0, len(directions), CHUNK):
            part = slice(start, start + CHUNK)
            starts, towards, light = (
                torch.tensor(np.ascontiguousarray(values[part]), dtype=torch.float32, device=device)
                for values in (origins, directions, lights)
            )
            count = len(starts)
            with torch.inference_mode():
                distances = evenly_spaced(NEAR, far, count, COARSE_SAMPLES, device)
                _, shares = march(self.coarse, starts, towards, light, distances)
                fixed = torch.linspace(0.0, 1.0, FINE_SAMPLES, device=device).expand(count, -1)
                distances = refined(distances, shares, fixed)
                colour, shares = march(self.fine, starts, towards, light, distances)
            rgba[part] = _premultiplied(colour.cpu().numpy(), shares.sum(dim=1).cpu().numpy())
        return rgba


def _premultiplied(colour: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Scene-linear RGBA (n, 4) of encoded colours (n, 3) on black with their opacities (n,)."""
    alpha = np.clip(alpha, 0.0, 1.0)[:, None]
    straight = np.divide(colour, alpha, out=np.zeros_like(colour), where=alpha > 0)
    return np.concatenate([alpha * srgb_decode(straight), alpha], axis=1)
