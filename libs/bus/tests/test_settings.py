"""Configuration from a file and the environment: the environment wins, and nothing wrong passes the start."""

import pytest
from pydantic import Field

from duralab_bus import BusMode, ConfigError, ServiceConfig
from duralab_bus.yaml_config import configured


class LabConfig(ServiceConfig):
    rigs: tuple[str, ...] = ("front_axle",)
    levels: dict[str, float] = Field(default_factory=dict)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "lab.yaml"
    path.write_text("bus: {lab: workshop, connect: ['tcp/10.0.0.1:7447']}\nworkers: 7\n")
    return path


def test_environment_lies_over_the_file_value_by_value(file, monkeypatch):
    monkeypatch.setenv("DURALAB__BUS__CONNECT", '["tcp/router:7447"]')
    monkeypatch.setenv("DURALAB__BUS__MODE", "client")
    monkeypatch.setenv("DURALAB__RIGS", '["a", "b"]')
    monkeypatch.setenv("DURALAB__LEVELS", '{"a": 0.5}')
    monkeypatch.setenv("DURALAB__METRICS__PORT", "9464")
    config = configured(LabConfig, file)
    assert config.bus.connect == ("tcp/router:7447",)
    assert (config.bus.mode, config.bus.lab, config.workers) == (BusMode.CLIENT, "workshop", 7)
    assert (config.rigs, config.levels) == (("a", "b"), {"a": 0.5})
    assert config.metrics is not None
    assert (config.metrics.host, config.metrics.port) == ("127.0.0.1", 9464)


def test_environment_alone_will_do(monkeypatch):
    monkeypatch.setenv("DURALAB__WORKERS", "3")
    assert configured(LabConfig, None).workers == 3
    monkeypatch.delenv("DURALAB__WORKERS")
    assert configured(LabConfig, None) == LabConfig()


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("DURALAB__WORKER", "3", "DURALAB__WORKER, which this service does not know; known are bus"),
        ("DURALAB__WORKERS", "many", "workers is 'many'"),
        ("DURALAB__WORKERS", "65", "workers is '65'"),
        ("DURALAB__BUS__CONECT", "[]", "unknown key 'conect' in bus; allowed: "),
        ("DURALAB__BUS__LAB", "A B", "'A B' is not a name"),
        ("DURALAB__RIGS", "[a", "DURALAB__RIGS; lists and mappings are written as JSON"),
    ],
)
def test_wrong_variable_is_one_sentence_that_names_it(file, monkeypatch, name, text, said):
    monkeypatch.setenv(name, text)
    with pytest.raises(ConfigError) as caught:
        configured(LabConfig, file)
    assert said in str(caught.value)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


def test_other_variables_are_none_of_a_service(monkeypatch):
    monkeypatch.setenv("DURALAB_FUZZ_SEED", "1")
    assert configured(LabConfig, None) == LabConfig()
