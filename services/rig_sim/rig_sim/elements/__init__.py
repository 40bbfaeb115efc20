"""Force elements that SDF has no word for: struts, rubber with friction, anti-roll bars, tyres; laws and equations."""

from rig_sim.elements.anti_roll_bar import AntiRollBarLaw
from rig_sim.elements.rubber import RubberLaw
from rig_sim.elements.strut import StrutLaw
from rig_sim.elements.tyre import TyreLaw

__all__ = [
    "AntiRollBarLaw",
    "RubberLaw",
    "StrutLaw",
    "TyreLaw",
]
