"""Arduinos with armctl's own firmware for motors with encoders."""
