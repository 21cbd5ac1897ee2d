#include "../atmega/atmega.h"

namespace daranti {

uint8_t AtmegaBoard::build() const { return 3; }

}  // namespace daranti
