// The maps that an estimate gives, by the names that the contract has for them. The one list of them.
#pragma once

#include <cstdint>
#include <string_view>
#include <variant>
#include <vector>

#include "service/imaging/estimate.h"

namespace teletact::service {

struct EstimateMap {
  const char* name;
  const char* unit;  // null: that of the modulus, Pa or 1
  // On the estimate's grid, but for the image, which has its own.
  std::variant<Field Estimate::*, Field ModulusEstimate::*, std::vector<std::uint8_t> Estimate::*,
               BMode Estimate::*>
      values;
};

const std::vector<EstimateMap>& estimate_maps();
// Null: there is none of that name.
const EstimateMap* find_map(std::string_view name);

}  // namespace teletact::service
