"""``python -m armctl.process``: what ``start_arm`` starts."""

from armctl.process.start import main

if __name__ == "__main__":
    main()
