"""Facts about vehicle files."""

from __future__ import annotations

from pathlib import Path

import pytest

from host.core.errors import UserError
from host.core.vehicle import Mount, Vehicle
from host.core.vehicle_file import load_vehicle, mount_of, save_vehicle


def written(folder: Path, text: str) -> Path:
    path = folder / "machine.yaml"
    path.write_text(text)
    return path


def test_a_missing_file_is_said(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="cannot read"):
        load_vehicle(tmp_path / "none")


def test_a_vehicle_file_reads_back_as_written(tmp_path: Path) -> None:
    vehicle = Vehicle(wheelbase_m=1.3, mounts={"roof": Mount(x_m=0.2, z_m=2.0, pitch_deg=30)})
    path = tmp_path / "vehicle.yaml"
    save_vehicle(path, vehicle)
    assert load_vehicle(path) == vehicle
    assert mount_of(load_vehicle(path), "roof").z_m == 2.0


def test_on_a_full_disk_the_machines_file_stays_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path, "wheelbase_m: 1.07\n")

    def full(_handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(UserError, match=r"cannot write the vehicle file .*: No space left"):
        save_vehicle(path, Vehicle())
    assert load_vehicle(path).wheelbase_m == 1.07
    assert list(tmp_path.iterdir()) == [path]


def test_no_file_means_the_default_vehicle(tmp_path: Path) -> None:
    assert load_vehicle(None) == load_vehicle(written(tmp_path, "{}")) == Vehicle()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("wheelbase_m: -1", "wheelbase_m: Input should be greater than 0"),
        (
            "wheelbase_m: 1.0\nblade_width_m: 1.2\nwheelbase_m: 1.3",
            r"machine.yaml, line 3: not YAML: wheelbase_m is there twice",
        ),
        ("mounts: {low: {x_m: 0, z_m: 1, x_m: 1}}", "x_m is there twice"),
        ("wheel_base: 1", "wheel_base: no such field"),
        ("mounts: {low: {x_m: 0, z_m: 1, pitch_deg: up}}", "mounts.low.pitch_deg"),
        ("cutting_speed_mps: .inf", "cutting_speed_mps: Input should be a finite number"),
        ("wheelbase_m: yes", "wheelbase_m: give a number, not yes or no"),
        ("mounts: {low: {focal_px: yes}}", "focal_px: give a number, not yes or no"),
        ("wheelbase_m: .nan", "wheelbase_m: Input should be a finite number"),
        ("cutting_speed_mps: 1000", "cutting_speed_mps: Input should be less than"),
        ("overlap_m: 0.45\nblade_width_m: 0.45", "overlap_m 0.45 is more than half"),
        ("half_width_m: 0.8", "half_width_m 0.8 is more than half of blade_width_m 1: the wheels"),
        ("hall_left_m: -0.5", "hall_left_m -0.5 lies outside of half_width_m 0.4: no wheel runs"),
        ("wheelbase_m: 1.0\nblade_ahead_m: -1.0", "puts the blade behind the rear axle"),
        ("blade_height_m: 0.9", "blade_height_m 0.9 is not below crop_height_m 0.9: nothing"),
        ("mounts: {low: {x_m: 0, z_m: 1, pitch_deg: 400}}", "mounts.low.pitch_deg"),
        ("- 1", "give fields"),
        ("", "is empty; give fields"),
        ("# wheelbase_m: 1.3\n", "is empty; give fields"),
        ("a: [", "line 1: not YAML"),
    ],
)
def test_a_bad_vehicle_file_names_file_and_field(tmp_path: Path, text: str, message: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(UserError, match=message) as error:
        load_vehicle(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_an_unknown_mount_names_those_there_are() -> None:
    with pytest.raises(UserError, match="no camera mount 'roof'; it has low, mast"):
        mount_of(Vehicle(), "roof")
