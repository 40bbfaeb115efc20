from duralab_proto.v1 import array_pb2 as _array_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class ExcitationKind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    EXCITATION_KIND_UNSPECIFIED: _ClassVar[ExcitationKind]
    EXCITATION_KIND_PURE_RANDOM: _ClassVar[ExcitationKind]
    EXCITATION_KIND_BURST_RANDOM: _ClassVar[ExcitationKind]
    EXCITATION_KIND_SWEPT_SINE: _ClassVar[ExcitationKind]
    EXCITATION_KIND_PSEUDO_RANDOM: _ClassVar[ExcitationKind]
    EXCITATION_KIND_HADAMARD: _ClassVar[ExcitationKind]
    EXCITATION_KIND_ORTHOGONAL_DFT: _ClassVar[ExcitationKind]
    EXCITATION_KIND_RANDOM_ORTHOGONAL: _ClassVar[ExcitationKind]

class EstimatorKind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    ESTIMATOR_KIND_UNSPECIFIED: _ClassVar[EstimatorKind]
    ESTIMATOR_KIND_H1: _ClassVar[EstimatorKind]
    ESTIMATOR_KIND_H2: _ClassVar[EstimatorKind]
    ESTIMATOR_KIND_HV: _ClassVar[EstimatorKind]
    ESTIMATOR_KIND_LOCAL_POLYNOMIAL: _ClassVar[EstimatorKind]
    ESTIMATOR_KIND_LOCAL_RATIONAL: _ClassVar[EstimatorKind]

class ModelWarningCode(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    MODEL_WARNING_CODE_UNSPECIFIED: _ClassVar[ModelWarningCode]
    MODEL_WARNING_CODE_OTHER: _ClassVar[ModelWarningCode]
    MODEL_WARNING_CODE_TRANSIENT_LEFT: _ClassVar[ModelWarningCode]
    MODEL_WARNING_CODE_CLIPPED: _ClassVar[ModelWarningCode]
    MODEL_WARNING_CODE_FEW_AVERAGES: _ClassVar[ModelWarningCode]
    MODEL_WARNING_CODE_SMOOTHED: _ClassVar[ModelWarningCode]
    MODEL_WARNING_CODE_STUCK: _ClassVar[ModelWarningCode]
    MODEL_WARNING_CODE_STATIC_GAIN: _ClassVar[ModelWarningCode]
    MODEL_WARNING_CODE_LEVEL: _ClassVar[ModelWarningCode]
EXCITATION_KIND_UNSPECIFIED: ExcitationKind
EXCITATION_KIND_PURE_RANDOM: ExcitationKind
EXCITATION_KIND_BURST_RANDOM: ExcitationKind
EXCITATION_KIND_SWEPT_SINE: ExcitationKind
EXCITATION_KIND_PSEUDO_RANDOM: ExcitationKind
EXCITATION_KIND_HADAMARD: ExcitationKind
EXCITATION_KIND_ORTHOGONAL_DFT: ExcitationKind
EXCITATION_KIND_RANDOM_ORTHOGONAL: ExcitationKind
ESTIMATOR_KIND_UNSPECIFIED: EstimatorKind
ESTIMATOR_KIND_H1: EstimatorKind
ESTIMATOR_KIND_H2: EstimatorKind
ESTIMATOR_KIND_HV: EstimatorKind
ESTIMATOR_KIND_LOCAL_POLYNOMIAL: EstimatorKind
ESTIMATOR_KIND_LOCAL_RATIONAL: EstimatorKind
MODEL_WARNING_CODE_UNSPECIFIED: ModelWarningCode
MODEL_WARNING_CODE_OTHER: ModelWarningCode
MODEL_WARNING_CODE_TRANSIENT_LEFT: ModelWarningCode
MODEL_WARNING_CODE_CLIPPED: ModelWarningCode
MODEL_WARNING_CODE_FEW_AVERAGES: ModelWarningCode
MODEL_WARNING_CODE_SMOOTHED: ModelWarningCode
MODEL_WARNING_CODE_STUCK: ModelWarningCode
MODEL_WARNING_CODE_STATIC_GAIN: ModelWarningCode
MODEL_WARNING_CODE_LEVEL: ModelWarningCode

class WhitePinkSpectrum(_message.Message):
    __slots__ = ("lowest_frequency", "highest_frequency", "corner_frequency", "decibels_per_octave")
    LOWEST_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    HIGHEST_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    CORNER_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    DECIBELS_PER_OCTAVE_FIELD_NUMBER: _ClassVar[int]
    lowest_frequency: float
    highest_frequency: float
    corner_frequency: float
    decibels_per_octave: float
    def __init__(self, lowest_frequency: _Optional[float] = ..., highest_frequency: _Optional[float] = ..., corner_frequency: _Optional[float] = ..., decibels_per_octave: _Optional[float] = ...) -> None: ...

class TabulatedSpectrum(_message.Message):
    __slots__ = ("frequency", "density")
    FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    DENSITY_FIELD_NUMBER: _ClassVar[int]
    frequency: _array_pb2.Array
    density: _array_pb2.Array
    def __init__(self, frequency: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., density: _Optional[_Union[_array_pb2.Array, _Mapping]] = ...) -> None: ...

class Spectrum(_message.Message):
    __slots__ = ("white_pink", "table")
    WHITE_PINK_FIELD_NUMBER: _ClassVar[int]
    TABLE_FIELD_NUMBER: _ClassVar[int]
    white_pink: WhitePinkSpectrum
    table: TabulatedSpectrum
    def __init__(self, white_pink: _Optional[_Union[WhitePinkSpectrum, _Mapping]] = ..., table: _Optional[_Union[TabulatedSpectrum, _Mapping]] = ...) -> None: ...

class Excitation(_message.Message):
    __slots__ = ("kind", "spectrum", "rms", "duration", "fade", "seed", "drive_spectra", "peak", "delay_blocks", "capture_blocks", "repeats", "realisations", "odd_lines", "detection_share", "minimise_crest_factor", "burst_share", "static_hold")
    KIND_FIELD_NUMBER: _ClassVar[int]
    SPECTRUM_FIELD_NUMBER: _ClassVar[int]
    RMS_FIELD_NUMBER: _ClassVar[int]
    DURATION_FIELD_NUMBER: _ClassVar[int]
    FADE_FIELD_NUMBER: _ClassVar[int]
    SEED_FIELD_NUMBER: _ClassVar[int]
    DRIVE_SPECTRA_FIELD_NUMBER: _ClassVar[int]
    PEAK_FIELD_NUMBER: _ClassVar[int]
    DELAY_BLOCKS_FIELD_NUMBER: _ClassVar[int]
    CAPTURE_BLOCKS_FIELD_NUMBER: _ClassVar[int]
    REPEATS_FIELD_NUMBER: _ClassVar[int]
    REALISATIONS_FIELD_NUMBER: _ClassVar[int]
    ODD_LINES_FIELD_NUMBER: _ClassVar[int]
    DETECTION_SHARE_FIELD_NUMBER: _ClassVar[int]
    MINIMISE_CREST_FACTOR_FIELD_NUMBER: _ClassVar[int]
    BURST_SHARE_FIELD_NUMBER: _ClassVar[int]
    STATIC_HOLD_FIELD_NUMBER: _ClassVar[int]
    kind: ExcitationKind
    spectrum: WhitePinkSpectrum
    rms: _array_pb2.Array
    duration: float
    fade: float
    seed: int
    drive_spectra: _containers.RepeatedCompositeFieldContainer[Spectrum]
    peak: _array_pb2.Array
    delay_blocks: int
    capture_blocks: int
    repeats: int
    realisations: int
    odd_lines: bool
    detection_share: float
    minimise_crest_factor: bool
    burst_share: float
    static_hold: float
    def __init__(self, kind: _Optional[_Union[ExcitationKind, str]] = ..., spectrum: _Optional[_Union[WhitePinkSpectrum, _Mapping]] = ..., rms: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., duration: _Optional[float] = ..., fade: _Optional[float] = ..., seed: _Optional[int] = ..., drive_spectra: _Optional[_Iterable[_Union[Spectrum, _Mapping]]] = ..., peak: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., delay_blocks: _Optional[int] = ..., capture_blocks: _Optional[int] = ..., repeats: _Optional[int] = ..., realisations: _Optional[int] = ..., odd_lines: _Optional[bool] = ..., detection_share: _Optional[float] = ..., minimise_crest_factor: _Optional[bool] = ..., burst_share: _Optional[float] = ..., static_hold: _Optional[float] = ...) -> None: ...

class Estimator(_message.Message):
    __slots__ = ("kind", "block_samples", "overlap", "local_order", "local_half_width")
    KIND_FIELD_NUMBER: _ClassVar[int]
    BLOCK_SAMPLES_FIELD_NUMBER: _ClassVar[int]
    OVERLAP_FIELD_NUMBER: _ClassVar[int]
    LOCAL_ORDER_FIELD_NUMBER: _ClassVar[int]
    LOCAL_HALF_WIDTH_FIELD_NUMBER: _ClassVar[int]
    kind: EstimatorKind
    block_samples: int
    overlap: float
    local_order: int
    local_half_width: int
    def __init__(self, kind: _Optional[_Union[EstimatorKind, str]] = ..., block_samples: _Optional[int] = ..., overlap: _Optional[float] = ..., local_order: _Optional[int] = ..., local_half_width: _Optional[int] = ...) -> None: ...

class IdentifyRequest(_message.Message):
    __slots__ = ("rig", "excitation", "estimator", "run", "rig_seed", "check_only", "real_time", "drive_map", "shape")
    RIG_FIELD_NUMBER: _ClassVar[int]
    EXCITATION_FIELD_NUMBER: _ClassVar[int]
    ESTIMATOR_FIELD_NUMBER: _ClassVar[int]
    RUN_FIELD_NUMBER: _ClassVar[int]
    RIG_SEED_FIELD_NUMBER: _ClassVar[int]
    CHECK_ONLY_FIELD_NUMBER: _ClassVar[int]
    REAL_TIME_FIELD_NUMBER: _ClassVar[int]
    DRIVE_MAP_FIELD_NUMBER: _ClassVar[int]
    SHAPE_FIELD_NUMBER: _ClassVar[int]
    rig: str
    excitation: Excitation
    estimator: Estimator
    run: str
    rig_seed: int
    check_only: bool
    real_time: bool
    drive_map: DriveMapRequest
    shape: TargetShape
    def __init__(self, rig: _Optional[str] = ..., excitation: _Optional[_Union[Excitation, _Mapping]] = ..., estimator: _Optional[_Union[Estimator, _Mapping]] = ..., run: _Optional[str] = ..., rig_seed: _Optional[int] = ..., check_only: _Optional[bool] = ..., real_time: _Optional[bool] = ..., drive_map: _Optional[_Union[DriveMapRequest, _Mapping]] = ..., shape: _Optional[_Union[TargetShape, _Mapping]] = ...) -> None: ...

class TargetShape(_message.Message):
    __slots__ = ("model", "target", "lowest_frequency", "highest_frequency", "level")
    MODEL_FIELD_NUMBER: _ClassVar[int]
    TARGET_FIELD_NUMBER: _ClassVar[int]
    LOWEST_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    HIGHEST_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    LEVEL_FIELD_NUMBER: _ClassVar[int]
    model: Model
    target: _array_pb2.Record
    lowest_frequency: float
    highest_frequency: float
    level: float
    def __init__(self, model: _Optional[_Union[Model, _Mapping]] = ..., target: _Optional[_Union[_array_pb2.Record, _Mapping]] = ..., lowest_frequency: _Optional[float] = ..., highest_frequency: _Optional[float] = ..., level: _Optional[float] = ...) -> None: ...

class DriveMapRequest(_message.Message):
    __slots__ = ("response_weight",)
    RESPONSE_WEIGHT_FIELD_NUMBER: _ClassVar[int]
    response_weight: _array_pb2.Array
    def __init__(self, response_weight: _Optional[_Union[_array_pb2.Array, _Mapping]] = ...) -> None: ...

class PlanRequest(_message.Message):
    __slots__ = ("identify",)
    IDENTIFY_FIELD_NUMBER: _ClassVar[int]
    identify: IdentifyRequest
    def __init__(self, identify: _Optional[_Union[IdentifyRequest, _Mapping]] = ...) -> None: ...

class ExperimentPlan(_message.Message):
    __slots__ = ("duration_seconds", "samples", "realisations", "experiments_per_realisation", "periods", "delay_share", "blocks", "independent_averages", "frequency_resolution", "lines", "lowest_frequency", "highest_frequency")
    DURATION_SECONDS_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_FIELD_NUMBER: _ClassVar[int]
    REALISATIONS_FIELD_NUMBER: _ClassVar[int]
    EXPERIMENTS_PER_REALISATION_FIELD_NUMBER: _ClassVar[int]
    PERIODS_FIELD_NUMBER: _ClassVar[int]
    DELAY_SHARE_FIELD_NUMBER: _ClassVar[int]
    BLOCKS_FIELD_NUMBER: _ClassVar[int]
    INDEPENDENT_AVERAGES_FIELD_NUMBER: _ClassVar[int]
    FREQUENCY_RESOLUTION_FIELD_NUMBER: _ClassVar[int]
    LINES_FIELD_NUMBER: _ClassVar[int]
    LOWEST_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    HIGHEST_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    duration_seconds: float
    samples: int
    realisations: int
    experiments_per_realisation: int
    periods: int
    delay_share: float
    blocks: int
    independent_averages: float
    frequency_resolution: float
    lines: int
    lowest_frequency: float
    highest_frequency: float
    def __init__(self, duration_seconds: _Optional[float] = ..., samples: _Optional[int] = ..., realisations: _Optional[int] = ..., experiments_per_realisation: _Optional[int] = ..., periods: _Optional[int] = ..., delay_share: _Optional[float] = ..., blocks: _Optional[int] = ..., independent_averages: _Optional[float] = ..., frequency_resolution: _Optional[float] = ..., lines: _Optional[int] = ..., lowest_frequency: _Optional[float] = ..., highest_frequency: _Optional[float] = ...) -> None: ...

class LevelsRequest(_message.Message):
    __slots__ = ("identify", "factors")
    IDENTIFY_FIELD_NUMBER: _ClassVar[int]
    FACTORS_FIELD_NUMBER: _ClassVar[int]
    identify: IdentifyRequest
    factors: _array_pb2.Array
    def __init__(self, identify: _Optional[_Union[IdentifyRequest, _Mapping]] = ..., factors: _Optional[_Union[_array_pb2.Array, _Mapping]] = ...) -> None: ...

class ModelDifference(_message.Message):
    __slots__ = ("first_id", "second_id", "relative_difference", "expected_by_noise", "sentences")
    FIRST_ID_FIELD_NUMBER: _ClassVar[int]
    SECOND_ID_FIELD_NUMBER: _ClassVar[int]
    RELATIVE_DIFFERENCE_FIELD_NUMBER: _ClassVar[int]
    EXPECTED_BY_NOISE_FIELD_NUMBER: _ClassVar[int]
    SENTENCES_FIELD_NUMBER: _ClassVar[int]
    first_id: str
    second_id: str
    relative_difference: _array_pb2.Array
    expected_by_noise: _array_pb2.Array
    sentences: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, first_id: _Optional[str] = ..., second_id: _Optional[str] = ..., relative_difference: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., expected_by_noise: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., sentences: _Optional[_Iterable[str]] = ...) -> None: ...

class LevelsResult(_message.Message):
    __slots__ = ("models", "differences")
    MODELS_FIELD_NUMBER: _ClassVar[int]
    DIFFERENCES_FIELD_NUMBER: _ClassVar[int]
    models: _containers.RepeatedCompositeFieldContainer[Model]
    differences: _containers.RepeatedCompositeFieldContainer[ModelDifference]
    def __init__(self, models: _Optional[_Iterable[_Union[Model, _Mapping]]] = ..., differences: _Optional[_Iterable[_Union[ModelDifference, _Mapping]]] = ...) -> None: ...

class AdviceRequest(_message.Message):
    __slots__ = ("model_id", "target", "lowest_frequency", "highest_frequency", "crest_factor")
    MODEL_ID_FIELD_NUMBER: _ClassVar[int]
    TARGET_FIELD_NUMBER: _ClassVar[int]
    LOWEST_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    HIGHEST_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    CREST_FACTOR_FIELD_NUMBER: _ClassVar[int]
    model_id: str
    target: _array_pb2.Record
    lowest_frequency: float
    highest_frequency: float
    crest_factor: float
    def __init__(self, model_id: _Optional[str] = ..., target: _Optional[_Union[_array_pb2.Record, _Mapping]] = ..., lowest_frequency: _Optional[float] = ..., highest_frequency: _Optional[float] = ..., crest_factor: _Optional[float] = ...) -> None: ...

class LevelAdvice(_message.Message):
    __slots__ = ("rms", "wanted_rms", "largest_rms", "identified_rms", "response_ratio", "sentences", "identification_damage", "one_pass_factor", "linear_rms")
    RMS_FIELD_NUMBER: _ClassVar[int]
    WANTED_RMS_FIELD_NUMBER: _ClassVar[int]
    LARGEST_RMS_FIELD_NUMBER: _ClassVar[int]
    IDENTIFIED_RMS_FIELD_NUMBER: _ClassVar[int]
    RESPONSE_RATIO_FIELD_NUMBER: _ClassVar[int]
    SENTENCES_FIELD_NUMBER: _ClassVar[int]
    IDENTIFICATION_DAMAGE_FIELD_NUMBER: _ClassVar[int]
    ONE_PASS_FACTOR_FIELD_NUMBER: _ClassVar[int]
    LINEAR_RMS_FIELD_NUMBER: _ClassVar[int]
    rms: _array_pb2.Array
    wanted_rms: _array_pb2.Array
    largest_rms: _array_pb2.Array
    identified_rms: _array_pb2.Array
    response_ratio: _array_pb2.Array
    sentences: _containers.RepeatedScalarFieldContainer[str]
    identification_damage: _array_pb2.Array
    one_pass_factor: float
    linear_rms: _array_pb2.Array
    def __init__(self, rms: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., wanted_rms: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., largest_rms: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., identified_rms: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., response_ratio: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., sentences: _Optional[_Iterable[str]] = ..., identification_damage: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., one_pass_factor: _Optional[float] = ..., linear_rms: _Optional[_Union[_array_pb2.Array, _Mapping]] = ...) -> None: ...

class PredictRequest(_message.Message):
    __slots__ = ("drive",)
    DRIVE_FIELD_NUMBER: _ClassVar[int]
    drive: _array_pb2.Record
    def __init__(self, drive: _Optional[_Union[_array_pb2.Record, _Mapping]] = ...) -> None: ...

class Prediction(_message.Message):
    __slots__ = ("response", "uncertainty_rms", "share_outside_band")
    RESPONSE_FIELD_NUMBER: _ClassVar[int]
    UNCERTAINTY_RMS_FIELD_NUMBER: _ClassVar[int]
    SHARE_OUTSIDE_BAND_FIELD_NUMBER: _ClassVar[int]
    response: _array_pb2.Record
    uncertainty_rms: _array_pb2.Array
    share_outside_band: _array_pb2.Array
    def __init__(self, response: _Optional[_Union[_array_pb2.Record, _Mapping]] = ..., uncertainty_rms: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., share_outside_band: _Optional[_Union[_array_pb2.Array, _Mapping]] = ...) -> None: ...

class ConvergenceRequest(_message.Message):
    __slots__ = ("iteration_gain", "lowest_frequency", "highest_frequency", "rig_model_id")
    ITERATION_GAIN_FIELD_NUMBER: _ClassVar[int]
    LOWEST_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    HIGHEST_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    RIG_MODEL_ID_FIELD_NUMBER: _ClassVar[int]
    iteration_gain: _array_pb2.Array
    lowest_frequency: float
    highest_frequency: float
    rig_model_id: str
    def __init__(self, iteration_gain: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., lowest_frequency: _Optional[float] = ..., highest_frequency: _Optional[float] = ..., rig_model_id: _Optional[str] = ...) -> None: ...

class Convergence(_message.Message):
    __slots__ = ("frequency", "spectral_radius", "spectral_radius_95", "largest_singular_value", "converging_share", "sentence")
    FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    SPECTRAL_RADIUS_FIELD_NUMBER: _ClassVar[int]
    SPECTRAL_RADIUS_95_FIELD_NUMBER: _ClassVar[int]
    LARGEST_SINGULAR_VALUE_FIELD_NUMBER: _ClassVar[int]
    CONVERGING_SHARE_FIELD_NUMBER: _ClassVar[int]
    SENTENCE_FIELD_NUMBER: _ClassVar[int]
    frequency: _array_pb2.Array
    spectral_radius: _array_pb2.Array
    spectral_radius_95: _array_pb2.Array
    largest_singular_value: _array_pb2.Array
    converging_share: float
    sentence: str
    def __init__(self, frequency: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., spectral_radius: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., spectral_radius_95: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., largest_singular_value: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., converging_share: _Optional[float] = ..., sentence: _Optional[str] = ...) -> None: ...

class ModelWarning(_message.Message):
    __slots__ = ("code", "channel", "lowest_frequency", "highest_frequency", "sentence")
    CODE_FIELD_NUMBER: _ClassVar[int]
    CHANNEL_FIELD_NUMBER: _ClassVar[int]
    LOWEST_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    HIGHEST_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    SENTENCE_FIELD_NUMBER: _ClassVar[int]
    code: ModelWarningCode
    channel: str
    lowest_frequency: float
    highest_frequency: float
    sentence: str
    def __init__(self, code: _Optional[_Union[ModelWarningCode, str]] = ..., channel: _Optional[str] = ..., lowest_frequency: _Optional[float] = ..., highest_frequency: _Optional[float] = ..., sentence: _Optional[str] = ...) -> None: ...

class Distortion(_message.Message):
    __slots__ = ("noise_psd", "distortion_psd", "odd_distortion_psd", "even_distortion_psd", "distortion_share", "noise_share")
    NOISE_PSD_FIELD_NUMBER: _ClassVar[int]
    DISTORTION_PSD_FIELD_NUMBER: _ClassVar[int]
    ODD_DISTORTION_PSD_FIELD_NUMBER: _ClassVar[int]
    EVEN_DISTORTION_PSD_FIELD_NUMBER: _ClassVar[int]
    DISTORTION_SHARE_FIELD_NUMBER: _ClassVar[int]
    NOISE_SHARE_FIELD_NUMBER: _ClassVar[int]
    noise_psd: _array_pb2.Array
    distortion_psd: _array_pb2.Array
    odd_distortion_psd: _array_pb2.Array
    even_distortion_psd: _array_pb2.Array
    distortion_share: _array_pb2.Array
    noise_share: _array_pb2.Array
    def __init__(self, noise_psd: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., distortion_psd: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., odd_distortion_psd: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., even_distortion_psd: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., distortion_share: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., noise_share: _Optional[_Union[_array_pb2.Array, _Mapping]] = ...) -> None: ...

class DriveMapTerm(_message.Message):
    __slots__ = ("follower", "first", "second", "coefficients", "standard_deviation", "significance", "residual", "sentence")
    FOLLOWER_FIELD_NUMBER: _ClassVar[int]
    FIRST_FIELD_NUMBER: _ClassVar[int]
    SECOND_FIELD_NUMBER: _ClassVar[int]
    COEFFICIENTS_FIELD_NUMBER: _ClassVar[int]
    STANDARD_DEVIATION_FIELD_NUMBER: _ClassVar[int]
    SIGNIFICANCE_FIELD_NUMBER: _ClassVar[int]
    RESIDUAL_FIELD_NUMBER: _ClassVar[int]
    SENTENCE_FIELD_NUMBER: _ClassVar[int]
    follower: int
    first: int
    second: int
    coefficients: _array_pb2.Array
    standard_deviation: _array_pb2.Array
    significance: float
    residual: float
    sentence: str
    def __init__(self, follower: _Optional[int] = ..., first: _Optional[int] = ..., second: _Optional[int] = ..., coefficients: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., standard_deviation: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., significance: _Optional[float] = ..., residual: _Optional[float] = ..., sentence: _Optional[str] = ...) -> None: ...

class DriveMap(_message.Message):
    __slots__ = ("scale", "highest_frequency", "terms", "remarks")
    SCALE_FIELD_NUMBER: _ClassVar[int]
    HIGHEST_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    TERMS_FIELD_NUMBER: _ClassVar[int]
    REMARKS_FIELD_NUMBER: _ClassVar[int]
    scale: _array_pb2.Array
    highest_frequency: float
    terms: _containers.RepeatedCompositeFieldContainer[DriveMapTerm]
    remarks: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, scale: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., highest_frequency: _Optional[float] = ..., terms: _Optional[_Iterable[_Union[DriveMapTerm, _Mapping]]] = ..., remarks: _Optional[_Iterable[str]] = ...) -> None: ...

class ModelRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class Model(_message.Message):
    __slots__ = ("id", "rig", "drives", "responses", "sample_rate", "frequency", "frf", "coherence", "condition_number", "drive_psd", "response_psd", "excitation", "estimator", "blocks", "independent_averages", "rig_content_hash", "run", "signal_epoch", "signal_blocks", "frf_variance", "residual_psd", "row_covariance", "lowest_frequency", "highest_frequency", "interpolated", "warnings", "distortion", "plan", "verdicts", "drive_map", "response_damage", "static_gain", "static_change", "shaped_by", "target_level")
    ID_FIELD_NUMBER: _ClassVar[int]
    RIG_FIELD_NUMBER: _ClassVar[int]
    DRIVES_FIELD_NUMBER: _ClassVar[int]
    RESPONSES_FIELD_NUMBER: _ClassVar[int]
    SAMPLE_RATE_FIELD_NUMBER: _ClassVar[int]
    FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    FRF_FIELD_NUMBER: _ClassVar[int]
    COHERENCE_FIELD_NUMBER: _ClassVar[int]
    CONDITION_NUMBER_FIELD_NUMBER: _ClassVar[int]
    DRIVE_PSD_FIELD_NUMBER: _ClassVar[int]
    RESPONSE_PSD_FIELD_NUMBER: _ClassVar[int]
    EXCITATION_FIELD_NUMBER: _ClassVar[int]
    ESTIMATOR_FIELD_NUMBER: _ClassVar[int]
    BLOCKS_FIELD_NUMBER: _ClassVar[int]
    INDEPENDENT_AVERAGES_FIELD_NUMBER: _ClassVar[int]
    RIG_CONTENT_HASH_FIELD_NUMBER: _ClassVar[int]
    RUN_FIELD_NUMBER: _ClassVar[int]
    SIGNAL_EPOCH_FIELD_NUMBER: _ClassVar[int]
    SIGNAL_BLOCKS_FIELD_NUMBER: _ClassVar[int]
    FRF_VARIANCE_FIELD_NUMBER: _ClassVar[int]
    RESIDUAL_PSD_FIELD_NUMBER: _ClassVar[int]
    ROW_COVARIANCE_FIELD_NUMBER: _ClassVar[int]
    LOWEST_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    HIGHEST_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    INTERPOLATED_FIELD_NUMBER: _ClassVar[int]
    WARNINGS_FIELD_NUMBER: _ClassVar[int]
    DISTORTION_FIELD_NUMBER: _ClassVar[int]
    PLAN_FIELD_NUMBER: _ClassVar[int]
    VERDICTS_FIELD_NUMBER: _ClassVar[int]
    DRIVE_MAP_FIELD_NUMBER: _ClassVar[int]
    RESPONSE_DAMAGE_FIELD_NUMBER: _ClassVar[int]
    STATIC_GAIN_FIELD_NUMBER: _ClassVar[int]
    STATIC_CHANGE_FIELD_NUMBER: _ClassVar[int]
    SHAPED_BY_FIELD_NUMBER: _ClassVar[int]
    TARGET_LEVEL_FIELD_NUMBER: _ClassVar[int]
    id: str
    rig: str
    drives: _containers.RepeatedCompositeFieldContainer[_array_pb2.Channel]
    responses: _containers.RepeatedCompositeFieldContainer[_array_pb2.Channel]
    sample_rate: float
    frequency: _array_pb2.Array
    frf: _array_pb2.Array
    coherence: _array_pb2.Array
    condition_number: _array_pb2.Array
    drive_psd: _array_pb2.Array
    response_psd: _array_pb2.Array
    excitation: Excitation
    estimator: Estimator
    blocks: int
    independent_averages: float
    rig_content_hash: str
    run: str
    signal_epoch: int
    signal_blocks: int
    frf_variance: _array_pb2.Array
    residual_psd: _array_pb2.Array
    row_covariance: _array_pb2.Array
    lowest_frequency: float
    highest_frequency: float
    interpolated: _containers.RepeatedScalarFieldContainer[bool]
    warnings: _containers.RepeatedCompositeFieldContainer[ModelWarning]
    distortion: Distortion
    plan: ExperimentPlan
    verdicts: _containers.RepeatedScalarFieldContainer[str]
    drive_map: DriveMap
    response_damage: _array_pb2.Array
    static_gain: _array_pb2.Array
    static_change: _array_pb2.Array
    shaped_by: str
    target_level: float
    def __init__(self, id: _Optional[str] = ..., rig: _Optional[str] = ..., drives: _Optional[_Iterable[_Union[_array_pb2.Channel, _Mapping]]] = ..., responses: _Optional[_Iterable[_Union[_array_pb2.Channel, _Mapping]]] = ..., sample_rate: _Optional[float] = ..., frequency: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., frf: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., coherence: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., condition_number: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., drive_psd: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., response_psd: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., excitation: _Optional[_Union[Excitation, _Mapping]] = ..., estimator: _Optional[_Union[Estimator, _Mapping]] = ..., blocks: _Optional[int] = ..., independent_averages: _Optional[float] = ..., rig_content_hash: _Optional[str] = ..., run: _Optional[str] = ..., signal_epoch: _Optional[int] = ..., signal_blocks: _Optional[int] = ..., frf_variance: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., residual_psd: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., row_covariance: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., lowest_frequency: _Optional[float] = ..., highest_frequency: _Optional[float] = ..., interpolated: _Optional[_Iterable[bool]] = ..., warnings: _Optional[_Iterable[_Union[ModelWarning, _Mapping]]] = ..., distortion: _Optional[_Union[Distortion, _Mapping]] = ..., plan: _Optional[_Union[ExperimentPlan, _Mapping]] = ..., verdicts: _Optional[_Iterable[str]] = ..., drive_map: _Optional[_Union[DriveMap, _Mapping]] = ..., response_damage: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., static_gain: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., static_change: _Optional[_Union[_array_pb2.Array, _Mapping]] = ..., shaped_by: _Optional[str] = ..., target_level: _Optional[float] = ...) -> None: ...
