"""Any other chain: damped least squares from many starts."""
