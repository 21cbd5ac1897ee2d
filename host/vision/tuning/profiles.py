"""Tuned parameters by circumstance: what the paper asks for four times a day, and its future work
promises to remember. One SQLite file."""

from __future__ import annotations

import contextlib
import datetime
import sqlite3
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from host.core.errors import UserError
from host.core.input_file import check_input
from host.vision.mounted.paper import PaperParams

DATABASE = Path.home() / ".local" / "share" / "daranti" / "profiles.sqlite"
"""Where the commands keep it."""
SCHEMA = """
CREATE TABLE IF NOT EXISTS profile (
  id INTEGER PRIMARY KEY,
  saved TEXT NOT NULL,          -- ISO 8601, UTC
  hour REAL NOT NULL,           -- 0..24, local time of the pictures
  terrain TEXT NOT NULL,
  crop TEXT NOT NULL,
  weather TEXT NOT NULL,
  mount TEXT NOT NULL,
  contrast REAL NOT NULL,       -- 0..1, reached on the pictures it was tuned on
  params TEXT NOT NULL          -- JSON of PaperParams
);
"""
HOURS = 2.0
"""A difference of so many hours weighs as much as another terrain, crop or weather."""
OTHER_MOUNT = 4.0
"""What another mount weighs: the picture is another one altogether."""
LEAST_CONTRAST = 0.1
"""Of 1: below it a profile would be worse than none."""


@dataclass(frozen=True, slots=True)
class Circumstance:
    """Where and when pictures were taken."""

    hour: float
    terrain: str = "flat"
    crop: str = "wheat"
    weather: str = "clear"
    mount: str = "low"

    def distance(self, other: Circumstance) -> float:
        """0 for the same circumstance."""
        apart = abs(self.hour - other.hour) / HOURS
        for name in ("terrain", "crop", "weather"):
            apart += getattr(self, name) != getattr(other, name)
        return apart + OTHER_MOUNT * (self.mount != other.mount)


@dataclass(frozen=True, slots=True)
class Profile:
    """One row."""

    circumstance: Circumstance
    params: PaperParams
    contrast: float
    saved: str


class Profiles(contextlib.AbstractContextManager["Profiles"]):
    """The database; a context manager."""

    def __init__(self, path: Path) -> None:
        """Opens or creates. UserError where the file is no such database."""
        self._path = path
        check_input(path, "the database of profiles", once=False)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._db = sqlite3.connect(path)
            self._db.executescript(SCHEMA)
        except (sqlite3.Error, OSError) as error:
            raise UserError(
                f"{path}: not a database of profiles ({error}); name another file with --db"
            ) from error

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the connection; what was saved stays."""
        self._db.close()

    def save(
        self, where: Circumstance, params: PaperParams, contrast: float, saved: datetime.datetime
    ) -> None:
        """Adds a profile; older ones of the same circumstance stay for comparison. UserError where
        its contrast is less than LEAST_CONTRAST: it would be worse than none."""
        if not contrast >= LEAST_CONTRAST:
            raise UserError(
                f"these parameters do not tell crop from stubble on these pictures (contrast "
                f"{contrast:.3f}, at least {LEAST_CONTRAST:g} is needed); nothing was saved. Take "
                "pictures with the edge in view, and say where the crop stands"
            )
        with self._db:
            self._db.execute(
                "INSERT INTO profile (saved, hour, terrain, crop, weather, mount, contrast, params)"
                " VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
                (
                    saved.astimezone(datetime.UTC).isoformat(timespec="seconds"),
                    where.hour,
                    where.terrain,
                    where.crop,
                    where.weather,
                    where.mount,
                    contrast,
                    params.model_dump_json(),
                ),
            )

    def all(self) -> list[Profile]:
        """Every profile, oldest first. UserError where one cannot be read."""
        found = []
        with closing(self._db.execute("SELECT * FROM profile ORDER BY id")) as rows:
            for number, saved, hour, terrain, crop, weather, mount, contrast, params in rows:
                try:
                    parsed = PaperParams.model_validate_json(params)
                except ValidationError as error:
                    raise UserError(
                        f"{self._path}: profile {number} holds parameters that this version does "
                        f"not know ({error.error_count()} errors); delete that row or the file"
                    ) from error
                where = Circumstance(hour, terrain, crop, weather, mount)
                found.append(Profile(where, parsed, contrast, saved))
        return found

    def nearest(self, where: Circumstance) -> Profile | None:
        """The profile of the nearest circumstance; of several as near, that of the best contrast,
        and then the newest. None in an empty database."""
        profiles = list(enumerate(self.all()))
        if not profiles:
            return None
        _, best = min(
            profiles, key=lambda p: (where.distance(p[1].circumstance), -p[1].contrast, -p[0])
        )
        return best
