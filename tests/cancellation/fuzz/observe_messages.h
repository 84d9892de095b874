// What an Observe of a case sends: what it wants, then acknowledgements.
#pragma once

#include <string>

#include "tests/cancellation/fuzz/messages.h"

namespace teletact::test {

Script observe_script(const Case&, const std::string& scene, Random&);

}  // namespace teletact::test
