"""Sensors and calculated channels of one rig, and the completion of its description with them."""

from __future__ import annotations

import hashlib
from datetime import date

import numpy as np
from pydantic import Field

from duralab_gateway.channels.calculated import CalculatedChannel, weighted_sum
from duralab_gateway.channels.sensors import SensorSettings, check_sensor
from duralab_proto.arrays import from_array, to_array
from duralab_proto.v1 import array_pb2, rig_pb2
from duralab_settings import Section


class ChannelTable(Section):
    """Additions of a configuration to the responses of a rig."""

    sensors: dict[str, SensorSettings] = Field(default_factory=dict, description="Sensor of a response, by its name.")
    calculated: tuple[CalculatedChannel, ...] = Field(
        default=(), strict=False, description="Responses that are calculated from the measured ones."
    )

    def complete(self, given: rig_pb2.RigDescription, *, today: date) -> rig_pb2.RigDescription:
        """Return a complete description with sensors and calculated responses, with a new content hash.

        Parameters
        ----------
        given : rig_pb2.RigDescription
            Description with static response and content hash; not changed.
        today : date
            Present day; no calibration may be later.

        Returns
        -------
        rig_pb2.RigDescription
            Completed description; calculated responses follow the measured ones.

        Raises
        ------
        ValueError
            A channel is missing or exists twice, a unit does not convert, or a sensor is not possible; one sentence.
        """
        description = rig_pb2.RigDescription()
        description.CopyFrom(given)
        measured = {channel.name: channel for channel in description.responses}
        if unknown := [name for name in self.sensors if name not in measured]:
            raise ValueError(f"there is no response {', '.join(unknown)}; there are {', '.join(measured)}.")
        for name, sensor in self.sensors.items():
            channel = measured[name]
            channel.sensor.CopyFrom(sensor.to_message())
            if sensor.minimum is not None and sensor.maximum is not None:
                channel.minimum, channel.maximum = sensor.minimum, sensor.maximum
        known = dict(measured)
        for calculated in self.calculated:
            if calculated.name in known:
                raise ValueError(f"{calculated.name} is calculated, and exists already; give it another name.")
            known[calculated.name] = calculated.describe(measured)
        description.responses.extend(list(known.values())[len(measured) :])
        drives = tuple(channel.name for channel in description.drives)
        for channel in description.responses:
            check_sensor(channel, drives=drives, today=today)
        if self.calculated:
            static = from_array(given.static_response, field="static_response")
            rows = [weighted_sum(factors, static) for factors in self.rows(description)]
            description.static_response.CopyFrom(to_array(np.concatenate([static, rows])))
        if self.sensors or self.calculated:
            content = f"{given.content_hash}\n{self.model_dump_json()}"
            description.content_hash = hashlib.sha256(content.encode()).hexdigest()
        return description

    def rows(self, description: rig_pb2.RigDescription) -> list[dict[int, float]]:
        """Return the factors of each calculated response by the row of the measured one.

        Parameters
        ----------
        description : rig_pb2.RigDescription
            Description from `complete`.

        Returns
        -------
        list of dict
            Factors in the order of the calculated responses.
        """
        row = {channel.name: index for index, channel in enumerate(description.responses)}
        calculated: list[array_pb2.Channel] = list(description.responses)[len(row) - len(self.calculated) :]
        return [
            {row[term.channel]: term.weight for term in channel.calculated}
            for channel in (calculated if self.calculated else ())
        ]
