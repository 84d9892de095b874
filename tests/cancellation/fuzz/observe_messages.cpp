#include "tests/cancellation/fuzz/observe_messages.h"

#include <array>
#include <cmath>

#include "teletact/v1/palpation.pb.h"

namespace teletact::test {

namespace {

v1::ObserveOpen observe_open(const std::string& scene, Random& random) {
  v1::ObserveOpen open;
  open.set_scene_id(scene);
  open.set_windows(random.chance(0.5));
  open.set_answers(random.chance(0.5));
  open.set_surface(random.chance(0.5));
  for (const char* map : {"youngs_modulus", "youngs_modulus_log_std", "valid", "b_mode"})
    if (random.chance(0.5)) open.add_maps(map);
  if (random.chance(0.3)) open.set_session_id("session-" + std::to_string(random.below(4)));
  if (random.chance(0.3)) open.set_max_rate_hz(random.within(1, 60));
  return open;
}

void spoil(v1::ObserveOpen& open, Random& random) {
  switch (random.below(4)) {
    case 0:
      return open.set_scene_id(odd_name(random));
    case 1:
      return open.add_maps(odd_name(random));
    case 2:
      return open.set_session_id(std::string(100'000, '\n'));
    default:
      return open.set_max_rate_hz(random.one_of(std::array{std::nan(""), HUGE_VAL, -1.0, 1e300}));
  }
}

}  // namespace

Script observe_script(const Case& tried, const std::string& scene, Random& random) {
  Script script;
  v1::ObserveRequest first;
  *first.mutable_open() = observe_open(scene, random);
  const auto acknowledging = [](std::uint64_t offset, std::size_t after_answers) {
    return Message{[offset](std::uint64_t newest) {
                     v1::ObserveRequest request;
                     request.set_acknowledged(newest + offset);
                     return request.SerializeAsString();
                   },
                   after_answers};
  };
  if (tried.content == Content::kEmpty) {
    if (random.chance(0.5)) script.messages.push_back(constant(first));
    script.messages.push_back(constant(std::string()));
    return script;
  }
  if (tried.content == Content::kInvalid) {
    switch (random.below(4)) {
      case 0:
        script.messages = {constant(first), constant(first)};
        return script;
      case 1:
        script.messages = {constant(first),
                           acknowledging(random.chance(0.5) ? 1 : std::uint64_t{1} << 63, 1)};
        return script;
      case 2:  // acknowledged before it is opened
        script.messages = {acknowledging(0, 0)};
        return script;
      default:
        spoil(*first.mutable_open(), random);
        script.messages = {constant(first)};
        return script;
    }
  }
  script.messages = {constant(first), acknowledging(0, 1)};
  script.repeats_last = true;
  return script;
}

}  // namespace teletact::test
