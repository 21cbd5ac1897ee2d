"""Prints the tables of docs/understand/navigation.md, in some seconds:
`python docs/understand/navigation/figures.py`."""

from __future__ import annotations

import math

import shapely

from host.commands.plan import table_of
from host.commands.tune_follow import table_of as margins_table
from host.core.terminal import PlainConsole
from host.core.vehicle import Vehicle
from host.field.areas import areas_of
from host.route.field_plan import plan_field
from host.route.plan import Plan
from host.route.preview import preview
from host.route.side import Side

VEHICLE = Vehicle()
GAP_M = 2.0
LONG_M = 12.0
TURNS = ("arc", "three_point")
FIELDS = {
    "20 m square": shapely.box(0, 0, 20, 20),
    "trapezoid, 70 and 110 degrees": shapely.Polygon([(0, 0), (18, 0), (13, 13.7), (5, 13.7)]),
    "L": shapely.Polygon([(0, 0), (16, 0), (16, 7), (8, 7), (8, 16), (0, 16)]),
    "15 m square with a well of 0.8 m": shapely.Polygon(
        shapely.box(0, 0, 15, 15).exterior.coords,
        [shapely.box(4.0, 6.0, 4.8, 6.8).exterior.coords],
    ),
}


def corner(inside_deg: float, turn: str) -> tuple[float, float, float, float]:
    """(crop left standing in m2, way in m, time in s, room beyond the edges in m) of one turn at
    the corner of a field with straight edges."""
    left = math.pi - math.radians(inside_deg)
    c, s = math.cos(left), math.sin(left)
    field = shapely.Polygon([(-LONG_M, 0), (0, 0), (LONG_M * c, LONG_M * s)])
    width = VEHICLE.pass_m
    first = Side(-LONG_M, 0.0, 0.0, LONG_M + max(0.0, width * c / s), width, LONG_M)
    begin = width / s  # where the first side's swath ends
    second = Side(begin * c, begin * s, left, LONG_M - begin, width, LONG_M)
    found = preview(Plan((first, second), turn), areas_of(field, GAP_M), VEHICLE)
    late = max(0.0, first.length_m + second.length_m - found.cutting_m)
    seconds = found.time_s - found.cutting_m / VEHICLE.cutting_speed_mps
    return late * width, found.turning_m, seconds, found.room_m


def main() -> None:
    """The corners, the fields, the steering."""
    print("corner | " + " | ".join(f"{turn}: stays m2, way m, time s, room m" for turn in TURNS))
    for inside in (50, 70, 90, 110, 130, 150):
        cells = [
            "{:.2f} | {:.1f} | {:.0f} | {:.2f}".format(*corner(inside, turn)) for turn in TURNS
        ]
        print(f"{inside} | " + " | ".join(cells))
    console = PlainConsole(width=100)
    for name, field in FIELDS.items():
        areas = areas_of(field, GAP_M)
        start = field.exterior.coords[0]
        plans = [plan_field(areas, (start[0], start[1]), VEHICLE, turn, GAP_M) for turn in TURNS]
        console.print(f"\n{name}, {field.area:.0f} m2")
        console.print(table_of([preview(plan, areas, VEHICLE) for plan in plans]))
    console.print()
    console.print(margins_table(VEHICLE))


if __name__ == "__main__":
    main()
