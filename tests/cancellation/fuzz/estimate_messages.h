// What an Estimate of a case sends: an acquisition and a pair, mostly tiny.
#pragma once

#include <string>

#include "tests/cancellation/fuzz/messages.h"

namespace teletact::test {

Script estimate_script(const Case&, const std::string& scene, Random&);

}  // namespace teletact::test
