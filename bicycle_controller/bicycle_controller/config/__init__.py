"""The configuration of a training: dataclasses, checks, YAML and overrides."""
