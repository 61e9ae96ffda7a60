"""Seven joints: the first or the last one is free, and the six others are closed form."""
