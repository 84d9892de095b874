// A service that lets nobody in: a command that asks it has found nothing wrong with its own options, and
// ends at once, where it waits for one that is not there.
#pragma once

#include <string>

#include "tests/support/fake_service.h"

namespace teletact::test {

inline constexpr const char* kKeptOut = "UNAUTHENTICATED: who calls?";

// For as long as the process lives.
inline const std::string& address_that_keeps_out() {
  static FakeServer* const server = [] {
    auto* const made = new FakeServer;
    made->palpation.keeps_out = true;
    return made;
  }();
  return server->address();
}

}  // namespace teletact::test
