"""Straight-line code made from DH rows: forward kinematics and Jacobian without loops over rows."""
