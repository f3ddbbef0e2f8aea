"""From light to counts: electrons of each pixel, the noise of their detection, and what the converter makes of them.

    electrons = light of the surface for the time of the exposure + dark current
    counts = round((Poisson(electrons) cut at the full well + read noise) / gain + bias), cut at the converter's ends

The lens spreads light by a Gaussian before that, see `ShadedBody.draw_spread`. Cosmic rays, stray light, stars and the
nonlinearity near the full well are left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarm_mj.observation.radiometry import electrons
from swarm_mj.scenarios.schema_imaging import Camera
from swarm_mj.typing import Array, Array32

#: Share of the pixels of the body that automatic exposure lets become brighter than it aims at.
BRIGHTEST = 1e-3
#: A full pixel may read less by so many sigmas of the read noise.
FULL_SIGMAS = 3.0


@dataclass(frozen=True, eq=False)
class Exposed:
    """A picture as it is read out.

    Attributes:
        counts: Of each pixel [DN], shape (height, width).
        exposure_s: How long it was exposed [s].
        gain: Electrons per count.
        bias: Count without light [DN].
        dark_e: Mean dark electrons of a pixel.
        read_noise_e: Electrons rms.
        full_scale: Count at which a pixel is full [DN].
        electrons_per_factor: Electrons of a radiance factor of 1.
    """

    counts: NDArray[np.uint16]
    exposure_s: float
    gain: float
    bias: float
    dark_e: float
    read_noise_e: float
    full_scale: float
    electrons_per_factor: float

    @property
    def signal(self) -> Array:
        """Electrons of each pixel above bias and mean dark current, shape (height, width)."""
        return (self.counts.astype(np.float64) - self.bias) * self.gain - self.dark_e

    @property
    def background_variance(self) -> float:
        """Of a pixel without light [electrons^2]: read noise, dark current and quantisation."""
        return self.read_noise_e**2 + self.dark_e + self.gain**2 / 12.0

    @property
    def variance(self) -> Array:
        """Of each pixel, as its own count tells it [electrons^2], same shape."""
        return np.maximum(self.signal, 0.0) + self.background_variance

    @property
    def saturated(self) -> NDArray[np.bool_]:
        """Pixels that are full, but for what reading them out errs by, same shape."""
        return self.counts >= self.full_scale - FULL_SIGMAS * self.read_noise_e / self.gain


class DetectorModel:
    """Exposes pictures.

    Args:
        camera: Lens, band, quantum efficiency, read noise, exposure and detector.
        pixel_angle: Width of a pixel at unit distance [rad].
        shape: Rows and columns of its pictures.
        seed: Of its hot pixels, which stay where they are.
    """

    def __init__(self, camera: Camera, pixel_angle: float, shape: tuple[int, int], seed: int = 0) -> None:
        self.camera, self.detector, self.pixel_angle = camera, camera.detector, pixel_angle
        rng, given = np.random.default_rng([seed, 0x686F74]), camera.detector
        count = int(rng.binomial(shape[0] * shape[1], given.hot_share))
        self._hot = rng.choice(shape[0] * shape[1], count, replace=False)
        self._hot_e_s = rng.exponential(given.hot_e_s, count)

    @property
    def gain(self) -> float:
        """Electrons per count."""
        return self.detector.full_well_e / (2**self.detector.bits - 1 - self.detector.bias_dn)

    def rate(self, sun_distance_m: float) -> float:
        """Electrons per second of a radiance factor of 1."""
        one = self.camera.model_copy(update={"exposure_s": 1.0})
        return float(electrons(one, self.pixel_angle, np.ones(1), sun_distance_m)[0])

    def exposure(self, factor: Array32, sun_distance_m: float) -> float:
        """Exposure [s]: the camera's own, or the one by which the brightest pixels fill a share of the full well."""
        if self.camera.exposure_s:
            return self.camera.exposure_s
        shortest, longest = self.detector.exposure_range_s
        light = factor[factor > 0.0]
        if not len(light):
            return longest
        bright = float(np.quantile(light, 1.0 - BRIGHTEST)) * self.rate(sun_distance_m)
        return float(np.clip(self.detector.exposure_share * self.detector.full_well_e / bright, shortest, longest))

    def expose(
        self,
        factor: Array32,
        sun_distance_m: float,
        rng: np.random.Generator | None,
        exposure_s: float | None = None,
    ) -> Exposed:
        """Expose a picture.

        Args:
            factor: Radiance factors averaged over each pixel and the exposure, as the lens spreads them, shape (height, width).
            sun_distance_m: Of the body from the Sun [m].
            rng: Draws the noise; None: there is none.
            exposure_s: How long [s]; None: see `exposure`.
        """
        given, light = self.detector, factor
        seconds = self.exposure(light, sun_distance_m) if exposure_s is None else exposure_s
        per_factor = self.rate(sun_distance_m) * seconds
        mean = light.astype(np.float64) * per_factor + given.dark_e_s * seconds
        mean.ravel()[self._hot] += self._hot_e_s * seconds
        full, read = given.full_well_e, self.camera.read_noise
        held = mean if rng is None else rng.poisson(np.minimum(mean, 4.0 * full)).astype(np.float64)
        held = np.minimum(held, full)
        if rng is not None and read > 0.0:
            held += rng.normal(0.0, read, held.shape)
        top = 2**given.bits - 1
        counts = np.clip(np.rint(held / self.gain + given.bias_dn), 0, top).astype(np.uint16)
        return Exposed(
            counts, seconds, self.gain, given.bias_dn, given.dark_e_s * seconds, read, float(top), per_factor
        )
