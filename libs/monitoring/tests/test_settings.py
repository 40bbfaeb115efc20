"""The section `monitoring` of a schedule as a user writes it."""

import pytest

from duralab_monitoring import AbsoluteLimits, MonitoringSettings, Statistic
from duralab_settings import SettingsError, parse_yaml

TEXT = """
baseline_repeats: 20
false_alarms: 0.5
bands: [1, 10, 100]
change: {warning: 0.01, abort: 0.2}
limits:
  left_vertical:
    max: {warning: [-2.0e+3, 2.0e+3], abort: [-3000, 3000]}
    rms: {abort: [10, 900]}
damage_exponent: 3
"""


def test_a_section_is_read_as_it_is_written():
    settings = MonitoringSettings(**parse_yaml(TEXT))
    assert settings.bands == (1.0, 10.0, 100.0)
    assert settings.change.warning == 0.01
    limits = settings.limits["left_vertical"]
    assert limits[Statistic.MAX].warning == (-2000.0, 2000.0)
    assert limits[Statistic.RMS] == AbsoluteLimits(abort=(10.0, 900.0))
    assert MonitoringSettings.model_validate(settings.model_dump()) == settings


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"bands": [1, 10, 5]}, "the edges of bands rise"),
        ({"bands": [10]}, "bands"),
        ({"baseline_repeats": 2}, "baseline_repeats"),
        ({"false_alarms": 0.0}, "false_alarms"),
        ({"change": {"warning": 0.4, "abort": 0.3}}, "the warning comes first"),
        ({"limits": {"a": {"max": {}}}}, "neither warning nor abort"),
        ({"limits": {"a": {"max": {"abort": [3, 1]}}}}, "the lower one first"),
        ({"limits": {"a": {"max": {"warning": [-9, 9], "abort": [-5, 5]}}}}, "the warning comes first"),
        ({"limits": {"a": {"peak": {"abort": [0, 1]}}}}, "peak"),
        ({"window": 3}, "window"),
    ],
)
def test_what_does_not_fit_is_refused_with_a_reason(given, reason):
    with pytest.raises(SettingsError, match=reason):
        MonitoringSettings(**given)
