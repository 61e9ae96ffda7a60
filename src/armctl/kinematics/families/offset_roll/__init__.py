"""Yaw, parallel pitch joints, and a roll joint with the tool beside its axis."""
