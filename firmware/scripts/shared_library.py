"""PlatformIO build step: the program becomes a shared library, libdaranti.so."""

from SCons.Script import Import

Import("env")
env.Append(CCFLAGS=["-fPIC"], LINKFLAGS=["-shared", "-fPIC", "-Wl,--no-undefined"])  # noqa: F821
env.Replace(PROGNAME="libdaranti", PROGSUFFIX=".so")  # noqa: F821
