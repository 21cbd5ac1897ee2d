#define DOCTEST_CONFIG_IMPLEMENT
#include <doctest.h>

int main(int argc, char **argv) {
  doctest::Context context;
  context.setOption("success", true);      // PlatformIO's runner counts the successes too
  context.setOption("no-exitcode", true);  // and judges by them
  context.applyCommandLine(argc, argv);
  return context.run();
}
