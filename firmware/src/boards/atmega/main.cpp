// The boards' main program. It has a main() of its own instead of setup() and loop(): the Arduino
// core's would set timer 0 to 1.024 ms, which a tick of 5 ms is no multiple of.
#include <avr/io.h>

#include "atmega.h"
#include "controller.h"

namespace {

#ifdef DARANTI_HIL
daranti::HilBoard board;
#else
daranti::AtmegaBoard board;
#endif
daranti::Controller controller;

}  // namespace

int main() {
  board.begin();
  controller.boot(board);
  for (;;) {
    board.wait_for_tick();
    GPIOR0 = 1;  // marks the tick for whoever measures it in a simulator
    controller.tick(board);
    GPIOR0 = 0;
  }
}
