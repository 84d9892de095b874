// What reaches the service: what clients say, its state on disk, its configuration and its command line.
#pragma once

#include "tests/fuzzers/support/boundary.h"

namespace teletact::fuzzers {

bool acquisition(Bytes);
bool address(Bytes);
bool configuration(Bytes);
bool create_scene(Bytes);
bool publish_slice(Bytes);
bool scene_state(Bytes);
bool touch_open(Bytes);

}  // namespace teletact::fuzzers
