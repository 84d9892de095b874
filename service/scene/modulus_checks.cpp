#include "service/scene/modulus_checks.h"

#include <fmt/format.h>

#include <cmath>
#include <stdexcept>

#include "service/scene/errors.h"
#include "service/scene/slices.h"

namespace teletact::service {
namespace {

void check_nodes(const char* field, const std::vector<double>& nodes_m, std::size_t most) {
  if (nodes_m.size() < 2 || nodes_m.size() > most)
    throw std::invalid_argument(fmt::format("{}: {} nodes, must be 2 to {}", field, nodes_m.size(), most));
  for (std::size_t k = 0; k + 1 < nodes_m.size(); ++k)
    if (!(nodes_m[k + 1] > nodes_m[k]))
      throw std::invalid_argument(fmt::format("{}[{}]: nodes must be finite and increase", field, k + 1));
  if (!std::isfinite(nodes_m.back() - nodes_m.front()))
    throw std::invalid_argument(fmt::format("{}: nodes must be finite and increase", field));
}

void check_axis(const char* field, const std::vector<double>& nodes_m, double length_m, std::size_t most) {
  check_nodes(field, nodes_m, most);
  const double slack_m = kNodesSlack * length_m;
  if (!(std::abs(nodes_m.front()) <= slack_m && std::abs(nodes_m.back() - length_m) <= slack_m))
    throw std::invalid_argument(
        fmt::format("{}: runs from {} to {} m, must run from 0 to the scene's size, {} m", field,
                    nodes_m.front(), nodes_m.back(), length_m));
}

// What CreateScene and PublishSlice see to as slices come: what is kept on disk may say otherwise.
void check_slices(const ExplicitModulus& e) {
  const double first_m = e.solid() ? e.z_m.front() : 0, last_m = e.solid() ? e.z_m.back() : -1;
  for (std::size_t n = 0; n < e.slices_m.size(); ++n)
    if (!(e.slices_m[n] >= first_m && e.slices_m[n] <= last_m &&
          (n == 0 || e.slices_m[n - 1] < e.slices_m[n])))
      throw std::invalid_argument(
          fmt::format("slices[{}]: {} m; places must increase, within the solid", n, e.slices_m[n]));
  if (!e.log_deviation.empty() && e.log_deviation.size() != e.youngs_modulus_pa.size())
    throw std::invalid_argument(fmt::format("log_deviation: {} values for {} elements",
                                            e.log_deviation.size(), e.youngs_modulus_pa.size()));
  for (std::size_t n = 0; n < e.log_deviation.size(); ++n)
    if (!(e.log_deviation[n] >= 0 && std::isfinite(e.log_deviation[n])))
      throw std::invalid_argument(fmt::format("log_deviation[{}]: {} cannot be", n, e.log_deviation[n]));
}

}  // namespace

void check_modulus(const ExplicitModulus& e, const SceneGeometry& geometry, const Limits& limits) {
  check_axis("modulus.x_m", e.x_m, geometry.width_m, limits.max_scene_columns);
  check_axis("modulus.y_m", e.y_m, geometry.depth_m, limits.max_scene_elements + 1);
  if (!e.solid() && e.y_m.front() != 0)
    throw std::invalid_argument(fmt::format(
        "modulus.y_m[0]: {} m; depth begins at 0 exactly, the surface of the tissue", e.y_m.front()));
  if (e.solid()) check_nodes("modulus.z_m", e.z_m, limits.max_scene_columns);
  const std::size_t elements = (e.x_m.size() - 1) * (e.y_m.size() - 1) * e.slices();
  const std::size_t most = e.solid() ? limits.max_solid_elements : limits.max_scene_elements;
  if (elements > most)
    throw Error(
        ErrorKind::kExhausted,
        fmt::format("modulus: {} elements, at most {} are allowed; use a coarser grid", elements, most));
  if (e.youngs_modulus_pa.size() != elements)
    throw std::invalid_argument(fmt::format("modulus.youngs_modulus_pa: {} values for {} elements",
                                            e.youngs_modulus_pa.size(), elements));
  check_moduli("modulus.youngs_modulus_pa", e.youngs_modulus_pa);
  check_slices(e);
}

}  // namespace teletact::service
