"""Metrics: counted and read in one place, and the same for Prometheus and over the bus."""

import math
import urllib.request

import pytest
from prometheus_client.parser import text_string_to_metric_families

import duralab_bus
from duralab_bus.metrics import FigureKind, Metrics, MetricsConfig, serve_metrics
from duralab_proto.v1 import health_pb2, rig_pb2


def page(address):
    with urllib.request.urlopen(address, timeout=10.0) as answer:
        return answer.read().decode()


def samples(text):
    return {
        (sample.name, tuple(sorted(sample.labels.items()))): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def told(health):
    return {
        (family.name, tuple(sorted(zip(family.labels, value.labels, strict=True)))): value.value
        for family in health.figures
        for value in family.values
    }


def test_counters_add_up_and_gauges_are_read_when_asked():
    metrics, level = Metrics(), {(): 1.0}
    counter = metrics.count("duralab_things_total", "Things", labels=("kind",))
    metrics.follow("duralab_level", "Level", lambda: level)
    counter.add("a")
    counter.add("a", amount=2.5)
    counter.add("b")
    level[()] = 7.0
    found = {family.name: (family.kind, dict(family.values)) for family in metrics.families()}
    assert found == {
        "duralab_level": (FigureKind.GAUGE, {(): 7.0}),
        "duralab_things_total": (FigureKind.COUNTER, {("a",): 3.5, ("b",): 1.0}),
    }


def test_readings_of_one_name_stand_side_by_side():
    metrics = Metrics()
    for rig in ("one", "two"):
        metrics.follow("duralab_rig_level", "Level", lambda rig=rig: {(rig,): 1.0}, labels=("rig",))
    (family,) = metrics.families()
    assert set(family.values) == {("one",), ("two",)}


@pytest.mark.parametrize("name", ["things_total", "duralab_Things_total", "duralab_things", "duralab_things_total "])
def test_counter_with_another_name_is_refused(name):
    with pytest.raises(ValueError, match="must be named"):
        Metrics().count(name, "Things")


def test_figure_that_means_two_things_is_refused():
    metrics = Metrics()
    metrics.count("duralab_things_total", "Things")
    with pytest.raises(ValueError, match="already exists"):
        metrics.count("duralab_things_total", "Other things")


def test_labels_of_another_number_are_refused():
    with pytest.raises(ValueError, match="1 labels; this counter has 2"):
        Metrics().count("duralab_things_total", "Things", labels=("a", "b")).add("only one")


def test_figure_that_cannot_be_read_hides_no_other():
    metrics = Metrics()
    metrics.follow("duralab_broken", "Broken", lambda: 1 / 0)
    metrics.follow("duralab_sound", "Sound", lambda: {(): 1.0})
    assert {family.name: dict(family.values) for family in metrics.families()} == {
        "duralab_broken": {},
        "duralab_sound": {(): 1.0},
    }


def test_prometheus_reads_what_was_counted_on_loopback():
    metrics = Metrics()
    metrics.count("duralab_things_total", "Things", labels=("kind",)).add('quoted "kind"\n')
    metrics.follow("duralab_level", "Level", lambda: {(): math.nan})
    with serve_metrics(MetricsConfig(port=0), metrics) as address:
        assert address.startswith("http://127.0.0.1:")
        read = samples(page(address))
    assert read["duralab_things_total", (("kind", 'quoted "kind"\n'),)] == 1.0
    assert math.isnan(read["duralab_level", ()])
    assert ("process_cpu_seconds_total", ()) in read


def test_port_in_use_is_one_sentence():
    metrics = Metrics()
    with serve_metrics(MetricsConfig(port=0), metrics) as address:
        port = int(address.split(":")[2].split("/")[0])
        with (
            pytest.raises(duralab_bus.ConfigError, match=rf"127.0.0.1:{port}: .*in use; correct `metrics`"),
            serve_metrics(MetricsConfig(port=port), metrics),
        ):
            pass


def test_health_on_the_bus_is_what_prometheus_is_told():
    with (
        duralab_bus.open_bus(service="bench") as bus,
        duralab_bus.open_bus(duralab_bus.BusConfig(connect=bus.listening), service="script") as script,
    ):
        bus.serve(bus.keys.rig_state("bench"), rig_pb2.StateRequest, lambda _request, _call: rig_pb2.RigState())
        bus.declare_live("rig_sim", "bench")
        script.wait_for_live({("rig_sim", "bench")}, 60.0)
        for _ in range(3):
            script.query(script.keys.rig_state("bench"), rig_pb2.StateRequest(), rig_pb2.RigState)
        bus.publisher(bus.keys.rig_state("bench")).put(rig_pb2.RigState())
        health = script.query(script.keys.health("rig_sim", "bench"), health_pb2.HealthRequest(), health_pb2.Health)
        with serve_metrics(MetricsConfig(port=0), bus.metrics) as address:
            read = samples(page(address))
    answer = told(health)
    assert (health.service, health.instance) == ("rig_sim", "bench")
    assert health.up_seconds > 0.0
    assert answer["duralab_queries_total", (("code", "OK"), ("key", "rig/bench/state"))] == 3.0
    assert answer["duralab_stream_published_messages_total", (("message", "RigState"),)] == 1.0
    # The question itself was counted in between.
    moved = {"duralab_up_seconds", "duralab_queries_total", "duralab_queries_running"}
    assert {key: value for key, value in answer.items() if key[0] not in moved} == {
        key: value for key, value in read.items() if key[0].startswith("duralab_") and key[0] not in moved
    }
    assert {family.name for family in health.figures} == {family.name for family in bus.metrics.families()}


def test_received_fetched_and_missing_messages_are_counted(until):
    with (
        duralab_bus.open_bus(service="bench") as bus,
        duralab_bus.open_bus(duralab_bus.BusConfig(connect=bus.listening), service="recorder") as recorder,
    ):
        publisher = bus.publisher(bus.keys.rig_state("bench"))
        for number in range(5):
            publisher.put(rig_pb2.RigState(fraction=number / 5))
        # Too late for the messages themselves: all five are fetched.
        got = []
        subscription = recorder.subscribe(bus.keys.rig_state("*"), rig_pb2.RigState, got.append, repair=True)
        until(lambda: len(got) == 5)
        counted = {family.name: dict(family.values) for family in recorder.metrics.families()}
        assert counted["duralab_stream_received_messages_total"] == {("RigState",): 5.0}
        assert counted["duralab_stream_fetched_messages_total"] == {("RigState",): 5.0}
        assert counted["duralab_stream_missing_messages"] == {("RigState",): 0.0}
        assert counted["duralab_stream_lost_messages_total"] == {("RigState",): 0.0}
        # A recorder that marks is waited for: what it has not stored is told of.
        subscription.mark([item.position for item in got[:2]])
        until(
            lambda: {f.name: f.values for f in bus.metrics.families()}["duralab_stream_unstored_messages"] == {(): 3.0}
        )
