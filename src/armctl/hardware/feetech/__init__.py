"""Feetech's STS, SMS and SCS servos."""

SCS_STEPS = 1024
"""of a servo of the SCS series, over its range"""
