"""The Inverse tab."""
