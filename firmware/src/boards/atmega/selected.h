// The folder of the board that this build is for; platformio.ini names it.
#pragma once

#if defined(DARANTI_BOARD_UNO)
#include "../uno/pins.h"
#include "../uno/ports.h"
#elif defined(DARANTI_BOARD_NANO)
#include "../nano/pins.h"
#include "../nano/ports.h"
#elif defined(DARANTI_BOARD_MEGA2560)
#include "../mega2560/pins.h"
#include "../mega2560/ports.h"
#else
#error \
    "no board is named: give it a folder in firmware/src/boards and an environment in platformio.ini"
#endif
