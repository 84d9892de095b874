// Ours: multigrid-preconditioned conjugate gradients on the device, the nodes in contact prescribed. Set-up:
// the stiffness on the device, the smoother and the coarse operators, all buffers. `tolerance`: the
// relative error in the energy norm that the solver is asked for.
#include <memory>
#include <optional>
#include <stdexcept>

#include "bench/basics/clock.h"
#include "bench/peers/peer.h"
#include "service/tissue/elasticity_solver.h"
#include "service/tissue/iterative_compliances.h"
#include "service/tissue/tissue_model.h"

namespace teletact::bench {
namespace {

using service::ElasticitySolver;
using service::Precision;
using service::SolvePrecision;

class DevicePcg final : public Peer {
 public:
  DevicePcg(std::shared_ptr<service::Device> device, SolvePrecision precision)
      : device_(std::move(device)), precision_(precision) {}
  std::string name() const override {
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
  bool products_choice(const ContactProblem& p) const override {
    return service::iterative_options(*device_, p.of.poisson_ratio).precision == precision_;
  }
  double prepare(const ContactProblem& p) override {
    tolerance_ = 0;
    solver_.reset();
    const std::uint64_t before = device_->held_bytes();
    const double spent_s = seconds_of([&] { make_solver(p, kAnyTolerance); });
    kept_bytes_ = device_->held_bytes() - before;
    return spent_s;
  }
  std::size_t kept_bytes() const override { return kept_bytes_; }
  PeerAnswer touch(const ContactProblem& p, double tolerance) override {
    if (tolerance != tolerance_) make_solver(p, tolerance);
    std::vector<double> u = pressed_;
    const service::SolveReport report = solver_->solve(1, {}, u);
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
    solver_.emplace(device_, p.tissue.grid, p.tissue.supports, p.tissue.material, options);
    solver_->nodal_forces(1, pressed_);  // makes the multigrid levels
    tolerance_ = tolerance;
  }

  std::shared_ptr<service::Device> device_;
  SolvePrecision precision_;
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
  return std::make_unique<DevicePcg>(device, precision);
}

}  // namespace teletact::bench
