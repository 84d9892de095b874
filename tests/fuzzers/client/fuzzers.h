// What reaches the client: files that a person opens, and what a service says.
#pragma once

#include "tests/fuzzers/support/boundary.h"

namespace teletact::fuzzers {

bool law_book(Bytes);
bool matlab(Bytes);
bool metaimage(Bytes);
bool recording(Bytes);
bool touch_answers(Bytes);
bool uff(Bytes);

}  // namespace teletact::fuzzers
