"""What any check reaches on this laptop: the phone's feeds, its disk, its power."""

from __future__ import annotations

import shutil
import time
from pathlib import Path
from typing import Final

from host.core.messages import Fix, Turned
from host.sensors.camera_stream import Picture
from host.sensors.newest import Feed

POWER: Final = Path("/sys/class/power_supply")


class Laptop:
    """The part of `lines.Target` that is the same wherever the check is asked for."""

    def __init__(
        self,
        camera: Feed[Picture] | None,
        gnss: Feed[Fix] | None,
        gyro: Feed[Turned] | None,
        folder: Path,
    ) -> None:
        """`folder`: where the records go."""
        self._camera, self._gnss, self._gyro, self._folder = camera, gnss, gyro, folder

    def picture(self) -> Picture | None:
        """The camera's newest, once."""
        return None if self._camera is None else self._camera.take()

    @property
    def camera_problem(self) -> str:
        """Why no picture comes."""
        return "no camera was given" if self._camera is None else self._camera.problem or ""

    def fix(self) -> Fix | None:
        """The receiver's newest, once."""
        return None if self._gnss is None else self._gnss.take()

    @property
    def gnss_problem(self) -> str:
        """Why no position comes."""
        return "no receiver was given" if self._gnss is None else self._gnss.problem or ""

    def turned(self) -> Turned | None:
        """The gyroscope's newest, once."""
        return None if self._gyro is None else self._gyro.take()

    @property
    def gyro_problem(self) -> str:
        """Why it says nothing."""
        return "no address was given" if self._gyro is None else self._gyro.problem or ""

    def free_bytes(self) -> int:
        """Room for the records."""
        return shutil.disk_usage(self._folder).free

    def power(self) -> tuple[int, bool] | None:
        """The battery in percent and whether it is being charged; None without one."""
        for one in sorted(POWER.glob("BAT*")):
            try:
                percent = int((one / "capacity").read_text())
                status = (one / "status").read_text().strip()
            except (OSError, ValueError):
                continue
            return percent, status != "Discharging"
        return None

    def busy_s(self) -> float:
        """This thread's processor time."""
        return time.thread_time()
