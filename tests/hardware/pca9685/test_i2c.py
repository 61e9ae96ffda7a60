"""I²C buses of this computer: addresses, transfers as bytes, and Linux's own bus through smbus2."""

from __future__ import annotations

import errno
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from armctl.errors import BoardError, PortError
from armctl.hardware.pca9685 import PI_BUS, i2c
from armctl.hardware.pca9685.i2c import BusTransport, bus_and_address, carried_out, pi_buses, request
from armctl.hardware.pca9685.simulated import SimulatedI2cBus, SimulatedPca9685


def test_addresses():
    assert bus_and_address("i2c://1/0x40") == (1, 0x40)
    assert bus_and_address("i2c://10/0x7f") == (10, 0x7F)
    assert bus_and_address("i2c://1/65") == (1, 0x41)
    assert bus_and_address("i2c://1") == (1, None)


@pytest.mark.parametrize("port", ["i2c://", "i2c://1/", "i2c:///dev/i2c-1", "i2c://1/0x40/2", "i2c://x/0x40"])
def test_what_is_no_bus(port: str):
    with pytest.raises(PortError, match=r"not an I²C bus; name a bus and an address, as in i2c://1/0x40"):
        bus_and_address(port)


@pytest.mark.parametrize("address", ["0x3f", "0x80", "0x70", "400"])
def test_an_address_that_no_pca9685_has(address: str):
    with pytest.raises(PortError, match=r"0x40 … 0x7f, but not 0x70.*i2cdetect -y 1"):
        bus_and_address(f"i2c://1/{address}")


def test_transfers_as_bytes():
    bus = SimulatedI2cBus([SimulatedPca9685(0x41)])
    read_mode1 = request(7, 0x41, b"\x00", 1)
    assert read_mode1.hex(" ") == "07 41 01 01 00"
    assert bus.feed(read_mode1).hex(" ") == "07 00 11"  # acknowledged; asleep, listens to all
    assert bus.feed(request(8, 0x40, b"\x00", 1)).hex(" ") == "08 01"  # nobody acknowledges
    assert bus.feed(request(9, 0x41, b"\x00\x31", 0) + read_mode1).hex(" ") == "09 00 07 00 31"
    assert list(carried_out(read_mode1[:-1], bus.transfer)) == []  # half a transfer is none


class FakeMessage:
    """As smbus2's i2c_msg."""

    def __init__(self, address: int, data: bytes, count: int) -> None:
        self.address, self.data, self.count = address, bytes(data), count

    @classmethod
    def read(cls, address: int, length: int) -> FakeMessage:
        return cls(address, b"", length)

    @classmethod
    def write(cls, address: int, buf: bytes) -> FakeMessage:
        return cls(address, buf, 0)

    def __bytes__(self) -> bytes:
        return self.data


class FakeBus:
    """As smbus2's SMBus, with a simulated bus behind it; ``fails`` is what the kernel reports."""

    fails: int | None = None
    opening: OSError | None = None

    def __init__(self, number: int) -> None:
        if self.opening is not None:
            raise self.opening
        self.number, self.open = number, True
        self.bus = SimulatedI2cBus([SimulatedPca9685()])

    def i2c_rdwr(self, *messages: FakeMessage) -> None:
        if self.fails is not None:
            raise OSError(self.fails, "as the kernel has it")
        data = b"".join(one.data for one in messages)
        found = self.bus.transfer(messages[0].address, data, messages[-1].count)
        if found is None:
            raise OSError(errno.EREMOTEIO, "Remote I/O error")
        if messages[-1].count:
            messages[-1].data = found

    def close(self) -> None:
        self.open = False


@pytest.fixture
def smbus2(monkeypatch: pytest.MonkeyPatch) -> type[FakeBus]:
    fake = type("Bus", (FakeBus,), {})
    monkeypatch.setitem(sys.modules, "smbus2", SimpleNamespace(SMBus=fake, i2c_msg=FakeMessage))
    return fake


def test_a_bus_of_linux(smbus2: type[FakeBus]):
    line = BusTransport("i2c://1/0x40")
    assert line.name == "i2c://1/0x40"
    line.write(request(1, 0x40, b"\x05", 1) + request(2, 0x41, b"\x05", 1))
    assert line.read(64, 1.0).hex(" ") == "01 00 e0 02 01"
    line.write(request(3, 0x40, b"\x00\x31", 0) + request(4, 0x40, b"", 1))
    line.discard_input()
    assert line.read(64, 1.0) == b""
    line.close()
    line.close()


def test_a_bus_that_fails_is_not_a_chip_that_is_silent(smbus2: type[FakeBus]):
    line = BusTransport("i2c://1")
    smbus2.fails = errno.ETIMEDOUT
    with pytest.raises(BoardError, match=r"the I²C bus failed .*short between SDA, SCL and GND"):
        line.write(request(1, 0x40, b"\x00", 1))
    smbus2.fails = errno.ENXIO
    line.write(request(2, 0x40, b"\x00", 1))
    assert line.read(8, 0.1).hex(" ") == "02 01"


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (
            FileNotFoundError(errno.ENOENT, "No such file"),
            "there is no /dev/i2c-1: switch I²C on .*raspi-config",
        ),
        (PermissionError(errno.EACCES, "Permission denied"), r"no permission .*sudo usermod -aG i2c \$USER"),
        (OSError(errno.EIO, "Input/output error"), r"/dev/i2c-1 cannot be opened \(Input/output error\)"),
    ],
)
def test_a_bus_that_cannot_be_opened(smbus2: type[FakeBus], error: OSError, says: str):
    smbus2.opening = error
    with pytest.raises(PortError, match=rf"i2c://1: .*{says}"):
        BusTransport("i2c://1")


def test_without_the_package_the_error_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "smbus2", None)
    with pytest.raises(PortError, match=r"i2c://1: .*which is not installed: pip install smbus2"):
        BusTransport("i2c://1")


def test_only_the_bus_of_a_raspberry_pi_is_listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    model = tmp_path / "model"
    assert pi_buses(model, tmp_path) == ()
    model.write_bytes(b"Some Laptop\0")
    (tmp_path / "i2c-1").touch()
    assert pi_buses(model, tmp_path) == ()
    model.write_bytes(b"Raspberry Pi 4 Model B Rev 1.4\0")
    (listed,) = pi_buses(model, tmp_path)
    assert (listed.device, listed.kind, listed.usable) == ("i2c://1", PI_BUS, True)
    assert listed.description == "Raspberry Pi 4 Model B Rev 1.4"
    monkeypatch.setattr(i2c, "may_open", lambda _: False)
    (listed,) = pi_buses(model, tmp_path)
    assert not listed.usable
    assert "usermod -aG" in (listed.why_not or "")
    (tmp_path / "i2c-1").unlink()
    assert pi_buses(model, tmp_path) == ()
