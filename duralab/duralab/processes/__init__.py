"""Processes on this machine: services of a lab, the viewer, and notes of running labs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from duralab.lazy_face import lazy_face

if TYPE_CHECKING:
    from duralab.processes.lab_notes import (
        RunningLab,
        end_lab,
        noted,
        notes_folder,
        require_no_lab,
        running_labs,
        the_running_lab,
    )
    from duralab.processes.page import PAGE_PORT, OperatorPage
    from duralab.processes.service_process import import_ahead
    from duralab.processes.service_programs import (
        findings_of,
        is_recording,
        rebuilt_view,
        require_shipped,
        shipped_rigs,
    )
    from duralab.processes.supervisor import ServicePlan, Supervisor, lab_services
    from duralab.processes.viewer import GRPC_PORT, WEB_PORT, Viewer, has_display, viewer_program

__all__ = [
    "GRPC_PORT",
    "PAGE_PORT",
    "WEB_PORT",
    "OperatorPage",
    "RunningLab",
    "ServicePlan",
    "Supervisor",
    "Viewer",
    "end_lab",
    "findings_of",
    "has_display",
    "import_ahead",
    "is_recording",
    "lab_services",
    "noted",
    "notes_folder",
    "rebuilt_view",
    "require_no_lab",
    "require_shipped",
    "running_labs",
    "shipped_rigs",
    "the_running_lab",
    "viewer_program",
]

__getattr__ = lazy_face(__name__)
