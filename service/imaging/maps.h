// The maps that an estimate gives, by the names that the contract has for them. The one list of them.
#pragma once

#include <algorithm>
#include <cstdint>
#include <iterator>
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
               BMode Estimate::*, LogModes ModulusEstimate::*>
      values;
};

inline constexpr EstimateMap kEstimateMaps[] = {
    {"axial_displacement", "m", &Estimate::axial_displacement},
    {"lateral_displacement", "m", &Estimate::lateral_displacement},
    {"axial_displacement_std", "m", &Estimate::axial_displacement_std},
    {"lateral_displacement_std", "m", &Estimate::lateral_displacement_std},
    {"axial_strain", "1", &Estimate::axial_strain},
    {"lateral_strain", "1", &Estimate::lateral_strain},
    {"shear_strain", "1", &Estimate::shear_strain},
    {"axial_strain_std", "1", &Estimate::axial_strain_std},
    {"lateral_strain_std", "1", &Estimate::lateral_strain_std},
    {"shear_strain_std", "1", &Estimate::shear_strain_std},
    {"correlation", "1", &Estimate::correlation},
    {"valid", "1", &Estimate::valid},
    {"youngs_modulus", nullptr, &ModulusEstimate::youngs_modulus},
    {"youngs_modulus_log_std", "1", &ModulusEstimate::log_deviation},
    {"b_mode", "1", &Estimate::b_mode}};

// Sent to who names it alone: its third axis is one of causes.
inline constexpr EstimateMap kLogModes{"youngs_modulus_log_modes", "1", &ModulusEstimate::log_modes};

// Null: there is none of that name.
inline const EstimateMap* find_map(std::string_view name) {
  if (name == kLogModes.name) return &kLogModes;
  const auto* found =
      std::ranges::find_if(kEstimateMaps, [name](const EstimateMap& map) { return map.name == name; });
  return found == std::end(kEstimateMaps) ? nullptr : found;
}

}  // namespace teletact::service
