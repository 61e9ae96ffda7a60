"""The Trajectory tab."""
