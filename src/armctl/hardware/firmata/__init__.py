"""Arduinos with StandardFirmata."""
