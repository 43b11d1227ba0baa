"""What a channel's reading adds to the signal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.data.recording import condition

MOST = 0.9  # correlation from sample to sample; what is more is a signal
MORE = (
    1.5  # times the stated noise from which what was estimated is a signal in part, and its colour is not the noise's
)


@dataclass(frozen=True)
class ChannelNoise:
    """sigma: 1 sigma in all, rounding included; colour: correlation from sample to sample, first order; step: of the
    converter, whose rounding is white."""

    sigma: float
    colour: float = 0.0
    step: float = 0.0

    @property
    def white(self) -> float:
        """Variance of the part that is new in every sample."""
        return self.sigma**2 if self.colour == 0 else min(self.step**2 / 12, 0.5 * self.sigma**2)

    @property
    def coloured(self) -> float:
        """Variance of the other part."""
        return self.sigma**2 - self.white if self.colour else 0.0

    @property
    def rho(self) -> float:
        """Correlation of the coloured part from sample to sample."""
        return float(np.clip(self.colour * self.sigma**2 / self.coloured, 0.0, 0.99)) if self.coloured else 0.0


def noise_of(campaign: Campaign) -> dict[str, ChannelNoise]:
    """Per compared channel: what campaign.toml states is believed, the rest is estimated from the recordings."""
    found = {}
    for name, quality in condition(campaign.recordings).items():
        logged = campaign.logged.get(name)
        step = logged.step if logged and logged.step is not None else quality.step
        sigma, colour = quality.sigma(), min(quality.colour, MOST) if quality.noise > 0 else 0.0
        if logged and logged.noise is not None:
            sigma = float(np.hypot(logged.noise, step / np.sqrt(12)))
            colour = colour if quality.noise < MORE * sigma else 0.0
        if logged and logged.colour is not None:
            colour = logged.colour
        found[name] = ChannelNoise(sigma, colour, step)
    return found


Noises = Mapping[str, ChannelNoise]
