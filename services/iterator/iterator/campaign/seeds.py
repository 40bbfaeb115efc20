"""Seeds of a campaign, all derived from the seed in its specification."""

from __future__ import annotations

from typing import Final

import numpy as np

EXCITATION: Final = 0
"""Index of the identification's excitation."""

IDENTIFICATION_PLAYBACK: Final = 1
"""Index of the rig's random processes during the identification's playback."""

EXCITATION_AT_TARGET: Final = 1 << 33
"""Index of the excitation of the experiment at the target."""

PLAYBACK_AT_TARGET: Final = (1 << 33) + 1
"""Index of the rig's random processes during the experiment at the target."""

_CONFIRMATIONS: Final = 1 << 32


def confirmation(number: int) -> int:
    """Return the index of the rig's random processes in a confirmation: 2^32 + its number."""
    return _CONFIRMATIONS + number


def playback(iteration: int) -> int:
    """Return the index of the rig's random processes in an iteration's playback: 2 for the first, 3 for the second."""
    return IDENTIFICATION_PLAYBACK + iteration


def derived_seed(campaign_seed: int, index: int) -> int:
    """Return the seed of one part of a campaign: the first 64 bits of `numpy.random.SeedSequence([seed, index])`."""
    return int(np.random.SeedSequence([campaign_seed, index]).generate_state(1, np.uint64)[0])
