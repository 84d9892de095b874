// The maps that an estimate gives, by the names that the contract has for them. The one list of them.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "service/imaging/estimate.h"

namespace teletact::service {

struct EstimateMap {
  const char* name;
  const char* unit;                // null: that of the modulus, Pa or 1
  const Field Estimate::*numbers;  // null: `flags` or `image` instead
  const std::vector<std::uint8_t> Estimate::*flags = nullptr;
  const BMode Estimate::*image = nullptr;  // the same, on a grid of its own
};

const std::vector<EstimateMap>& estimate_maps();
// Null: there is none of that name.
const EstimateMap* find_map(std::string_view name);

}  // namespace teletact::service
