"""Levels of an identification by a recorded pre-test and the target file of a campaign."""

from __future__ import annotations

from pathlib import Path

from duralab.campaign import Campaign, PulseLevels, levels_by_pulses
from duralab.data import Rig
from duralab.errors import InputError
from duralab.recording import open_recording
from duralab.target.making import make_target


def levels_by_pre_test(recording: str | Path, *, campaign: Campaign, rig: Rig) -> PulseLevels:
    """Return levels at which the responses of an identification stay below the target of a campaign.

    Parameters
    ----------
    recording : str or Path
        Recording of the pre-test.
    campaign : Campaign
        Campaign whose target is a file.
    rig : Rig
        Rig of the campaign.

    Returns
    -------
    PulseLevels
        RMS of each drive in its unit, for a multisine that falls by 6 dB per octave from 1 Hz.

    Raises
    ------
    InputError
        The recording is not of a passed pre-test of this rig as it is now, the target comes from a road, does not fit
        the rig, or does not move in the control band.
    """
    opened = open_recording(recording)
    found = opened.pre_test
    if found is None:
        raise InputError(
            f"The recording {opened.path} holds no completed pre-test; give one of `duralab pre-test {rig.name}`.",
            field="pre_test",
        )
    again = f"make one with `duralab pre-test {rig.name}`"
    if not found.passed:
        raise InputError(f"The pre-test {found.id} did not pass; see to its findings, then {again}.", field="pre_test")
    if (found.rig, opened.rig.content_hash) != (rig.name, rig.content_hash):
        raise InputError(
            f"The pre-test {found.id} is of another rig than {rig.name!r}, or from before a change of it; {again}.",
            field="pre_test",
        )
    if campaign.target.file is None:
        raise InputError(
            "Levels by a pre-test need a target file, and the target comes from a road; give a measured file.",
            field="target",
        )
    band = campaign.control_band
    target = make_target(campaign, rig=rig, vehicle=None, play=None).signals
    return levels_by_pulses(found, rig=rig, target=target, band=(band.lowest_frequency, band.highest_frequency))
