"""A short round of every fault in a real lab; `make faults` runs many at random moments, longer ones, and a soak."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from .fault_kinds import FAULTS, SHORT, FaultKind, Place, place_for, why_not
from .lab_under_fault import Topology
from .malformed_queries import Tally, send_to_lab
from .reference import Reference, make_reference
from .rounds import perform_rounds

SEED = 7
# Moments and durations are random, but the same in every run of the tests; `make faults` takes others.
pytestmark = pytest.mark.timeout(600)


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> Reference:
    return make_reference(tmp_path_factory.mktemp("reference"), iterations=3)


@pytest.fixture(scope="module", params=list(Topology), ids=str)
def place(
    request: pytest.FixtureRequest, reference: Reference, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Place]:
    """One lab for all faults of a topology: it has to stay sound through all of them."""
    kinds = [kind for kind in FAULTS if kind.topology is request.param and not why_not(kind)]
    with place_for(kinds, reference, tmp_path_factory.mktemp("lab")) as place:
        yield place


def of(topology: Topology) -> list[FaultKind]:
    return [kind for kind in FAULTS if kind.topology is topology]


def perform(kind: FaultKind, place: Place) -> None:
    if reason := why_not(kind):
        pytest.skip(reason)
    done = perform_rounds(kind, place, rounds=1, seed=SEED, scale=SHORT, tell=lambda _outcome: None)
    assert done.findings == []
    (outcome,) = done.rounds
    assert (outcome.lost, outcome.doubled, outcome.reordered) == (0, 0, 0)
    assert outcome.recovered_seconds > 0.0


@pytest.mark.parametrize("place", [Topology.EMBEDDED], indirect=True, ids=str)
@pytest.mark.parametrize("kind", of(Topology.EMBEDDED), ids=lambda kind: kind.name.replace(" ", "_"))
def test_nothing_is_lost_where_peers_talk_directly(kind: FaultKind, place: Place) -> None:
    perform(kind, place)


@pytest.mark.parametrize("place", [Topology.ROUTED], indirect=True, ids=str)
@pytest.mark.parametrize("kind", of(Topology.ROUTED), ids=lambda kind: kind.name.replace(" ", "_"))
def test_nothing_is_lost_where_all_goes_through_a_router(kind: FaultKind, place: Place) -> None:
    perform(kind, place)


@pytest.mark.parametrize("place", [Topology.EMBEDDED], indirect=True, ids=str)
def test_malformed_queries_are_answered_and_do_nothing(place: Place) -> None:
    tallies = send_to_lab(place.lab, place.reference, seed=SEED, each=2)
    assert {service: tally.findings for service, tally in tallies.items() if tally.findings} == {}
    assert all(tally.sent > 50 for service, tally in tallies.items() if service != "lab")
    assert not any("INTERNAL" in tally.answers for tally in tallies.values())
    assert isinstance(tallies["rig"], Tally)
