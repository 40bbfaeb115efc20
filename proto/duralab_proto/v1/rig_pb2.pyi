from duralab_proto.v1 import array_pb2 as _array_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class ShapeRole(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    SHAPE_ROLE_UNSPECIFIED: _ClassVar[ShapeRole]
    SHAPE_ROLE_SPECIMEN: _ClassVar[ShapeRole]
    SHAPE_ROLE_WHEEL: _ClassVar[ShapeRole]
    SHAPE_ROLE_PISTON: _ClassVar[ShapeRole]
    SHAPE_ROLE_CYLINDER: _ClassVar[ShapeRole]

class LinkKind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    LINK_KIND_UNSPECIFIED: _ClassVar[LinkKind]
    LINK_KIND_ACTUATOR: _ClassVar[LinkKind]
    LINK_KIND_STRUT: _ClassVar[LinkKind]
    LINK_KIND_ROD: _ClassVar[LinkKind]
    LINK_KIND_ANTI_ROLL_BAR: _ClassVar[LinkKind]

class RigMode(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    RIG_MODE_UNSPECIFIED: _ClassVar[RigMode]
    RIG_MODE_IDLE: _ClassVar[RigMode]
    RIG_MODE_SETTLING: _ClassVar[RigMode]
    RIG_MODE_PLAYING: _ClassVar[RigMode]
    RIG_MODE_INTERLOCKED: _ClassVar[RigMode]
    RIG_MODE_RAMPING_DOWN: _ClassVar[RigMode]
    RIG_MODE_WAITING: _ClassVar[RigMode]
SHAPE_ROLE_UNSPECIFIED: ShapeRole
SHAPE_ROLE_SPECIMEN: ShapeRole
SHAPE_ROLE_WHEEL: ShapeRole
SHAPE_ROLE_PISTON: ShapeRole
SHAPE_ROLE_CYLINDER: ShapeRole
LINK_KIND_UNSPECIFIED: LinkKind
LINK_KIND_ACTUATOR: LinkKind
LINK_KIND_STRUT: LinkKind
LINK_KIND_ROD: LinkKind
LINK_KIND_ANTI_ROLL_BAR: LinkKind
RIG_MODE_UNSPECIFIED: RigMode
RIG_MODE_IDLE: RigMode
RIG_MODE_SETTLING: RigMode
RIG_MODE_PLAYING: RigMode
RIG_MODE_INTERLOCKED: RigMode
RIG_MODE_RAMPING_DOWN: RigMode
RIG_MODE_WAITING: RigMode

class DescriptionRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class RigDescription(_message.Message):
    __slots__ = ("rig", "specimen", "engine", "version", "sample_rate", "drives", "responses", "longest_drive_seconds", "static_response", "block_samples", "bodies", "content_hash", "shapes", "links", "rest_poses", "publishes_after_run", "cannot_be_stopped", "simulated")
    RIG_FIELD_NUMBER: _ClassVar[int]
    SPECIMEN_FIELD_NUMBER: _ClassVar[int]
    ENGINE_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    SAMPLE_RATE_FIELD_NUMBER: _ClassVar[int]
    DRIVES_FIELD_NUMBER: _ClassVar[int]
    RESPONSES_FIELD_NUMBER: _ClassVar[int]
    LONGEST_DRIVE_SECONDS_FIELD_NUMBER: _ClassVar[int]
    STATIC_RESPONSE_FIELD_NUMBER: _ClassVar[int]
    BLOCK_SAMPLES_FIELD_NUMBER: _ClassVar[int]
    BODIES_FIELD_NUMBER: _ClassVar[int]
    CONTENT_HASH_FIELD_NUMBER: _ClassVar[int]
    SHAPES_FIELD_NUMBER: _ClassVar[int]
    LINKS_FIELD_NUMBER: _ClassVar[int]
    REST_POSES_FIELD_NUMBER: _ClassVar[int]
    PUBLISHES_AFTER_RUN_FIELD_NUMBER: _ClassVar[int]
    CANNOT_BE_STOPPED_FIELD_NUMBER: _ClassVar[int]
    SIMULATED_FIELD_NUMBER: _ClassVar[int]
    rig: str
    specimen: str
    engine: str
    version: str
    sample_rate: float
    drives: _containers.RepeatedCompositeFieldContainer[_array_pb2.Channel]
    responses: _containers.RepeatedCompositeFieldContainer[_array_pb2.Channel]
    longest_drive_seconds: float
    static_response: _array_pb2.Array
    block_samples: int
    bodies: _containers.RepeatedScalarFieldContainer[str]
    content_hash: str
    shapes: _containers.RepeatedCompositeFieldContainer[RigShape]
    links: _containers.RepeatedCompositeFieldContainer[RigLink]
    rest_poses: _array_pb2.Array
    publishes_after_run: bool
    cannot_be_stopped: bool
    simulated: bool
    def __init__(self, rig: _Optional[str] = ..., specimen: _Optional[str] = ..., engine: _Optional[str] = ..., version: _Optional[str] = ..., sample_rate: _Optional[float] = ..., drives: _Optional[_Iterable[_Union[_array_pb2.Channel, _Mapping]]] = ..., responses: _Optional[_Iterable[_Union[_array_pb2.Channel, _Mapping]]] = ..., longest_drive_seconds: _Optional[float] = ..., static_response: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., block_samples: _Optional[int] = ..., bodies: _Optional[_Iterable[str]] = ..., content_hash: _Optional[str] = ..., shapes: _Optional[_Iterable[_Union[RigShape, _Mapping]]] = ..., links: _Optional[_Iterable[_Union[RigLink, _Mapping]]] = ..., rest_poses: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., publishes_after_run: _Optional[bool] = ..., cannot_be_stopped: _Optional[bool] = ..., simulated: _Optional[bool] = ...) -> None: ...

class RigShape(_message.Message):
    __slots__ = ("name", "body", "role", "pose", "box", "cylinder", "sphere", "mesh")
    NAME_FIELD_NUMBER: _ClassVar[int]
    BODY_FIELD_NUMBER: _ClassVar[int]
    ROLE_FIELD_NUMBER: _ClassVar[int]
    POSE_FIELD_NUMBER: _ClassVar[int]
    BOX_FIELD_NUMBER: _ClassVar[int]
    CYLINDER_FIELD_NUMBER: _ClassVar[int]
    SPHERE_FIELD_NUMBER: _ClassVar[int]
    MESH_FIELD_NUMBER: _ClassVar[int]
    name: str
    body: str
    role: ShapeRole
    pose: _array_pb2.Array
    box: BoxShape
    cylinder: CylinderShape
    sphere: SphereShape
    mesh: MeshShape
    def __init__(self, name: _Optional[str] = ..., body: _Optional[str] = ..., role: _Optional[_Union[ShapeRole, str]] = ..., pose: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., box: _Optional[_Union[BoxShape, _Mapping]] = ..., cylinder: _Optional[_Union[CylinderShape, _Mapping]] = ..., sphere: _Optional[_Union[SphereShape, _Mapping]] = ..., mesh: _Optional[_Union[MeshShape, _Mapping]] = ...) -> None: ...

class BoxShape(_message.Message):
    __slots__ = ("x", "y", "z")
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    Z_FIELD_NUMBER: _ClassVar[int]
    x: float
    y: float
    z: float
    def __init__(self, x: _Optional[float] = ..., y: _Optional[float] = ..., z: _Optional[float] = ...) -> None: ...

class CylinderShape(_message.Message):
    __slots__ = ("radius", "length")
    RADIUS_FIELD_NUMBER: _ClassVar[int]
    LENGTH_FIELD_NUMBER: _ClassVar[int]
    radius: float
    length: float
    def __init__(self, radius: _Optional[float] = ..., length: _Optional[float] = ...) -> None: ...

class SphereShape(_message.Message):
    __slots__ = ("radius",)
    RADIUS_FIELD_NUMBER: _ClassVar[int]
    radius: float
    def __init__(self, radius: _Optional[float] = ...) -> None: ...

class MeshShape(_message.Message):
    __slots__ = ("vertices", "corners")
    VERTICES_FIELD_NUMBER: _ClassVar[int]
    CORNERS_FIELD_NUMBER: _ClassVar[int]
    vertices: _array_pb2.Array
    corners: _containers.RepeatedScalarFieldContainer[int]
    def __init__(self, vertices: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., corners: _Optional[_Iterable[int]] = ...) -> None: ...

class RigLink(_message.Message):
    __slots__ = ("name", "kind", "body_a", "point_a", "body_b", "point_b")
    NAME_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    BODY_A_FIELD_NUMBER: _ClassVar[int]
    POINT_A_FIELD_NUMBER: _ClassVar[int]
    BODY_B_FIELD_NUMBER: _ClassVar[int]
    POINT_B_FIELD_NUMBER: _ClassVar[int]
    name: str
    kind: LinkKind
    body_a: str
    point_a: _array_pb2.Array
    body_b: str
    point_b: _array_pb2.Array
    def __init__(self, name: _Optional[str] = ..., kind: _Optional[_Union[LinkKind, str]] = ..., body_a: _Optional[str] = ..., point_a: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., body_b: _Optional[str] = ..., point_b: _Optional[_Union[_array_pb2.Array, _Mapping]] = ...) -> None: ...

class RigFrfRequest(_message.Message):
    __slots__ = ("frequency",)
    FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    frequency: _array_pb2.Array
    def __init__(self, frequency: _Optional[_Union[_array_pb2.Array, _Mapping]] = ...) -> None: ...

class RigFrf(_message.Message):
    __slots__ = ("rig", "frequency", "frf", "content_hash")
    RIG_FIELD_NUMBER: _ClassVar[int]
    FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    FRF_FIELD_NUMBER: _ClassVar[int]
    CONTENT_HASH_FIELD_NUMBER: _ClassVar[int]
    rig: str
    frequency: _array_pb2.Array
    frf: _array_pb2.Array
    content_hash: str
    def __init__(self, rig: _Optional[str] = ..., frequency: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., frf: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., content_hash: _Optional[str] = ...) -> None: ...

class PlayRequest(_message.Message):
    __slots__ = ("run", "drive", "seed", "real_time")
    RUN_FIELD_NUMBER: _ClassVar[int]
    DRIVE_FIELD_NUMBER: _ClassVar[int]
    SEED_FIELD_NUMBER: _ClassVar[int]
    REAL_TIME_FIELD_NUMBER: _ClassVar[int]
    run: str
    drive: _array_pb2.Record
    seed: int
    real_time: bool
    def __init__(self, run: _Optional[str] = ..., drive: _Optional[_Union[_array_pb2.Record, _Mapping]] = ..., seed: _Optional[int] = ..., real_time: _Optional[bool] = ...) -> None: ...

class PlayResult(_message.Message):
    __slots__ = ("run", "response", "actuators", "epoch", "blocks", "real_time_factor", "warnings", "alignment")
    RUN_FIELD_NUMBER: _ClassVar[int]
    RESPONSE_FIELD_NUMBER: _ClassVar[int]
    ACTUATORS_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    BLOCKS_FIELD_NUMBER: _ClassVar[int]
    REAL_TIME_FACTOR_FIELD_NUMBER: _ClassVar[int]
    WARNINGS_FIELD_NUMBER: _ClassVar[int]
    ALIGNMENT_FIELD_NUMBER: _ClassVar[int]
    run: str
    response: _array_pb2.Record
    actuators: _containers.RepeatedCompositeFieldContainer[ActuatorUse]
    epoch: int
    blocks: int
    real_time_factor: float
    warnings: _containers.RepeatedScalarFieldContainer[str]
    alignment: Alignment
    def __init__(self, run: _Optional[str] = ..., response: _Optional[_Union[_array_pb2.Record, _Mapping]] = ..., actuators: _Optional[_Iterable[_Union[ActuatorUse, _Mapping]]] = ..., epoch: _Optional[int] = ..., blocks: _Optional[int] = ..., real_time_factor: _Optional[float] = ..., warnings: _Optional[_Iterable[str]] = ..., alignment: _Optional[_Union[Alignment, _Mapping]] = ...) -> None: ...

class Alignment(_message.Message):
    __slots__ = ("lag", "drift", "commands")
    LAG_FIELD_NUMBER: _ClassVar[int]
    DRIFT_FIELD_NUMBER: _ClassVar[int]
    COMMANDS_FIELD_NUMBER: _ClassVar[int]
    lag: float
    drift: float
    commands: _containers.RepeatedCompositeFieldContainer[CommandFit]
    def __init__(self, lag: _Optional[float] = ..., drift: _Optional[float] = ..., commands: _Optional[_Iterable[_Union[CommandFit, _Mapping]]] = ...) -> None: ...

class CommandFit(_message.Message):
    __slots__ = ("drive", "gain", "offset", "correlation")
    DRIVE_FIELD_NUMBER: _ClassVar[int]
    GAIN_FIELD_NUMBER: _ClassVar[int]
    OFFSET_FIELD_NUMBER: _ClassVar[int]
    CORRELATION_FIELD_NUMBER: _ClassVar[int]
    drive: str
    gain: float
    offset: float
    correlation: float
    def __init__(self, drive: _Optional[str] = ..., gain: _Optional[float] = ..., offset: _Optional[float] = ..., correlation: _Optional[float] = ...) -> None: ...

class ActuatorUse(_message.Message):
    __slots__ = ("drive", "peak_command_ratio", "saturated_share", "largest_following_error", "largest_load_pressure_share", "lowest_supply_pressure")
    DRIVE_FIELD_NUMBER: _ClassVar[int]
    PEAK_COMMAND_RATIO_FIELD_NUMBER: _ClassVar[int]
    SATURATED_SHARE_FIELD_NUMBER: _ClassVar[int]
    LARGEST_FOLLOWING_ERROR_FIELD_NUMBER: _ClassVar[int]
    LARGEST_LOAD_PRESSURE_SHARE_FIELD_NUMBER: _ClassVar[int]
    LOWEST_SUPPLY_PRESSURE_FIELD_NUMBER: _ClassVar[int]
    drive: str
    peak_command_ratio: float
    saturated_share: float
    largest_following_error: float
    largest_load_pressure_share: float
    lowest_supply_pressure: float
    def __init__(self, drive: _Optional[str] = ..., peak_command_ratio: _Optional[float] = ..., saturated_share: _Optional[float] = ..., largest_following_error: _Optional[float] = ..., largest_load_pressure_share: _Optional[float] = ..., lowest_supply_pressure: _Optional[float] = ...) -> None: ...

class StopRequest(_message.Message):
    __slots__ = ("reason",)
    REASON_FIELD_NUMBER: _ClassVar[int]
    reason: str
    def __init__(self, reason: _Optional[str] = ...) -> None: ...

class ResetRequest(_message.Message):
    __slots__ = ("command", "name", "reason")
    COMMAND_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    command: str
    name: str
    reason: str
    def __init__(self, command: _Optional[str] = ..., name: _Optional[str] = ..., reason: _Optional[str] = ...) -> None: ...

class RigState(_message.Message):
    __slots__ = ("rig", "mode", "reason", "run", "fraction", "reset_name", "reset_reason")
    RIG_FIELD_NUMBER: _ClassVar[int]
    MODE_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    RUN_FIELD_NUMBER: _ClassVar[int]
    FRACTION_FIELD_NUMBER: _ClassVar[int]
    RESET_NAME_FIELD_NUMBER: _ClassVar[int]
    RESET_REASON_FIELD_NUMBER: _ClassVar[int]
    rig: str
    mode: RigMode
    reason: str
    run: str
    fraction: float
    reset_name: str
    reset_reason: str
    def __init__(self, rig: _Optional[str] = ..., mode: _Optional[_Union[RigMode, str]] = ..., reason: _Optional[str] = ..., run: _Optional[str] = ..., fraction: _Optional[float] = ..., reset_name: _Optional[str] = ..., reset_reason: _Optional[str] = ...) -> None: ...

class StateRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class SignalBlock(_message.Message):
    __slots__ = ("run", "first_sample", "sample_rate", "drive", "response", "last")
    RUN_FIELD_NUMBER: _ClassVar[int]
    FIRST_SAMPLE_FIELD_NUMBER: _ClassVar[int]
    SAMPLE_RATE_FIELD_NUMBER: _ClassVar[int]
    DRIVE_FIELD_NUMBER: _ClassVar[int]
    RESPONSE_FIELD_NUMBER: _ClassVar[int]
    LAST_FIELD_NUMBER: _ClassVar[int]
    run: str
    first_sample: int
    sample_rate: float
    drive: _array_pb2.Array
    response: _array_pb2.Array
    last: bool
    def __init__(self, run: _Optional[str] = ..., first_sample: _Optional[int] = ..., sample_rate: _Optional[float] = ..., drive: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., response: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., last: _Optional[bool] = ...) -> None: ...

class PoseBlock(_message.Message):
    __slots__ = ("run", "time", "poses")
    RUN_FIELD_NUMBER: _ClassVar[int]
    TIME_FIELD_NUMBER: _ClassVar[int]
    POSES_FIELD_NUMBER: _ClassVar[int]
    run: str
    time: _array_pb2.Array
    poses: _array_pb2.Array
    def __init__(self, run: _Optional[str] = ..., time: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., poses: _Optional[_Union[_array_pb2.Array, _Mapping]] = ...) -> None: ...
