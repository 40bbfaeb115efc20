"""Effect of decisions at hold points on a campaign's specification."""

from __future__ import annotations

from collections.abc import Iterable

from duralab_proto.v1 import iterator_pb2


def decisions_in_force(
    decisions: Iterable[iterator_pb2.Decision], proposals: Iterable[iterator_pb2.Proposal]
) -> list[iterator_pb2.Decision]:
    """Return the valid decisions, without those on a proposal that was replaced after a crash.

    Parameters
    ----------
    decisions : iterable of Decision
        Decisions of a recording, in its order.
    proposals : iterable of Proposal
        All proposals of that recording.

    Returns
    -------
    list of Decision
        Valid decisions in the same order.
    """
    replaced = [range(proposal.replaces, proposal.number) for proposal in proposals if proposal.replaces]
    return [decision for decision in decisions if not any(decision.proposal in numbers for numbers in replaced)]


def revised_specification(
    specification: iterator_pb2.CampaignSpec, *decisions: iterator_pb2.Decision
) -> iterator_pb2.CampaignSpec:
    """Return the specification of a campaign after decisions.

    Parameters
    ----------
    specification : CampaignSpec
        Specification before the decisions; not changed.
    *decisions : Decision
        Decisions in their order; those without changed settings have no effect.

    Returns
    -------
    CampaignSpec
        Copy with the update, the control band and the campaign file of the last decisions that give them.
    """
    revised = iterator_pb2.CampaignSpec()
    revised.CopyFrom(specification)
    for decision in decisions:
        if decision.HasField("update"):
            revised.update.CopyFrom(decision.update)
        if decision.HasField("control_band"):
            for field in decision.control_band.DESCRIPTOR.fields:
                setattr(revised, field.name, getattr(decision.control_band, field.name))
        revised.scenario = decision.scenario or revised.scenario
    return revised
