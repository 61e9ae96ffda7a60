"""The third-party firmware: StandardFirmata for the Mega, as the npm package avrgirl-arduino ships it.

``python -m tests.avr.firmata_image`` fetches it; so does the first test that needs it. The package is
only unpacked, never installed, and both it and the image are held to the digests below.
"""

from __future__ import annotations

import base64
import hashlib
import sys
import tarfile
import tempfile
from pathlib import Path

from tests.avr.building import BUILD, BuildError, build_lock, run

PACKAGE = "avrgirl-arduino@5.0.1"
INTEGRITY = "sha512-wF9wJhhRG6vDinBxTuFRR3iIaVDMjJfce2wW7JwmbXJquzoGu3HIK5SnvDqNplsi3hcOS+p+15m1z9kt3IwgdQ=="
MEMBER = "package/junk/hex/mega/StandardFirmata.cpp.hex"
IMAGE_SHA256 = "44139612e9aa601f4e92c40cf7e72e3716871e43b2024323776d8b781d165e68"


def firmata_image() -> Path:
    """The image, fetched when it is not there yet.

    Raises:
        BuildError: it cannot be fetched, or is not the one that was pinned.
    """
    image = BUILD / "StandardFirmata.mega.hex"
    with build_lock():
        if not image.exists():
            _fetch(image)
        digest = hashlib.sha256(image.read_bytes()).hexdigest()
    if digest != IMAGE_SHA256:
        raise BuildError(f"{image} has the sha256 {digest}, not {IMAGE_SHA256}; delete it and try again")
    return image


def _fetch(image: Path) -> None:
    with tempfile.TemporaryDirectory(dir=BUILD) as folder:
        run(["npm", "pack", "--silent", PACKAGE, "--pack-destination", folder], packages="npm")
        package = next(Path(folder).glob("*.tgz"), None)
        if package is None:
            raise BuildError(f"npm pack {PACKAGE} left no package behind")
        digest = base64.b64encode(hashlib.sha512(package.read_bytes()).digest()).decode()
        if f"sha512-{digest}" != INTEGRITY:
            raise BuildError(f"{PACKAGE} has the integrity sha512-{digest}, not the pinned {INTEGRITY}")
        with tarfile.open(package) as archive:
            member = archive.extractfile(MEMBER)
            if member is None:
                raise BuildError(f"{PACKAGE} has no {MEMBER}")
            partial = Path(folder) / "image"
            partial.write_bytes(member.read())
        partial.replace(image)


if __name__ == "__main__":
    try:
        firmata_image()
    except BuildError as error:
        sys.exit(str(error))
