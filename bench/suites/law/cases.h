// Random tissues and tips that contact laws are judged on, meshed as the product meshes a window.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "service/contact/touch_model.h"

namespace teletact::bench {

enum class LawGroup {
  kResolved,  // tips that the mesh resolves, frictionless; inclusions, borders, interior layers
  kChecker,   // checkerboards of contrast 10 under such tips
  kStuck,     // stuck tips on tissues as of kResolved
  kCoarse     // tips too small for the mesh
};

struct LawCase {
  std::string name;  // what it is, for people
  std::shared_ptr<const service::TouchModel> model;
  service::Layer layer;
  service::Fingertip tip;
  service::Region region;  // of the law
  double deepest_m = 0;    // poses reach to here
};

// The same for the same numbers, on every machine.
LawCase make_law_case(LawGroup, std::uint64_t seed, std::size_t index);

}  // namespace teletact::bench
