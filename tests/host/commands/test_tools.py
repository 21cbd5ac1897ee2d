"""Facts about the commands that talk to the board: params, monitor, flash."""

from __future__ import annotations

import json
import stat
import subprocess
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from host.core.errors import EXIT_FAULT, EXIT_UNFINISHED, EXIT_USER, UserError
from host.link import flash, protocol
from tests.helpers.console import Cli
from tests.helpers.fake_firmware import RESTING, FakeFirmware

ANY = next(iter(protocol.PARAMS.values()))
SCALED = next(spec for spec in protocol.PARAMS.values() if spec.scale != 1)


# ---- params --------------------------------------------------------------------------------------


def test_list_shows_every_parameter(cli: Cli, board: FakeFirmware) -> None:
    code, out, _ = cli("params", "list", "--port", board.port)
    assert code == 0
    lines = out.splitlines()[1:]
    assert [line.split()[0] for line in lines] == list(protocol.PARAMS), "one line each"


def test_get_gives_the_value_in_its_unit(cli: Cli, board: FakeFirmware) -> None:
    board.params[SCALED.id] = SCALED.max_raw
    _, out, _ = cli("params", "get", SCALED.name, "--port", board.port)
    value = SCALED.from_raw(SCALED.max_raw)
    assert out == f"{SCALED.name} = {value:g} {SCALED.unit}".rstrip() + "\n"


@pytest.mark.parametrize("spec", protocol.PARAMS.values(), ids=protocol.PARAMS)
def test_set_takes_the_limits_and_refuses_what_lies_beyond(
    cli: Cli, board: FakeFirmware, spec: protocol.ParamSpec
) -> None:
    for raw in (spec.min_raw, spec.max_raw):
        code, _, err = cli(
            "params", "set", "--port", board.port, spec.name, f"{spec.from_raw(raw)}"
        )
        assert (code, board.params[spec.id]) == (0, raw), err
    for raw in (spec.min_raw - 1, spec.max_raw + 1):
        code, _, err = cli(
            "params", "set", "--port", board.port, spec.name, f"{spec.from_raw(raw)}"
        )
        assert code == EXIT_USER
        assert f"{spec.name} must be" in err
        assert board.params[spec.id] == spec.max_raw


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e400", "-1e9"])
def test_a_value_out_of_range_needs_no_board(cli: Cli, value: str) -> None:
    code, _, err = cli("params", "set", "steer_kp", value, "--port", "/dev/no-such-port")
    assert code == EXIT_USER
    assert err.startswith("daranti: steer_kp must be ")


def test_set_shows_what_the_firmware_keeps_and_not_what_was_asked(
    cli: Cli, board: FakeFirmware
) -> None:
    kept = SCALED.from_raw(SCALED.min_raw + 1)
    asked = kept + 0.4 * SCALED.scale
    _, out, _ = cli("params", "set", SCALED.name, f"{asked}", "--port", board.port)
    assert out.splitlines()[0] == f"{SCALED.name} = {kept:g} {SCALED.unit}".rstrip()


def test_set_says_that_it_is_not_saved_and_save_saves(cli: Cli, board: FakeFirmware) -> None:
    value = f"{ANY.from_raw(ANY.max_raw)}"
    _, out, _ = cli("params", "set", ANY.name, value, "--port", board.port)
    assert "not saved" in out
    assert not any(isinstance(m, protocol.ParamSave) for m in board.received)
    _, out, _ = cli("params", "set", ANY.name, value, "--save", "--port", board.port)
    assert "saved" in out
    assert any(isinstance(m, protocol.ParamSave) for m in board.received)


def test_defaults_are_restored(cli: Cli, board: FakeFirmware) -> None:
    board.params[ANY.id] = ANY.max_raw
    code, out, _ = cli("params", "defaults", "--yes", "--port", board.port)
    assert (code, board.params[ANY.id]) == (0, ANY.default_raw)
    assert "not saved" in out


def test_defaults_are_not_set_without_consent(cli: Cli, board: FakeFirmware) -> None:
    code, out, err = cli("params", "defaults", "--port", board.port)
    assert code == EXIT_USER
    assert "hall_per_metre = 50" in out
    assert "export" in err
    assert not any(isinstance(each, protocol.ParamDefaults) for each in board.received)


def test_parameters_go_to_a_file_and_back(cli: Cli, board: FakeFirmware, tmp_path: Path) -> None:
    path, port = str(tmp_path / "machine.yaml"), ("--port", board.port)
    assert cli("params", "export", path, *port)[0] == 0
    assert cli("params", "export", path, *port)[0] == EXIT_USER, "never written over"
    assert cli("params", "diff", path, *port)[:2] == (0, "the same\n")
    assert cli("params", "set", "steer_kp", "60", *port)[0] == 0
    code, out, _ = cli("params", "diff", path, *port)
    assert code == EXIT_UNFINISHED
    assert out == f"steer_kp: 60 in the firmware, 75 in {path}\n"
    code, out, _ = cli("params", "load", path, "--save", *port)
    assert code == 0
    assert "steer_kp: 60 -> 75" in out
    assert cli("params", "diff", path, *port)[0] == 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("steer_kp: fast", "no number"),
        ("steer_kq: 1", "steer_kp"),
        ("- 1", "give lines"),
        ("steer_kp: 1000000000", "steer_kp"),
        ("steer_driver: 1.5", "steer_driver must be a whole number, not 1.5"),
        ("a: [", "not YAML"),
        ("steer_kp: .nan", "steer_kp"),
    ],
)
def test_a_bad_file_of_parameters_is_one_message(
    cli: Cli, board: FakeFirmware, tmp_path: Path, text: str, message: str
) -> None:
    (path := tmp_path / "a.yaml").write_text(text)
    code, _, err = cli("params", "load", str(path), "--port", board.port)
    assert code == EXIT_USER
    assert message in err
    assert err.count("\n") == 1


@pytest.mark.parametrize("name", ["steer_driver", "drive_driver", "hall_phases"])
def test_what_lies_between_two_bridges_is_none(cli: Cli, board: FakeFirmware, name: str) -> None:
    spec = protocol.PARAMS[name]
    code, _, err = cli("params", "set", name, "1.5", "--port", board.port)
    assert code == EXIT_USER
    assert f"{name} must be a whole number" in err
    assert board.params.get(spec.id, spec.default_raw) == spec.default_raw


def test_load_names_what_a_file_that_was_cut_off_lacks(
    cli: Cli, board: FakeFirmware, tmp_path: Path
) -> None:
    (path := tmp_path / "cut.yaml").write_text("steer_kp: 60\n")
    code, out, _ = cli("params", "load", str(path), "--port", board.port)
    assert code == 0
    assert "1 of 1 changed" in out
    assert f"not in {path}: steer_driver, drive_driver, " in out


def test_clear_clears_what_can_be_cleared_and_names_the_rest(cli: Cli, board: FakeFirmware) -> None:
    board.telemetry = replace(RESTING, state=protocol.State.FAULT, faults=protocol.Fault(2))
    code, out, err = cli("clear", "--port", board.port)
    assert code == EXIT_FAULT
    assert "emergency-stop" in out
    assert "emergency-stop" in err
    board.telemetry = RESTING
    assert cli("clear", "--port", board.port)[:2] == (0, "cleared; the firmware is SAFE\n")


POT_AND_LINK = protocol.LogEntry(
    index=0,
    number=7,
    faults=protocol.Fault.POT_FROZEN | protocol.Fault.LINK_LOST,
    uptime=3725,
    reset_cause=protocol.ResetCause.BY_RESET_PIN,
    state=protocol.State.RUNNING,
)
HUNG = protocol.LogEntry(
    index=1,
    number=6,
    faults=protocol.Fault.WATCHDOG,
    uptime=0,
    reset_cause=protocol.ResetCause.BY_WATCHDOG | protocol.ResetCause.WHILE_ARMED,
    state=protocol.State.FAULT,
)


def test_the_fault_log_is_shown_in_words(cli: Cli, board: FakeFirmware) -> None:
    board.log = [POT_AND_LINK, HUNG]
    code, out, _ = cli("faultlog", "list", "--port", board.port)
    assert code == 0
    assert [line.strip() for line in out.splitlines()] == [
        "7  1:02:05 after the start by reset button, or the port was opened, RUNNING",
        *protocol.fault_texts(POT_AND_LINK.faults),
        "6  at the start by watchdog and while it was armed",
        *protocol.fault_texts(HUNG.faults),
    ]
    board.log = []
    assert cli("faultlog", "list", "--port", board.port)[:2] == (0, "the log is empty\n")


def test_the_fault_log_is_not_emptied_without_consent(cli: Cli, board: FakeFirmware) -> None:
    board.log = [POT_AND_LINK]
    code, _, err = cli("faultlog", "clear", "--port", board.port)
    assert code == EXIT_USER
    assert "1 entry would be lost" in err
    assert board.log == [POT_AND_LINK]
    code, out, _ = cli("faultlog", "clear", "--yes", "--port", board.port)
    assert (code, out) == (0, "emptied: 1 entry\n")
    assert board.log == []


def test_a_firmware_without_a_fault_log_is_named(cli: Cli, board: FakeFirmware) -> None:
    board.minor = 0
    for verb in ("list", "clear"):
        code, _, err = cli("faultlog", verb, "--port", board.port)
        assert code == EXIT_USER
        assert "keeps no fault log" in err


def test_a_refusal_is_one_message(cli: Cli, board: FakeFirmware) -> None:
    board.refuse[protocol.ParamSave] = protocol.Result.STORE_FAILED
    code, _, err = cli("params", "save", "--port", board.port)
    assert code == EXIT_USER
    assert err.strip().endswith("ParamSave refused: the EEPROM did not keep it")


def test_an_unknown_parameter_names_its_likes(cli: Cli, board: FakeFirmware) -> None:
    code, _, err = cli("params", "get", "steer_kpp", "--port", board.port)
    assert code == EXIT_USER
    assert "did you mean steer_kp" in err


@pytest.mark.parametrize("command", [("params", "list"), ("params", "save"), ("monitor",)])
def test_a_missing_port_is_one_message(cli: Cli, command: tuple[str, ...]) -> None:
    code, _, err = cli(*command, "--port", "/dev/no-such-port")
    assert code == EXIT_USER
    assert err.startswith("daranti: serial port /dev/no-such-port does not exist")
    assert err.count("\n") == 1


# ---- monitor -------------------------------------------------------------------------------------


def test_monitor_says_faults_in_words(cli: Cli, board: FakeFirmware) -> None:
    faults = protocol.Fault.ESTOP_OPEN | protocol.Fault.BATTERY_LOW
    board.telemetry = replace(RESTING, state=protocol.State.FAULT, faults=faults)
    code, out, _ = cli("monitor", "--port", board.port, "--duration", "1")
    assert code == 0
    assert "firmware 2.1 (desk), protocol 3, started by power-on" in out
    assert "FAULT" in out
    for text in protocol.fault_texts(faults):
        assert f"fault: {text}\n" in out
    assert out.count("fault:") == 2, "said when they change, not with every line"


def test_monitor_gives_every_message_as_json(cli: Cli, board: FakeFirmware) -> None:
    _, out, _ = cli("monitor", "--port", board.port, "--duration", "1", "--json")
    messages = [json.loads(text) for text in out.splitlines()]
    assert len(messages) > 10
    assert messages[0]["state"] == "SAFE"
    assert messages[0]["battery_v"] == 12.0


def test_monitor_says_that_the_board_is_silent_or_has_restarted(
    cli: Cli, board: FakeFirmware
) -> None:
    def later() -> None:
        board.wait_for(protocol.Hello)
        board.mute.set()

    threading.Thread(target=later, daemon=True).start()
    code, _, err = cli("monitor", "--port", board.port, "--duration", "1.5")
    assert code == 0
    assert err == "no telemetry for 1 s: the board hangs, or its cable is broken\n"
    board.mute.clear()
    restart = threading.Timer(0.5, board.reset)
    restart.start()
    _, _, err = cli("monitor", "--port", board.port, "--duration", "1")
    restart.join()
    assert err == "the firmware has restarted\n"


def test_monitor_shows_what_the_sensors_read(cli: Cli, board: FakeFirmware) -> None:
    board.readings = protocol.Readings(1.5, 7.0, 512.0, 613.0, 542.0, 569.0, 180.0, 42, 7, 0, 3, 0)
    code, out, _ = cli("monitor", "--port", board.port, "--duration", "1", "--readings")
    assert code == 0
    first, *_ = (text for text in out.splitlines() if text.startswith("pot"))
    for shown in ("pot  512.0", "e-stop  180.0", " 1.50 A (542.0)", "wheel 42", "line errors 3"):
        assert shown in first
    _, out, _ = cli("monitor", "--port", board.port, "--duration", "1", "--readings", "--json")
    assert json.loads(out.splitlines()[0])["estop"] == 180.0


# ---- flash ---------------------------------------------------------------------------------------


def test_a_virtual_port_is_refused(cli: Cli, board: FakeFirmware) -> None:
    code, _, err = cli("flash", "--port", board.port)
    assert code == EXIT_USER
    assert "is a virtual port: there is no board behind it" in err


@pytest.mark.parametrize(
    ("port", "message"),
    [
        ("socket://127.0.0.1:5000", "is a network port"),
        ("/dev/no-such-port", "does not exist; plug the board in"),
        ("/etc/hostname", "is not a serial port"),
    ],
)
def test_what_is_no_board_is_refused(port: str, message: str) -> None:
    with pytest.raises(UserError, match=message):
        flash.check_port(port)


def test_a_missing_image_says_how_to_build_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(flash, "CHECKOUT", tmp_path)
    with pytest.raises(UserError, match="pio run -e uno"):
        flash.find_image("uno")


def test_a_missing_avrdude_says_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(flash, "CHECKOUT", tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(UserError, match="apt install avrdude"):
        flash.find_avrdude()
    package = tmp_path / ".platformio" / "packages" / "tool-avrdude"
    package.mkdir(parents=True)
    (package / "avrdude").touch()
    assert flash.find_avrdude() == [
        str(package / "avrdude"),
        "-C",
        str(package / "avrdude.conf"),
    ]


def fake_avrdude(folder: Path, monkeypatch: pytest.MonkeyPatch, script: str) -> None:
    program = folder / "avrdude"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")


@pytest.mark.parametrize(("suffix", "kind"), [(".hex", "i"), (".elf", "e")])
def test_avrdude_is_asked_to_write_and_verify_the_image(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str, kind: str
) -> None:
    fake_avrdude(tmp_path, monkeypatch, f'echo "$@" > {tmp_path}/asked')
    image = tmp_path / f"firmware{suffix}"
    flash.write_image("/dev/ttyACM0", image, "uno")
    asked = (tmp_path / "asked").read_text()
    assert f"-p atmega328p -c arduino -P /dev/ttyACM0 -b 115200 -D -U flash:w:{image}:{kind}" in (
        asked
    )


def test_an_image_for_another_chip_is_refused(tmp_path: Path) -> None:
    """The architecture stands in an ELF's flags; 5 is the ATmega328P's, 6 the ATmega2560's."""
    image = tmp_path / "firmware.elf"
    for kind, board, other in ((5, "nano_old", "mega2560"), (6, "mega2560", "uno")):
        head = bytearray(64)
        head[:4], head[18], head[36] = b"\x7fELF", flash.ELF_AVR, kind
        image.write_bytes(head)
        flash.check_image(image, board)
        build = flash.LOADERS[other].build
        with pytest.raises(UserError, match=f"no image for the board.*pio run -e {build}"):
            flash.check_image(image, other)


def test_avrdudes_failure_is_told_in_its_own_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake_avrdude(tmp_path, monkeypatch, "echo 'stk500_getsync: not in sync' >&2; exit 1")
    with pytest.raises(UserError, match="could not write /dev/ttyACM0: stk500_getsync"):
        flash.write_image("/dev/ttyACM0", tmp_path / "firmware.hex", "uno")
    with pytest.raises(UserError, match="old bootloader wants `--board nano_old`"):
        flash.write_image("/dev/ttyUSB0", tmp_path / "firmware.hex", "nano")


def test_the_real_avrdude_knows_the_part_and_the_options(tmp_path: Path) -> None:
    try:
        command = flash.find_avrdude()
    except UserError as error:
        pytest.skip(str(error))
    image = tmp_path / "firmware.hex"
    image.write_text(":00000001FF\n")
    # -n: without writing; the missing port is what it has to complain about.
    loader = flash.LOADERS["uno"]
    asked = [*command, "-n", "-p", loader.part, "-c", loader.programmer]
    asked += ["-P", "/dev/no-such-port", "-b", str(loader.baud)]
    asked += ["-D", "-U", f"flash:w:{image}:i"]
    done = subprocess.run(asked, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode != 0
    assert "/dev/no-such-port" in done.stderr
