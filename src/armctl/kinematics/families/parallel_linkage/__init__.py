"""Solver family: arms whose rods keep the hand level."""
