"""A linear rig of two drives and two responses as the contract describes it, and campaigns for it."""

import numpy as np

from duralab_proto.arrays import to_array, to_record
from duralab_proto.v1 import array_pb2, identifier_pb2, iterator_pb2, rig_pb2

if __package__:
    from .linear_plants import BLOCK, SAMPLE_RATE, frequency_response, impulse_responses, noise_target
else:
    from linear_plants import BLOCK, SAMPLE_RATE, frequency_response, impulse_responses, noise_target

STATIC = np.array([3600.0, 20.0])
DRIVES = [
    array_pb2.Channel(name=name, unit="m", minimum=-0.5, maximum=0.5, slew_limit=100.0) for name in ("left", "right")
]
RESPONSES = [
    array_pb2.Channel(name=name, unit="N", minimum=-1e6, maximum=1e6) for name in ("left_vertical", "right_vertical")
]


def description(rig="front"):
    return rig_pb2.RigDescription(
        rig=rig,
        specimen="two coupled channels",
        engine="fake",
        version="1",
        sample_rate=SAMPLE_RATE,
        drives=DRIVES,
        responses=RESPONSES,
        longest_drive_seconds=120.0,
        static_response=to_array(STATIC),
        block_samples=100,
        content_hash="linear",
        simulated=True,
    )


def exact_model(request):
    frequency, frf = frequency_response(impulse_responses(), request.estimator.block_samples)
    outside = (frequency < 1.0) | (frequency > 70.0)
    frf[outside] = 0.0
    return identifier_pb2.Model(
        id="0" * 64,
        rig=request.rig,
        drives=DRIVES,
        responses=RESPONSES,
        sample_rate=SAMPLE_RATE,
        frequency=to_array(frequency),
        frf=to_array(frf),
        coherence=to_array(np.ones(frf.shape[:2])),
        rig_content_hash="linear",
        run=request.run,
        signal_epoch=7,
        signal_blocks=3,
    )


def experiment_plan(request):
    spectrum = request.excitation.spectrum
    return identifier_pb2.ExperimentPlan(
        duration_seconds=request.excitation.duration,
        realisations=2,
        experiments_per_realisation=2,
        frequency_resolution=SAMPLE_RATE / max(1, request.estimator.block_samples),
        lowest_frequency=spectrum.lowest_frequency,
        highest_frequency=spectrum.highest_frequency,
    )


def specification(id="try", *, rig="front", samples=8000, iterations=3, gain=(0.5, 0.5), level=(900.0, 40.0)):
    return iterator_pb2.CampaignSpec(
        id=id,
        rig=rig,
        target=to_record(RESPONSES, SAMPLE_RATE, noise_target(samples, level=level) + 500.0),
        target_source="noise",
        excitation=identifier_pb2.Excitation(
            kind=identifier_pb2.EXCITATION_KIND_PURE_RANDOM,
            spectrum=identifier_pb2.WhitePinkSpectrum(
                lowest_frequency=1.0, highest_frequency=70.0, corner_frequency=10.0, decibels_per_octave=3.0
            ),
            rms=to_array(np.array([0.01, 0.02])),
            duration=40.0,
            fade=1.0,
        ),
        estimator=identifier_pb2.Estimator(kind=identifier_pb2.ESTIMATOR_KIND_H1, block_samples=BLOCK, overlap=0.5),
        update=iterator_pb2.UpdateSettings(
            kind=iterator_pb2.UPDATE_KIND_ADAPTIVE_MODELLING,
            iteration_gain=to_array(np.array(gain)),
            smallest_correction=0.5,
            largest_correction=2.0,
            weigh_by_coherence=True,
            lowest_coherence=0.7,
        ),
        stop=iterator_pb2.StopCriteria(iterations=iterations),
        lowest_frequency=2.0,
        highest_frequency=60.0,
        seed=11,
        scenario="name: try\n",
    )
