"""A small campaign made with numpy alone, written as a recording: the oracle of the reader and of the report.

The plant is linear with resonances and cross-coupling, the model is off in gain and delay, so that the error shrinks
from playback to playback but not at once. All figures come from formulas written out here, not from the product.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import Message
from mcap.writer import Writer

from duralab_proto.arrays import to_array, to_record
from duralab_proto.v1 import array_pb2, identifier_pb2, iterator_pb2, recorder_pb2, rig_pb2

RATE = 1000.0
BAND = (0.7, 35.0)
NAMES = tuple(f"{side}_{axis}" for side in ("left", "right") for axis in ("vertical", "lateral", "longitudinal"))
LIMITS = {"vertical": 0.125, "lateral": 0.075, "longitudinal": 0.1}


def drive_channels() -> list[array_pb2.Channel]:
    return [
        array_pb2.Channel(
            name=name,
            unit="m",
            kind=array_pb2.CHANNEL_KIND_DISPLACEMENT,
            minimum=-LIMITS[name.split("_")[1]],
            maximum=LIMITS[name.split("_")[1]],
            slew_limit=2.0,
            label=f"{name} actuator",
        )
        for name in NAMES
    ]


def response_channels() -> list[array_pb2.Channel]:
    return [
        array_pb2.Channel(
            name=name, unit="N", kind=array_pb2.CHANNEL_KIND_FORCE, minimum=-3e4, maximum=3e4, label=f"{name} force"
        )
        for name in NAMES
    ]


def description(rig: str = "front_axle") -> rig_pb2.RigDescription:
    return rig_pb2.RigDescription(
        rig=rig,
        specimen="double wishbone front axle",
        engine="compiled",
        version="0.1.0",
        sample_rate=RATE,
        drives=drive_channels(),
        responses=response_channels(),
        longest_drive_seconds=3600.0,
        static_response=to_array(np.array([3600.0, 0.0, 0.0] * 2)),
        block_samples=100,
        content_hash="c0ffee" * 10 + "1234",
    )


def plant(frequency: np.ndarray) -> np.ndarray:
    """FRF of the made-up rig, shape (lines, 6, 6), N/m."""
    s = 2j * np.pi * frequency
    frf = np.zeros((frequency.size, 6, 6), dtype=complex)
    for i in range(6):
        stiffness, resonance, damping = 1.2e5 / (1 + i % 3), 8.0 + 5.0 * (i % 3), 0.15
        w = 2 * np.pi * resonance
        frf[:, i, i] = stiffness * (1 + s / 60) * w**2 / (s**2 + 2 * damping * w * s + w**2)
        for j in range(6):
            if i != j:
                coupling = 0.12 if i // 3 == j // 3 else 0.02
                frf[:, i, j] = coupling * 1.2e5 / (1 + i % 3) * w**2 / (s**2 + 2 * damping * w * s + w**2)
    return frf


@dataclass(frozen=True)
class Campaign:
    """What is written into the recording."""

    target: np.ndarray
    drives: list[np.ndarray]
    responses: list[np.ndarray]
    errors: np.ndarray
    rms_responses: np.ndarray
    peak_ratios: np.ndarray
    model: identifier_pb2.Model


def in_band(samples: np.ndarray) -> np.ndarray:
    spectrum = np.fft.rfft(samples, axis=1)
    frequency = np.fft.rfftfreq(samples.shape[1], 1 / RATE)
    spectrum[:, (frequency < BAND[0]) | (frequency > BAND[1])] = 0
    return np.fft.irfft(spectrum, n=samples.shape[1], axis=1)


def make(*, seconds: float = 20.0, iterations: int = 4, gain: float = 0.7, seed: int = 3) -> Campaign:
    generator = np.random.default_rng(seed)
    samples = int(seconds * RATE)
    frequency = np.fft.rfftfreq(samples, 1 / RATE)
    frf = plant(frequency)
    wrong_gain, delay = np.array([1.1, 0.75, 1.3, 1.15, 0.8, 1.25]), np.array([1, 4, 9, 2, 3, 8]) * 1e-3
    wrong = wrong_gain * np.exp(-2j * np.pi * frequency[:, None] * delay)
    estimated = frf * wrong[:, :, None]
    envelope = 1 + 2.5 * np.exp(-(((np.arange(samples) / RATE - 0.6 * seconds) / 0.3) ** 2))
    shape = 1 / (1 + (frequency / 6) ** 2) ** 0.5
    noise = np.fft.irfft(np.fft.rfft(generator.standard_normal((6, samples)), axis=1) * shape, n=samples, axis=1)
    target = in_band(noise * envelope * np.array([900.0, 400, 500] * 2)[:, None] / noise.std(axis=1, keepdims=True))
    inside = (frequency >= BAND[0]) & (frequency <= BAND[1])
    inverse = np.zeros_like(frf)
    inverse[inside] = np.linalg.inv(estimated[inside])

    drive, error = np.zeros((6, samples)), target
    drives, responses = [], []
    for _ in range(iterations):
        step = np.einsum("fij,jf->if", inverse, np.fft.rfft(error, axis=1)) * gain
        drive = drive + np.fft.irfft(step, n=samples, axis=1)
        response = np.fft.irfft(np.einsum("fij,jf->if", frf, np.fft.rfft(drive, axis=1)), n=samples, axis=1)
        response += 20.0 * generator.standard_normal(response.shape)
        drives.append(drive)
        responses.append(response)
        error = target - in_band(response)
    rms = lambda x: np.sqrt(np.mean(x**2, axis=1))  # noqa: E731
    judged = [in_band(response) for response in responses]
    return Campaign(
        target=target,
        drives=drives,
        responses=responses,
        errors=np.array([rms(target - y) / rms(target) for y in judged]),
        rms_responses=np.array([rms(y) / rms(target) for y in judged]),
        peak_ratios=np.array([np.abs(y).max(axis=1) / np.abs(target).max(axis=1) for y in judged]),
        model=_model(generator),
    )


def _model(generator: np.random.Generator) -> identifier_pb2.Model:
    lines = np.arange(1025) * RATE / 2048
    excited = (lines >= 0.5) & (lines <= 40.0)
    level = np.where(excited, 1e-6 / np.maximum(1, lines / 4) ** 2, 1e-12)
    noise = 1 + 0.02 * (generator.standard_normal((1025, 6, 6)) + 1j * generator.standard_normal((1025, 6, 6)))
    return identifier_pb2.Model(
        id="ab" * 32,
        rig="front_axle",
        drives=drive_channels(),
        responses=response_channels(),
        sample_rate=RATE,
        frequency=to_array(lines),
        frf=to_array(plant(lines) * noise),
        coherence=to_array(np.where(excited[:, None], 0.97 - 0.1 * generator.random((1025, 6)), 0.05)),
        condition_number=to_array(np.where(excited, 1.2 + 0.3 * generator.random(1025), 80.0)),
        drive_psd=to_array(np.repeat(level[:, None], 6, axis=1)),
        response_psd=to_array(np.sum(np.abs(plant(lines)) ** 2 * level[:, None, None], axis=2) / 0.93),
        excitation=specification(np.zeros((6, 2))).excitation,
        estimator=identifier_pb2.Estimator(kind=identifier_pb2.ESTIMATOR_KIND_H1, block_samples=2048, overlap=0.5),
        blocks=94,
        independent_averages=49.5,
        rig_content_hash=description().content_hash,
        run="demo.identify",
        frf_variance=to_array(0.02**2 * np.abs(plant(lines)) ** 2),
        verdicts=["Nonlinear 6 % of the response at 14 Hz in left longitudinal; noise 1 % over the band."],
        warnings=[identifier_pb2.ModelWarning(sentence="Response right_vertical is clipped.")],
    )


def specification(target: np.ndarray, *, iterations: int = 4, scenario: str = "") -> iterator_pb2.CampaignSpec:
    return iterator_pb2.CampaignSpec(
        id="demo",
        rig="front_axle",
        target=to_record(response_channels(), RATE, target),
        target_source="ISO 8608 road of class C/D with 4 potholes (seed 8608), 20 s driven by predecessor at 15 m/s",
        excitation=identifier_pb2.Excitation(
            kind=identifier_pb2.EXCITATION_KIND_PURE_RANDOM,
            spectrum=identifier_pb2.WhitePinkSpectrum(
                lowest_frequency=0.5, highest_frequency=40.0, corner_frequency=4.0, decibels_per_octave=6.0
            ),
            rms=to_array(np.array([0.004, 0.0015, 0.0015] * 2)),
            duration=100.0,
            fade=1.0,
            seed=7,
        ),
        estimator=identifier_pb2.Estimator(kind=identifier_pb2.ESTIMATOR_KIND_H1, block_samples=2048, overlap=0.5),
        update=iterator_pb2.UpdateSettings(
            kind=iterator_pb2.UPDATE_KIND_ADAPTIVE_MODELLING,
            iteration_gain=to_array(np.full(6, 0.7)),
            smallest_correction=0.5,
            largest_correction=2.0,
            weigh_by_coherence=True,
            lowest_coherence=0.7,
        ),
        stop=iterator_pb2.StopCriteria(iterations=iterations),
        lowest_frequency=BAND[0],
        highest_frequency=BAND[1],
        seed=7,
        scenario=scenario,
    )


def metrics(campaign: Campaign, row: int) -> iterator_pb2.IterationMetrics:
    return iterator_pb2.IterationMetrics(
        iteration=row + 1,
        channels=[
            iterator_pb2.ChannelMetrics(
                channel=name,
                relative_rms_error=campaign.errors[row, i],
                rms_response=campaign.rms_responses[row, i],
                peak_ratio=campaign.peak_ratios[row, i],
                # What a response does that has the target's shape.
                damage_ratio=[campaign.rms_responses[row, i] ** slope for slope in (3, 5, 8)],
            )
            for i, name in enumerate(NAMES)
        ],
        overall_relative_rms_error=float(np.sqrt(np.mean(campaign.errors[row] ** 2))),
    )


def steps(campaign: Campaign, *, scenario: str = "") -> list[Message]:
    """Every committed step, in order."""
    count = len(campaign.drives)
    messages: list[Message] = [
        specification(campaign.target, iterations=count, scenario=scenario),
        description(),
        iterator_pb2.TargetInBand(samples=to_array(campaign.target)),
        recorder_pb2.RunPlanned(run="demo.identify", rig="front_axle", purpose="identification"),
        campaign.model,
    ]
    for row in range(count):
        run = f"demo.i{row + 1:02d}"
        messages += [
            recorder_pb2.RunPlanned(run=run, rig="front_axle", purpose=f"playback {row + 1}"),
            recorder_pb2.RunPlayed(run=run, rig="front_axle", epoch=1, blocks=2),
            iterator_pb2.IterationStep(
                iteration=row + 1,
                run=run,
                drive=to_record(drive_channels(), RATE, campaign.drives[row]),
                response=to_record(response_channels(), RATE, campaign.responses[row]),
                metrics=metrics(campaign, row),
                actuators=[
                    rig_pb2.ActuatorUse(
                        drive=channel.name,
                        peak_command_ratio=float(np.abs(campaign.drives[row][i]).max() / channel.maximum),
                        saturated_share=0.001 * i,
                        largest_following_error=1e-4 * (i + 1),
                    )
                    for i, channel in enumerate(drive_channels())
                ],
                inverse_frf=to_array(np.zeros((3, 6, 6), dtype=complex)),
                response_in_band=to_array(in_band(campaign.responses[row])),
            ),
        ]
    best = int(np.argmin(np.sqrt(np.mean(campaign.errors**2, axis=1)))) + 1
    messages += [
        iterator_pb2.CampaignStatus(
            id="demo",
            phase=iterator_pb2.CAMPAIGN_PHASE_FINISHED,
            activity="finished",
            fraction=1.0,
            iterations=[metrics(campaign, row) for row in range(count)],
            outcome=iterator_pb2.OUTCOME_ITERATIONS_USED,
            best_iteration=best,
            remarks=["Playback 2: The drive of left_lateral would have passed its slew limit."],
        ),
        recorder_pb2.RecordingClosed(reason="finished"),
    ]
    return messages


def signal_blocks(drive: np.ndarray, response: np.ndarray, *, run: str, size: int = 100) -> list[rig_pb2.SignalBlock]:
    starts = range(0, drive.shape[1], size)
    return [
        rig_pb2.SignalBlock(
            run=run,
            first_sample=first,
            sample_rate=RATE,
            drive=to_array(np.ascontiguousarray(drive[:, first : first + size])),
            response=to_array(np.ascontiguousarray(response[:, first : first + size])),
            last=first + size >= drive.shape[1],
        )
        for first in starts
    ]


SIGNALS = "duralab/v1/local/rig/front_axle/signal"


def write(
    path: Path,
    messages: list[Message],
    *,
    finish: bool = True,
    chunk_size: int = 1 << 20,
    epochs: dict[int, list[rig_pb2.SignalBlock]] | None = None,
    part: tuple[str, int] | None = None,
    next_file: str = "",
    reason: str = "",
) -> Path:
    """Write messages on the topics of the recorder, with the standard MCAP writer; those of epochs after the others.

    Blocks among the messages are of epoch 1, as the steps say of every playback.
    Where a part is given, recording and number, the file says at its start and at its end what a recorder's says.
    """
    told = [(message, "1" if isinstance(message, rig_pb2.SignalBlock) else "") for message in messages]
    told += [(block, str(epoch)) for epoch, blocks in (epochs or {}).items() for block in blocks]
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=chunk_size)
        writer.start(profile="duralab")
        if part is not None:
            writer.add_metadata("part", {"recording": part[0], "number": str(part[1])})
        channels: dict[tuple[str, str], int] = {}
        for number, (message, epoch) in enumerate(told):
            descriptor = message.DESCRIPTOR
            is_signal = isinstance(message, rig_pb2.SignalBlock)
            topic = f"{SIGNALS}/{message.run}" if is_signal else f"step/{descriptor.name}"
            if (topic, epoch) not in channels:
                files = FileDescriptorSet()
                descriptor.file.CopyToProto(files.file.add())
                schema = writer.register_schema(descriptor.full_name, "protobuf", files.SerializeToString())
                metadata = {"epoch": epoch} if epoch else {}
                channels[topic, epoch] = writer.register_channel(topic, "protobuf", schema, metadata)
            channel = channels[topic, epoch]
            writer.add_message(channel, log_time=number, publish_time=number, data=message.SerializeToString())
        if finish:
            if part is not None:
                writer.add_metadata("summary", {"recording": part[0], "reason": reason, "next_file": next_file})
            writer.finish()
        else:
            writer.flush()
    return path


def recording(path: Path, **options: float) -> tuple[Path, Campaign]:
    campaign = make(**options)  # type: ignore[arg-type]
    return write(path, steps(campaign)), campaign
