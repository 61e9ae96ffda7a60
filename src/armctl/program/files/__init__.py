"""Programs as files: TOML, CSV, Python scripts."""
