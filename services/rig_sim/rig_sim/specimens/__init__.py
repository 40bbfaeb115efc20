"""The specimens that ship with the project: SDF models with the YAML of what SDF has no word for."""
