"""Serial motion, on the Manual tab."""
