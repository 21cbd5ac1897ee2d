"""What a pixel of a label picture shows (`Camera.labels`)."""

from __future__ import annotations

from typing import Final

BACKGROUND: Final = 0
"""Sky, distant trees and houses."""
STANDING: Final = 1
STUBBLE: Final = 2
STRAW: Final = 3
SOIL: Final = 4
NEIGHBOUR: Final = 5
WEEDS: Final = 6
MACHINE: Final = 7
EDGE: Final = 8
"""The border of the field's own standing crop with open ground to its right."""
