"""Lab: start or join it, and use its rigs, campaigns, catalogue, state and events."""

from __future__ import annotations

from typing import TYPE_CHECKING

from duralab.lazy_face import lazy_face

if TYPE_CHECKING:
    from duralab.lab.async_lab import AsyncEnduranceTest, AsyncLab, AsyncWatch, async_connect, async_start
    from duralab.lab.campaign_result import CampaignResult
    from duralab.lab.campaign_running import expected_id, recording_file
    from duralab.lab.catalogue import Catalogue, CatalogueEntries, CatalogueEntry
    from duralab.lab.endurance import (
        EnduranceAlarm,
        EnduranceChoice,
        EnduranceHistory,
        EndurancePhase,
        EnduranceProgress,
        EnduranceTest,
        PlayedRepeat,
    )
    from duralab.lab.identifier import Identifier
    from duralab.lab.lab import Lab
    from duralab.lab.opening import DEFAULT_RIGS, FIND_SECONDS, connect, join_bus, start
    from duralab.lab.playing import read_drive_file
    from duralab.lab.progress import RunProgress, Stage
    from duralab.lab.project_result import EventResult, ProjectResult
    from duralab.lab.recorded_result import Result
    from duralab.lab.recordings_folder import RecordingsPlace
    from duralab.lab.status import SERVICES, LabStatus, ServiceHealth, lab_status
    from duralab.lab.watching import CampaignEvent, EnduranceEvent, LabEvent, RigEvent, SignalsEvent, Watch, Watched

__all__ = [
    "DEFAULT_RIGS",
    "FIND_SECONDS",
    "SERVICES",
    "AsyncEnduranceTest",
    "AsyncLab",
    "AsyncWatch",
    "CampaignEvent",
    "CampaignResult",
    "Catalogue",
    "CatalogueEntries",
    "CatalogueEntry",
    "EnduranceAlarm",
    "EnduranceChoice",
    "EnduranceEvent",
    "EnduranceHistory",
    "EndurancePhase",
    "EnduranceProgress",
    "EnduranceTest",
    "EventResult",
    "Identifier",
    "Lab",
    "LabEvent",
    "LabStatus",
    "PlayedRepeat",
    "ProjectResult",
    "RecordingsPlace",
    "Result",
    "RigEvent",
    "RunProgress",
    "ServiceHealth",
    "SignalsEvent",
    "Stage",
    "Watch",
    "Watched",
    "async_connect",
    "async_start",
    "connect",
    "expected_id",
    "join_bus",
    "lab_status",
    "read_drive_file",
    "recording_file",
    "start",
]

__getattr__ = lazy_face(__name__)
