"""Looks: an arm as rows of a few simple solids, which are drawn and kept apart."""
