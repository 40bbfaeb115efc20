from duralab_proto.v1 import array_pb2 as _array_pb2
from duralab_proto.v1 import identifier_pb2 as _identifier_pb2
from duralab_proto.v1 import query_pb2 as _query_pb2
from duralab_proto.v1 import rig_pb2 as _rig_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class UpdateKind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    UPDATE_KIND_UNSPECIFIED: _ClassVar[UpdateKind]
    UPDATE_KIND_BASIC_TWR: _ClassVar[UpdateKind]
    UPDATE_KIND_ADAPTIVE_MODELLING: _ClassVar[UpdateKind]
    UPDATE_KIND_SECANT: _ClassVar[UpdateKind]

class CorrectionPrediction(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    CORRECTION_PREDICTION_UNSPECIFIED: _ClassVar[CorrectionPrediction]
    CORRECTION_PREDICTION_FORWARD: _ClassVar[CorrectionPrediction]
    CORRECTION_PREDICTION_BACKWARD: _ClassVar[CorrectionPrediction]

class CorrectionShape(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    CORRECTION_SHAPE_UNSPECIFIED: _ClassVar[CorrectionShape]
    CORRECTION_SHAPE_DIAGONAL: _ClassVar[CorrectionShape]
    CORRECTION_SHAPE_FULL: _ClassVar[CorrectionShape]

class LimitPolicy(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    LIMIT_POLICY_UNSPECIFIED: _ClassVar[LimitPolicy]
    LIMIT_POLICY_REFUSE: _ClassVar[LimitPolicy]
    LIMIT_POLICY_PROJECT: _ClassVar[LimitPolicy]

class HoldPoint(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    HOLD_POINT_UNSPECIFIED: _ClassVar[HoldPoint]
    HOLD_POINT_NEVER: _ClassVar[HoldPoint]
    HOLD_POINT_FIRST: _ClassVar[HoldPoint]
    HOLD_POINT_EACH: _ClassVar[HoldPoint]
    HOLD_POINT_PREDICTED: _ClassVar[HoldPoint]

class CampaignPhase(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    CAMPAIGN_PHASE_UNSPECIFIED: _ClassVar[CampaignPhase]
    CAMPAIGN_PHASE_CHECKING: _ClassVar[CampaignPhase]
    CAMPAIGN_PHASE_IDENTIFYING: _ClassVar[CampaignPhase]
    CAMPAIGN_PHASE_ITERATING: _ClassVar[CampaignPhase]
    CAMPAIGN_PHASE_FINISHED: _ClassVar[CampaignPhase]
    CAMPAIGN_PHASE_FAULTED: _ClassVar[CampaignPhase]
    CAMPAIGN_PHASE_STOPPED: _ClassVar[CampaignPhase]
    CAMPAIGN_PHASE_CONFIRMING: _ClassVar[CampaignPhase]

class Outcome(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    OUTCOME_UNSPECIFIED: _ClassVar[Outcome]
    OUTCOME_REACHED: _ClassVar[Outcome]
    OUTCOME_ITERATIONS_USED: _ClassVar[Outcome]
    OUTCOME_DIVERGED: _ClassVar[Outcome]
    OUTCOME_NO_IMPROVEMENT: _ClassVar[Outcome]
    OUTCOME_DAMAGE_BUDGET_USED: _ClassVar[Outcome]
    OUTCOME_RESPONSE_STOOD_STILL: _ClassVar[Outcome]
    OUTCOME_BOUND_PASSED: _ClassVar[Outcome]
    OUTCOME_ENDED_AT_HOLD_POINT: _ClassVar[Outcome]

class DecisionKind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    DECISION_KIND_UNSPECIFIED: _ClassVar[DecisionKind]
    DECISION_KIND_PLAY: _ClassVar[DecisionKind]
    DECISION_KIND_CHANGE: _ClassVar[DecisionKind]
    DECISION_KIND_BACK: _ClassVar[DecisionKind]
    DECISION_KIND_END: _ClassVar[DecisionKind]

class PreTestVerdict(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    PRE_TEST_VERDICT_UNSPECIFIED: _ClassVar[PreTestVerdict]
    PRE_TEST_VERDICT_PASSED: _ClassVar[PreTestVerdict]
    PRE_TEST_VERDICT_FAILED: _ClassVar[PreTestVerdict]
    PRE_TEST_VERDICT_UNFINISHED: _ClassVar[PreTestVerdict]

class PreTestCheck(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    PRE_TEST_CHECK_UNSPECIFIED: _ClassVar[PreTestCheck]
    PRE_TEST_CHECK_CALIBRATION: _ClassVar[PreTestCheck]
    PRE_TEST_CHECK_NOISE: _ClassVar[PreTestCheck]
    PRE_TEST_CHECK_OFFSET: _ClassVar[PreTestCheck]
    PRE_TEST_CHECK_SATURATION: _ClassVar[PreTestCheck]
    PRE_TEST_CHECK_DEAD: _ClassVar[PreTestCheck]
    PRE_TEST_CHECK_POLARITY: _ClassVar[PreTestCheck]
    PRE_TEST_CHECK_SWAPPED: _ClassVar[PreTestCheck]
    PRE_TEST_CHECK_CROSS_TALK: _ClassVar[PreTestCheck]
    PRE_TEST_CHECK_LAG: _ClassVar[PreTestCheck]
    PRE_TEST_CHECK_GAIN: _ClassVar[PreTestCheck]
UPDATE_KIND_UNSPECIFIED: UpdateKind
UPDATE_KIND_BASIC_TWR: UpdateKind
UPDATE_KIND_ADAPTIVE_MODELLING: UpdateKind
UPDATE_KIND_SECANT: UpdateKind
CORRECTION_PREDICTION_UNSPECIFIED: CorrectionPrediction
CORRECTION_PREDICTION_FORWARD: CorrectionPrediction
CORRECTION_PREDICTION_BACKWARD: CorrectionPrediction
CORRECTION_SHAPE_UNSPECIFIED: CorrectionShape
CORRECTION_SHAPE_DIAGONAL: CorrectionShape
CORRECTION_SHAPE_FULL: CorrectionShape
LIMIT_POLICY_UNSPECIFIED: LimitPolicy
LIMIT_POLICY_REFUSE: LimitPolicy
LIMIT_POLICY_PROJECT: LimitPolicy
HOLD_POINT_UNSPECIFIED: HoldPoint
HOLD_POINT_NEVER: HoldPoint
HOLD_POINT_FIRST: HoldPoint
HOLD_POINT_EACH: HoldPoint
HOLD_POINT_PREDICTED: HoldPoint
CAMPAIGN_PHASE_UNSPECIFIED: CampaignPhase
CAMPAIGN_PHASE_CHECKING: CampaignPhase
CAMPAIGN_PHASE_IDENTIFYING: CampaignPhase
CAMPAIGN_PHASE_ITERATING: CampaignPhase
CAMPAIGN_PHASE_FINISHED: CampaignPhase
CAMPAIGN_PHASE_FAULTED: CampaignPhase
CAMPAIGN_PHASE_STOPPED: CampaignPhase
CAMPAIGN_PHASE_CONFIRMING: CampaignPhase
OUTCOME_UNSPECIFIED: Outcome
OUTCOME_REACHED: Outcome
OUTCOME_ITERATIONS_USED: Outcome
OUTCOME_DIVERGED: Outcome
OUTCOME_NO_IMPROVEMENT: Outcome
OUTCOME_DAMAGE_BUDGET_USED: Outcome
OUTCOME_RESPONSE_STOOD_STILL: Outcome
OUTCOME_BOUND_PASSED: Outcome
OUTCOME_ENDED_AT_HOLD_POINT: Outcome
DECISION_KIND_UNSPECIFIED: DecisionKind
DECISION_KIND_PLAY: DecisionKind
DECISION_KIND_CHANGE: DecisionKind
DECISION_KIND_BACK: DecisionKind
DECISION_KIND_END: DecisionKind
PRE_TEST_VERDICT_UNSPECIFIED: PreTestVerdict
PRE_TEST_VERDICT_PASSED: PreTestVerdict
PRE_TEST_VERDICT_FAILED: PreTestVerdict
PRE_TEST_VERDICT_UNFINISHED: PreTestVerdict
PRE_TEST_CHECK_UNSPECIFIED: PreTestCheck
PRE_TEST_CHECK_CALIBRATION: PreTestCheck
PRE_TEST_CHECK_NOISE: PreTestCheck
PRE_TEST_CHECK_OFFSET: PreTestCheck
PRE_TEST_CHECK_SATURATION: PreTestCheck
PRE_TEST_CHECK_DEAD: PreTestCheck
PRE_TEST_CHECK_POLARITY: PreTestCheck
PRE_TEST_CHECK_SWAPPED: PreTestCheck
PRE_TEST_CHECK_CROSS_TALK: PreTestCheck
PRE_TEST_CHECK_LAG: PreTestCheck
PRE_TEST_CHECK_GAIN: PreTestCheck

class SecantSettings(_message.Message):
    __slots__ = ("forgetting", "prior_strength", "caution", "regularisation", "odd_terms", "whole_record", "rate_limits", "speed_terms")
    FORGETTING_FIELD_NUMBER: _ClassVar[int]
    PRIOR_STRENGTH_FIELD_NUMBER: _ClassVar[int]
    CAUTION_FIELD_NUMBER: _ClassVar[int]
    REGULARISATION_FIELD_NUMBER: _ClassVar[int]
    ODD_TERMS_FIELD_NUMBER: _ClassVar[int]
    WHOLE_RECORD_FIELD_NUMBER: _ClassVar[int]
    RATE_LIMITS_FIELD_NUMBER: _ClassVar[int]
    SPEED_TERMS_FIELD_NUMBER: _ClassVar[int]
    forgetting: float
    prior_strength: float
    caution: float
    regularisation: float
    odd_terms: bool
    whole_record: bool
    rate_limits: bool
    speed_terms: bool
    def __init__(self, forgetting: _Optional[float] = ..., prior_strength: _Optional[float] = ..., caution: _Optional[float] = ..., regularisation: _Optional[float] = ..., odd_terms: _Optional[bool] = ..., whole_record: _Optional[bool] = ..., rate_limits: _Optional[bool] = ..., speed_terms: _Optional[bool] = ...) -> None: ...

class DriveMapSettings(_message.Message):
    __slots__ = ("learn",)
    LEARN_FIELD_NUMBER: _ClassVar[int]
    learn: bool
    def __init__(self, learn: _Optional[bool] = ...) -> None: ...

class UpdatePlugin(_message.Message):
    __slots__ = ("name", "settings")
    NAME_FIELD_NUMBER: _ClassVar[int]
    SETTINGS_FIELD_NUMBER: _ClassVar[int]
    name: str
    settings: str
    def __init__(self, name: _Optional[str] = ..., settings: _Optional[str] = ...) -> None: ...

class UpdateSettings(_message.Message):
    __slots__ = ("kind", "iteration_gain", "smallest_correction", "largest_correction", "weigh_by_coherence", "lowest_coherence", "accept_segments", "gain_schedule", "gain_curve_frequency", "gain_curve_share", "prediction", "correction", "secant", "weights", "drive_map", "plugin")
    KIND_FIELD_NUMBER: _ClassVar[int]
    ITERATION_GAIN_FIELD_NUMBER: _ClassVar[int]
    SMALLEST_CORRECTION_FIELD_NUMBER: _ClassVar[int]
    LARGEST_CORRECTION_FIELD_NUMBER: _ClassVar[int]
    WEIGH_BY_COHERENCE_FIELD_NUMBER: _ClassVar[int]
    LOWEST_COHERENCE_FIELD_NUMBER: _ClassVar[int]
    ACCEPT_SEGMENTS_FIELD_NUMBER: _ClassVar[int]
    GAIN_SCHEDULE_FIELD_NUMBER: _ClassVar[int]
    GAIN_CURVE_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    GAIN_CURVE_SHARE_FIELD_NUMBER: _ClassVar[int]
    PREDICTION_FIELD_NUMBER: _ClassVar[int]
    CORRECTION_FIELD_NUMBER: _ClassVar[int]
    SECANT_FIELD_NUMBER: _ClassVar[int]
    WEIGHTS_FIELD_NUMBER: _ClassVar[int]
    DRIVE_MAP_FIELD_NUMBER: _ClassVar[int]
    PLUGIN_FIELD_NUMBER: _ClassVar[int]
    kind: UpdateKind
    iteration_gain: _array_pb2.Array
    smallest_correction: float
    largest_correction: float
    weigh_by_coherence: bool
    lowest_coherence: float
    accept_segments: bool
    gain_schedule: _containers.RepeatedScalarFieldContainer[float]
    gain_curve_frequency: _array_pb2.Array
    gain_curve_share: _array_pb2.Array
    prediction: CorrectionPrediction
    correction: CorrectionShape
    secant: SecantSettings
    weights: _array_pb2.Array
    drive_map: DriveMapSettings
    plugin: UpdatePlugin
    def __init__(self, kind: _Optional[_Union[UpdateKind, str]] = ..., iteration_gain: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., smallest_correction: _Optional[float] = ..., largest_correction: _Optional[float] = ..., weigh_by_coherence: _Optional[bool] = ..., lowest_coherence: _Optional[float] = ..., accept_segments: _Optional[bool] = ..., gain_schedule: _Optional[_Iterable[float]] = ..., gain_curve_frequency: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., gain_curve_share: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., prediction: _Optional[_Union[CorrectionPrediction, str]] = ..., correction: _Optional[_Union[CorrectionShape, str]] = ..., secant: _Optional[_Union[SecantSettings, _Mapping]] = ..., weights: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., drive_map: _Optional[_Union[DriveMapSettings, _Mapping]] = ..., plugin: _Optional[_Union[UpdatePlugin, _Mapping]] = ...) -> None: ...

class StopCriteria(_message.Message):
    __slots__ = ("iterations", "relative_rms_error", "divergence_ratio", "smallest_damage_ratio", "largest_damage_ratio", "smallest_improvement", "improvement_playbacks", "damage_budget", "damage_exponent", "error_bound", "peak_bound", "damage_bound")
    ITERATIONS_FIELD_NUMBER: _ClassVar[int]
    RELATIVE_RMS_ERROR_FIELD_NUMBER: _ClassVar[int]
    DIVERGENCE_RATIO_FIELD_NUMBER: _ClassVar[int]
    SMALLEST_DAMAGE_RATIO_FIELD_NUMBER: _ClassVar[int]
    LARGEST_DAMAGE_RATIO_FIELD_NUMBER: _ClassVar[int]
    SMALLEST_IMPROVEMENT_FIELD_NUMBER: _ClassVar[int]
    IMPROVEMENT_PLAYBACKS_FIELD_NUMBER: _ClassVar[int]
    DAMAGE_BUDGET_FIELD_NUMBER: _ClassVar[int]
    DAMAGE_EXPONENT_FIELD_NUMBER: _ClassVar[int]
    ERROR_BOUND_FIELD_NUMBER: _ClassVar[int]
    PEAK_BOUND_FIELD_NUMBER: _ClassVar[int]
    DAMAGE_BOUND_FIELD_NUMBER: _ClassVar[int]
    iterations: int
    relative_rms_error: float
    divergence_ratio: float
    smallest_damage_ratio: float
    largest_damage_ratio: float
    smallest_improvement: float
    improvement_playbacks: int
    damage_budget: float
    damage_exponent: float
    error_bound: float
    peak_bound: float
    damage_bound: float
    def __init__(self, iterations: _Optional[int] = ..., relative_rms_error: _Optional[float] = ..., divergence_ratio: _Optional[float] = ..., smallest_damage_ratio: _Optional[float] = ..., largest_damage_ratio: _Optional[float] = ..., smallest_improvement: _Optional[float] = ..., improvement_playbacks: _Optional[int] = ..., damage_budget: _Optional[float] = ..., damage_exponent: _Optional[float] = ..., error_bound: _Optional[float] = ..., peak_bound: _Optional[float] = ..., damage_bound: _Optional[float] = ...) -> None: ...

class Acceptance(_message.Message):
    __slots__ = ("relative_rms_error", "peak_ratio", "damage_ratio", "damage_exponent", "energy_outside_band")
    RELATIVE_RMS_ERROR_FIELD_NUMBER: _ClassVar[int]
    PEAK_RATIO_FIELD_NUMBER: _ClassVar[int]
    DAMAGE_RATIO_FIELD_NUMBER: _ClassVar[int]
    DAMAGE_EXPONENT_FIELD_NUMBER: _ClassVar[int]
    ENERGY_OUTSIDE_BAND_FIELD_NUMBER: _ClassVar[int]
    relative_rms_error: float
    peak_ratio: _containers.RepeatedScalarFieldContainer[float]
    damage_ratio: _containers.RepeatedScalarFieldContainer[float]
    damage_exponent: float
    energy_outside_band: float
    def __init__(self, relative_rms_error: _Optional[float] = ..., peak_ratio: _Optional[_Iterable[float]] = ..., damage_ratio: _Optional[_Iterable[float]] = ..., damage_exponent: _Optional[float] = ..., energy_outside_band: _Optional[float] = ...) -> None: ...

class HoldSettings(_message.Message):
    __slots__ = ("when", "predicted_peak", "predicted_damage")
    WHEN_FIELD_NUMBER: _ClassVar[int]
    PREDICTED_PEAK_FIELD_NUMBER: _ClassVar[int]
    PREDICTED_DAMAGE_FIELD_NUMBER: _ClassVar[int]
    when: HoldPoint
    predicted_peak: float
    predicted_damage: float
    def __init__(self, when: _Optional[_Union[HoldPoint, str]] = ..., predicted_peak: _Optional[float] = ..., predicted_damage: _Optional[float] = ...) -> None: ...

class TargetStepChannel(_message.Message):
    __slots__ = ("channel", "energy_removed", "spikes", "damage_kept", "source", "source_unit", "stated_unit", "factor", "peak_before", "rms_before", "peak_after", "rms_after")
    CHANNEL_FIELD_NUMBER: _ClassVar[int]
    ENERGY_REMOVED_FIELD_NUMBER: _ClassVar[int]
    SPIKES_FIELD_NUMBER: _ClassVar[int]
    DAMAGE_KEPT_FIELD_NUMBER: _ClassVar[int]
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    SOURCE_UNIT_FIELD_NUMBER: _ClassVar[int]
    STATED_UNIT_FIELD_NUMBER: _ClassVar[int]
    FACTOR_FIELD_NUMBER: _ClassVar[int]
    PEAK_BEFORE_FIELD_NUMBER: _ClassVar[int]
    RMS_BEFORE_FIELD_NUMBER: _ClassVar[int]
    PEAK_AFTER_FIELD_NUMBER: _ClassVar[int]
    RMS_AFTER_FIELD_NUMBER: _ClassVar[int]
    channel: str
    energy_removed: float
    spikes: int
    damage_kept: float
    source: str
    source_unit: str
    stated_unit: str
    factor: float
    peak_before: float
    rms_before: float
    peak_after: float
    rms_after: float
    def __init__(self, channel: _Optional[str] = ..., energy_removed: _Optional[float] = ..., spikes: _Optional[int] = ..., damage_kept: _Optional[float] = ..., source: _Optional[str] = ..., source_unit: _Optional[str] = ..., stated_unit: _Optional[str] = ..., factor: _Optional[float] = ..., peak_before: _Optional[float] = ..., rms_before: _Optional[float] = ..., peak_after: _Optional[float] = ..., rms_after: _Optional[float] = ...) -> None: ...

class TargetSection(_message.Message):
    __slots__ = ("start_seconds", "end_seconds")
    START_SECONDS_FIELD_NUMBER: _ClassVar[int]
    END_SECONDS_FIELD_NUMBER: _ClassVar[int]
    start_seconds: float
    end_seconds: float
    def __init__(self, start_seconds: _Optional[float] = ..., end_seconds: _Optional[float] = ...) -> None: ...

class TargetStep(_message.Message):
    __slots__ = ("name", "settings", "finding", "samples_before", "samples_after", "sample_rate_before", "sample_rate_after", "channels", "sections", "left_out")
    NAME_FIELD_NUMBER: _ClassVar[int]
    SETTINGS_FIELD_NUMBER: _ClassVar[int]
    FINDING_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_BEFORE_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_AFTER_FIELD_NUMBER: _ClassVar[int]
    SAMPLE_RATE_BEFORE_FIELD_NUMBER: _ClassVar[int]
    SAMPLE_RATE_AFTER_FIELD_NUMBER: _ClassVar[int]
    CHANNELS_FIELD_NUMBER: _ClassVar[int]
    SECTIONS_FIELD_NUMBER: _ClassVar[int]
    LEFT_OUT_FIELD_NUMBER: _ClassVar[int]
    name: str
    settings: str
    finding: str
    samples_before: int
    samples_after: int
    sample_rate_before: float
    sample_rate_after: float
    channels: _containers.RepeatedCompositeFieldContainer[TargetStepChannel]
    sections: _containers.RepeatedCompositeFieldContainer[TargetSection]
    left_out: str
    def __init__(self, name: _Optional[str] = ..., settings: _Optional[str] = ..., finding: _Optional[str] = ..., samples_before: _Optional[int] = ..., samples_after: _Optional[int] = ..., sample_rate_before: _Optional[float] = ..., sample_rate_after: _Optional[float] = ..., channels: _Optional[_Iterable[_Union[TargetStepChannel, _Mapping]]] = ..., sections: _Optional[_Iterable[_Union[TargetSection, _Mapping]]] = ..., left_out: _Optional[str] = ...) -> None: ...

class FirstDrive(_message.Message):
    __slots__ = ("drive", "response", "source", "of_this_target")
    DRIVE_FIELD_NUMBER: _ClassVar[int]
    RESPONSE_FIELD_NUMBER: _ClassVar[int]
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    OF_THIS_TARGET_FIELD_NUMBER: _ClassVar[int]
    drive: _array_pb2.Record
    response: _array_pb2.Record
    source: str
    of_this_target: bool
    def __init__(self, drive: _Optional[_Union[_array_pb2.Record, _Mapping]] = ..., response: _Optional[_Union[_array_pb2.Record, _Mapping]] = ..., source: _Optional[str] = ..., of_this_target: _Optional[bool] = ...) -> None: ...

class KnownBefore(_message.Message):
    __slots__ = ("model", "model_source", "model_time", "largest_model_age", "learn_from", "first_drive")
    MODEL_FIELD_NUMBER: _ClassVar[int]
    MODEL_SOURCE_FIELD_NUMBER: _ClassVar[int]
    MODEL_TIME_FIELD_NUMBER: _ClassVar[int]
    LARGEST_MODEL_AGE_FIELD_NUMBER: _ClassVar[int]
    LEARN_FROM_FIELD_NUMBER: _ClassVar[int]
    FIRST_DRIVE_FIELD_NUMBER: _ClassVar[int]
    model: _identifier_pb2.Model
    model_source: str
    model_time: int
    largest_model_age: float
    learn_from: _containers.RepeatedScalarFieldContainer[str]
    first_drive: FirstDrive
    def __init__(self, model: _Optional[_Union[_identifier_pb2.Model, _Mapping]] = ..., model_source: _Optional[str] = ..., model_time: _Optional[int] = ..., largest_model_age: _Optional[float] = ..., learn_from: _Optional[_Iterable[str]] = ..., first_drive: _Optional[_Union[FirstDrive, _Mapping]] = ...) -> None: ...

class AtTarget(_message.Message):
    __slots__ = ("level", "duration")
    LEVEL_FIELD_NUMBER: _ClassVar[int]
    DURATION_FIELD_NUMBER: _ClassVar[int]
    level: float
    duration: float
    def __init__(self, level: _Optional[float] = ..., duration: _Optional[float] = ...) -> None: ...

class CampaignSpec(_message.Message):
    __slots__ = ("id", "rig", "target", "target_source", "excitation", "estimator", "update", "stop", "lowest_frequency", "highest_frequency", "seed", "scenario", "target_drive", "target_rig", "target_seed", "levels", "parent", "parent_iteration", "limit_policy", "lower_flank", "upper_flank", "largest_overrun", "confirmations", "target_steps", "real_time", "accept", "pre_test", "hold", "known", "at_target")
    ID_FIELD_NUMBER: _ClassVar[int]
    RIG_FIELD_NUMBER: _ClassVar[int]
    TARGET_FIELD_NUMBER: _ClassVar[int]
    TARGET_SOURCE_FIELD_NUMBER: _ClassVar[int]
    EXCITATION_FIELD_NUMBER: _ClassVar[int]
    ESTIMATOR_FIELD_NUMBER: _ClassVar[int]
    UPDATE_FIELD_NUMBER: _ClassVar[int]
    STOP_FIELD_NUMBER: _ClassVar[int]
    LOWEST_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    HIGHEST_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    SEED_FIELD_NUMBER: _ClassVar[int]
    SCENARIO_FIELD_NUMBER: _ClassVar[int]
    TARGET_DRIVE_FIELD_NUMBER: _ClassVar[int]
    TARGET_RIG_FIELD_NUMBER: _ClassVar[int]
    TARGET_SEED_FIELD_NUMBER: _ClassVar[int]
    LEVELS_FIELD_NUMBER: _ClassVar[int]
    PARENT_FIELD_NUMBER: _ClassVar[int]
    PARENT_ITERATION_FIELD_NUMBER: _ClassVar[int]
    LIMIT_POLICY_FIELD_NUMBER: _ClassVar[int]
    LOWER_FLANK_FIELD_NUMBER: _ClassVar[int]
    UPPER_FLANK_FIELD_NUMBER: _ClassVar[int]
    LARGEST_OVERRUN_FIELD_NUMBER: _ClassVar[int]
    CONFIRMATIONS_FIELD_NUMBER: _ClassVar[int]
    TARGET_STEPS_FIELD_NUMBER: _ClassVar[int]
    REAL_TIME_FIELD_NUMBER: _ClassVar[int]
    ACCEPT_FIELD_NUMBER: _ClassVar[int]
    PRE_TEST_FIELD_NUMBER: _ClassVar[int]
    HOLD_FIELD_NUMBER: _ClassVar[int]
    KNOWN_FIELD_NUMBER: _ClassVar[int]
    AT_TARGET_FIELD_NUMBER: _ClassVar[int]
    id: str
    rig: str
    target: _array_pb2.Record
    target_source: str
    excitation: _identifier_pb2.Excitation
    estimator: _identifier_pb2.Estimator
    update: UpdateSettings
    stop: StopCriteria
    lowest_frequency: float
    highest_frequency: float
    seed: int
    scenario: str
    target_drive: _array_pb2.Record
    target_rig: str
    target_seed: int
    levels: _containers.RepeatedScalarFieldContainer[float]
    parent: str
    parent_iteration: int
    limit_policy: LimitPolicy
    lower_flank: float
    upper_flank: float
    largest_overrun: float
    confirmations: int
    target_steps: _containers.RepeatedCompositeFieldContainer[TargetStep]
    real_time: bool
    accept: Acceptance
    pre_test: float
    hold: HoldSettings
    known: KnownBefore
    at_target: AtTarget
    def __init__(self, id: _Optional[str] = ..., rig: _Optional[str] = ..., target: _Optional[_Union[_array_pb2.Record, _Mapping]] = ..., target_source: _Optional[str] = ..., excitation: _Optional[_Union[_identifier_pb2.Excitation, _Mapping]] = ..., estimator: _Optional[_Union[_identifier_pb2.Estimator, _Mapping]] = ..., update: _Optional[_Union[UpdateSettings, _Mapping]] = ..., stop: _Optional[_Union[StopCriteria, _Mapping]] = ..., lowest_frequency: _Optional[float] = ..., highest_frequency: _Optional[float] = ..., seed: _Optional[int] = ..., scenario: _Optional[str] = ..., target_drive: _Optional[_Union[_array_pb2.Record, _Mapping]] = ..., target_rig: _Optional[str] = ..., target_seed: _Optional[int] = ..., levels: _Optional[_Iterable[float]] = ..., parent: _Optional[str] = ..., parent_iteration: _Optional[int] = ..., limit_policy: _Optional[_Union[LimitPolicy, str]] = ..., lower_flank: _Optional[float] = ..., upper_flank: _Optional[float] = ..., largest_overrun: _Optional[float] = ..., confirmations: _Optional[int] = ..., target_steps: _Optional[_Iterable[_Union[TargetStep, _Mapping]]] = ..., real_time: _Optional[bool] = ..., accept: _Optional[_Union[Acceptance, _Mapping]] = ..., pre_test: _Optional[float] = ..., hold: _Optional[_Union[HoldSettings, _Mapping]] = ..., known: _Optional[_Union[KnownBefore, _Mapping]] = ..., at_target: _Optional[_Union[AtTarget, _Mapping]] = ...) -> None: ...

class CampaignRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class StopCampaignRequest(_message.Message):
    __slots__ = ("reason",)
    REASON_FIELD_NUMBER: _ClassVar[int]
    reason: str
    def __init__(self, reason: _Optional[str] = ...) -> None: ...

class ResumeCampaignRequest(_message.Message):
    __slots__ = ("new_id", "from_iteration", "update", "stop", "scenario", "accept")
    NEW_ID_FIELD_NUMBER: _ClassVar[int]
    FROM_ITERATION_FIELD_NUMBER: _ClassVar[int]
    UPDATE_FIELD_NUMBER: _ClassVar[int]
    STOP_FIELD_NUMBER: _ClassVar[int]
    SCENARIO_FIELD_NUMBER: _ClassVar[int]
    ACCEPT_FIELD_NUMBER: _ClassVar[int]
    new_id: str
    from_iteration: int
    update: UpdateSettings
    stop: StopCriteria
    scenario: str
    accept: Acceptance
    def __init__(self, new_id: _Optional[str] = ..., from_iteration: _Optional[int] = ..., update: _Optional[_Union[UpdateSettings, _Mapping]] = ..., stop: _Optional[_Union[StopCriteria, _Mapping]] = ..., scenario: _Optional[str] = ..., accept: _Optional[_Union[Acceptance, _Mapping]] = ...) -> None: ...

class ProposedDrive(_message.Message):
    __slots__ = ("channel", "peak", "slew", "range_share", "slew_share", "change")
    CHANNEL_FIELD_NUMBER: _ClassVar[int]
    PEAK_FIELD_NUMBER: _ClassVar[int]
    SLEW_FIELD_NUMBER: _ClassVar[int]
    RANGE_SHARE_FIELD_NUMBER: _ClassVar[int]
    SLEW_SHARE_FIELD_NUMBER: _ClassVar[int]
    CHANGE_FIELD_NUMBER: _ClassVar[int]
    channel: str
    peak: float
    slew: float
    range_share: float
    slew_share: float
    change: float
    def __init__(self, channel: _Optional[str] = ..., peak: _Optional[float] = ..., slew: _Optional[float] = ..., range_share: _Optional[float] = ..., slew_share: _Optional[float] = ..., change: _Optional[float] = ...) -> None: ...

class ProposedResponse(_message.Message):
    __slots__ = ("channel", "forecast")
    CHANNEL_FIELD_NUMBER: _ClassVar[int]
    FORECAST_FIELD_NUMBER: _ClassVar[int]
    channel: str
    forecast: ChannelForecast
    def __init__(self, channel: _Optional[str] = ..., forecast: _Optional[_Union[ChannelForecast, _Mapping]] = ...) -> None: ...

class Proposal(_message.Message):
    __slots__ = ("number", "playback", "reason", "level", "follows", "drives", "responses", "overall_relative_rms_error", "remarks", "replaces", "refusal", "drive", "predicted_response", "scenario")
    NUMBER_FIELD_NUMBER: _ClassVar[int]
    PLAYBACK_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    LEVEL_FIELD_NUMBER: _ClassVar[int]
    FOLLOWS_FIELD_NUMBER: _ClassVar[int]
    DRIVES_FIELD_NUMBER: _ClassVar[int]
    RESPONSES_FIELD_NUMBER: _ClassVar[int]
    OVERALL_RELATIVE_RMS_ERROR_FIELD_NUMBER: _ClassVar[int]
    REMARKS_FIELD_NUMBER: _ClassVar[int]
    REPLACES_FIELD_NUMBER: _ClassVar[int]
    REFUSAL_FIELD_NUMBER: _ClassVar[int]
    DRIVE_FIELD_NUMBER: _ClassVar[int]
    PREDICTED_RESPONSE_FIELD_NUMBER: _ClassVar[int]
    SCENARIO_FIELD_NUMBER: _ClassVar[int]
    number: int
    playback: int
    reason: str
    level: float
    follows: int
    drives: _containers.RepeatedCompositeFieldContainer[ProposedDrive]
    responses: _containers.RepeatedCompositeFieldContainer[ProposedResponse]
    overall_relative_rms_error: float
    remarks: _containers.RepeatedScalarFieldContainer[str]
    replaces: int
    refusal: str
    drive: _array_pb2.Record
    predicted_response: _array_pb2.Array
    scenario: str
    def __init__(self, number: _Optional[int] = ..., playback: _Optional[int] = ..., reason: _Optional[str] = ..., level: _Optional[float] = ..., follows: _Optional[int] = ..., drives: _Optional[_Iterable[_Union[ProposedDrive, _Mapping]]] = ..., responses: _Optional[_Iterable[_Union[ProposedResponse, _Mapping]]] = ..., overall_relative_rms_error: _Optional[float] = ..., remarks: _Optional[_Iterable[str]] = ..., replaces: _Optional[int] = ..., refusal: _Optional[str] = ..., drive: _Optional[_Union[_array_pb2.Record, _Mapping]] = ..., predicted_response: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., scenario: _Optional[str] = ...) -> None: ...

class ControlBand(_message.Message):
    __slots__ = ("lowest_frequency", "highest_frequency", "lower_flank", "upper_flank")
    LOWEST_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    HIGHEST_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    LOWER_FLANK_FIELD_NUMBER: _ClassVar[int]
    UPPER_FLANK_FIELD_NUMBER: _ClassVar[int]
    lowest_frequency: float
    highest_frequency: float
    lower_flank: float
    upper_flank: float
    def __init__(self, lowest_frequency: _Optional[float] = ..., highest_frequency: _Optional[float] = ..., lower_flank: _Optional[float] = ..., upper_flank: _Optional[float] = ...) -> None: ...

class Decision(_message.Message):
    __slots__ = ("proposal", "kind", "name", "reason", "update", "control_band", "from_iteration", "scenario", "playback", "decided")
    PROPOSAL_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    UPDATE_FIELD_NUMBER: _ClassVar[int]
    CONTROL_BAND_FIELD_NUMBER: _ClassVar[int]
    FROM_ITERATION_FIELD_NUMBER: _ClassVar[int]
    SCENARIO_FIELD_NUMBER: _ClassVar[int]
    PLAYBACK_FIELD_NUMBER: _ClassVar[int]
    DECIDED_FIELD_NUMBER: _ClassVar[int]
    proposal: int
    kind: DecisionKind
    name: str
    reason: str
    update: UpdateSettings
    control_band: ControlBand
    from_iteration: int
    scenario: str
    playback: int
    decided: int
    def __init__(self, proposal: _Optional[int] = ..., kind: _Optional[_Union[DecisionKind, str]] = ..., name: _Optional[str] = ..., reason: _Optional[str] = ..., update: _Optional[_Union[UpdateSettings, _Mapping]] = ..., control_band: _Optional[_Union[ControlBand, _Mapping]] = ..., from_iteration: _Optional[int] = ..., scenario: _Optional[str] = ..., playback: _Optional[int] = ..., decided: _Optional[int] = ...) -> None: ...

class CampaignStatus(_message.Message):
    __slots__ = ("id", "phase", "activity", "fraction", "remaining_seconds", "iterations", "outcome", "fault", "best_iteration", "remarks", "repeatability", "confirmations", "hold", "first_drive")
    ID_FIELD_NUMBER: _ClassVar[int]
    PHASE_FIELD_NUMBER: _ClassVar[int]
    ACTIVITY_FIELD_NUMBER: _ClassVar[int]
    FRACTION_FIELD_NUMBER: _ClassVar[int]
    REMAINING_SECONDS_FIELD_NUMBER: _ClassVar[int]
    ITERATIONS_FIELD_NUMBER: _ClassVar[int]
    OUTCOME_FIELD_NUMBER: _ClassVar[int]
    FAULT_FIELD_NUMBER: _ClassVar[int]
    BEST_ITERATION_FIELD_NUMBER: _ClassVar[int]
    REMARKS_FIELD_NUMBER: _ClassVar[int]
    REPEATABILITY_FIELD_NUMBER: _ClassVar[int]
    CONFIRMATIONS_FIELD_NUMBER: _ClassVar[int]
    HOLD_FIELD_NUMBER: _ClassVar[int]
    FIRST_DRIVE_FIELD_NUMBER: _ClassVar[int]
    id: str
    phase: CampaignPhase
    activity: str
    fraction: float
    remaining_seconds: float
    iterations: _containers.RepeatedCompositeFieldContainer[IterationMetrics]
    outcome: Outcome
    fault: _query_pb2.Fault
    best_iteration: int
    remarks: _containers.RepeatedScalarFieldContainer[str]
    repeatability: Repeatability
    confirmations: _containers.RepeatedCompositeFieldContainer[IterationMetrics]
    hold: Proposal
    first_drive: IterationMetrics
    def __init__(self, id: _Optional[str] = ..., phase: _Optional[_Union[CampaignPhase, str]] = ..., activity: _Optional[str] = ..., fraction: _Optional[float] = ..., remaining_seconds: _Optional[float] = ..., iterations: _Optional[_Iterable[_Union[IterationMetrics, _Mapping]]] = ..., outcome: _Optional[_Union[Outcome, str]] = ..., fault: _Optional[_Union[_query_pb2.Fault, _Mapping]] = ..., best_iteration: _Optional[int] = ..., remarks: _Optional[_Iterable[str]] = ..., repeatability: _Optional[_Union[Repeatability, _Mapping]] = ..., confirmations: _Optional[_Iterable[_Union[IterationMetrics, _Mapping]]] = ..., hold: _Optional[_Union[Proposal, _Mapping]] = ..., first_drive: _Optional[_Union[IterationMetrics, _Mapping]] = ...) -> None: ...

class Repeatability(_message.Message):
    __slots__ = ("iteration", "playbacks", "channels")
    ITERATION_FIELD_NUMBER: _ClassVar[int]
    PLAYBACKS_FIELD_NUMBER: _ClassVar[int]
    CHANNELS_FIELD_NUMBER: _ClassVar[int]
    iteration: int
    playbacks: int
    channels: _containers.RepeatedCompositeFieldContainer[ChannelRepeatability]
    def __init__(self, iteration: _Optional[int] = ..., playbacks: _Optional[int] = ..., channels: _Optional[_Iterable[_Union[ChannelRepeatability, _Mapping]]] = ...) -> None: ...

class ChannelRepeatability(_message.Message):
    __slots__ = ("channel", "noise_floor", "relative_rms_error", "systematic_error")
    CHANNEL_FIELD_NUMBER: _ClassVar[int]
    NOISE_FLOOR_FIELD_NUMBER: _ClassVar[int]
    RELATIVE_RMS_ERROR_FIELD_NUMBER: _ClassVar[int]
    SYSTEMATIC_ERROR_FIELD_NUMBER: _ClassVar[int]
    channel: str
    noise_floor: float
    relative_rms_error: float
    systematic_error: float
    def __init__(self, channel: _Optional[str] = ..., noise_floor: _Optional[float] = ..., relative_rms_error: _Optional[float] = ..., systematic_error: _Optional[float] = ...) -> None: ...

class ChannelForecast(_message.Message):
    __slots__ = ("relative_rms_error", "peak_ratio", "damage_ratio", "uncertainty", "missed")
    RELATIVE_RMS_ERROR_FIELD_NUMBER: _ClassVar[int]
    PEAK_RATIO_FIELD_NUMBER: _ClassVar[int]
    DAMAGE_RATIO_FIELD_NUMBER: _ClassVar[int]
    UNCERTAINTY_FIELD_NUMBER: _ClassVar[int]
    MISSED_FIELD_NUMBER: _ClassVar[int]
    relative_rms_error: float
    peak_ratio: float
    damage_ratio: _containers.RepeatedScalarFieldContainer[float]
    uncertainty: float
    missed: float
    def __init__(self, relative_rms_error: _Optional[float] = ..., peak_ratio: _Optional[float] = ..., damage_ratio: _Optional[_Iterable[float]] = ..., uncertainty: _Optional[float] = ..., missed: _Optional[float] = ...) -> None: ...

class ChannelMetrics(_message.Message):
    __slots__ = ("channel", "relative_rms_error", "rms_response", "peak_ratio", "crest_ratio", "damage_ratio", "watched", "target_energy_outside_band", "forecast", "specimen_damage", "identification_damage")
    CHANNEL_FIELD_NUMBER: _ClassVar[int]
    RELATIVE_RMS_ERROR_FIELD_NUMBER: _ClassVar[int]
    RMS_RESPONSE_FIELD_NUMBER: _ClassVar[int]
    PEAK_RATIO_FIELD_NUMBER: _ClassVar[int]
    CREST_RATIO_FIELD_NUMBER: _ClassVar[int]
    DAMAGE_RATIO_FIELD_NUMBER: _ClassVar[int]
    WATCHED_FIELD_NUMBER: _ClassVar[int]
    TARGET_ENERGY_OUTSIDE_BAND_FIELD_NUMBER: _ClassVar[int]
    FORECAST_FIELD_NUMBER: _ClassVar[int]
    SPECIMEN_DAMAGE_FIELD_NUMBER: _ClassVar[int]
    IDENTIFICATION_DAMAGE_FIELD_NUMBER: _ClassVar[int]
    channel: str
    relative_rms_error: float
    rms_response: float
    peak_ratio: float
    crest_ratio: float
    damage_ratio: _containers.RepeatedScalarFieldContainer[float]
    watched: bool
    target_energy_outside_band: float
    forecast: ChannelForecast
    specimen_damage: _containers.RepeatedScalarFieldContainer[float]
    identification_damage: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, channel: _Optional[str] = ..., relative_rms_error: _Optional[float] = ..., rms_response: _Optional[float] = ..., peak_ratio: _Optional[float] = ..., crest_ratio: _Optional[float] = ..., damage_ratio: _Optional[_Iterable[float]] = ..., watched: _Optional[bool] = ..., target_energy_outside_band: _Optional[float] = ..., forecast: _Optional[_Union[ChannelForecast, _Mapping]] = ..., specimen_damage: _Optional[_Iterable[float]] = ..., identification_damage: _Optional[_Iterable[float]] = ...) -> None: ...

class IterationMetrics(_message.Message):
    __slots__ = ("iteration", "channels", "overall_relative_rms_error", "level")
    ITERATION_FIELD_NUMBER: _ClassVar[int]
    CHANNELS_FIELD_NUMBER: _ClassVar[int]
    OVERALL_RELATIVE_RMS_ERROR_FIELD_NUMBER: _ClassVar[int]
    LEVEL_FIELD_NUMBER: _ClassVar[int]
    iteration: int
    channels: _containers.RepeatedCompositeFieldContainer[ChannelMetrics]
    overall_relative_rms_error: float
    level: float
    def __init__(self, iteration: _Optional[int] = ..., channels: _Optional[_Iterable[_Union[ChannelMetrics, _Mapping]]] = ..., overall_relative_rms_error: _Optional[float] = ..., level: _Optional[float] = ...) -> None: ...

class CampaignEvent(_message.Message):
    __slots__ = ("status",)
    STATUS_FIELD_NUMBER: _ClassVar[int]
    status: CampaignStatus
    def __init__(self, status: _Optional[_Union[CampaignStatus, _Mapping]] = ...) -> None: ...

class IterationStep(_message.Message):
    __slots__ = ("iteration", "run", "drive", "response", "metrics", "actuators", "inverse_frf", "response_in_band", "level", "signal_epoch", "signal_blocks", "remarks", "samples_hash", "error_in_band", "with_drive_map", "learned_drive_map", "judged_target", "alignment")
    ITERATION_FIELD_NUMBER: _ClassVar[int]
    RUN_FIELD_NUMBER: _ClassVar[int]
    DRIVE_FIELD_NUMBER: _ClassVar[int]
    RESPONSE_FIELD_NUMBER: _ClassVar[int]
    METRICS_FIELD_NUMBER: _ClassVar[int]
    ACTUATORS_FIELD_NUMBER: _ClassVar[int]
    INVERSE_FRF_FIELD_NUMBER: _ClassVar[int]
    RESPONSE_IN_BAND_FIELD_NUMBER: _ClassVar[int]
    LEVEL_FIELD_NUMBER: _ClassVar[int]
    SIGNAL_EPOCH_FIELD_NUMBER: _ClassVar[int]
    SIGNAL_BLOCKS_FIELD_NUMBER: _ClassVar[int]
    REMARKS_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_HASH_FIELD_NUMBER: _ClassVar[int]
    ERROR_IN_BAND_FIELD_NUMBER: _ClassVar[int]
    WITH_DRIVE_MAP_FIELD_NUMBER: _ClassVar[int]
    LEARNED_DRIVE_MAP_FIELD_NUMBER: _ClassVar[int]
    JUDGED_TARGET_FIELD_NUMBER: _ClassVar[int]
    ALIGNMENT_FIELD_NUMBER: _ClassVar[int]
    iteration: int
    run: str
    drive: _array_pb2.Record
    response: _array_pb2.Record
    metrics: IterationMetrics
    actuators: _containers.RepeatedCompositeFieldContainer[_rig_pb2.ActuatorUse]
    inverse_frf: _array_pb2.Array
    response_in_band: _array_pb2.Array
    level: float
    signal_epoch: int
    signal_blocks: int
    remarks: _containers.RepeatedScalarFieldContainer[str]
    samples_hash: str
    error_in_band: _array_pb2.Array
    with_drive_map: bool
    learned_drive_map: _identifier_pb2.DriveMap
    judged_target: int
    alignment: _rig_pb2.Alignment
    def __init__(self, iteration: _Optional[int] = ..., run: _Optional[str] = ..., drive: _Optional[_Union[_array_pb2.Record, _Mapping]] = ..., response: _Optional[_Union[_array_pb2.Record, _Mapping]] = ..., metrics: _Optional[_Union[IterationMetrics, _Mapping]] = ..., actuators: _Optional[_Iterable[_Union[_rig_pb2.ActuatorUse, _Mapping]]] = ..., inverse_frf: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., response_in_band: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., level: _Optional[float] = ..., signal_epoch: _Optional[int] = ..., signal_blocks: _Optional[int] = ..., remarks: _Optional[_Iterable[str]] = ..., samples_hash: _Optional[str] = ..., error_in_band: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., with_drive_map: _Optional[bool] = ..., learned_drive_map: _Optional[_Union[_identifier_pb2.DriveMap, _Mapping]] = ..., judged_target: _Optional[int] = ..., alignment: _Optional[_Union[_rig_pb2.Alignment, _Mapping]] = ...) -> None: ...

class ConfirmationStep(_message.Message):
    __slots__ = ("number", "run", "iteration", "response", "response_in_band", "metrics", "actuators", "signal_epoch", "signal_blocks", "samples_hash", "error_in_band", "judged_target", "alignment")
    NUMBER_FIELD_NUMBER: _ClassVar[int]
    RUN_FIELD_NUMBER: _ClassVar[int]
    ITERATION_FIELD_NUMBER: _ClassVar[int]
    RESPONSE_FIELD_NUMBER: _ClassVar[int]
    RESPONSE_IN_BAND_FIELD_NUMBER: _ClassVar[int]
    METRICS_FIELD_NUMBER: _ClassVar[int]
    ACTUATORS_FIELD_NUMBER: _ClassVar[int]
    SIGNAL_EPOCH_FIELD_NUMBER: _ClassVar[int]
    SIGNAL_BLOCKS_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_HASH_FIELD_NUMBER: _ClassVar[int]
    ERROR_IN_BAND_FIELD_NUMBER: _ClassVar[int]
    JUDGED_TARGET_FIELD_NUMBER: _ClassVar[int]
    ALIGNMENT_FIELD_NUMBER: _ClassVar[int]
    number: int
    run: str
    iteration: int
    response: _array_pb2.Record
    response_in_band: _array_pb2.Array
    metrics: IterationMetrics
    actuators: _containers.RepeatedCompositeFieldContainer[_rig_pb2.ActuatorUse]
    signal_epoch: int
    signal_blocks: int
    samples_hash: str
    error_in_band: _array_pb2.Array
    judged_target: int
    alignment: _rig_pb2.Alignment
    def __init__(self, number: _Optional[int] = ..., run: _Optional[str] = ..., iteration: _Optional[int] = ..., response: _Optional[_Union[_array_pb2.Record, _Mapping]] = ..., response_in_band: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., metrics: _Optional[_Union[IterationMetrics, _Mapping]] = ..., actuators: _Optional[_Iterable[_Union[_rig_pb2.ActuatorUse, _Mapping]]] = ..., signal_epoch: _Optional[int] = ..., signal_blocks: _Optional[int] = ..., samples_hash: _Optional[str] = ..., error_in_band: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., judged_target: _Optional[int] = ..., alignment: _Optional[_Union[_rig_pb2.Alignment, _Mapping]] = ...) -> None: ...

class TargetInBand(_message.Message):
    __slots__ = ("samples",)
    SAMPLES_FIELD_NUMBER: _ClassVar[int]
    samples: _array_pb2.Array
    def __init__(self, samples: _Optional[_Union[_array_pb2.Array, _Mapping]] = ...) -> None: ...

class PreTestRequest(_message.Message):
    __slots__ = ("id", "rig", "level", "seed", "real_time")
    ID_FIELD_NUMBER: _ClassVar[int]
    RIG_FIELD_NUMBER: _ClassVar[int]
    LEVEL_FIELD_NUMBER: _ClassVar[int]
    SEED_FIELD_NUMBER: _ClassVar[int]
    REAL_TIME_FIELD_NUMBER: _ClassVar[int]
    id: str
    rig: str
    level: float
    seed: int
    real_time: bool
    def __init__(self, id: _Optional[str] = ..., rig: _Optional[str] = ..., level: _Optional[float] = ..., seed: _Optional[int] = ..., real_time: _Optional[bool] = ...) -> None: ...

class PreTestFinding(_message.Message):
    __slots__ = ("check", "channels", "failed", "sentence")
    CHECK_FIELD_NUMBER: _ClassVar[int]
    CHANNELS_FIELD_NUMBER: _ClassVar[int]
    FAILED_FIELD_NUMBER: _ClassVar[int]
    SENTENCE_FIELD_NUMBER: _ClassVar[int]
    check: PreTestCheck
    channels: _containers.RepeatedScalarFieldContainer[str]
    failed: bool
    sentence: str
    def __init__(self, check: _Optional[_Union[PreTestCheck, str]] = ..., channels: _Optional[_Iterable[str]] = ..., failed: _Optional[bool] = ..., sentence: _Optional[str] = ...) -> None: ...

class PreTest(_message.Message):
    __slots__ = ("id", "rig", "rig_content_hash", "verdict", "findings", "expectations", "drives", "responses", "sample_rate", "amplitude", "offset", "noise", "peak", "lag", "gain", "response", "run", "signal_epoch", "signal_blocks")
    ID_FIELD_NUMBER: _ClassVar[int]
    RIG_FIELD_NUMBER: _ClassVar[int]
    RIG_CONTENT_HASH_FIELD_NUMBER: _ClassVar[int]
    VERDICT_FIELD_NUMBER: _ClassVar[int]
    FINDINGS_FIELD_NUMBER: _ClassVar[int]
    EXPECTATIONS_FIELD_NUMBER: _ClassVar[int]
    DRIVES_FIELD_NUMBER: _ClassVar[int]
    RESPONSES_FIELD_NUMBER: _ClassVar[int]
    SAMPLE_RATE_FIELD_NUMBER: _ClassVar[int]
    AMPLITUDE_FIELD_NUMBER: _ClassVar[int]
    OFFSET_FIELD_NUMBER: _ClassVar[int]
    NOISE_FIELD_NUMBER: _ClassVar[int]
    PEAK_FIELD_NUMBER: _ClassVar[int]
    LAG_FIELD_NUMBER: _ClassVar[int]
    GAIN_FIELD_NUMBER: _ClassVar[int]
    RESPONSE_FIELD_NUMBER: _ClassVar[int]
    RUN_FIELD_NUMBER: _ClassVar[int]
    SIGNAL_EPOCH_FIELD_NUMBER: _ClassVar[int]
    SIGNAL_BLOCKS_FIELD_NUMBER: _ClassVar[int]
    id: str
    rig: str
    rig_content_hash: str
    verdict: PreTestVerdict
    findings: _containers.RepeatedCompositeFieldContainer[PreTestFinding]
    expectations: _containers.RepeatedScalarFieldContainer[str]
    drives: _containers.RepeatedCompositeFieldContainer[_array_pb2.Channel]
    responses: _containers.RepeatedCompositeFieldContainer[_array_pb2.Channel]
    sample_rate: float
    amplitude: _array_pb2.Array
    offset: _array_pb2.Array
    noise: _array_pb2.Array
    peak: _array_pb2.Array
    lag: _array_pb2.Array
    gain: _array_pb2.Array
    response: _array_pb2.Array
    run: str
    signal_epoch: int
    signal_blocks: int
    def __init__(self, id: _Optional[str] = ..., rig: _Optional[str] = ..., rig_content_hash: _Optional[str] = ..., verdict: _Optional[_Union[PreTestVerdict, str]] = ..., findings: _Optional[_Iterable[_Union[PreTestFinding, _Mapping]]] = ..., expectations: _Optional[_Iterable[str]] = ..., drives: _Optional[_Iterable[_Union[_array_pb2.Channel, _Mapping]]] = ..., responses: _Optional[_Iterable[_Union[_array_pb2.Channel, _Mapping]]] = ..., sample_rate: _Optional[float] = ..., amplitude: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., offset: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., noise: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., peak: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., lag: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., gain: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., response: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., run: _Optional[str] = ..., signal_epoch: _Optional[int] = ..., signal_blocks: _Optional[int] = ...) -> None: ...
