"""Conditions for the start of a campaign: a free id, the services it needs, a rig that can play now."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from duralab_bus import Bus, FaultError, RecordingLog, already_exists
from duralab_proto.keys import LONGEST_NAME, MAIN_INSTANCE, check_id
from duralab_proto.v1 import identifier_pb2, query_pb2, recorder_pb2, rig_pb2
from iterator.campaign.recorded import RecordedCampaign, read_campaign

_DISCOVERY_SECONDS: Final = 1.5
# The name of a run begins with its campaign's id and may be as long as a name; this is the longest suffix.
_LONGEST_ID: Final = LONGEST_NAME - len(".i4294967295-999")


def require_name(check: Callable[[str], str], name: str, *, field: str) -> None:
    """Refuse a name that the contract does not allow.

    `check`: Check of the contract, which raises ValueError. `name`: As received. `field`: Field of the request that
    holds it.
    Raises `FaultError`: INVALID_ARGUMENT with the field.
    """
    try:
        check(name)
    except ValueError as error:
        raise FaultError(query_pb2.FAULT_CODE_INVALID_ARGUMENT, str(error), field=field) from error


def require_id(id: str, *, field: str = "id") -> None:
    """Refuse an id that the contract does not allow, or that leaves no room for the names of the campaign's runs.

    `id`: Id of a campaign, as received. `field`: Field of the request that holds it.
    Raises `FaultError`: INVALID_ARGUMENT with the field.
    """
    require_name(check_id, id, field=field)
    if len(id) > _LONGEST_ID:
        raise FaultError(
            query_pb2.FAULT_CODE_INVALID_ARGUMENT,
            f"The id {id[:20]!r}… has {len(id)} characters; a campaign's has at most {_LONGEST_ID}, because its runs "
            "have longer names: choose a shorter one.",
            field=field,
        )


def expect_free_id(bus: Bus, campaign: str, *, field: str = "id") -> None:
    """Refuse an id that has a recording; refuse a campaign whose services are not on the bus.

    `bus`: Bus of the identifier and the recorder. `campaign`: The id. `field`: Field of the request that holds it.
    Raises `FaultError`: ALREADY_EXISTS with the field, UNAVAILABLE for a missing service.
    """
    bus.wait_for_live({("identifier", MAIN_INSTANCE)}, _DISCOVERY_SECONDS)
    try:
        bus.query(bus.keys.recording(campaign), recorder_pb2.RecordingRequest(), recorder_pb2.RecordingInfo)
    except FaultError as fault:
        if fault.code == query_pb2.FAULT_CODE_NOT_FOUND:
            return
        raise
    raise already_exists(campaign, field=field)


def require_same_rig(model: identifier_pb2.Model, description: rig_pb2.RigDescription) -> None:
    """Refuse a rig that was changed after its identification.

    `model`: Model from the identification. `description`: Present description of the rig.
    Raises `FaultError`: FAILED_PRECONDITION with the field `rig`.
    """
    if model.rig_content_hash != description.content_hash:
        raise FaultError(
            query_pb2.FAULT_CODE_FAILED_PRECONDITION,
            f"The rig {description.rig!r} is not the one that was identified: it was changed since; start a new "
            "campaign.",
            field="rig",
        )


def read_parent(bus: Bus, recorded: RecordedCampaign) -> RecordedCampaign:
    """Read the campaign that another one was resumed from.

    `bus`: Bus of the recorder. `recorded`: The resumed campaign.
    Returns: Its parent.
    Raises `FaultError`: FAILED_PRECONDITION if the parent is missing or holds too few playbacks.
    """
    spec = recorded.spec
    try:
        parent = read_campaign(bus, spec.parent)
    except FaultError as fault:
        if fault.code not in (query_pb2.FAULT_CODE_NOT_FOUND, query_pb2.FAULT_CODE_DATA_LOSS):
            raise
        raise _no_parent(recorded, fault.message.rstrip(".")) from fault
    if parent.model is None or len(parent.iterations) < spec.parent_iteration:
        raise _no_parent(recorded, f"it holds {len(parent.iterations)}")
    return parent


def _no_parent(recorded: RecordedCampaign, why: str) -> FaultError:
    spec = recorded.spec
    return FaultError(
        query_pb2.FAULT_CODE_FAILED_PRECONDITION,
        f"Campaign {spec.id!r} takes over {spec.parent_iteration} playbacks of {spec.parent!r} and its recording holds "
        f"{len(recorded.iterations)} of them; the recording of {spec.parent!r} does not give the rest ({why}): bring "
        "it back, or start a new campaign.",
        field="id",
    )


def go_on_recording(bus: Bus, recorded: RecordedCampaign) -> None:
    """Check that the recorder can continue a recording; close the recording if only that is missing.

    `bus`: Bus of the recorder. `recorded`: A recording that is not closed.
    Raises `FaultError`: FAILED_PRECONDITION if the recorder cannot continue it because a file of it is damaged.
    """
    log = RecordingLog(bus, recorded.spec.id, next_step=recorded.steps)
    try:
        log.confirm(recorded.last)
    except FaultError as fault:
        if fault.code not in (query_pb2.FAULT_CODE_ALREADY_EXISTS, query_pb2.FAULT_CODE_FAILED_PRECONDITION):
            raise
        raise FaultError(
            query_pb2.FAULT_CODE_FAILED_PRECONDITION,
            f"The recorder cannot continue the recording of campaign {recorded.spec.id!r} "
            f"({fault.message.rstrip('.')}); name a new_id to resume the campaign under.",
            field="new_id",
        ) from fault
    if recorded.final is not None:
        log.commit(recorder_pb2.RecordingClosed(reason=recorded.final.activity))
