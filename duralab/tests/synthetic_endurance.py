"""A made-up endurance test, monitored by the library's monitor and written as recordings: the oracle of its report.

Responses of two events are sums of sines that are the same in each repeat but for noise; from one repeat on one channel
loses a part of its amplitude.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import synthetic_campaign
from google.protobuf.message import Message

from duralab_loads import channel_damage
from duralab_monitoring import Alarm, Monitor, Statistic
from duralab_proto.arrays import samples_hash, to_array, to_record
from duralab_proto.v1 import recorder_pb2, sequencer_pb2
from duralab_schedules import Schedule
from duralab_settings import parse_yaml

RATE = 1000.0
SAMPLES = 2000
EVENTS = ("rough", "smooth")
NAMES = synthetic_campaign.NAMES
CHANGED = NAMES.index("left_lateral")
# 2026-03-01 06:30 UTC; alarms are found a minute a repeat after it.
FOUND = 1_772_346_600 * 10**9

SCHEDULE = """name: weeks
rig: front_axle
events:
  rough: {drive: rough.drv, repeats: 80}
  smooth: {drive: smooth.drv, repeats: 40}
order: interleaved
keep: {first: 2, every: 20, around_alarm: 1}
"""


@dataclass(frozen=True)
class Endurance:
    """What is written: messages of each recording, blocks, and what the repeats were."""

    volumes: list[list[Message]]
    responses: list[np.ndarray]
    statistics: list[np.ndarray]
    alarms: list[Alarm]
    sequence: np.ndarray
    unknown: int


def make(*, changed_from: int | None = 70, unknown: int = 33, volume_repeats: int = 50, seed: int = 1) -> Endurance:
    random = np.random.default_rng(seed)
    schedule = Schedule.model_validate(parse_yaml(SCHEDULE))
    sequence = schedule.sequence()
    time = np.arange(SAMPLES) / RATE
    scale = np.array([900.0, 400.0, 500.0] * 2)[:, None]
    clean = [
        scale
        * level
        * sum(
            random.uniform(0.3, 1.0, (6, 1)) * np.sin(2 * np.pi * f * time + random.uniform(0, 6.28, (6, 1)))
            for f in (1.0, 3.5, 7.0, 12.5, 24.0)
        )
        for level in (1.0, 0.5)
    ]
    drives = [1e-6 * record for record in clean]
    monitor = Monitor(schedule.monitoring, EVENTS, channels=NAMES, sample_rate=RATE)
    columns = [*map(str, Statistic), "residual static"]
    bands = zip(schedule.monitoring.bands, schedule.monitoring.bands[1:], strict=False)
    columns += [f"residual {low:g} to {high:g} Hz" for low, high in bands]
    planned = [channel_damage(record, exponents=[5.0])[:, 0] for record in clean]
    description = synthetic_campaign.description()
    spec = sequencer_pb2.EnduranceSpec(id="weeks", rig="front_axle", schedule=SCHEDULE, seed=5)
    for name, drive, damage in zip(EVENTS, drives, planned, strict=True):
        record = to_record(synthetic_campaign.drive_channels(), RATE, drive)
        spec.events.add(name=name, drive=record, source=f"file {name}.drv", planned_damage=to_array(damage))

    def volume(number: int, first: int) -> list[Message]:
        begin = sequencer_pb2.EnduranceVolume(
            id="weeks", rig="front_axle", number=number, first_repeat=first, columns=columns
        )
        for name, planned in schedule.repeats.items():
            begin.events.add(name=name, planned=planned)
        return [*([spec] if number == 1 else []), begin, description]

    volumes, responses, statistics, alarms = [volume(1, 0)], [], [], []
    nth = [0, 0]
    for repeat, event in enumerate(sequence.tolist()):
        if repeat and repeat % volume_repeats == 0:
            volumes[-1].append(recorder_pb2.RecordingClosed(reason="goes on"))
            volumes.append(volume(len(volumes) + 1, repeat))
        run = f"weeks.r{repeat:07d}"
        response = clean[event] + 1.0 * random.standard_normal(clean[event].shape)
        if changed_from is not None and repeat >= changed_from:
            response[CHANGED] *= 0.85
        responses.append(response)
        kept = schedule.keep.keeps(nth[event])
        nth[event] += 1
        volumes[-1].append(
            recorder_pb2.RunPlanned(run=run, rig="front_axle", purpose=f"repeat {repeat}", not_kept=not kept)
        )
        if repeat == unknown:
            volumes[-1].append(
                sequencer_pb2.EnduranceRepeat(
                    repeat=repeat,
                    event=event,
                    run=run,
                    end=sequencer_pb2.REPEAT_END_UNKNOWN,
                    reason=f"Repeat {repeat} ({EVENTS[event]}) counts as played, its damage as planned: the rig left.",
                    damage=to_array(planned[event]),
                )
            )
            statistics.append(np.full((6, len(columns)), np.nan))
            continue
        verdict = monitor.judge(repeat, EVENTS[event], response=response)
        alarms += verdict.alarms
        statistics.append(np.concatenate([verdict.statistics.table, verdict.statistics.residual], axis=1))
        step = sequencer_pb2.EnduranceRepeat(
            repeat=repeat,
            event=event,
            run=run,
            end=sequencer_pb2.REPEAT_END_PLAYED,
            statistics=to_array(statistics[-1]),
            damage=to_array(verdict.statistics.column(Statistic.DAMAGE)),
            alarms=[_alarm(alarm, event) for alarm in verdict.alarms],
        )
        if kept:
            blocks = synthetic_campaign.signal_blocks(drives[event], response, run=run, size=500)
            step.signal_epoch, step.signal_blocks = 1, len(blocks)
            step.samples_hash = samples_hash(drives[event], response)
            volumes[-1] += [
                *blocks,
                step,
                recorder_pb2.RunPlayed(run=run, rig="front_axle", epoch=1, blocks=len(blocks)),
            ]
        else:
            volumes[-1].append(step)
            if verdict.alarms:
                channels = synthetic_campaign.response_channels()
                volumes[-1].append(
                    sequencer_pb2.RepeatSamples(
                        repeat=repeat,
                        event=event,
                        run=run,
                        response=to_record(channels, RATE, response),
                        reason="alarm",
                    )
                )
    volumes[-1] += [
        sequencer_pb2.EnduranceStatus(
            id="weeks", rig="front_axle", phase=sequencer_pb2.ENDURANCE_PHASE_FINISHED, activity="finished"
        ),
        recorder_pb2.RecordingClosed(reason="finished"),
    ]
    return Endurance(volumes, responses, statistics, alarms, sequence, unknown)


def _alarm(alarm: Alarm, event: int) -> sequencer_pb2.EnduranceAlarm:
    low, high = alarm.band or (0.0, 0.0)
    return sequencer_pb2.EnduranceAlarm(
        repeat=alarm.repeat,
        event=event,
        level=getattr(sequencer_pb2, f"ALARM_LEVEL_{alarm.level.name}"),
        kind=getattr(sequencer_pb2, f"ALARM_KIND_{alarm.kind.name}"),
        channel=alarm.channel,
        lowest_frequency=low,
        highest_frequency=high,
        since_repeat=alarm.since,
        sentence=alarm.sentence,
        action=sequencer_pb2.ALARM_ACTION_LOG,
        measure=alarm.measure.value,
        size=alarm.size,
        found=FOUND + alarm.repeat * 60_000_000_000,
    )


def write(folder: Path, endurance: Endurance) -> Path:
    """Write the recordings as the recorder names them; return the first."""
    for number, messages in enumerate(endurance.volumes, start=1):
        name = "weeks.mcap" if number == 1 else f"weeks-v{number:04d}.mcap"
        synthetic_campaign.write(folder / name, messages)
    return folder / "weeks.mcap"
