"""Key space: functions that make and parse every key of the contract as strings.

All keys begin with `duralab/v1/<lab>/`. A method given "*" for a name returns a key expression that matches every
name; user-chosen names are checked here, so that none of them can reach another part of the key space.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

PREFIX: Final = "duralab/v1"
"""First chunks of every key: the project and the version of the contract."""

ANY: Final = "*"
"""Wildcard for any one name in a key expression."""

ANY_DEPTH: Final = "**"
"""Wildcard for any number of chunks in a key expression."""

LONGEST_NAME: Final = 120
"""Largest number of characters of a name; names become parts of file names."""

_LAB = re.compile(r"[a-z0-9_-]+")
_RIG = re.compile(r"[a-z0-9][a-z0-9_]*")
_IDENTIFIER = re.compile(r"[a-z0-9][a-z0-9_-]*")
_RUN = re.compile(r"[a-z0-9][a-z0-9_.-]*")

_RIG_RULE = "lower case letters, digits and '_', starting with a letter or digit"
_IDENTIFIER_RULE = "lower case letters, digits, '-' and '_', starting with a letter or digit"
_RUN_RULE = "lower case letters, digits, '-', '_' and '.', starting with a letter or digit"

MAIN_INSTANCE: Final = "main"
"""Instance name of every service of which a lab has one."""

_RESERVED_IDENTIFIERS: Final = frozenset({"start", "list"})


class KeyNameError(ValueError):
    """A name is not allowed in a key, or a key does not name such an object; the message is one sentence."""


def _check(name: str, pattern: re.Pattern[str], *, what: str, rule: str) -> str:
    if len(name) > LONGEST_NAME:
        raise KeyNameError(f"The {what} {name[:20]!r}… has {len(name)} characters; at most {LONGEST_NAME} are allowed.")
    if pattern.fullmatch(name) is None:
        raise KeyNameError(f"The {what} {name!r} is not a name of {rule}.")
    return name


def check_rig(name: str) -> str:
    """Return `name` if it may name a rig, else raise ValueError with one sentence."""
    return _check(name, _RIG, what="rig", rule=_RIG_RULE)


def check_run(name: str) -> str:
    """Return `name` if it may name a playback, else raise ValueError with one sentence."""
    return _check(name, _RUN, what="run", rule=_RUN_RULE)


def check_id(name: str) -> str:
    """Return `name` if it may name a campaign, recording or model, else raise ValueError with one sentence."""
    if name in _RESERVED_IDENTIFIERS:
        raise KeyNameError(f"The id {name!r} is taken by the contract itself; choose another.")
    return _check(name, _IDENTIFIER, what="id", rule=_IDENTIFIER_RULE)


def check_project(name: str) -> str:
    """Return `name` if it may name a project, else raise ValueError with one sentence."""
    if name in _RESERVED_IDENTIFIERS:
        raise KeyNameError(f"The project {name!r} is taken by the contract itself; choose another.")
    return _check(name, _RIG, what="project", rule=_RIG_RULE)


def in_project(id: str, project: str) -> bool:
    """Return whether a campaign or recording is of a project: its id is the project's name, or begins with it and -."""
    return id == project or id.startswith(f"{project}-")


def _or_any(name: str, check: Callable[[str], str]) -> str:
    return name if name == ANY else check(name)


@dataclass(frozen=True)
class Keys:
    """The keys of one lab.

    Every method takes the names in the key, each of which may be "*", and returns the full key. A name that the
    contract does not allow raises ValueError with one sentence.

    Parameters
    ----------
    lab : str
        Name of the lab: lower case letters, digits, '-' and '_'.
    """

    lab: str = "local"

    def __post_init__(self) -> None:
        _check(self.lab, _LAB, what="lab", rule="lower case letters, digits, '-' and '_'")

    def _key(self, *chunks: str) -> str:
        return "/".join((PREFIX, self.lab, *chunks))

    def _rig(self, rig: str, *chunks: str) -> str:
        return self._key("rig", _or_any(rig, check_rig), *chunks)

    def rig_description(self, rig: str) -> str:
        """Query: DescriptionRequest → RigDescription."""
        return self._rig(rig, "description")

    def rig_frf(self, rig: str) -> str:
        """Query: RigFrfRequest → RigFrf, for a rig with its FRF in closed form."""
        return self._rig(rig, "frf")

    def rig_play(self, rig: str) -> str:
        """Query: PlayRequest → Progress, then PlayResult."""
        return self._rig(rig, "play")

    def rig_stop(self, rig: str) -> str:
        """Query: StopRequest → RigState."""
        return self._rig(rig, "stop")

    def rig_reset(self, rig: str) -> str:
        """Query: ResetRequest → RigState."""
        return self._rig(rig, "reset")

    def rig_state(self, rig: str) -> str:
        """Query: StateRequest → RigState; and stream of RigState at every change."""
        return self._rig(rig, "state")

    def rig_signal(self, rig: str, run: str) -> str:
        """Stream of SignalBlock while the run plays."""
        return self._rig(rig, "signal", _or_any(run, check_run))

    def rig_pose(self, rig: str) -> str:
        """Stream of PoseBlock while it plays."""
        return self._rig(rig, "pose")

    def identify(self, rig: str) -> str:
        """Query: IdentifyRequest → Progress, then Model."""
        return self._key("identifier", "identify", _or_any(rig, check_rig))

    def experiment_plan(self) -> str:
        """Query: PlanRequest → ExperimentPlan."""
        return self._key("identifier", "plan")

    def identify_levels(self, rig: str) -> str:
        """Query: LevelsRequest → Progress, then LevelsResult."""
        return self._key("identifier", "levels", _or_any(rig, check_rig))

    def level_advice(self) -> str:
        """Query: AdviceRequest → LevelAdvice."""
        return self._key("identifier", "advise")

    def model(self, id: str) -> str:
        """Query: ModelRequest → Model."""
        return self._key("identifier", "model", _or_any(id, check_id))

    def prediction(self, id: str) -> str:
        """Query: PredictRequest → Prediction."""
        return self._key("identifier", "predict", _or_any(id, check_id))

    def convergence(self, id: str) -> str:
        """Query: ConvergenceRequest → Convergence."""
        return self._key("identifier", "convergence", _or_any(id, check_id))

    def campaign_start(self, rig: str) -> str:
        """Query: CampaignSpec → CampaignStatus."""
        return self._key("iterator", "campaign", "start", _or_any(rig, check_rig))

    def campaign(self, id: str) -> str:
        """Query: CampaignRequest → CampaignStatus."""
        return self._key("iterator", "campaign", _or_any(id, check_id))

    def campaign_stop(self, id: str) -> str:
        """Query: StopCampaignRequest → CampaignStatus."""
        return f"{self.campaign(id)}/stop"

    def campaign_resume(self, id: str, rig: str) -> str:
        """Query: ResumeCampaignRequest → CampaignStatus; `rig` is the campaign's."""
        return f"{self.campaign(id)}/resume/{_or_any(rig, check_rig)}"

    def campaign_decide(self, id: str, rig: str) -> str:
        """Query: Decision → CampaignStatus; `rig` is the campaign's."""
        return f"{self.campaign(id)}/decide/{_or_any(rig, check_rig)}"

    def campaign_event(self, id: str) -> str:
        """Stream of CampaignEvent."""
        return self._key("iterator", "event", _or_any(id, check_id))

    def pre_test(self, rig: str) -> str:
        """Query: PreTestRequest → Progress, then PreTest."""
        return self._key("iterator", "pre_test", _or_any(rig, check_rig))

    def endurance_start(self, rig: str) -> str:
        """Query: EnduranceSpec → EnduranceStatus."""
        return self._key("sequencer", "test", "start", _or_any(rig, check_rig))

    def endurance(self, id: str) -> str:
        """Query: EnduranceRequest → EnduranceStatus."""
        return self._key("sequencer", "test", _or_any(id, check_id))

    def endurance_stop(self, id: str) -> str:
        """Query: StopEnduranceRequest → EnduranceStatus."""
        return f"{self.endurance(id)}/stop"

    def endurance_hold(self, id: str) -> str:
        """Query: HoldEnduranceRequest → EnduranceStatus."""
        return f"{self.endurance(id)}/hold"

    def endurance_resume(self, id: str, rig: str) -> str:
        """Query: ResumeEnduranceRequest → EnduranceStatus; `rig` is the test's."""
        return f"{self.endurance(id)}/resume/{_or_any(rig, check_rig)}"

    def endurance_decide(self, id: str, rig: str) -> str:
        """Query: EnduranceDecision → EnduranceStatus; `rig` is the test's."""
        return f"{self.endurance(id)}/decide/{_or_any(rig, check_rig)}"

    def endurance_event(self, id: str) -> str:
        """Stream of EnduranceEvent."""
        return self._key("sequencer", "event", _or_any(id, check_id))

    def commit(self) -> str:
        """Query: CommitRequest → CommitAck."""
        return self._key("recorder", "commit")

    def recordings(self) -> str:
        """Query: ListRecordingsRequest → RecordingList."""
        return self._key("recorder", "recording", "list")

    def project_recordings(self, project: str) -> str:
        """Query: ListRecordingsRequest → RecordingList, of one project."""
        return self._key("recorder", "project", _or_any(project, check_project))

    def recording(self, id: str) -> str:
        """Query: RecordingRequest → RecordingInfo. "**" matches everything under recorder/recording."""
        return self._key("recorder", "recording", id if id == ANY_DEPTH else _or_any(id, check_id))

    def recording_read(self, id: str) -> str:
        """Query: ReadRecordingRequest → RecordingPart."""
        return self._key("recorder", "recording", _or_any(id, check_id), "read")

    def recording_steps(self, id: str) -> str:
        """Query: ReadStepsRequest → RecordedSteps."""
        return self._key("recorder", "recording", _or_any(id, check_id), "steps")

    def recording_signals(self, id: str) -> str:
        """Query: SignalWindowRequest → SignalWindow."""
        return self._key("recorder", "recording", _or_any(id, check_id), "signals")

    def recording_verify(self, id: str) -> str:
        """Query: VerifyRecordingRequest → VerifyResult."""
        return self._key("recorder", "recording", _or_any(id, check_id), "verify")

    def live(self, service: str, instance: str) -> str:
        """Liveliness token of one instance of a service."""
        return self._key("live", _or_any(service, check_rig), _or_any(instance, check_id))

    def health(self, service: str, instance: str) -> str:
        """Query: HealthRequest → Health, of every instance that is live."""
        return self._key("health", _or_any(service, check_rig), _or_any(instance, check_id))

    def asking(self, query: str) -> str:
        """Liveliness token that a client holds while it waits for a query's answer; `query` is its random id."""
        return self._key("asking", _or_any(query, check_id))

    def within(self, key: str) -> str:
        """Return a key of this lab without the common prefix, e.g. "rig/front_axle/play"."""
        return key.removeprefix(f"{PREFIX}/{self.lab}/")


def _chunks(key: str) -> tuple[str, list[str]]:
    """Split a key into its lab and the chunks after it."""
    chunks = key.split("/")
    if "/".join(chunks[:2]) != PREFIX or len(chunks) < 4 or "" in chunks:
        raise KeyNameError(f"The key {key!r} is not of the contract, whose keys are '{PREFIX}/<lab>/…'.")
    return chunks[2], chunks[3:]


def _lacks(key: str, what: str) -> KeyNameError:
    return KeyNameError(f"The key {key!r} names no {what}.")


def rig_of(key: str) -> str:
    """Return the rig named in a key under rig/, or in that of a query that moves one; else raise ValueError."""
    match _chunks(key)[1]:
        case ["rig", rig, *_]:
            return rig
        case ["identifier", "identify" | "levels", rig]:
            return rig
        case ["iterator", "campaign", "start", rig] | ["iterator", "campaign", _, "resume" | "decide", rig]:
            return rig
        case ["iterator", "pre_test", rig]:
            return rig
        case ["sequencer", "test", "start", rig] | ["sequencer", "test", _, "resume" | "decide", rig]:
            return rig
    raise _lacks(key, "rig")


def project_of(key: str) -> str:
    """Return the project named in a key of its recordings, or raise ValueError."""
    _, rest = _chunks(key)
    if len(rest) != 3 or rest[:2] != ["recorder", "project"]:
        raise _lacks(key, "project")
    return rest[2]


def run_of(key: str) -> str:
    """Return the run named in the key of a signal stream, or raise ValueError."""
    _, rest = _chunks(key)
    if rest[0] != "rig" or len(rest) != 4 or rest[2] != "signal":
        raise _lacks(key, "run")
    return rest[3]


def stream_family(key: str) -> str:
    """Return the key expression of all streams of this key's kind.

    A service publishes a stream for each run or campaign, so that the number has no limit: "*" replaces its name. Any
    other key is unchanged.
    """
    family = key.rpartition("/")[0]
    match family.removeprefix(f"{PREFIX}/").split("/"):
        case [_, "rig", _, "signal"] | [_, "iterator" | "sequencer", "event"]:
            return f"{family}/{ANY}"
    return key


_NAMED_BY_ID: Final = frozenset(
    {
        ("identifier", "model"),
        ("identifier", "predict"),
        ("identifier", "convergence"),
        ("iterator", "campaign"),
        ("iterator", "event"),
        ("recorder", "recording"),
        ("sequencer", "event"),
        ("sequencer", "test"),
    }
)


def id_of(key: str) -> str:
    """Return the campaign, endurance test, recording or model named in a key, or raise ValueError."""
    _, rest = _chunks(key)
    if len(rest) < 3 or (rest[0], rest[1]) not in _NAMED_BY_ID or rest[2] in _RESERVED_IDENTIFIERS:
        raise _lacks(key, "campaign, recording or model")
    return rest[2]


def parse_live(key: str) -> tuple[str, str]:
    """Return (service, instance) of a liveliness key, or raise ValueError."""
    _, rest = _chunks(key)
    if rest[0] != "live" or len(rest) != 3:
        raise _lacks(key, "service and instance")
    return rest[1], rest[2]


def serving(key: str) -> str:
    """Return the liveliness key of the service that answers a query key.

    Parameters
    ----------
    key : str
        Any key of the contract under rig/, identifier/, iterator/, sequencer/, recorder/ or health/.

    Returns
    -------
    str
        `live/rig_sim/<rig>` for the keys of a rig, `live/<service>/main` for the others, in the key's lab. A gateway
        to a real rig declares the same token as the simulation it replaces.

    Raises
    ------
    ValueError
        No service answers the key.
    """
    lab, rest = _chunks(key)
    match rest:
        case ["rig", rig, *_]:
            return Keys(lab).live("rig_sim", rig)
        case [("identifier" | "iterator" | "sequencer" | "recorder") as service, *_]:
            return Keys(lab).live(service, MAIN_INSTANCE)
        case ["health", service, instance]:
            return Keys(lab).live(service, instance)
        case _:
            raise ValueError(
                f"The key {key!r} is answered by no service: it is not under rig/, identifier/, iterator/, sequencer/, "
                "recorder/ or health/."
            )
