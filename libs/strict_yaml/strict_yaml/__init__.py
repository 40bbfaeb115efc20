"""YAML as the lab takes it, for whoever reads a file: rigs, campaigns, sweeps and configurations."""

from strict_yaml.reading import YamlError, parse_yaml

__all__ = ["YamlError", "parse_yaml"]
