"""Channels as described in a configuration: sensors with their levels, calculated channels."""

from duralab_gateway.channels.calculated import CalculatedChannel, weighted_sum
from duralab_gateway.channels.sensors import SensorSettings, check_sensor
from duralab_gateway.channels.table import ChannelTable

__all__ = [
    "CalculatedChannel",
    "ChannelTable",
    "SensorSettings",
    "check_sensor",
    "weighted_sum",
]
