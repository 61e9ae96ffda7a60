"""Meshes of other people's files: read within bounds, and kept on disk."""
