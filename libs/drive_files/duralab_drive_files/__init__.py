"""Drive and response files of rig controllers: RPC III, the channel map, outbox, inbox and alignment."""

from duralab_drive_files.alignment import Alignment, align
from duralab_drive_files.controller_map import ControllerMap, MappedChannel, read_controller_map
from duralab_drive_files.errors import DriveFileError, opened, require_file
from duralab_drive_files.inbox import AcceptedResponse, Inbox, judged
from duralab_drive_files.outbox import Order, Outbox, drive_faults, drive_hash, read_order
from duralab_drive_files.rates import resampled, sampled_at
from duralab_drive_files.rpc3_header import ByteOrder, DataType, TimeType
from duralab_drive_files.rpc3_reading import open_rpc3, read_rpc3
from duralab_drive_files.rpc3_writing import Rpc3Settings, write_rpc3
from duralab_drive_files.time_history import TimeHistory, rate_of_step, unique_names
from duralab_drive_files.wheel_force import WheelForceConvention, moments_about, wheel_force_signs

__all__ = [
    "AcceptedResponse",
    "Alignment",
    "ByteOrder",
    "ControllerMap",
    "DataType",
    "DriveFileError",
    "Inbox",
    "MappedChannel",
    "Order",
    "Outbox",
    "Rpc3Settings",
    "TimeHistory",
    "TimeType",
    "WheelForceConvention",
    "align",
    "drive_faults",
    "drive_hash",
    "judged",
    "moments_about",
    "open_rpc3",
    "opened",
    "rate_of_step",
    "read_controller_map",
    "read_order",
    "read_rpc3",
    "require_file",
    "resampled",
    "sampled_at",
    "unique_names",
    "wheel_force_signs",
    "write_rpc3",
]
