"""Force elements that SDF lacks: struts, rubber with friction, anti-roll bars and tyres, with their laws."""

from rig_sim.elements.anti_roll_bar import AntiRollBar, AntiRollBarLaw, Lever
from rig_sim.elements.linear_loss import LinearLoss
from rig_sim.elements.rubber import Rubber, RubberLaw
from rig_sim.elements.strut import Strut, StrutLaw
from rig_sim.elements.tyre import Tyre, TyreLaw

__all__ = [
    "AntiRollBar",
    "AntiRollBarLaw",
    "Lever",
    "LinearLoss",
    "Rubber",
    "RubberLaw",
    "Strut",
    "StrutLaw",
    "Tyre",
    "TyreLaw",
]
