"""Pre-test of a rig: pulses within 5 % of the limits, the faults of its channels, and their recording."""

from iterator.pre_test.pre_test import perform_pre_test
from iterator.pre_test.stored import require_pre_test

__all__ = ["perform_pre_test", "require_pre_test"]
