"""Duralab: start or join a durability test lab, play its rigs, run campaigns, read recordings, write reports.

Each name is imported at its first use, so that `import duralab` is fast.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from duralab.lazy_face import lazy_face

if TYPE_CHECKING:
    from duralab.analysis import ChannelComparison, ComparedRecording, Comparison, compare
    from duralab.campaign import (
        Campaign,
        EstimatorSettings,
        ExcitationSettings,
        Judgement,
        Verdict,
        load_campaign,
        shipped_campaigns,
    )
    from duralab.data import (
        ActuatorUse,
        Channel,
        Convergence,
        Decided,
        ExperimentPlan,
        IterationTable,
        LevelAdvice,
        LevelSeries,
        Model,
        ModelDifference,
        Playback,
        Played,
        PreTest,
        PreTestFinding,
        Proposal,
        Rig,
        RigMode,
        Rigs,
        RigState,
        Signals,
    )
    from duralab.display import to_html
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
    from duralab.lab import (
        AsyncEnduranceTest,
        AsyncLab,
        AsyncWatch,
        CampaignEvent,
        CampaignResult,
        Catalogue,
        CatalogueEntries,
        CatalogueEntry,
        EnduranceChoice,
        EnduranceEvent,
        EndurancePhase,
        EnduranceProgress,
        EnduranceTest,
        Identifier,
        Lab,
        LabEvent,
        Result,
        RigEvent,
        RunProgress,
        SignalsEvent,
        Stage,
        Watch,
        Watched,
        async_connect,
        async_start,
        connect,
        start,
    )
    from duralab.recording import Recording, open_recording
    from duralab.report import write_comparison, write_pdf, write_report
    from duralab.schedule import ScheduleForecast, design_schedule, forecast_schedule, load_schedule

__all__ = [
    "ActuatorUse",
    "AsyncEnduranceTest",
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
    "Decided",
    "EnduranceChoice",
    "EnduranceEvent",
    "EndurancePhase",
    "EnduranceProgress",
    "EnduranceTest",
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
    "PreTest",
    "PreTestFinding",
    "Proposal",
    "Recording",
    "Result",
    "Rig",
    "RigEvent",
    "RigMode",
    "RigState",
    "Rigs",
    "RunProgress",
    "ScheduleForecast",
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
    "design_schedule",
    "forecast_schedule",
    "load_campaign",
    "load_schedule",
    "open_recording",
    "shipped_campaigns",
    "start",
    "to_html",
    "write_comparison",
    "write_pdf",
    "write_report",
]

_public = lazy_face(__name__)


def __getattr__(name: str) -> object:
    """Import a public name at its first use; `duralab.open` is `open_recording`, which `import *` does not import."""
    return _public("open_recording" if name == "open" else name)


def __dir__() -> list[str]:
    """Return the public names."""
    return list(__all__)
