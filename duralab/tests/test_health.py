"""How a lab is, as a script learns it: the services' figures, and who does not tell."""

import math

import pytest

import duralab_bus
from duralab.lab.status import health_of


@pytest.fixture
def script():
    with duralab_bus.open_bus(service="script") as bus:
        yield bus


def test_figures_come_with_their_labels_and_add_up(script):
    with duralab_bus.open_bus(duralab_bus.BusConfig(connect=script.listening), service="rig_sim") as rig:
        tally = rig.metrics.count("duralab_rig_playbacks_total", "Playbacks", labels=("rig", "code"))
        tally.add("left", "OK", amount=3)
        tally.add("left", "CANCELLED")
        tally.add("right", "OK")
        rig.declare_live("rig_sim", "left")
        rig.declare_live("rig_sim", "right")
        script.wait_for_live({("rig_sim", "left"), ("rig_sim", "right")}, 60.0)
        left, right = health_of(script)
    assert (left.service, left.instance, right.instance) == ("rig_sim", "left", "right")
    assert left.value("duralab_rig_playbacks_total") == right.value("duralab_rig_playbacks_total") == 5.0
    assert left.value("duralab_rig_playbacks_total", rig="left") == 4.0
    assert left.value("duralab_rig_playbacks_total", rig="left", code="OK") == 3.0
    assert left.value("duralab_rig_playbacks_total", rig="nobody") is None
    assert left.value("duralab_unknown") is None
    assert left.up_seconds > 0.0
    assert left.trouble == ""
    kinds = {figure.name: figure.kind for figure in left.figures}
    assert kinds["duralab_rig_playbacks_total"] is duralab_bus.FigureKind.COUNTER
    assert kinds["duralab_up_seconds"] is duralab_bus.FigureKind.GAUGE


def test_gateway_that_does_not_know_the_question_is_there_all_the_same(script):
    with duralab_bus.open_bus(duralab_bus.BusConfig(connect=script.listening), service="gateway") as gateway:
        token = gateway.declare_live("rig_sim", "real")
        # In the place of what duralab_bus serves by itself: a gateway in another language.
        token._answering.close()
        script.wait_for_live({("rig_sim", "real")}, 60.0)
        (real,) = health_of(script)
    assert real.figures == ()
    assert math.isnan(real.up_seconds)
    assert "does not know the question" in real.trouble
