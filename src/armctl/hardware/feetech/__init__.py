"""Feetech's STS and SMS servos."""
