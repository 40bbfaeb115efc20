"""A configuration that is none is one sentence that says where."""

import pytest

from duralab_bus import ConfigError, ServiceConfig, load_config


@pytest.mark.parametrize("text", ["workers: 2\nworkers: 3", "workers: 2024-02-30", "bus: " + "[" * 3_000])
def test_a_configuration_that_is_none_is_a_configuration_error(tmp_path, text):
    path = tmp_path / "lab.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"lab\.yaml is not YAML: .* \(line \d, column \d+\)\.$"):
        load_config(ServiceConfig, path)
