// Ours: multigrid-preconditioned conjugate gradients on the device, the nodes in contact prescribed. Set-up:
// the stiffness on the device, the smoother and the coarse operators, all buffers. `tolerance`: the
// relative error in the energy norm that the solver is asked for.
//
// With the factor of a uniform modulus in multigrid's place (T4.6): the least that a tissue's own factor,
// kept for its next modulus, would do.
#include <chrono>
#include <memory>
#include <optional>
#include <stdexcept>

#include "bench/peers/peer.h"
#include "service/tissue/elasticity.h"
#include "service/tissue/elasticity_solver.h"
#include "service/tissue/tissue_factor.h"

namespace teletact::bench {
namespace {

using service::ElasticitySolver;
using service::Precision;
using service::SolvePrecision;

class DevicePcg final : public Peer {
 public:
  DevicePcg(std::shared_ptr<service::Device> device, SolvePrecision precision, bool by_factor)
      : device_(std::move(device)), precision_(precision), by_factor_(by_factor) {}
  std::string name() const override {
    if (by_factor_) return "ours, PCG with a uniform factor";
    switch (precision_) {
      case SolvePrecision::kFloat:
        return "ours, device PCG float";
      case SolvePrecision::kDouble:
        return "ours, device PCG double";
      case SolvePrecision::kRefined:
        return "ours, device PCG refined";
    }
    throw std::invalid_argument("precision: unknown");
  }
  bool ours() const override { return true; }
  bool iterative() const override { return true; }
  double prepare(const ContactProblem& p) override {
    tolerance_ = 0;
    solver_.reset();
    if (by_factor_) make_factor(p);
    const std::uint64_t before = device_->held_bytes();
    const auto begin = std::chrono::steady_clock::now();
    make_solver(p, kAnyTolerance);
    const std::chrono::duration<double> spent = std::chrono::steady_clock::now() - begin;
    kept_bytes_ = device_->held_bytes() - before;
    return spent.count();
  }
  std::size_t kept_bytes() const override { return kept_bytes_; }
  PeerAnswer touch(const ContactProblem& p, double tolerance) override {
    if (tolerance != tolerance_) make_solver(p, tolerance);
    std::vector<double> u(pressed_.size(), 0.0);
    const service::SolveReport report = solver_->solve(1, {}, pressed_, u);
    const std::vector<double> force = solver_->nodal_forces(1, u);
    Eigen::VectorXd multiplier(p.overlap_m.size());
    for (Eigen::Index r = 0; r < multiplier.size(); ++r)
      multiplier[r] = -force[p.contact_dofs[static_cast<std::size_t>(r)]];
    PeerAnswer answer;
    answer.force_n = p.force_n(multiplier);
    answer.displacement_m = Eigen::Map<Eigen::VectorXd>(u.data(), static_cast<Eigen::Index>(u.size()));
    answer.iterations = report.iterations;
    answer.stated_error = report.relative_error;
    return answer;
  }

 private:
  static constexpr double kAnyTolerance = 1e-4;  // the set-up does not depend on it

  // Of a uniform modulus: it depends on the grid, nu and what is held, not on the tissue, and is no set-up.
  void make_factor(const ContactProblem& p) {
    std::vector<std::uint8_t> free = service::free_unknowns(p.tissue.grid, p.tissue.supports);
    for (const std::size_t dof : p.contact_dofs) free[dof] = 0;
    const std::vector<double> modulus(p.tissue.grid.elements(), 1e4);
    factor_ = std::make_shared<service::TissueFactor>(
        p.tissue.grid, service::Material{modulus, p.tissue.material.poisson_ratio}, free);
  }

  void make_solver(const ContactProblem& p, double tolerance) {
    service::ElasticitySolverOptions options;
    options.precision = precision_;
    options.relative_error = tolerance;
    options.max_iterations = 2000;
    options.prescribed.assign(p.tissue.grid.dofs(), 0);
    pressed_.assign(p.tissue.grid.dofs(), 0.0);
    for (std::size_t r = 0; r < p.contact_dofs.size(); ++r) {
      options.prescribed[p.contact_dofs[r]] = 1;
      pressed_[p.contact_dofs[r]] = p.overlap_m[static_cast<Eigen::Index>(r)];
    }
    solver_.emplace(device_, p.tissue.grid, p.tissue.supports, options);
    solver_->use_factor(factor_);
    solver_->set_material(p.tissue.material);
    solver_->nodal_forces(1, pressed_);  // makes the multigrid levels
    tolerance_ = tolerance;
  }

  std::shared_ptr<service::Device> device_;
  SolvePrecision precision_;
  bool by_factor_;
  std::shared_ptr<const service::TissueFactor> factor_;
  std::size_t kept_bytes_ = 0;  // on the device
  double tolerance_ = 0;
  std::optional<ElasticitySolver> solver_;
  std::vector<double> pressed_;  // [dof]
};

}  // namespace

std::unique_ptr<Peer> make_device_pcg(const std::shared_ptr<service::Device>& device, Precision inside,
                                      bool refined) {
  const SolvePrecision precision = inside == Precision::kDouble ? SolvePrecision::kDouble
                                   : refined                    ? SolvePrecision::kRefined
                                                                : SolvePrecision::kFloat;
  return std::make_unique<DevicePcg>(device, precision, false);
}

std::unique_ptr<Peer> make_factor_pcg(const std::shared_ptr<service::Device>& device) {
  return std::make_unique<DevicePcg>(device, SolvePrecision::kDouble, true);
}

}  // namespace teletact::bench
