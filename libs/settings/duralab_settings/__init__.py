"""Settings of an identification and an iteration: one frozen model each, for YAML, messages and code.

A section as a user writes it (`ExcitationSettings`, `UpdateSection`) names channels; `resolved` gives it one value for
each channel of a rig, as in a message. The other sections are the same in both. The converter to messages has a
separate face, `duralab_settings.messages`, so that a core with settings does not depend on messages. Strict YAML is
also here, for rigs, campaigns, sweeps and configurations.
"""

from duralab_settings.estimator import BlockSettings, EstimatorKind, EstimatorSettings
from duralab_settings.excitation import (
    AtTarget,
    DriveSpectrum,
    ExcitationKind,
    ExcitationSettings,
    LevelKind,
    PowerSpectrum,
    ResolvedExcitation,
    Spectrum,
    TabulatedSpectrum,
    WhitePinkSpectrum,
)
from duralab_settings.hold import Decision, DecisionKind, HoldPoint, HoldSettings
from duralab_settings.iteration import (
    Acceptance,
    ControlBandSettings,
    CorrectionPrediction,
    CorrectionShape,
    DamageExponent,
    DriveMapSettings,
    GainPoint,
    LimitPolicy,
    PlaybackSettings,
    ResolvedUpdate,
    ResponseGroup,
    SecantSettings,
    StopCriteria,
    UpdateKind,
    UpdatePlugin,
    UpdateSection,
)
from duralab_settings.old_keys import new_key, remarks_on, with_new_keys
from duralab_settings.plugins import Plugin, load_plugin, one_line, plugin_names
from duralab_settings.portable_files import OPEN_BINARY, lock_file
from duralab_settings.regular_files import open_regular, read_regular, require_regular
from duralab_settings.section import Section
from duralab_settings.strict_yaml import LARGEST_TEXT, YamlError, dump_yaml, parse_yaml, read_yaml_text
from duralab_settings.units import UnitError, base_unit, unit_conversion
from duralab_settings.validation import Explanation, explain_validation
from duralab_settings.values import Gain, MisfitError, NotNegative, Positive, Range, Seed, SettingsError, per_channel
from duralab_settings.wording import explained

__all__ = [
    "LARGEST_TEXT",
    "OPEN_BINARY",
    "Acceptance",
    "AtTarget",
    "BlockSettings",
    "ControlBandSettings",
    "CorrectionPrediction",
    "CorrectionShape",
    "DamageExponent",
    "Decision",
    "DecisionKind",
    "DriveMapSettings",
    "DriveSpectrum",
    "EstimatorKind",
    "EstimatorSettings",
    "ExcitationKind",
    "ExcitationSettings",
    "Explanation",
    "Gain",
    "GainPoint",
    "HoldPoint",
    "HoldSettings",
    "LevelKind",
    "LimitPolicy",
    "MisfitError",
    "NotNegative",
    "PlaybackSettings",
    "Plugin",
    "Positive",
    "PowerSpectrum",
    "Range",
    "ResolvedExcitation",
    "ResolvedUpdate",
    "ResponseGroup",
    "SecantSettings",
    "Section",
    "Seed",
    "SettingsError",
    "Spectrum",
    "StopCriteria",
    "TabulatedSpectrum",
    "UnitError",
    "UpdateKind",
    "UpdatePlugin",
    "UpdateSection",
    "WhitePinkSpectrum",
    "YamlError",
    "base_unit",
    "dump_yaml",
    "explain_validation",
    "explained",
    "load_plugin",
    "lock_file",
    "new_key",
    "one_line",
    "open_regular",
    "parse_yaml",
    "per_channel",
    "plugin_names",
    "read_regular",
    "read_yaml_text",
    "remarks_on",
    "require_regular",
    "unit_conversion",
    "with_new_keys",
]
