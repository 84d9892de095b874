#include "client/acquire/modulus_names.h"

#include <fmt/format.h>

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

std::string name_of(v1::ModulusMethod method) {
  for (const auto& [name, value] : modulus_methods())
    if (value == method) return name;
  return "unknown";
}

std::string background_of(const v1::EstimateSummary& summary) {
  const std::string kpa = fmt::format("{:.2f} kPa", 1e-3 * summary.background_modulus_pa());
  if (!summary.has_youngs_modulus_log_std()) return kpa;
  return kpa + fmt::format(" +- {:.0f} %", 100 * summary.youngs_modulus_log_std());
}

}  // namespace teletact::client
