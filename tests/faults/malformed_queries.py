"""Malformed queries to every key: each is answered, with a fault that is not the service's own defect, or a result."""

from __future__ import annotations

import time
import zlib
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import zenoh
from google.protobuf.message import Message

from duralab_bus import encoding_of
from duralab_proto.keys import Keys
from duralab_proto.v1 import identifier_pb2, iterator_pb2, query_pb2, recorder_pb2, rig_pb2, sequencer_pb2

from .disturbed_campaign import Operator, Round
from .keys_of_contract import ContractKey, contract_keys, odd_name_in
from .lab_under_fault import RIG, LabUnderFault
from .malformed import Malformation, malformed
from .raw_session import Answer, Query, Stranger
from .reference import Reference
from .templates import template

WRONG_ENCODING = "wrong encodings and attachments"
ODD_NAME = "odd names in the key"
KINDS = (*(kind.value for kind in Malformation), WRONG_ENCODING, ODD_NAME)
_LONGEST_SENTENCE = 2000
_ENCODINGS = (None, "", "text/plain", "application/protobuf", "application/protobuf;duralab.v1.Nothing", "x" * 200)
_DEFECTS = (query_pb2.FAULT_CODE_INTERNAL, query_pb2.FAULT_CODE_UNSPECIFIED)
_MOST_FINDINGS = 50
GROWTH_MEBIBYTES = 100.0
"""Most that a service may grow under all the messages, after it has grown warm under a tenth of them."""


@dataclass
class Tally:
    """What became of the malformed queries to one service."""

    sent: int = 0
    answers: dict[str, int] = field(default_factory=dict)
    findings: list[str] = field(default_factory=list)
    slowest_seconds: float = 0.0
    begun: list[str] = field(default_factory=list)
    """Campaigns that a message started after all."""
    sessions: int = 0
    """How many the asker needed: another one where a link was lost."""


@dataclass(frozen=True)
class Target:
    """The lab that is asked.

    Parameters
    ----------
    endpoint : str
        Where it listens.
    keys : Keys
        Its keys.
    campaign, model : str
        Of a campaign that it has recorded, and of the model that this one identified.
    recordings : Path
        Where its recorder keeps them.
    """

    endpoint: str
    keys: Keys
    campaign: str
    model: str
    recordings: Path


def _silent(_progress: str) -> None:
    """Say nothing."""


def query_keys(keys: Keys) -> list[ContractKey]:
    """Return the keys that are asked."""
    return [key for key in contract_keys(keys) if not key.stream]


def send_malformed(
    target: Target,
    reference: Reference,
    *,
    seed: int,
    each: int,
    only: Collection[str] = (),
    tell: Callable[[str], None] = _silent,
) -> dict[str, Tally]:
    """Ask every key so many malformed questions of each kind; the services are asked side by side.

    `only` are names of keys, all where there is none; `tell` is called when all of a key's are answered.

    Returns
    -------
    dict
        What became of them, by service.
    """
    queries: dict[str, list[ContractKey]] = {}
    for key in query_keys(target.keys):
        if not only or key.name in only:
            service = _path(key, target).split("/")[3]
            # The health of the rigs is asked here.
            queries.setdefault("rig" if service == "health" else service, []).append(key)
    tallies = {service: Tally() for service in queries}
    with ThreadPoolExecutor(len(queries)) as pool:
        asking = [
            pool.submit(
                _ask_service, target, keys, tallies[service], reference=reference, seed=seed, each=each, tell=tell
            )
            for service, keys in queries.items()
        ]
    for each_service in asking:
        each_service.result()
    return tallies


def _ask_service(
    target: Target,
    keys: list[ContractKey],
    tally: Tally,
    *,
    reference: Reference,
    seed: int,
    each: int,
    tell: Callable[[str], None],
) -> None:
    with closing(Stranger(target.endpoint)) as stranger:
        for key in keys:
            sound = template(key.kind, reference.recording)
            began, before = time.monotonic(), tally.sent
            for kind in KINDS:
                # One sequence of random numbers for each key and kind: a finding is made again by its number alone.
                random = np.random.default_rng([seed, zlib.crc32(f"{key.name} {kind}".encode())])
                for number in range(each):
                    query = _made(target, key, sound, kind=kind, number=number, random=random)
                    origin = f"{key.name}, {kind}, number {number}"
                    _ask(stranger, target, query, tally, origin=origin)
            seconds, found = time.monotonic() - began, f"; {len(tally.findings)} FINDINGS" if tally.findings else ""
            tally.sessions = stranger.sessions
            tell(f"malformed queries to {key.name}: {tally.sent - before} sent in {seconds:.0f} s{found}")


def _path(key: ContractKey, target: Target) -> str:
    known = target.model if key.name in ("model", "prediction", "convergence") else target.campaign
    names = {"rig": RIG, "id": known, "project": "wheel", "service": "rig_sim", "instance": RIG}
    return key.make(*(names[name] for name in key.names))


def _made(
    target: Target, key: ContractKey, sound: Message, *, kind: str, number: int, random: np.random.Generator
) -> Query:
    _rename(sound, f"m{zlib.crc32(f'{key.name}, {kind}, number {number}'.encode())}", target)
    path, whole, encoding = _path(key, target), sound.SerializeToString(), encoding_of(sound)
    if kind == WRONG_ENCODING:
        if random.random() < 0.3:
            return Query(path, whole, encoding, attachment=random.bytes(int(random.integers(0, 3000))))
        payload = None if random.random() < 0.2 else whole
        return Query(path, payload, _ENCODINGS[int(random.integers(len(_ENCODINGS)))])
    if kind == ODD_NAME:
        return Query(odd_name_in(path, key, random), whole, encoding)
    return Query(path, malformed(sound, Malformation(kind), random), encoding)


def _rename(sound: Message, name: str, target: Target) -> None:
    """Give what would be begun a name that is free, so that it is checked beyond its name."""
    match sound:
        case iterator_pb2.CampaignSpec():
            sound.id = name
        case iterator_pb2.ResumeCampaignRequest():
            sound.new_id = name
        case rig_pb2.PlayRequest() | identifier_pb2.IdentifyRequest():
            sound.run = name
        case identifier_pb2.AdviceRequest():
            sound.model_id = target.model


def _ask(stranger: Stranger, target: Target, query: Query, tally: Tally, *, origin: str) -> None:
    began = time.monotonic()
    try:
        # A key that nobody serves has no answer either; that is the contract.
        answer = stranger.ask(query, served=ODD_NAME not in origin)
    except zenoh.ZError:
        return
    tally.sent += 1
    tally.slowest_seconds = max(tally.slowest_seconds, time.monotonic() - began)
    code = query_pb2.FaultCode.Name(answer.fault.code) if answer.fault is not None else answer.result or "no answer"
    short = code.removeprefix("FAULT_CODE_").removeprefix("duralab.v1.")
    tally.answers[short] = tally.answers.get(short, 0) + 1
    tally.findings += [f"{origin}: {finding}" for finding in _judge(answer, served=ODD_NAME not in origin)]
    del tally.findings[_MOST_FINDINGS:]
    _tidy_up(stranger, target, answer, tally)


def _judge(answer: Answer, *, served: bool) -> Iterator[str]:
    if answer.none and served:
        yield "silent" if answer.silent else "no answer"
    if answer.fault is None:
        return
    sentence = answer.fault.message
    if answer.fault.code in _DEFECTS:
        yield f"a defect: {sentence}"
    if not sentence or "\n" in sentence or "Traceback" in sentence or len(sentence) > _LONGEST_SENTENCE:
        yield f"not one sentence of at most {_LONGEST_SENTENCE} characters: {sentence[:200]!r}"


def _tidy_up(stranger: Stranger, target: Target, answer: Answer, tally: Tally) -> None:
    """Stop what was begun, and clear the latch, so that the next question is answered as this one was."""
    reset = _sound(target.keys.rig_reset(RIG), rig_pb2.ResetRequest())
    if answer.fault is None and answer.result == iterator_pb2.CampaignStatus.DESCRIPTOR.full_name:
        status = iterator_pb2.CampaignStatus.FromString(answer.payload)
        if status.id != target.campaign:
            stop = iterator_pb2.StopCampaignRequest(reason="the test goes on")
            stranger.ask(_sound(target.keys.campaign_stop(status.id), stop), served=True)
            stranger.ask(reset, served=True)
            # The one before is over, or this one had been refused. Thousands would be what `list` takes its time for.
            for path in [path for id in tally.begun for path in target.recordings.glob(f"{id}.*")]:
                path.unlink()
            tally.begun = [status.id]
    elif answer.fault is None and answer.result == sequencer_pb2.EnduranceStatus.DESCRIPTOR.full_name:
        status = sequencer_pb2.EnduranceStatus.FromString(answer.payload)
        stop = sequencer_pb2.StopEnduranceRequest(reason="the test goes on")
        stranger.ask(_sound(target.keys.endurance_stop(status.id), stop), served=True)
        stranger.ask(reset, served=True)
    elif answer.result == rig_pb2.RigState.DESCRIPTOR.full_name:
        stranger.ask(reset, served=True)


def _sound(key: str, message: Message) -> Query:
    return Query(key, message.SerializeToString(), encoding_of(message))


def send_to_lab(
    lab: LabUnderFault,
    reference: Reference,
    *,
    seed: int,
    each: int,
    only: Collection[str] = (),
    tell: Callable[[str], None] = _silent,
) -> dict[str, Tally]:
    """Send the malformed queries to a lab that then still gives the bytes of the undisturbed campaign.

    Returns
    -------
    dict
        By service; under `lab` what is wrong with all of them afterwards.
    """
    before, after = Round("malformed queries", 1), Round("malformed queries", 2)
    Operator(lab, _of_one_playback(reference), before).perform(lambda _stack: "", moment=0.0)
    target = _target(lab, before.recordings[0])
    # Once to warm up: buffers for the largest messages, and the models and campaigns that are kept.
    send_malformed(target, reference, seed=seed + 1, each=max(1, each // 10), only=only)
    resident = lab.resident_mebibytes()
    tallies = send_malformed(target, reference, seed=seed, each=each, only=only, tell=tell)
    whole = tallies["lab"] = Tally()
    for name, size in lab.resident_mebibytes().items():
        if size - resident[name] > GROWTH_MEBIBYTES:
            whole.findings.append(f"{name} grew from {resident[name]:.0f} to {size:.0f} MiB")
    whole.findings += [f"{name} ended by itself" for name in lab.dead()]
    Operator(lab, reference, after).perform(lambda _stack: "", moment=0.0)
    whole.findings += [*before.findings, *after.findings, *lab.defects()]
    return tallies


def _of_one_playback(reference: Reference) -> Reference:
    """Return the campaign cut short: what is asked of its recording again and again is read quickly."""
    short = iterator_pb2.CampaignSpec()
    short.CopyFrom(reference.specification)
    short.stop.iterations = 1
    return replace(reference, specification=short, playbacks=reference.playbacks[:1])


def _target(lab: LabUnderFault, campaign: str) -> Target:
    steps = lab.bus.query(
        lab.bus.keys.recording_steps(campaign), recorder_pb2.ReadStepsRequest(), recorder_pb2.RecordedSteps
    )
    model = next(
        identifier_pb2.Model.FromString(step.payload)
        for step in steps.steps
        if step.message_type == identifier_pb2.Model.DESCRIPTOR.full_name
    )
    return Target(lab.endpoint, lab.bus.keys, campaign, model.id, lab.recordings)
