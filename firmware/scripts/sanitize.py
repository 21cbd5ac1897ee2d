"""PlatformIO build step: unit tests run under the address and undefined-behaviour sanitizers."""

from SCons.Script import Import

Import("env")
FLAGS = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
env.Append(CCFLAGS=FLAGS, LINKFLAGS=FLAGS)  # noqa: F821
