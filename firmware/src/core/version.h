// The commit that this was built from. firmware/scripts/commit.py writes commit.h for the boards;
// the desk's build has none, so that its records do not depend on it.
#pragma once
#include <stdint.h>

#if defined(__AVR__) && defined(__has_include)
#if __has_include("commit.h")
#include "commit.h"
#endif
#endif
#ifndef DARANTI_COMMIT
#define DARANTI_COMMIT 0
#define DARANTI_MODIFIED 0
#endif

namespace daranti {

constexpr uint32_t kCommit = DARANTI_COMMIT;
constexpr uint8_t kModified = DARANTI_MODIFIED;

}  // namespace daranti
