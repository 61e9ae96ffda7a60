"""The Simulation tab."""
