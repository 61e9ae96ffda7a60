from __future__ import annotations

from pathlib import Path

import pytest
from serial.tools.list_ports_common import ListPortInfo

from armctl.errors import PortError
from armctl.hardware.ports import PortChecks, find_board, list_ports
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
) -> list[PortInfo]:
    checks = PortChecks(lambda _device: may_open, lambda _device: used_by, lambda _device: note)
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
    ("pid", "kind"),
    [
        (0x0089, "Pololu Micro Maestro 6-channel"),
        (0x008A, "Pololu Mini Maestro 12-channel"),
        (0x008B, "Pololu Mini Maestro 18-channel"),
        (0x008C, "Pololu Mini Maestro 24-channel"),
    ],
)
def test_every_maestro_by_its_usb_numbers(pid, kind):
    assert [port.kind for port in ports(listed("/dev/ttyACM0", 0x1FFB, pid))] == [kind]


@pytest.mark.parametrize(
    ("vid", "pid"),
    [
        (0x2341, 0x0010),
        (0x2341, 0x0042),
        (0x2A03, 0x0010),
        (0x2A03, 0x0042),
        (0x2341, 0x0210),
        (0x2341, 0x0242),
    ],
)
def test_an_arduino_mega(vid, pid):
    (port,) = ports(listed("/dev/ttyACM0", vid, pid))
    assert (port.kind, port.usable) == ("Arduino Mega", True)


@pytest.mark.parametrize(
    ("vid", "pid"),
    [
        (0x2341, 0x0043),  # Uno R3
        (0x2341, 0x0001),  # Uno
        (0x2A03, 0x0043),
        (0x1A86, 0x7523),  # CH340
        (0x1A86, 0x55D4),  # CH9102
        (0x0403, 0x6001),  # FT232R
        (0x10C4, 0xEA60),  # CP2102
        (0x067B, 0x2303),  # PL2303
    ],
)
def test_what_may_be_an_arduino_is_not_said_to_be_more(vid, pid):
    (port,) = ports(listed("/dev/ttyUSB0", vid, pid))
    assert (port.kind, port.usable) == ("Arduino or clone (USB-serial)", True)


def test_another_device_of_a_chips_maker_is_unknown():
    (port,) = ports(listed("/dev/ttyUSB0", 0x0403, 0x6011))
    assert port.kind == "unknown"


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


def test_a_port_without_permission_says_what_to_type():
    (port,) = ports(COMMAND_PORT, may_open=False)
    assert port.usable is False
    assert port.why_not is not None
    assert port.why_not.startswith("no permission to open it; run `sudo usermod -aG dialout $USER`")
    assert "armctl ports --udev | sudo tee /etc/udev/rules.d/70-armctl.rules" in port.why_not


def test_a_port_that_another_program_has_open_says_which():
    (port,) = ports(COMMAND_PORT, used_by="minicom (process 812)")
    assert port.usable is False
    assert port.why_not == "in use by another program: minicom (process 812); close that and try again"


def test_modem_manager_is_mentioned_for_boards_only():
    board, unknown = ports(
        COMMAND_PORT, listed("/dev/ttyACM5", 0x12D1, 0x1001), note="ModemManager is running"
    )
    assert (board.usable, board.notes) == (True, ("ModemManager is running",))
    assert unknown.notes == ()


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


def test_a_folder_of_stable_names_that_vanishes_while_it_is_read(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    monkeypatch.setattr(Path, "is_dir", lambda _self: True)  # udev removes it right after the look
    assert ports(by_id=tmp_path / "by-id") == []


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


def test_no_maestro():
    with pytest.raises(PortError, match=r"no Maestro found; serial ports: none at all; plug one in"):
        find_board([], "maestro")
    mega = ports(listed("/dev/ttyACM3", 0x2341, 0x0042))
    with pytest.raises(PortError, match=r"serial ports: /dev/ttyACM3 \(Arduino Mega\)"):
        find_board(mega, "maestro")


def test_several_maestros():
    other = listed("/dev/ttyACM2", 0x1FFB, 0x008A, "1-1.3:1.0")
    with pytest.raises(PortError, match=r"several Maestros .*/dev/ttyACM0 .*/dev/ttyACM2 .*name one"):
        find_board(ports(COMMAND_PORT, TTL_PORT, other), "maestro")


def test_a_maestro_that_cannot_be_used():
    with pytest.raises(
        PortError,
        match="the Maestro that is plugged in cannot be used: /dev/ttyACM1: this is the Maestro's TTL port",
    ):
        find_board(ports(TTL_PORT), "maestro")


MEGA = listed("/dev/ttyACM3", 0x2341, 0x0042)
CLONE = listed("/dev/ttyUSB0", 0x1A86, 0x7523)


@pytest.mark.parametrize("kind", ["firmata", "encoder"])
def test_an_arduino_for_a_board_that_runs_on_one(kind):
    assert find_board(ports(COMMAND_PORT, MEGA), kind).device == "/dev/ttyACM3"
    assert find_board(ports(CLONE), kind).device == "/dev/ttyUSB0"
    # What calls itself a Mega goes before what may be anything.
    assert find_board(ports(CLONE, MEGA), kind).device == "/dev/ttyACM3"


def test_a_maestro_for_a_maestro():
    assert find_board(ports(COMMAND_PORT, TTL_PORT, MEGA), "maestro").device == "/dev/ttyACM0"


def test_any_board_is_found_where_no_kind_is_wanted():
    assert find_board(ports(COMMAND_PORT, TTL_PORT), None).device == "/dev/ttyACM0"
    assert find_board(ports(CLONE, MEGA), None).device == "/dev/ttyACM3"
    assert find_board(ports(CLONE), None).device == "/dev/ttyUSB0"
    with pytest.raises(PortError, match=r"several boards may be meant: /dev/ttyACM\d .*/dev/ttyACM\d"):
        find_board(ports(COMMAND_PORT, MEGA), None)
    with pytest.raises(PortError, match="no board found; serial ports: none at all"):
        find_board([], None)


def test_no_arduino():
    with pytest.raises(PortError, match=r"no Arduino found; serial ports: none at all; plug one in"):
        find_board([], "firmata")
    with pytest.raises(PortError, match=r"serial ports: /dev/ttyACM0 \(Pololu Micro Maestro 6-channel\)"):
        find_board(ports(COMMAND_PORT), "encoder")


@pytest.mark.parametrize("pair", [((0x2341, 0x0042), (0x2A03, 0x0010)), ((0x1A86, 0x7523), (0x0403, 0x6001))])
def test_several_arduinos_that_may_be_meant(pair):
    found = ports(*(listed(f"/dev/ttyX{number}", *usb) for number, usb in enumerate(pair)))
    with pytest.raises(PortError, match=r"several Arduinos may be meant: /dev/ttyX0 .*/dev/ttyX1 .*name one"):
        find_board(found, "firmata")


def test_an_arduino_that_cannot_be_used():
    found = ports(MEGA, used_by="avrdude (process 9)")
    with pytest.raises(PortError, match=r"cannot be used: /dev/ttyACM3: in use by another program: avrdude"):
        find_board(found, "encoder")


def test_the_real_listing_of_this_computer_is_readable():
    for port in list_ports():
        assert port.usable == (port.why_not is None)
