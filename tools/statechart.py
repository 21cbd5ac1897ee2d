"""Draws the pilot's statechart (Mermaid) from its behaviours' reasons: docs/understand/pilot.md.

`--check` exits with 1 where the document is not what the code says.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from host.pilot.behaviours import BEHAVIOURS  # noqa: E402
from host.pilot.endings import Over, Standing  # noqa: E402
from host.pilot.guard import Watched  # noqa: E402
from host.pilot.phase import Reason  # noqa: E402

DOCUMENT = ROOT / "docs" / "understand" / "pilot.md"


def _words(reason: Reason) -> str:
    """A reason as it reads, what it speaks of as an ellipsis."""
    return re.sub(r"\{\w+\}", "…", reason.text)


def chart() -> str:
    """The document."""
    lines = ["```mermaid", "stateDiagram-v2", f"    [*] --> {next(iter(BEHAVIOURS)).name}"]
    table = ["| behaviour | file | phase | what it does |", "|---|---|---|---|"]
    for doing, kind in BEHAVIOURS.items():
        module = sys.modules[kind.__module__]
        path = Path(module.__file__ or "").relative_to(ROOT)
        about = (module.__doc__ or "").split("\n\n")[0].partition(": ")[2].replace("\n", " ")
        table.append(f"| {doing.name} | `{path}` | {kind.phase.value} | {about.strip()} |")
        for reasons in kind.reasons:
            for reason in reasons:
                words = _words(reason).replace(":", " -")
                lines.append(f"    {doing.name} --> {reason.to.name}: {words}")
    lines.append("```")
    return "\n".join(
        [
            "# The pilot's behaviours",
            "",
            "What is the machine doing, and why did it stop? At each moment one behaviour runs.",
            "Each step it gives a command. If another behaviour is to take over, it names that and",
            "a reason: a code with a text. Screen, panel and record show the text and the phase.",
            "Several behaviours may share a phase.",
            "",
            "`tools/statechart.py` writes this page from the classes in `host/pilot/behaviours`.",
            "An ellipsis stands for what a reason fills in.",
            "",
            *table,
            "",
            *lines,
            "",
            "These end any behaviour but CONNECT and FINISH (`host/pilot/guard.py`). Where no gap",
            "lies beside the strip, the geofence first sends the machine to what else is left",
            "standing:",
            "",
            *(f"- to {reason.to.name}: {_words(reason)}" for reason in Watched),
            "",
            "Where the plan ends and crop may still stand, one of these takes the place of the",
            "reason to FINISH, or, while that is gathered, of a reason to FAULT",
            "(`host/pilot/endings.py`):",
            "",
            *(f"- to {reason.to.name}: {_words(reason)}" for reason in (*Standing, *Over)),
            "",
        ]
    )


def main() -> int:
    """Writes or checks."""
    text = chart()
    if "--check" in sys.argv:
        if not DOCUMENT.exists() or DOCUMENT.read_text(encoding="utf-8") != text:
            print(f"{DOCUMENT}: not what the code says; run tools/statechart.py", file=sys.stderr)
            return 1
        return 0
    DOCUMENT.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
