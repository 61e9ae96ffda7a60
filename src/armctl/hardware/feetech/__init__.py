"""Feetech's STS, SMS and SCS servos."""
