"""Six joints in any position to each other: offset wrists, calibrated arms, arms nearly of a family."""
