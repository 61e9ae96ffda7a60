"""Geometry that solver families share."""
