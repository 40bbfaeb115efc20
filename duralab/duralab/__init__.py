"""Duralab: start or join a durability test lab, play its rigs, run campaigns, read recordings, write reports.

Everything is imported when it is first used, so that `import duralab` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from duralab._following import RunProgress, Stage
    from duralab.async_lab import AsyncLab, AsyncWatch, async_connect, async_start
    from duralab.campaign_file import Campaign
    from duralab.campaign_loading import load_campaign, shipped_campaigns
    from duralab.campaign_result import CampaignResult
    from duralab.catalogue import Catalogue, CatalogueEntries, CatalogueEntry
    from duralab.comparison import ChannelComparison, ComparedRecording, Comparison, compare
    from duralab.errors import (
        BusyError,
        CampaignFaultError,
        InputError,
        LabError,
        LabTimeoutError,
        NotReadyError,
        ServiceEndedError,
        StoppedError,
        UnavailableError,
    )
    from duralab.identification import Identifier
    from duralab.identification_results import (
        Convergence,
        ExperimentPlan,
        LevelAdvice,
        LevelSeries,
        ModelDifference,
    )
    from duralab.identification_section import EstimatorSettings, ExcitationSettings
    from duralab.iteration_table import IterationTable
    from duralab.lab import Lab
    from duralab.lab_opening import connect, start
    from duralab.played import Played
    from duralab.recorded_result import Result
    from duralab.recording import Recording, open_recording
    from duralab.recording_content import ActuatorUse, Model, Playback
    from duralab.report import write_comparison, write_pdf, write_report
    from duralab.rig import Rig, Rigs
    from duralab.rig_state import RigMode, RigState
    from duralab.showing.page import to_html
    from duralab.signals import Channel, Signals
    from duralab.verdict import Judgement, Verdict
    from duralab.watching import CampaignEvent, LabEvent, RigEvent, SignalsEvent, Watch, Watched

_MODULES = {
    "duralab._following": ("RunProgress", "Stage"),
    "duralab.campaign_file": ("Campaign",),
    "duralab.campaign_loading": ("load_campaign", "shipped_campaigns"),
    "duralab.campaign_result": ("CampaignResult",),
    "duralab.catalogue": ("Catalogue", "CatalogueEntries", "CatalogueEntry"),
    "duralab.comparison": ("ChannelComparison", "ComparedRecording", "Comparison", "compare"),
    "duralab.errors": (
        "BusyError",
        "CampaignFaultError",
        "InputError",
        "LabError",
        "LabTimeoutError",
        "NotReadyError",
        "ServiceEndedError",
        "StoppedError",
        "UnavailableError",
    ),
    "duralab.identification": ("Identifier",),
    "duralab.identification_results": (
        "Convergence",
        "ExperimentPlan",
        "LevelAdvice",
        "LevelSeries",
        "ModelDifference",
    ),
    "duralab.identification_section": ("EstimatorSettings", "ExcitationSettings"),
    "duralab.iteration_table": ("IterationTable",),
    "duralab.lab": ("Lab",),
    "duralab.lab_opening": ("connect", "start"),
    "duralab.played": ("Played",),
    "duralab.recording": ("Recording", "open_recording"),
    "duralab.recording_content": ("ActuatorUse", "Model", "Playback"),
    "duralab.report": ("write_comparison", "write_pdf", "write_report"),
    "duralab.recorded_result": ("Result",),
    "duralab.rig": ("Rig", "Rigs"),
    "duralab.showing.page": ("to_html",),
    "duralab.signals": ("Channel", "Signals"),
    "duralab.verdict": ("Judgement", "Verdict"),
    "duralab.async_lab": ("AsyncLab", "AsyncWatch", "async_connect", "async_start"),
    "duralab.rig_state": ("RigMode", "RigState"),
    "duralab.watching": ("CampaignEvent", "LabEvent", "RigEvent", "SignalsEvent", "Watch", "Watched"),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}

__all__ = [
    "ActuatorUse",
    "AsyncLab",
    "AsyncWatch",
    "BusyError",
    "Campaign",
    "CampaignEvent",
    "CampaignFaultError",
    "CampaignResult",
    "Catalogue",
    "CatalogueEntries",
    "CatalogueEntry",
    "Channel",
    "ChannelComparison",
    "ComparedRecording",
    "Comparison",
    "Convergence",
    "EstimatorSettings",
    "ExcitationSettings",
    "ExperimentPlan",
    "Identifier",
    "InputError",
    "IterationTable",
    "Judgement",
    "Lab",
    "LabError",
    "LabEvent",
    "LabTimeoutError",
    "LevelAdvice",
    "LevelSeries",
    "Model",
    "ModelDifference",
    "NotReadyError",
    "Playback",
    "Played",
    "Recording",
    "Result",
    "Rig",
    "RigEvent",
    "RigMode",
    "RigState",
    "Rigs",
    "RunProgress",
    "ServiceEndedError",
    "Signals",
    "SignalsEvent",
    "Stage",
    "StoppedError",
    "UnavailableError",
    "Verdict",
    "Watch",
    "Watched",
    "async_connect",
    "async_start",
    "compare",
    "connect",
    "load_campaign",
    "open_recording",
    "shipped_campaigns",
    "start",
    "to_html",
    "write_comparison",
    "write_pdf",
    "write_report",
]


def __getattr__(name: str) -> object:
    """Import what is asked for; `duralab.open` is `open_recording`, and not one of those that `import *` takes."""
    if name == "open":
        return __getattr__("open_recording")
    module = _MODULE_OF.get(name)
    if module is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(module), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the public names."""
    return list(__all__)
