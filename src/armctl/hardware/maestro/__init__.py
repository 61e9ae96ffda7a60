"""Pololu's Maestro."""
