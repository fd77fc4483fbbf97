"""The band of frequencies in which a law learns."""

from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from pkm_core.config import Config, Frequency


class Band(Config):
    """Zero-phase weight: a half cosine up from `rise_from` to `rise_to`, down from `fall_from` to `fall_to`."""

    rise_from: Annotated[Frequency, Field(ge=0)]
    rise_to: Frequency
    fall_from: Frequency
    fall_to: Frequency

    @model_validator(mode='after')
    def _is_in_order(self):
        if not self.rise_from < self.rise_to < self.fall_from < self.fall_to:
            raise ValueError('expected rise_from < rise_to < fall_from < fall_to')
        return self

    def narrowed(self, share):
        """Return the band with its fall at `share` of the frequency; itself from 1 on."""
        if share >= 1:
            return self
        return self.model_copy(update={'fall_from': share * self.fall_from, 'fall_to': share * self.fall_to})

    def weight(self, frequency):
        """Return the weight at `frequency` [Hz]; 0 at 0 Hz."""
        rise = np.clip((frequency - self.rise_from) / (self.rise_to - self.rise_from), 0, 1)
        fall = np.clip((frequency - self.fall_from) / (self.fall_to - self.fall_from), 0, 1)
        return 0.25 * (1 - np.cos(np.pi * rise)) * (1 + np.cos(np.pi * fall))
