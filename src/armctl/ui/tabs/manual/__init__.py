"""The Manual tab."""
