#include "service/imaging/modulus/skin.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include "service/device/cancellation.h"
#include "service/imaging/modulus/cell_strains.h"
#include "service/imaging/modulus/weighed_tissues.h"

namespace teletact::service {

using Eigen::Index;
using Eigen::VectorXd;

VectorXd skin_cells(const CellGrid& cells, std::size_t change) {
  VectorXd out = VectorXd::Zero(static_cast<Index>(cells.size()));
  for (std::size_t c = 0; c < cells.size() && cells.row(c) < kSkinLayers; ++c)
    out[static_cast<Index>(c)] = change == 0 || cells.row(c) == change - 1 ? 1 : 0;
  return out;
}

SkinAnswer skin_answer(const Queue& queue, const StrainOptions& strain, const ProbeFace& face,
                       const CellGrid& at) {
  constexpr double kStep = 0.3;    // of ln E: within it strain is linear to a tenth
  constexpr double kLeast = 0.02;  // of the median strain: with less a cell tells nothing
  const auto tissue = make_probed_solid(queue, face);
  const CellGrid& cells = tissue->cells();
  const auto pushed = [&](const VectorXd& log_modulus) {
    check_cancelled();
    const ProbedTissue::Response response = tissue->push(log_modulus);
    const VectorXd size = -as_measured(response.axial_strain, cells, strain);
    return std::pair(VectorXd(size.cwiseMax(kLeast * size.mean()).array().log()), std::log(response.force_n));
  };
  const auto [level, force] = pushed(VectorXd::Zero(static_cast<Index>(cells.size())));
  SkinAnswer out;
  out.log_strain[0] = VectorXd::Zero(static_cast<Index>(at.size())), out.log_force[0] = 0;
  for (std::size_t k = 1; k < kSkinChanges; ++k) {
    const auto [changed, changed_force] = pushed(kStep * skin_cells(cells, k));
    out.log_strain[k] = sampled((changed - level) / kStep, cells, at);
    out.log_force[k] = (changed_force - force) / kStep;
    out.log_strain[0] += out.log_strain[k], out.log_force[0] += out.log_force[k];
  }
  return out;
}

}  // namespace teletact::service
