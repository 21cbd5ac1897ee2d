"""PlatformIO build step: writes commit.h, which names the commit that the board's build is from."""

import subprocess
from pathlib import Path

from SCons.Script import Import

Import("env")


def git(*arguments):
    """What git says, or nothing where there is no git or no checkout."""
    command = ["git", "-C", env.subst("$PROJECT_DIR"), *arguments]  # noqa: F821
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError:
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


commit = git("rev-parse", "--short=8", "HEAD")[:8] or "0"
modified = int(bool(git("status", "--porcelain", "--", "firmware", "platformio.ini")))
folder = Path(env.subst("$BUILD_DIR")) / "generated"  # noqa: F821
text = f"#define DARANTI_COMMIT 0x{commit}UL\n#define DARANTI_MODIFIED {modified}\n"
header = folder / "commit.h"
if not header.exists() or header.read_text() != text:
    folder.mkdir(parents=True, exist_ok=True)
    header.write_text(text)
env.Append(CPPPATH=[str(folder)])  # noqa: F821
