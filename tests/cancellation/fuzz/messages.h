// What a call of a case sends.
#pragma once

#include <google/protobuf/message_lite.h>

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "tests/cancellation/fuzz/case.h"

namespace teletact::test {

struct Message {
  // `newest`: the number of the newest answer or state received, to acknowledge.
  std::function<std::string(std::uint64_t newest)> bytes;
  std::size_t after_answers = 0;  // not written before so many have been received
};

struct Script {
  std::vector<Message> messages;
  bool repeats_last = false;  // once per answer, for as long as the call lives
};

Message constant(std::string bytes, std::size_t after_answers = 0);
Message constant(const google::protobuf::MessageLite&);
// A scene or map that there cannot be.
std::string odd_name(Random&);

// What the calls of a state are about.
struct Targets {
  std::vector<std::string> touched;  // scenes to touch, watch, and publish into
  std::string large;                 // its full view fills more than a stream's window
  std::vector<std::string> made;     // names for CreateScene and DeleteScene
};

// Serialised requests; `newest` of an answer to it, 0 when it has no number.
Script script_for(const Case&, const Targets&, Random&);
std::uint64_t number_in(Method, const std::string& answer);

// Made once, before the clock runs: the pair that a few Estimates upload.
void make_pairs();

// One that behaves: touches at rest, watches and acknowledges, or has sent an acquisition and waits. Holds a
// slot.
Script script_of_holder(Method, const std::string& scene);

}  // namespace teletact::test
