#pragma once
#include "../uno/ports.h"
