"""The false-alarm rate in the far tail, where few alarms come from many repeats: at the rate that is the default."""

import numpy as np
import pytest
from scipy import stats

from duralab_monitoring import ChangeWatch, MonitoringSettings

CHANNELS = ("a", "b", "c", "d", "e", "f")


@pytest.mark.parametrize("repeats", [100, 2000])
def test_the_default_rate_holds_from_the_first_repeats_on(repeats):
    """Many short tests: a rate that only holds once much is learnt fails here.

    A detector that does not learn from what is merely suspicious, 4 standard deviations away, has four times the
    stated rate: a baseline that is wrong by chance then stays wrong.
    """
    settings, judged, count = MonitoringSettings(), 0, 0
    random = np.random.default_rng(11)
    while judged < 100_000:
        watch = ChangeWatch(settings, ("one", "two"), channels=CHANNELS)
        drawn = random.standard_normal((repeats, len(CHANNELS), 19))
        for repeat, measures in enumerate(drawn):
            event = ("one", "two")[repeat % 2]
            if repeat < settings.baseline_repeats:
                watch.learn(event, measures)
            else:
                count += len(watch.judge(repeat, event, measures))
        judged += repeats - settings.baseline_repeats
    assert count < stats.poisson.isf(1e-3, 1e-4 * settings.false_alarms * judged)
