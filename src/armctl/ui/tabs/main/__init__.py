"""The Main tab."""
