#include "service/imaging/maps.h"

#include <algorithm>

namespace teletact::service {

const std::vector<EstimateMap>& estimate_maps() {
  static const std::vector<EstimateMap> maps{
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
  return maps;
}

const EstimateMap* find_map(std::string_view name) {
  const auto& maps = estimate_maps();
  const auto found =
      std::find_if(maps.begin(), maps.end(), [&](const auto& map) { return map.name == name; });
  return found == maps.end() ? nullptr : &*found;
}

}  // namespace teletact::service
