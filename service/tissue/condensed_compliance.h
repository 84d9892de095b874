// The compliance of a row that was condensed on the host (T4.2).
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <limits>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

#include "service/base/memory.h"
#include "service/tissue/compliance.h"
#include "service/tissue/grid.h"

namespace teletact::service {

// Bound of the relative error |dC_ij| / sqrt(C_ii C_jj) that rounding leaves in any entry, calibrated once on
// measured rounding (rounding_test): it grows with bulk over shear, by rows of nodes with its square, with
// the stiffest element over the softest node, E C, and with the elements, most for a row amid deep tissue.
// Measured were at most 230 (1 + elements / 500) (1 + b) E C eps by columns, 210 + 0.8 b of it by rows,
// up to 29 000 elements.
inline double condensation_rounding(const Material& material, double largest_compliance, bool by_columns) {
  const double nu = material.poisson_ratio, bulk_over_shear = 2 * nu / (1 - 2 * nu);
  const double stiffest =
      *std::max_element(material.youngs_modulus_pa.begin(), material.youngs_modulus_pa.end());
  const double size = 1 + double(material.youngs_modulus_pa.size()) / 500;
  const double worst = size * (400 + (by_columns ? 0 : 1.5 * bulk_over_shear));
  return worst * (1 + bulk_over_shear) * stiffest * largest_compliance *
         std::numeric_limits<double>::epsilon();
}

class CondensedCompliance final : public Compliance {
 public:
  // `compliance`: of the touchable columns, its lower triangle. `rounding`: bound of its relative error.
  CondensedCompliance(const Eigen::MatrixXd& compliance, ColumnRange touchable, double rounding, Charge held)
      : held_(std::move(held)),
        columns_(touchable),
        rounding_(rounding),
        compliance_(compliance.selfadjointView<Eigen::Lower>()) {
    if (!compliance_.allFinite()) throw std::domain_error("condensation: the compliance is not finite");
  }

  Eigen::MatrixXd among(std::span<const std::size_t> nodes, SolveReport* report) override {
    const Eigen::Index n = Eigen::Index(nodes.size());
    const std::vector<Eigen::Index> at = positions(nodes);
    Eigen::MatrixXd s(2 * n, 2 * n);
    for (Eigen::Index b = 0; b < n; ++b) {
      for (Eigen::Index a = 0; a < n; ++a)
        s.block<2, 2>(2 * a, 2 * b) = compliance_.block<2, 2>(at[a], at[b]);
    }
    state(report);
    return s;
  }

  Eigen::MatrixXd axial_among(std::span<const std::size_t> nodes, SolveReport* report) override {
    const Eigen::Index n = Eigen::Index(nodes.size());
    const std::vector<Eigen::Index> at = positions(nodes);
    Eigen::MatrixXd s(n, n);
    for (Eigen::Index b = 0; b < n; ++b) {
      for (Eigen::Index a = 0; a < n; ++a) s(a, b) = compliance_(at[a] + 1, at[b] + 1);
    }
    state(report);
    return s;
  }

 private:
  std::vector<Eigen::Index> positions(std::span<const std::size_t> nodes) const {
    std::vector<Eigen::Index> at(nodes.size());
    for (std::size_t a = 0; a < nodes.size(); ++a)
      at[a] = 2 * Eigen::Index(position_among(nodes[a], columns_));
    return at;
  }
  void state(SolveReport* report) const {
    if (!report) return;
    *report = SolveReport{};
    report->relative_error = rounding_;
  }

  const Charge held_;
  const ColumnRange columns_;
  const double rounding_;
  const Eigen::MatrixXd compliance_;
};

}  // namespace teletact::service
