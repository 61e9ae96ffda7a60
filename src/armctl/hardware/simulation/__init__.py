"""Simulated boards on a line: pseudo-terminals, memory, faults."""
