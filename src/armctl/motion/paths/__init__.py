"""Paths: where a motion goes, without its time."""
