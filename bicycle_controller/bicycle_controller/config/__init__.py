"""Configuration of a training: dataclasses, checks, YAML and overrides."""
