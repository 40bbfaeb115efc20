"""A map of two drives, a rig that answers in closed form, and a controller that plays well."""

import numpy as np

from duralab_drive_files import Rpc3Settings, TimeHistory, read_controller_map, read_rpc3, sampled_at, write_rpc3

RATE = 500.0
MAP = """
rig: beam
sample_rate: 500
controller_rate: 512
lead: 0.5
drives:
  lift: {channel: Lift, kind: displacement, unit: mm, sign: -1, minimum: -100, maximum: 100, slew_limit: 5000,
         recorded_command: Lift Cmd}
  push: {channel: Push, kind: force, unit: kN, minimum: -20, maximum: 20, slew_limit: 1000, recorded_command: Push Cmd}
responses:
  strain: {channel: SG 1, kind: strain, unit: microstrain, minimum: -200000, maximum: 200000}
  load: {channel: Load, kind: force, unit: kN, offset: 0.2, minimum: -50, maximum: 50}
"""
MIX = np.array([[2.0e-2, 3.0e-8], [2.0e4, 0.4]])


def beam_map(folder, text=MAP):
    path = folder / "beam.yaml"
    path.write_text(text)
    return read_controller_map(path)


def gentle(seconds=4.0, seed=0, highest=15.0):
    """A drive of random lines below `highest` Hz that begins and ends at zero."""
    random, count = np.random.default_rng(seed), round(RATE * seconds)
    time = np.arange(count) / RATE
    lines = np.arange(1.0, highest, 0.5)
    phases = random.uniform(0.0, 2.0 * np.pi, (2, lines.size, 1))
    drive = np.sin(2.0 * np.pi * lines[:, None] * time + phases).sum(axis=1) * np.sin(np.pi * time / time[-1]) ** 2
    return drive / np.abs(drive).max(axis=1, keepdims=True) * [[0.05], [10000.0]]


def recorded(
    controller_map, order, *, delay=37.4, gain=1.005, rate=1024.0, change=lambda rows: rows, ppm=0.0, end=None
):
    """Return what a controller records of its drive file: commands and responses, late, at its rate."""
    history = read_rpc3(controller_map.exchange / "outbox" / order.drive_file)
    drive = controller_map.drives_from_controller(history)
    played = change(gain * drive)
    both = np.vstack([played, MIX @ played])
    seconds = history.samples.shape[1] / history.sample_rate + delay / RATE if end is None else end
    times = np.arange(int(seconds * rate)) / rate * (1.0 + 1e-6 * ppm) - delay / RATE
    late = sampled_at(both, history.sample_rate, times, new_rate=rate)
    rows = np.vstack([controller_map.drives_to_controller(late[:2]), controller_map.responses_to_controller(late[2:])])
    return TimeHistory(order.wanted_channels, ("mm", "kN", "microstrain", "kN"), rate, rows)


def save(controller_map, order, history, **settings):
    path = controller_map.exchange / "inbox" / order.response_file
    write_rpc3(history, path, Rpc3Settings(**settings))
    return path
