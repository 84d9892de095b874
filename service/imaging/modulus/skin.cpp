#include "service/imaging/modulus/skin.h"

#include <algorithm>
#include <cmath>

#include "service/device/cancellation.h"
#include "service/imaging/modulus/cell_strains.h"
#include "service/imaging/modulus/weighed_tissues.h"

namespace teletact::service {

using Eigen::Index;
using Eigen::VectorXd;

namespace {

constexpr double kBareLog = 0.07;  // of all alike, and of each layer

}  // namespace

std::array<double, 2> layer_log(const Surface& capsule, std::size_t layer, double row_m) {
  const double part = std::clamp(capsule.thickness_m / row_m - static_cast<double>(layer), 0.0, 1.0);
  const double voigt = std::log(1 - part + part * capsule.ratio),
               reuss = -std::log(1 - part + part / capsule.ratio);
  return {(voigt + reuss) / 2, (voigt - reuss) / 2};
}

SkinPrior skin_known(const Surface& surface, double row_m) {
  constexpr double kLeast = 0.05;  // of thickness and ratio: no capsule is thinner or softer by far
  SkinPrior out;
  if (surface.kind == Surface::Kind::kUnknown || surface.kind == Surface::Kind::kUneven) return out;
  out.deviation.fill(kBareLog);
  if (surface.kind == Surface::Kind::kBare) return out;
  for (std::size_t k = 1; k < kSkinChanges; ++k) {
    const auto [mean, apart] = layer_log(surface, k - 1, row_m);
    // The larger of what one deviation more and one less make of it.
    const auto by = [&, mean = mean](double Surface::*what, double deviation) {
      Surface more = surface, less = surface;
      more.*what += deviation, less.*what = std::max(kLeast * surface.*what, surface.*what - deviation);
      return std::max(std::abs(layer_log(more, k - 1, row_m)[0] - mean),
                      std::abs(layer_log(less, k - 1, row_m)[0] - mean));
    };
    out.mean[k] = mean;
    out.deviation[k] =
        std::hypot(kBareLog, std::hypot(apart, by(&Surface::thickness_m, surface.thickness_std_m),
                                        by(&Surface::ratio, surface.ratio_std)));
  }
  return out;
}

VectorXd skin_cells(const CellGrid& cells, std::size_t change) {
  VectorXd out = VectorXd::Zero(static_cast<Index>(cells.size()));
  for (std::size_t c = 0; c < cells.size() && cells.row(c) < kSkinLayers; ++c)
    out[static_cast<Index>(c)] = change == 0 || cells.row(c) == change - 1 ? 1 : 0;
  return out;
}

SkinAnswer skin_answer(ProbedTissue& tissue, const VectorXd& log_strain, double log_force,
                       const StrainOptions& strain, const CellGrid& at) {
  constexpr double kStep = 0.3;    // of ln E: within it strain is linear to a tenth
  constexpr double kLeast = 0.02;  // of the mean strain: with less a cell tells nothing
  const CellGrid& cells = tissue.cells();
  SkinAnswer out;
  out.log_strain[0] = VectorXd::Zero(static_cast<Index>(at.size())), out.log_force[0] = 0;
  for (std::size_t k = 1; k < kSkinChanges; ++k) {
    check_cancelled();
    const ProbedTissue::Response changed = tissue.push(kStep * skin_cells(cells, k));
    const VectorXd size = -as_measured(changed.axial_strain, cells, strain),
                   more = size.cwiseMax(kLeast * size.mean()).array().log().matrix() - log_strain;
    out.log_strain[k] = sampled(more / kStep, cells, at);
    out.log_force[k] = (std::log(changed.force_n) - log_force) / kStep;
    out.log_strain[0] += out.log_strain[k], out.log_force[0] += out.log_force[k];
  }
  return out;
}

}  // namespace teletact::service
