// The compliance of a line that was condensed on the host (T4.2), and samples of its rounding.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

#include "service/limits/memory.h"
#include "service/tissue/compliance.h"
#include "service/tissue/form.h"
#include "service/tissue/grid.h"
#include "service/tissue/tissue_model.h"

namespace teletact::service {

// Relative error that rounding leaves in an exact elimination: eps times a bound of the condition number
// (stiffest element against softest node), and what cancelling the bulk stiffness of nearly incompressible
// layers down to the shear that remains adds: measured errors follow (lambda / mu)^2 eps.
inline double condensation_rounding_error(const Material& material, double largest_compliance,
                                          std::size_t dofs) {
  const double nu = material.poisson_ratio, bulk_over_shear = 2 * nu / (1 - 2 * nu);
  const double modulus =
      *std::max_element(material.youngs_modulus_pa.begin(), material.youngs_modulus_pa.end());
  const double condition =
      modulus / (2 * (1 + nu)) * (2 + bulk_over_shear) * largest_compliance * double(dofs);
  return 16 * std::numeric_limits<double>::epsilon() * (condition + bulk_over_shear * bulk_over_shear);
}

class CondensedLine final : public Compliance {
 public:
  static constexpr std::size_t kRoundingSamples = 3;  // one for each background job
  // `compliance`: of the touchable columns, its lower triangle.
  CondensedLine(const Eigen::MatrixXd& compliance, ColumnRange touchable, const Material& material,
                std::size_t dofs, Charge held)
      : held_(std::move(held)), columns_(touchable), compliance_(compliance.selfadjointView<Eigen::Lower>()) {
    if (!compliance_.allFinite()) throw std::domain_error("condensation: the compliance is not finite");
    bound_ = condensation_rounding_error(material, compliance_.diagonal().maxCoeff(), dofs);
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

  std::optional<FormError> error_between(std::span<const std::size_t> unknowns, const Eigen::MatrixX2d& left,
                                         const Eigen::VectorXd& right) const override {
    const std::shared_ptr<const Rounding> rounding = measured();
    if (!rounding || rounding->samples.size() < kRoundingSamples) return {};
    const Eigen::Index first = 2 * Eigen::Index(columns_.first);
    FormError error;
    error.largest_rounding = rounding->largest();
    for (const Eigen::MatrixXf& sample : rounding->samples)
      error.rounding.push_back(forms_of(sample, first, unknowns, left, right));
    return error;
  }

  const Eigen::MatrixXd& whole() const { return compliance_; }
  std::size_t samples() const {
    const auto rounding = measured();
    return rounding ? rounding->samples.size() : 0;
  }
  // `other`: the whole compliance, computed with other rounding.
  void add_sample(const Eigen::MatrixXd& other) {
    const auto before = measured();
    auto rounding = before ? std::make_shared<Rounding>(*before) : std::make_shared<Rounding>();
    const Eigen::VectorXd root = compliance_.diagonal().cwiseSqrt();
    const Eigen::MatrixXd difference = other - compliance_;
    const double largest = (difference.array() / (root * root.transpose()).array()).abs().maxCoeff();
    rounding->samples.push_back(difference.cast<float>());
    rounding->squares += largest * largest;
    const std::lock_guard lock(mutex_);
    rounding_ = std::move(rounding);
  }

 private:
  struct Rounding {
    std::vector<Eigen::MatrixXf> samples;  // size of the compliance
    double squares = 0;                    // of the largest relative entry of each
    double largest() const { return std::sqrt(squares / double(samples.size())); }
  };
  std::shared_ptr<const Rounding> measured() const {
    const std::lock_guard lock(mutex_);
    return rounding_;
  }
  std::vector<Eigen::Index> positions(std::span<const std::size_t> nodes) const {
    std::vector<Eigen::Index> at(nodes.size());
    for (std::size_t a = 0; a < nodes.size(); ++a)
      at[a] = 2 * Eigen::Index(position_among(nodes[a], columns_));
    return at;
  }
  void state(SolveReport* report) const {
    if (!report) return;
    *report = SolveReport{};
    const auto rounding = measured();
    report->relative_error =
        rounding && rounding->samples.size() == kRoundingSamples ? rounding->largest() : bound_;
  }

  const Charge held_;
  ColumnRange columns_;
  double bound_ = 0;
  mutable std::mutex mutex_;
  std::shared_ptr<const Rounding> rounding_;
  Eigen::MatrixXd compliance_;
};

}  // namespace teletact::service
