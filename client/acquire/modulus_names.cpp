#include "client/acquire/modulus_names.h"

#include <fmt/format.h>

#include <cmath>

namespace teletact::client {

namespace v1 = ::teletact::v1;

const std::map<std::string, v1::ModulusMethod>& modulus_methods() {
  static const std::map<std::string, v1::ModulusMethod> names{
      {"reference-stress", v1::MODULUS_METHOD_REFERENCE_STRESS},
      {"direct", v1::MODULUS_METHOD_DIRECT},
      {"iterative", v1::MODULUS_METHOD_ITERATIVE},
      {"solid", v1::MODULUS_METHOD_SOLID}};
  return names;
}

const std::map<std::string, v1::PlaneCondition>& plane_conditions() {
  static const std::map<std::string, v1::PlaneCondition> names{{"strain", v1::PLANE_CONDITION_STRAIN},
                                                               {"stress", v1::PLANE_CONDITION_STRESS},
                                                               {"solid", v1::PLANE_CONDITION_SOLID}};
  return names;
}

const std::map<std::string, v1::SurfaceKind>& surface_kinds() {
  static const std::map<std::string, v1::SurfaceKind> names{{"unknown", v1::SURFACE_KIND_UNSPECIFIED},
                                                            {"bare", v1::SURFACE_KIND_BARE},
                                                            {"capsule", v1::SURFACE_KIND_CAPSULE},
                                                            {"uneven", v1::SURFACE_KIND_UNEVEN}};
  return names;
}

std::string name_of(v1::ModulusMethod method) {
  for (const auto& [name, value] : modulus_methods())
    if (value == method) return name;
  return "unknown";
}

std::string background_of(double background_pa, double log_deviation) {
  const std::string kpa = fmt::format("{:.2f} kPa", 1e-3 * background_pa);
  if (!(log_deviation > 0)) return kpa;
  const double factor = std::exp(1.96 * log_deviation);
  return kpa + fmt::format(" (95 %: {:.2f} to {:.2f})", 1e-3 * background_pa / factor,
                           1e-3 * background_pa * factor);
}

}  // namespace teletact::client
