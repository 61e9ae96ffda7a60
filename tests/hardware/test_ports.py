from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest
from serial.tools.list_ports_common import ListPortInfo

from armctl.errors import PortError
from armctl.hardware.access import TakenDevice
from armctl.hardware.board_type import USB_SERIAL
from armctl.hardware.bus.board import SERVO_BUS
from armctl.hardware.ports import PortChecks, boards_listed_as, find_board, list_ports, listing_of
from armctl.hardware.transport import PortInfo, describe_port


def listed(
    device: str, vid: int | None = None, pid: int | None = None, location: str | None = None
) -> ListPortInfo:
    port = ListPortInfo(device, skip_link_detection=True)
    port.description = f"description of {device}"
    port.vid, port.pid, port.location = vid, pid, location
    port.serial_number = "00046907" if vid else None
    port.hwid = "USB" if vid else "n/a"
    return port


def ports(
    *found: ListPortInfo,
    by_id: Path = Path("/nowhere"),
    may_open: bool = True,
    used_by: str | None = None,
    note: str | None = None,
    taken: Sequence[TakenDevice] = (),
) -> list[PortInfo]:
    notes = () if note is None else (note,)
    checks = PortChecks(
        lambda _device: may_open, lambda _device: used_by, lambda _device: notes, lambda: taken
    )
    return list_ports(lambda: found, by_id, checks)


COMMAND_PORT = listed("/dev/ttyACM0", 0x1FFB, 0x0089, "1-1.2:1.0")
TTL_PORT = listed("/dev/ttyACM1", 0x1FFB, 0x0089, "1-1.2:1.2")


def test_the_command_port_of_a_maestro_and_not_its_ttl_port():
    command, ttl = ports(TTL_PORT, COMMAND_PORT)
    assert command == PortInfo(
        device="/dev/ttyACM0",
        kind="Pololu Micro Maestro 6-channel",
        description="description of /dev/ttyACM0",
        serial_number="00046907",
        usable=True,
        why_not=None,
    )
    assert ttl.kind == command.kind
    assert ttl.usable is False
    assert ttl.why_not is not None
    assert ttl.why_not.startswith("this is the Maestro's TTL port")
    assert find_board([ttl, command], "maestro") == command


@pytest.mark.parametrize(
    ("vid", "pid", "kind"),
    [
        (0x1FFB, 0x0089, "Pololu Micro Maestro 6-channel"),
        (0x1FFB, 0x008A, "Pololu Mini Maestro 12-channel"),
        (0x1FFB, 0x008B, "Pololu Mini Maestro 18-channel"),
        (0x1FFB, 0x008C, "Pololu Mini Maestro 24-channel"),
        *((vid, pid, "Arduino Mega") for vid in (0x2341, 0x2A03) for pid in (0x0010, 0x0042)),
        (0x2341, 0x0210, "Arduino Mega"),
        (0x2341, 0x0242, "Arduino Mega"),
        (0x2341, 0x0043, "Arduino or clone (USB-serial)"),  # Uno R3
        (0x2A03, 0x0043, "Arduino or clone (USB-serial)"),
        (0x1A86, 0x7523, "Arduino or clone (USB-serial)"),  # CH340
        (0x1A86, 0x55D4, "Arduino or clone (USB-serial)"),  # CH9102
        (0x0403, 0x6001, "Arduino or clone (USB-serial)"),  # FT232R
        (0x10C4, 0xEA60, "Arduino or clone (USB-serial)"),  # CP2102
        (0x067B, 0x2303, "Arduino or clone (USB-serial)"),  # PL2303
        (0x0403, 0x6011, "unknown"),  # another device of a chip's maker
    ],
)
def test_every_board_by_its_usb_numbers(vid: int, pid: int, kind: str):
    (port,) = ports(listed("/dev/ttyACM0", vid, pid))
    assert (port.kind, port.usable) == (kind, True)


def test_boards_that_are_known_come_first_and_ports_without_hardware_not_at_all():
    found = ports(
        listed("/dev/ttyS0"),
        listed("/dev/ttyACM0", 0x0BDA, 0x0001),
        listed("/dev/ttyUSB0", 0x0403, 0x6001),
        listed("/dev/ttyACM3", 0x2341, 0x0042),
    )
    assert [(port.device, port.kind) for port in found] == [
        ("/dev/ttyACM3", "Arduino Mega"),
        ("/dev/ttyUSB0", "Arduino or clone (USB-serial)"),
        ("/dev/ttyACM0", "unknown"),
    ]


def test_a_port_that_cannot_be_opened_says_why_and_what_to_do():
    (port,) = ports(COMMAND_PORT, may_open=False)
    assert port.usable is False
    assert port.why_not is not None
    assert port.why_not.startswith("no permission to open it; run `sudo usermod -aG dialout $USER`")
    assert "armctl ports --udev | sudo tee /etc/udev/rules.d/70-armctl.rules" in port.why_not
    (port,) = ports(COMMAND_PORT, used_by="minicom (process 812)")
    assert port.usable is False
    assert port.why_not == "in use by another program: minicom (process 812); close that and try again"


def test_modem_manager_is_mentioned_for_boards_only():
    board, unknown = ports(
        COMMAND_PORT, listed("/dev/ttyACM5", 0x12D1, 0x1001), note="ModemManager is running"
    )
    assert (board.usable, board.notes) == (True, ("ModemManager is running",))
    assert unknown.notes == ()


def test_a_board_that_brltty_has_taken_is_listed_and_no_port_to_choose():
    ours = TakenDevice("1-1.2", 0x1A86, 0x7523, "A7", "brltty takes it; run this")
    others = TakenDevice("1-3", 0x0BDA, 0x0001, None, "brltty takes it")
    (found,) = ports(taken=(ours, others))
    assert (found.device, found.kind, found.serial_number) == (
        "USB 1-1.2",
        "Arduino or clone (USB-serial)",
        "A7",
    )
    assert (found.usable, found.missing, found.why_not) == (False, True, ours.why)
    with pytest.raises(PortError, match=r"plugged in cannot be used: USB 1-1\.2: brltty takes it; run this"):
        find_board([found], "firmata")
    other = ports(listed("/dev/ttyACM3", 0x2341, 0x0042), taken=(ours,))
    assert find_board(other, "firmata").device == "/dev/ttyACM3"


@pytest.fixture
def by_id(tmp_path: Path) -> Path:
    """udev's folder with the two ports of a Maestro and an adapter, pointing to files of this test."""
    folder = tmp_path / "by-id"
    folder.mkdir()
    name = "usb-Pololu_Corporation_Pololu_Micro_Maestro_6-Servo_Controller_00046907"
    for suffix, device in (("-if00", "ttyACM0"), ("-if02", "ttyACM1")):
        (tmp_path / device).touch()
        (folder / f"{name}{suffix}").symlink_to(tmp_path / device)
    (tmp_path / "ttyUSB0").touch()
    (folder / "usb-FTDI_FT232R_USB_UART_A7007dag-if00-port0").symlink_to(tmp_path / "ttyUSB0")
    return folder


def test_stable_names_alone_are_enough(by_id: Path, tmp_path: Path):
    command, ttl, adapter = ports(by_id=by_id)
    assert command.device == str(tmp_path / "ttyACM0")
    assert command.kind == "Pololu Micro Maestro 6-channel"
    assert command.serial_number == "00046907"
    assert command.usable is True
    assert command.stable_name is not None
    assert command.stable_name.endswith("00046907-if00")
    assert (ttl.device, ttl.usable) == (str(tmp_path / "ttyACM1"), False)
    assert (adapter.kind, adapter.serial_number, adapter.usable) == ("unknown", "A7007dag", True)


def test_stable_names_tell_the_interface_where_the_listing_does_not(by_id: Path, tmp_path: Path):
    found = ports(
        listed(str(tmp_path / "ttyACM0"), 0x1FFB, 0x0089),
        listed(str(tmp_path / "ttyACM1"), 0x1FFB, 0x0089),
        by_id=by_id,
    )
    maestros = [port for port in found if port.kind != "unknown"]
    assert [(Path(port.device).name, port.usable) for port in maestros] == [
        ("ttyACM0", True),
        ("ttyACM1", False),
    ]


def test_a_port_is_found_under_any_of_its_names(by_id: Path, tmp_path: Path):
    found = ports(by_id=by_id)
    by_stable_name = describe_port(str(next(by_id.glob("*-if00"))), found)
    assert by_stable_name is not None
    assert by_stable_name == describe_port(str(tmp_path / "ttyACM0"), found)
    assert describe_port("/dev/pts/7", found) is None
    assert describe_port("socket://127.0.0.1:5000", found) is None


MINI = listed("/dev/ttyACM2", 0x1FFB, 0x008A, "1-1.3:1.0")
MEGA = listed("/dev/ttyACM3", 0x2341, 0x0042)
OTHER_MEGA = listed("/dev/ttyACM4", 0x2A03, 0x0010)
CLONE = listed("/dev/ttyUSB0", 0x1A86, 0x7523)
OTHER_CLONE = listed("/dev/ttyUSB1", 0x0403, 0x6001)


@pytest.mark.parametrize(
    ("found", "kind", "device"),
    [
        ((COMMAND_PORT, TTL_PORT, MEGA), "maestro", "/dev/ttyACM0"),
        *(
            (found, kind, device)
            for kind in ("firmata", "encoder")
            for found, device in (
                ((COMMAND_PORT, MEGA), "/dev/ttyACM3"),
                ((CLONE,), "/dev/ttyUSB0"),
                ((CLONE, MEGA), "/dev/ttyACM3"),  # what calls itself a Mega goes before what may be anything
            )
        ),
        ((COMMAND_PORT, TTL_PORT), None, "/dev/ttyACM0"),
        ((CLONE, MEGA), None, "/dev/ttyACM3"),
        ((CLONE,), None, "/dev/ttyUSB0"),
    ],
)
def test_the_board_that_is_meant(found: tuple[ListPortInfo, ...], kind: str | None, device: str):
    assert find_board(ports(*found), kind).device == device


@pytest.mark.parametrize(
    ("found", "kind", "says"),
    [
        ((), "maestro", "no Maestro found; serial ports: none at all; plug one in"),
        ((), "firmata", "no Arduino found; serial ports: none at all; plug one in"),
        ((), None, "no board found; serial ports: none at all"),
        ((MEGA,), "maestro", r"serial ports: /dev/ttyACM3 \(Arduino Mega\)"),
        ((COMMAND_PORT,), "encoder", r"serial ports: /dev/ttyACM0 \(Pololu Micro Maestro 6-channel\)"),
        ((COMMAND_PORT, TTL_PORT, MINI), "maestro", "several Maestros .*ttyACM0 .*ttyACM2 .*name one"),
        ((MEGA, OTHER_MEGA), "firmata", "several Arduinos may be meant: .*ttyACM3 .*ttyACM4 .*name one"),
        ((CLONE, OTHER_CLONE), "firmata", "several Arduinos may be meant: .*ttyUSB0 .*ttyUSB1 .*name one"),
        ((COMMAND_PORT, MEGA), None, r"several boards may be meant: /dev/ttyACM\d .*/dev/ttyACM\d"),
        ((TTL_PORT,), "maestro", "the Maestro that is plugged in cannot be used: /dev/ttyACM1: this is the"),
    ],
)
def test_no_board_or_several(found: tuple[ListPortInfo, ...], kind: str | None, says: str):
    with pytest.raises(PortError, match=says):
        find_board(ports(*found), kind)


def test_the_real_listing_of_this_computer_is_readable():
    for port in list_ports():
        assert port.usable == (port.why_not is None)


@pytest.mark.parametrize(
    ("chip", "vendor", "product", "listing"),
    [
        ("CH343 of a Waveshare board", 0x1A86, 0x55D3, SERVO_BUS),
        ("FT232H of a U2D2", 0x0403, 0x6014, SERVO_BUS),
        ("OpenRB-150", 0x2F5D, 0x2202, SERVO_BUS),
        ("CH340, which may be anything", 0x1A86, 0x7523, USB_SERIAL),
        ("CP2102, likewise", 0x10C4, 0xEA60, USB_SERIAL),
    ],
)
def test_adapters_of_servo_buses_are_known_and_what_may_be_one_may_be_chosen(
    chip: str, vendor: int, product: int, listing: str
) -> None:
    assert listing_of(vendor, product) == listing, chip
    behind = [board.kind for board in boards_listed_as(listing)]
    assert {"feetech", "dynamixel", "feetech_scs"} <= set(behind)
