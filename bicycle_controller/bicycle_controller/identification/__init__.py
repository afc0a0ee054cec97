"""Identification: a bicycle's parameters from logs of its rides."""
