"""The receiver of a machine at rest: does it know where it is, and is that the corner asked for?"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import shapely

from host.check.notes import Notes
from host.core.messages import Fix
from host.field.boundary_file import Boundary
from host.field.fence import nearest_corner

FIX_S: Final = 12.0
"""Time in which a receiver that has a fix gives four, at one a second."""
POOR_HDOP: Final = 4.0
"""Horizontal dilution of precision above which errors of 10 m are common."""
FEW_SATELLITES: Final = 5
"""Four make a position; fewer than five cannot tell that one of them is wrong."""
FAR_M: Final = 30.0
"""Of a field's edge: no phone's position is so wrong under the open sky."""
CORNER_M: Final = 8.0
"""What a phone's position may be off by: three times its CEP of 2.5 m."""


def receiver(notes: Notes, boundary: Boundary | None, corner: int) -> None:
    """The fix, and where it says that the machine stands."""
    hands = notes.hands
    heard: list[Fix] = []
    end = hands.clock() + FIX_S
    while hands.clock() < end and len([f for f in heard if f.quality > 0]) < 4:
        hands.pump(0.1)
        fix = hands.fix()
        if fix is not None:
            heard.append(fix)
    good = [fix for fix in heard if fix.quality > 0]
    if not heard:
        notes.note("receiver", "bad", "receiver.none", why=hands.gnss_problem or "-")
    elif not good:
        notes.note("receiver", "bad", "receiver.no_fix")
    elif good[-1].satellites == 0 and math.isnan(good[-1].hdop):
        # RMC alone: no satellites counted is not none seen.
        notes.note("receiver", "warn", "receiver.unrated")
    elif good[-1].hdop > POOR_HDOP or good[-1].satellites < FEW_SATELLITES:
        last = good[-1]
        hdop = "-" if math.isnan(last.hdop) else last.hdop
        notes.note("receiver", "bad", "receiver.poor", satellites=last.satellites, hdop=hdop)
    elif len(good) < 4:
        notes.note("receiver", "bad", "receiver.slow", count=len(good), seconds=FIX_S)
    else:
        notes.note("receiver", "ok", "receiver.ok", satellites=good[-1].satellites)
    if not good or boundary is None:
        notes.skip("place")
    else:
        _place(notes, good, boundary, corner)


def _place(notes: Notes, fixes: list[Fix], boundary: Boundary, asked: int) -> None:
    frame = boundary.frame
    lat = float(np.median([fix.lat_deg for fix in fixes]))
    lon = float(np.median([fix.lon_deg for fix in fixes]))
    here = frame.to_local(lat, lon)
    away = float(boundary.polygon(frame).distance(shapely.Point(here)))
    if away > FAR_M:
        notes.note("place", "bad", "place.other_field", metres=round(away))
        return
    corner = frame.to_local(*boundary.crop[asked])
    nearest = nearest_corner(boundary.crop, lat, lon)
    other = frame.to_local(*boundary.crop[nearest])
    wrong = math.dist(here, corner)
    numbers = {"asked": asked + 1, "nearest": nearest + 1, "metres": round(wrong)}
    if nearest != asked and wrong > math.dist(here, other) + CORNER_M:
        notes.note("place", "bad", "place.corner", **numbers)
    elif wrong > FAR_M / 2:
        notes.note("place", "bad", "place.far", **numbers)
    else:
        notes.note("place", "ok", "place.ok", **numbers)
