// The iterative modulus (T3.3): regularised least squares on the measured axial displacement.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "service/device/cancellation.h"
#include "service/imaging/modulus/modulus.h"
#include "service/imaging/modulus/problem.h"
#include "service/imaging/modulus/seed.h"

namespace teletact::service {
namespace {

using Eigen::VectorXd;
constexpr float kMinDeviationM = 0.3e-6f;
constexpr double kLargestMisfit = 6;  // mean square of (modelled - measured) / deviation; above it kMisfit
// A start needs no more. Corrected on, beside an inclusion that goes on beyond the window, it once came with
// one of its own (demo, patient 3), and the steps did not take that away; the direct method stops there by
// itself since, but each correction takes the time of a step.
constexpr DirectOptions kStart{.max_corrections = 1};

class Iterative : public ModulusMethod {
 public:
  Iterative(Queue queue, std::shared_ptr<StripCache> strips)
      : strips_(std::move(strips)), direct_(make_direct(std::move(queue), kStart, strips_)) {}

  ModulusEstimate estimate(const ModulusInput& in) override {
    const double begun_s = worked_s();
    ModulusEstimate out = direct_->estimate(in);
    out.start_s = worked_s() - begun_s;
    out.kind = ModulusKind::kIterative;
    const auto strip = strips_->get(in.tissue, in.window_width_m);
    StripModel& model = strip->model;
    const VectorXd start = shrunk_log_modulus(model, in, out);
    DisplacementData data(model, in.measured, kMinDeviationM, kTrackingWindowM2);
    VectorXd prior = VectorXd::Zero(start.size());
    if (in.known && out.absolute) prior = beside(model, start);
    ModulusProblem problem(model, std::move(data), std::move(prior), out.background);
    const ModulusProblem::Point best = iterate(problem, in, model, start, out);
    publish(in, model, problem, best, out);
    return out;
  }

 private:
  static constexpr int kMaxSteps = 16;
  static constexpr double kConvergedStep = 0.01;  // rms change of log E under the probe

  // The modulus that is known beside the window, 0 under it.
  static VectorXd beside(const StripModel& model, VectorXd theta) {
    const std::size_t columns = model.grid().nx() - 1;
    for (Eigen::Index e = 0; e < theta.size(); ++e) {
      const std::size_t i = static_cast<std::size_t>(e) % columns;
      if (i >= model.first_column() && i < model.last_column()) theta[e] = 0;
    }
    return theta;
  }

  // Gauss-Newton with halved steps where the objective does not fall.
  ModulusProblem::Point iterate(ModulusProblem& problem, const ModulusInput& in, const StripModel& model,
                                const VectorXd& start, ModulusEstimate& out) const {
    ModulusProblem::Point best = problem.at(start);
    double factor = 1;
    out.converged = false;
    VectorXd step;
    const int steps = std::min(kMaxSteps, in.budget.steps);
    for (out.iterations = 0; out.iterations < steps && !out.converged;) {
      if (factor == 1) step = problem.step(best);
      ModulusProblem::Point next = problem.at(best.theta + factor * step);
      ++out.iterations;
      if (next.objective < best.objective) {
        out.converged = factor * rms_under_probe(model, step) < std::max(kConvergedStep, in.tolerance / 3);
        best = std::move(next);
        factor = 1;
      } else {
        factor *= 0.5;
      }
    }
    return factor == 1 ? best : problem.at(best.theta);
  }

  static std::string unsettled(int steps, const ModulusBudget& budget) {
    if (steps == 0)
      return fmt::format(
          "there was no time for a step of the iterative method ({}): this is the direct "
          "method's modulus; allow more time",
          budget.why_steps);
    constexpr const char* kBest = "before it had settled: this is the best so far";
    if (steps < kMaxSteps)
      return fmt::format(
          "there was time for {} step(s) of the iterative method ({}); they ended {}; allow more "
          "time",
          steps, budget.why_steps, kBest);
    return fmt::format("the iterative modulus was stopped after {} steps, the most, {}", steps, kBest);
  }

  void publish(const ModulusInput& in, const StripModel& model, ModulusProblem& problem,
               const ModulusProblem::Point& best, ModulusEstimate& out) const {
    if (!out.converged)
      out.warn(out.iterations < kMaxSteps ? ModulusFlag::kCut : ModulusFlag::kDeadline, "{}",
               unsettled(out.iterations, in.budget));
    if (out.iterations == 0) {
      out.kind = ModulusKind::kDirect;
      return;
    }
    if (best.fit.mean_square > kLargestMisfit)
      out.warn(ModulusFlag::kMisfit,
               "no modulus explains the displacement: it is off by {} standard deviations (rms); the extent, "
               "the plane condition or the probe's contact may not be as stated",
               std::lround(std::sqrt(best.fit.mean_square)));
    const double scale = force_scale(in, best.response.force_n_per_m, best.fit.amplitude);
    const Field map = model.on_image(problem.modulus(best.theta), in.measured.grid);
    for (std::size_t n = 0; n < map.size(); ++n)
      if (std::isfinite(out.youngs_modulus[n])) out.youngs_modulus[n] = static_cast<float>(scale) * map[n];
    normalise(out);
    const ModulusPosterior posterior = problem.posterior(best, out.absolute);
    out.log_deviation =
        model.on_image({posterior.deviation.begin(), posterior.deviation.end()}, in.measured.grid);
    out.correlation_m = posterior.correlation_m;
  }

  std::shared_ptr<StripCache> strips_;
  std::unique_ptr<ModulusMethod> direct_;
};

}  // namespace

std::unique_ptr<ModulusMethod> make_iterative(Queue queue, std::shared_ptr<StripCache> strips) {
  return std::make_unique<Iterative>(std::move(queue), std::move(strips));
}

}  // namespace teletact::service
