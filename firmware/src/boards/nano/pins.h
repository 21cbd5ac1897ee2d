// The Arduino Nano's wiring: the Uno's, pin for pin.
#pragma once
#include "../uno/pins.h"
