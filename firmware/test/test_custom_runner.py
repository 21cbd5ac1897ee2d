"""Runs the doctest suites. PlatformIO's own doctest runner asks its registry for the library in
every environment; this one takes it from `lib_deps` of [env:native] alone, seeded or downloaded."""

from platformio.test.runners.doctest import DoctestTestRunner


class CustomTestRunner(DoctestTestRunner):
    EXTRA_LIB_DEPS = None
